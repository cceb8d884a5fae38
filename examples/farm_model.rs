//! How long a shot takes on a farm, by number of machines, frames of a task and codec, and which chunk and codec to take.
//!
//! `cargo run --release --example farm_model -- [NAME=VALUE]...`
//!
//! Values, with their units, are the fields of [`Farm`] and [`Shot`]: `frames`, `cores`, `bandwidth` and `link` in bytes a second, `start`, `decide` and
//! `requeue` in seconds, `failures` as a share of tasks. `check=FILE` compares predictions with the wall times of a real SLURM instead, which
//! `tests/slurm/run THINLENS FILE` measures.
//!
//! A machine runs one task at a time. A task starts, then reads, blurs and writes its frames; reading and writing of neighbouring frames go on
//! while one is blurred. Those who read or write at a moment share the storage's bandwidth equally. A task that fails is ended after half of
//! its frames and queued again; its finished frames are kept. Nothing is random.

#![expect(clippy::print_stdout, reason = "the table is the result")]

use std::collections::VecDeque;
use std::path::Path;
use thinlens::error::Error;

/// Pixels of the frame that [`CODECS`] was measured on.
const MEASURED: &str = "1920×1080, 4 peels, half colour and float depth, 64 lens samples";

/// Processor seconds of a frame without its codec: analysis and blur.
const BLUR_CPU_SECONDS: f64 = 0.90;

/// What a larger chunk or another codec must save to be worth it: a small chunk loses less when a machine fails.
const WORTH: f64 = 0.02;

/// What a codec costs: bytes of a stack and of its picture, processor seconds to decode the one and to encode the other.
struct Codec {
    name: &'static str,
    read_bytes: f64,
    write_bytes: f64,
    decode_cpu_seconds: f64,
    encode_cpu_seconds: f64,
}

/// Measured with `thinlens render STACK --codec NAME --report FILE` on copies of one stack by codec: medians of three, processor seconds by stage.
/// First come those that lose nothing and cost least; `pxr24` rounds depth to 24 bits, by up to 8 millionths of it.
const CODECS: [Codec; 6] = [
    codec("zip", [25.27e6, 5.84e6], [0.376, 0.319]),
    codec("zips", [25.36e6, 6.26e6], [0.365, 0.270]),
    codec("none", [99.55e6, 16.61e6], [0.203, 0.036]),
    codec("rle", [53.65e6, 8.61e6], [0.248, 0.067]),
    codec("piz", [30.71e6, 5.97e6], [0.861, 0.123]),
    codec("pxr24", [17.14e6, 5.71e6], [0.382, 0.277]),
];

/// Index of the default codec in [`CODECS`].
const ZIP: usize = 0;

const fn codec(name: &'static str, bytes: [f64; 2], cpu_seconds: [f64; 2]) -> Codec {
    Codec {
        name,
        read_bytes: bytes[0],
        write_bytes: bytes[1],
        decode_cpu_seconds: cpu_seconds[0],
        encode_cpu_seconds: cpu_seconds[1],
    }
}

/// Machines and storage.
#[derive(Clone)]
struct Farm {
    machines: usize,
    /// Cores of a machine; a frame's processor seconds divide by them.
    cores: f64,
    /// Bytes a second of the shared storage, for all machines together.
    bandwidth: f64,
    /// Bytes a second between one machine and the storage.
    link: f64,
    /// Seconds from the end of one task to the first read of the next: the scheduler and the program's start.
    start: f64,
    /// Seconds until a task that failed can begin again.
    requeue: f64,
}

/// What is to be rendered.
#[derive(Clone)]
struct Shot {
    frames: usize,
    /// Frames of a task.
    chunk: usize,
    cpu_seconds: f64,
    read_bytes: f64,
    write_bytes: f64,
    /// Seconds of the step before the chunks, its own start included.
    decide: f64,
    /// Share of tasks that fail once.
    failures: f64,
}

/// Frames that one machine renders in one go.
#[derive(Clone, Copy, Default)]
struct Task {
    frames: usize,
    /// The task is ended when so many of its frames are written.
    ends_after: Option<usize>,
    /// Seconds before which it cannot begin.
    not_before: f64,
}

/// What a machine reads or writes.
#[derive(Clone, Copy, PartialEq)]
enum Transfer {
    Read,
    Write,
}

/// A machine at work on a task. Frames are counted; which ones they are does not matter.
#[derive(Default)]
struct Worker {
    task: Option<Task>,
    /// Until when the task starts.
    starts_until: Option<f64>,
    to_read: usize,
    /// Frames that are read and wait to be blurred.
    ready: usize,
    /// When the frame that is blurred is done.
    blurred_at: Option<f64>,
    /// Frames that are blurred and wait to be written.
    to_write: usize,
    transfer: Option<(Transfer, f64)>,
    written: usize,
}

impl Worker {
    fn begin(&mut self, task: Task, starts_until: f64) {
        *self = Self {
            task: Some(task),
            starts_until: Some(starts_until),
            to_read: task.frames,
            ..Self::default()
        };
    }

    /// Begins what can begin at `now`: one transfer and one blur at a time, and one frame read ahead.
    fn proceed(&mut self, now: f64, shot: &Shot, blur_seconds: f64) {
        if self.starts_until.is_some() {
            return;
        }
        if self.blurred_at.is_none() && self.ready > 0 {
            self.ready -= 1;
            self.blurred_at = Some(now + blur_seconds);
        }
        if self.transfer.is_none() && self.to_write > 0 {
            self.to_write -= 1;
            self.transfer = Some((Transfer::Write, shot.write_bytes));
        } else if self.transfer.is_none() && self.to_read > 0 && self.ready == 0 {
            self.to_read -= 1;
            self.transfer = Some((Transfer::Read, shot.read_bytes));
        }
    }

    /// Seconds until something of it ends, at `rate` bytes a second.
    fn next(&self, now: f64, rate: f64) -> f64 {
        let transferred = self.transfer.map(|(_, bytes)| bytes / rate);
        let ends = [self.starts_until.map(|at| at - now), self.blurred_at.map(|at| at - now), transferred];
        ends.into_iter().flatten().fold(f64::INFINITY, f64::min).max(0.0)
    }

    /// Lets `step` seconds pass, which end at `now`.
    fn pass(&mut self, step: f64, now: f64, rate: f64) {
        if self.starts_until.is_some_and(|at| at <= now) {
            self.starts_until = None;
        }
        if self.blurred_at.is_some_and(|at| at <= now) {
            self.blurred_at = None;
            self.to_write += 1;
        }
        if let Some((kind, bytes)) = self.transfer {
            // What would take less than a nanosecond has ended: sums of steps are rounded.
            self.transfer = (bytes / rate > step + 1e-9).then_some((kind, bytes - rate * step));
            match (self.transfer, kind) {
                (None, Transfer::Read) => self.ready += 1,
                (None, Transfer::Write) => self.written += 1,
                _ => {}
            }
        }
    }

    /// Takes the task away if it has ended; what is left of it is a task of its own.
    fn finish(&mut self, now: f64, requeue: f64) -> Option<Task> {
        let ends = |task: &Task| {
            self.starts_until.is_none() && self.written >= task.ends_after.unwrap_or(task.frames)
        };
        let task = self.task.filter(ends)?;
        let rest = Task { frames: task.frames - self.written, ends_after: None, not_before: now + requeue };
        *self = Self::default();
        Some(rest)
    }
}

/// The tasks of `shot`. Of those that fail each is followed by as many that do not, so that they are spread evenly.
fn tasks(shot: &Shot) -> VecDeque<Task> {
    let count = shot.frames.div_ceil(shot.chunk);
    let task = |index: usize| {
        let frames = shot.chunk.min(shot.frames - index * shot.chunk);
        let before = (index as f64 * shot.failures).floor();
        let fails = ((index + 1) as f64 * shot.failures).floor() > before;
        Task { frames, ends_after: fails.then_some(frames / 2), not_before: shot.decide }
    };
    (0..count).map(task).collect()
}

/// What a simulation found.
struct Outcome {
    wall_seconds: f64,
    /// Frames that were written.
    frames: usize,
}

/// Renders `shot` on `farm`, event by event.
fn simulate(farm: &Farm, shot: &Shot) -> Outcome {
    let mut queue = tasks(shot);
    let mut workers: Vec<Worker> = (0..farm.machines).map(|_| Worker::default()).collect();
    let (mut now, mut frames) = (shot.decide, 0);
    loop {
        for worker in workers.iter_mut().filter(|worker| worker.task.is_none()) {
            let Some(task) = queue.pop_front() else { break };
            worker.begin(task, now.max(task.not_before) + farm.start);
        }
        workers.iter_mut().for_each(|worker| worker.proceed(now, shot, shot.cpu_seconds / farm.cores));
        let active = workers.iter().filter(|worker| worker.transfer.is_some()).count();
        let rate = farm.link.min(farm.bandwidth / active.max(1) as f64);
        let step = workers.iter().map(|worker| worker.next(now, rate)).fold(f64::INFINITY, f64::min);
        if step.is_infinite() {
            return Outcome { wall_seconds: now, frames };
        }
        now += step;
        for worker in &mut workers {
            let written = worker.written;
            worker.pass(step, now, rate);
            frames += worker.written - written;
            queue.extend(worker.finish(now, farm.requeue).filter(|rest| rest.frames > 0));
        }
    }
}

fn shot_of(codec: &Codec, shot: &Shot) -> Shot {
    Shot {
        cpu_seconds: BLUR_CPU_SECONDS + codec.decode_cpu_seconds + codec.encode_cpu_seconds,
        read_bytes: codec.read_bytes,
        write_bytes: codec.write_bytes,
        ..shot.clone()
    }
}

const MACHINES: [usize; 7] = [1, 4, 16, 32, 64, 128, 256];
const CHUNKS: [usize; 6] = [1, 5, 10, 20, 50, 100];
/// Frames of a task where codecs are compared.
const CHUNK: usize = 20;

/// The first of `choices` that takes at most [`WORTH`] longer than the best.
fn recommended(choices: &[f64]) -> usize {
    let best = choices.iter().copied().fold(f64::INFINITY, f64::min);
    choices.iter().position(|&seconds| seconds <= best * (1.0 + WORTH)).unwrap_or(0)
}

/// Wall minutes by machines and chunk, then by machines and codec, with what to take.
fn print_tables(farm: &Farm, shot: &Shot) {
    println!("{} frames of {MEASURED}", shot.frames);
    println!(
        "machines with {} cores, storage {:.2} GB/s for all and {:.2} GB/s for one, {} s from task to task, {} % of tasks fail once",
        farm.cores,
        farm.bandwidth / 1e9,
        farm.link / 1e9,
        farm.start,
        100.0 * shot.failures
    );
    let outcome = |machines: usize, chunk: usize, codec: &Codec| {
        simulate(&Farm { machines, ..farm.clone() }, &Shot { chunk, ..shot_of(codec, shot) })
    };
    let zip = &CODECS[ZIP];
    let header: String = CHUNKS.iter().map(|chunk| format!("{chunk:>9}")).collect();
    println!("\nwall minutes by frames of a task, {}\nmachines{header}   take", zip.name);
    for machines in MACHINES {
        let walls = CHUNKS.map(|chunk| outcome(machines, chunk, zip).wall_seconds);
        println!("{machines:>8}{} {:>6}", minutes(&walls), CHUNKS[recommended(&walls)]);
    }
    let header: String = CODECS.iter().map(|codec| format!("{:>9}", codec.name)).collect();
    println!("\nwall minutes by codec, {CHUNK} frames a task\nmachines{header}   take    frames/s");
    for machines in MACHINES {
        let walls = CODECS.each_ref().map(|codec| outcome(machines, CHUNK, codec).wall_seconds);
        let codec = &CODECS[recommended(&walls)];
        let Outcome { wall_seconds, frames } = outcome(machines, CHUNK, codec);
        println!("{machines:>8}{}   {:<8}{:>8.1}", minutes(&walls), codec.name, frames as f64 / wall_seconds);
    }
}

fn minutes(walls: &[f64]) -> String {
    walls.iter().map(|wall| format!("{:>9.1}", wall / 60.0)).collect()
}

/// A wall time of `tests/slurm/run`.
struct Measured {
    chunk: usize,
    workers: usize,
    seconds: f64,
}

/// The seconds of one frame without a farm, and the wall times, of a file of `tests/slurm/run`.
fn read_measured(file: &Path) -> Result<(f64, Vec<Measured>), Error> {
    let bad = || Error::settings("not a file of `tests/slurm/run`").in_file(file);
    let text = std::fs::read_to_string(file).map_err(|cause| bad().caused_by(cause))?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| bad());
    let mut rows = Vec::new();
    let mut frame = None;
    for line in text.lines().skip(1) {
        match line.split(',').collect::<Vec<_>>().as_slice() {
            ["frame", _, seconds] => frame = Some(number(seconds)?),
            [chunk, workers, seconds] => rows.push(Measured {
                chunk: number(chunk)? as usize,
                workers: number(workers)? as usize,
                seconds: number(seconds)?,
            }),
            _ => return Err(bad()),
        }
    }
    Ok((frame.ok_or_else(bad)?, rows))
}

/// Compares predictions with what SLURM did with 24 frames. Two of the times, with one worker, say what a task's start and the decision cost; the
/// others are predicted.
fn check(file: &Path) -> Result<(), Error> {
    const FRAMES: usize = 24;
    let (frame_seconds, rows) = read_measured(file)?;
    let one_worker = |chunk: usize| rows.iter().find(|row| row.workers == 1 && row.chunk == chunk);
    let (Some(single), Some(six)) = (one_worker(1), one_worker(6)) else {
        return Err(Error::settings("the wall times of one worker with chunks of 1 and of 6 are missing")
            .in_file(file));
    };
    let start = (single.seconds - six.seconds) / (FRAMES - FRAMES / 6) as f64;
    let decide = six.seconds - FRAMES as f64 * frame_seconds - (FRAMES / 6) as f64 * start;
    println!("a frame {frame_seconds:.2} s, a task's start {start:.2} s, the decision {decide:.2} s");
    println!("chunk workers measured predicted error");
    for Measured { chunk, workers, seconds } in rows {
        let farm = Farm { machines: workers, cores: 1.0, start, ..unlimited() };
        let shot = Shot { frames: FRAMES, chunk, cpu_seconds: frame_seconds, decide, ..instant() };
        let predicted = simulate(&farm, &shot).wall_seconds;
        let note = if workers == 1 && (chunk == 1 || chunk == 6) { "  fitted" } else { "" };
        let error = 100.0 * (predicted / seconds - 1.0);
        println!("{chunk:>5} {workers:>7} {seconds:>7.1}s {predicted:>8.1}s {error:>4.0}%{note}");
    }
    Ok(())
}

/// One machine with one core; storage and scheduler take no time.
fn unlimited() -> Farm {
    Farm { machines: 1, cores: 1.0, bandwidth: f64::INFINITY, link: f64::INFINITY, start: 0.0, requeue: 0.0 }
}

/// One frame that takes no time.
fn instant() -> Shot {
    Shot {
        frames: 1,
        chunk: 1,
        cpu_seconds: 0.0,
        read_bytes: 0.0,
        write_bytes: 0.0,
        decide: 0.0,
        failures: 0.0,
    }
}

fn main() -> Result<(), Error> {
    // A file server with 10 Gbit/s links, and a scheduler that starts a task in 2 s.
    let mut farm =
        Farm { cores: 16.0, bandwidth: 1.25e9, link: 1.25e9, start: 2.0, requeue: 60.0, ..unlimited() };
    let mut shot = Shot { frames: 10_000, decide: 10.0, ..instant() };
    for argument in std::env::args().skip(1) {
        let (name, text) = argument.split_once('=').unwrap_or((&argument, ""));
        if name == "check" {
            return check(Path::new(text));
        }
        let value: f64 = text.parse().ok().filter(|value| *value >= 0.0).ok_or_else(|| unknown(&argument))?;
        match name {
            "frames" => shot.frames = value as usize,
            "cores" if value > 0.0 => farm.cores = value,
            "bandwidth" if value > 0.0 => farm.bandwidth = value,
            "link" if value > 0.0 => farm.link = value,
            "start" => farm.start = value,
            "requeue" => farm.requeue = value,
            "decide" => shot.decide = value,
            "failures" if value <= 1.0 => shot.failures = value,
            _ => return Err(unknown(&argument)),
        }
    }
    print_tables(&farm, &shot);
    Ok(())
}

fn unknown(argument: &str) -> Error {
    let names = "frames, cores, bandwidth, link, start, requeue, decide, failures or check, with a value";
    Error::settings("an argument cannot be used")
        .with("found", argument.to_owned())
        .with("expected", names.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall(farm: &Farm, shot: &Shot) -> f64 {
        let outcome = simulate(farm, shot);
        assert_eq!(outcome.frames, shot.frames, "every frame is written once");
        outcome.wall_seconds
    }

    fn is_close(found: f64, expected: f64, tolerance: f64) -> bool {
        (found / expected - 1.0).abs() <= tolerance
    }

    #[test]
    fn without_storage_and_start_n_machines_take_an_nth() {
        let shot = Shot { frames: 960, chunk: 5, cpu_seconds: 1.5, ..instant() };
        for machines in [1, 2, 4, 16, 64] {
            let farm = Farm { machines, cores: 2.0, ..unlimited() };
            let expected = 960.0 * 1.5 / 2.0 / machines as f64;
            assert!(is_close(wall(&farm, &shot), expected, 1e-9), "{machines}: {}", wall(&farm, &shot));
        }
    }

    #[test]
    fn where_storage_is_the_limit_more_machines_change_nothing() {
        let shot = Shot {
            frames: 2000,
            chunk: 10,
            cpu_seconds: 0.1,
            read_bytes: 30e6,
            write_bytes: 10e6,
            ..instant()
        };
        for machines in [20, 40, 100] {
            let farm = Farm { machines, bandwidth: 100e6, ..unlimited() };
            assert!(is_close(wall(&farm, &shot), 2000.0 * 40e6 / 100e6, 0.01), "{}", wall(&farm, &shot));
        }
    }

    #[test]
    fn reading_and_writing_go_on_while_a_frame_is_blurred() {
        let farm = Farm { link: 100e6, ..unlimited() };
        let shot = Shot { frames: 1000, chunk: 1000, read_bytes: 30e6, write_bytes: 10e6, ..instant() };
        for (cpu_seconds, frame_seconds) in [(1.0, 1.0), (0.1, 0.4)] {
            let found = wall(&farm, &Shot { cpu_seconds, ..shot.clone() });
            assert!(is_close(found, 1000.0 * frame_seconds, 0.01), "{cpu_seconds}: {found}");
        }
    }

    #[test]
    fn each_task_starts_once_and_none_before_the_decision() {
        let farm = Farm { machines: 4, start: 3.0, ..unlimited() };
        let shot = Shot { frames: 120, chunk: 10, cpu_seconds: 1.0, decide: 7.0, ..instant() };
        assert!(is_close(wall(&farm, &shot), 7.0 + 3.0 * (3.0 + 10.0), 1e-9));
    }

    #[test]
    fn what_a_failed_task_finished_is_kept_and_the_rest_is_done_again() {
        let farm = Farm { requeue: 5.0, ..unlimited() };
        let shot = Shot { frames: 40, chunk: 20, cpu_seconds: 1.0, failures: 1.0, ..instant() };
        // Both tasks end with 10 frames written. The 11th frame, which the end interrupts, costs nothing yet.
        assert!(is_close(wall(&farm, &shot), 40.0, 1e-9), "{}", wall(&farm, &shot));
    }

    #[test]
    fn the_smallest_chunk_that_is_nearly_the_best_is_recommended() {
        assert_eq!(recommended(&[2.0, 1.01, 1.0, 1.5]), 1);
    }
}
