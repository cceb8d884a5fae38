//! Many frames at once: a frame is read while others are blurred and written.
//!
//! Frames are tasks of the caller's thread pool. Each of them is parallel in itself; where it is not, threads work on another frame. A frame
//! starts when the memory that it is expected to take fits beside that of the frames in flight, and always when there is none in flight.
//! Frames start in the order given, and may end in another.

use crate::error::Error;
use rayon::Scope;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often frames that are not ready are looked at again.
const POLL: Duration = Duration::from_millis(250);

/// What limits the frames in flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Memory of all frames in flight in bytes.
    pub memory_bytes: u64,
    /// Number of frames in flight, at least 1.
    pub frames: usize,
    /// Whether no frame starts after one has failed.
    pub fail_fast: bool,
}

/// What a frame needs before it starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readiness {
    /// It can start, and takes this much memory in bytes.
    Ready(u64),
    /// Its input is not complete; it is asked for again later.
    Waiting,
}

/// The work of a run, by frame.
pub trait Work: Sync {
    /// A frame.
    type Frame: Send;
    /// What is known of a frame that was rendered.
    type Done;

    /// Whether `frame` can start. Called for one frame at a time, before [`Self::render`].
    fn readiness(&self, frame: &Self::Frame) -> Readiness;

    /// Renders `frame`, from files to files.
    ///
    /// # Errors
    /// Those of the frame, which stop no other.
    fn render(&self, frame: &Self::Frame) -> Result<Self::Done, Error>;

    /// Takes note of the end of `frame`. Called by one thread at a time, which does no parallel work in it.
    fn ended(&self, frame: Self::Frame, result: Result<Self::Done, Error>);
}

/// Renders `frames` with `work`; returns those that did not start, because another failed and the run should then stop.
///
/// A panic in a frame is an error of that frame.
pub fn run<W: Work>(frames: Vec<W::Frame>, limits: Limits, work: &W) -> Vec<W::Frame> {
    let queue = Queue { work, limits, state: Mutex::new(State::new(frames)), ending: Mutex::new(()) };
    rayon::scope(|scope| {
        queue.start_or_wait(scope);
    });
    let state = queue.state.into_inner().unwrap_or_else(PoisonError::into_inner);
    state.waiting.into()
}

/// The frames of a run that have not ended.
struct Queue<'w, W: Work> {
    work: &'w W,
    limits: Limits,
    state: Mutex<State<W::Frame>>,
    /// Held while a frame's end is noted.
    ending: Mutex<()>,
}

struct State<F> {
    /// Frames that have not started, in order.
    waiting: VecDeque<F>,
    frames_in_flight: usize,
    bytes_in_flight: u64,
    stopped: bool,
}

impl<F> State<F> {
    fn new(frames: Vec<F>) -> Self {
        Self { waiting: frames.into(), frames_in_flight: 0, bytes_in_flight: 0, stopped: false }
    }
}

impl<W: Work> Queue<'_, W> {
    fn state(&self) -> MutexGuard<'_, State<W::Frame>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts the frames that have room. If none is in flight then, waits for one that is ready: nothing else would start it.
    fn start_or_wait<'scope>(&'scope self, scope: &Scope<'scope>) {
        self.start(scope);
        while self.is_idle() {
            std::thread::sleep(POLL);
            self.start(scope);
        }
    }

    /// Whether there are frames to start, and none is in flight.
    fn is_idle(&self) -> bool {
        let state = self.state();
        !state.stopped && !state.waiting.is_empty() && state.frames_in_flight == 0
    }

    /// Starts the frames that have room.
    fn start<'scope>(&'scope self, scope: &Scope<'scope>) {
        let mut state = self.state();
        let mut place = 0;
        while !state.stopped && state.frames_in_flight < self.limits.frames && place < state.waiting.len() {
            let Readiness::Ready(bytes) = self.work.readiness(&state.waiting[place]) else {
                place += 1;
                continue;
            };
            let has_room = bytes.saturating_add(state.bytes_in_flight) <= self.limits.memory_bytes;
            if state.frames_in_flight > 0 && !has_room {
                return;
            }
            let Some(frame) = state.waiting.remove(place) else { return };
            state.frames_in_flight += 1;
            state.bytes_in_flight += bytes;
            scope.spawn(move |scope| self.carry_out(scope, frame, bytes));
        }
    }

    /// Renders `frame`, and starts what then has room. Frames that were not ready are asked again at the end of each frame.
    fn carry_out<'scope>(&'scope self, scope: &Scope<'scope>, frame: W::Frame, bytes: u64) {
        let result = catch_unwind(AssertUnwindSafe(|| self.work.render(&frame)))
            .unwrap_or_else(|panic| Err(panicked(panic.as_ref())));
        let failed = result.is_err();
        {
            let _one_at_a_time = self.ending.lock().unwrap_or_else(PoisonError::into_inner);
            self.work.ended(frame, result);
        }
        {
            let mut state = self.state();
            state.frames_in_flight -= 1;
            state.bytes_in_flight -= bytes;
            state.stopped |= failed && self.limits.fail_fast;
        }
        self.start_or_wait(scope);
    }
}

/// The error of a frame that panicked: a fault of the program.
fn panicked(panic: &(dyn std::any::Any + Send)) -> Error {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    Error::unsupported("the program failed in this frame")
        .with("found", text.unwrap_or_else(|| "a panic without a message".to_owned()))
        .help("this is a fault of thinlens: please report it with the frame")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Frames of `bytes` each; number `fails` fails, `panics` panics, and `late` is ready when five others have ended.
    #[derive(Default)]
    struct Fake {
        bytes: u64,
        fails: Option<usize>,
        panics: Option<usize>,
        late: Option<usize>,
        in_flight: AtomicU64,
        most_in_flight: AtomicU64,
        ended: Mutex<Vec<(usize, bool)>>,
    }

    impl Work for Fake {
        type Frame = usize;
        type Done = ();

        fn readiness(&self, frame: &usize) -> Readiness {
            if self.late == Some(*frame) && self.ended.lock().unwrap().len() < 5 {
                return Readiness::Waiting;
            }
            Readiness::Ready(self.bytes)
        }

        fn render(&self, frame: &usize) -> Result<(), Error> {
            let now = self.in_flight.fetch_add(1, Ordering::SeqCst) + 1;
            self.most_in_flight.fetch_max(now, Ordering::SeqCst);
            std::thread::sleep(Duration::from_millis(2));
            self.in_flight.fetch_sub(1, Ordering::SeqCst);
            assert_ne!(self.panics, Some(*frame), "a panic on purpose");
            if self.fails == Some(*frame) { Err(Error::input("bad")) } else { Ok(()) }
        }

        fn ended(&self, frame: usize, result: Result<(), Error>) {
            self.ended.lock().unwrap().push((frame, result.is_ok()));
        }
    }

    fn limits(memory_bytes: u64, frames: usize) -> Limits {
        Limits { memory_bytes, frames, fail_fast: false }
    }

    /// Runs `count` frames on four threads; returns the frames that did not start, and those that ended, in order of number.
    fn run_all(fake: &Fake, count: usize, limits: Limits) -> (Vec<usize>, Vec<(usize, bool)>) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let left = pool.install(|| run((0..count).collect(), limits, fake));
        let mut ended = fake.ended.lock().unwrap().clone();
        ended.sort_unstable();
        (left, ended)
    }

    #[test]
    fn every_frame_is_rendered_once() {
        for frames in [1, 2, 7] {
            let (left, ended) = run_all(&Fake::default(), 40, limits(u64::MAX, frames));
            assert_eq!((left.len(), ended), (0, (0..40).map(|frame| (frame, true)).collect()));
        }
        assert_eq!(run_all(&Fake::default(), 0, limits(0, 1)), (Vec::new(), Vec::new()));
    }

    #[test]
    fn frames_in_flight_stay_within_memory_and_number() {
        let most = |bytes, limits| {
            let fake = Fake { bytes, ..Fake::default() };
            run_all(&fake, 30, limits);
            fake.most_in_flight.into_inner()
        };
        assert!(most(10, limits(30, 100)) <= 3, "three of 10 bytes fit into 30");
        assert!(most(10, limits(1000, 2)) <= 2);
        assert_eq!(most(10, limits(5, 100)), 1, "a frame that does not fit is alone");
        assert!(most(u64::MAX, limits(u64::MAX, 4)) <= 4, "no overflow");
    }

    #[test]
    fn a_frame_that_fails_or_panics_stops_no_other() {
        let fake = Fake { fails: Some(3), panics: Some(5), ..Fake::default() };
        let (left, ended) = run_all(&fake, 12, limits(u64::MAX, 3));
        let expected: Vec<_> = (0..12).map(|frame| (frame, frame != 3 && frame != 5)).collect();
        assert_eq!((left.len(), ended), (0, expected));
    }

    #[test]
    fn no_frame_starts_after_a_failure_where_the_run_should_stop() {
        let fake = Fake { fails: Some(3), ..Fake::default() };
        let (left, ended) = run_all(&fake, 12, Limits { fail_fast: true, ..limits(u64::MAX, 1) });
        assert_eq!(left, (4..12).collect::<Vec<_>>());
        assert_eq!(ended.len(), 4);
    }

    #[test]
    fn a_frame_that_is_not_ready_is_waited_for_and_holds_up_no_other() {
        let fake = Fake { late: Some(0), ..Fake::default() };
        let (left, ended) = run_all(&fake, 6, limits(u64::MAX, 1));
        assert_eq!((left.len(), ended.len()), (0, 6));
        assert_eq!(fake.ended.into_inner().unwrap().last(), Some(&(0, true)), "it comes last");
    }

    #[test]
    fn a_run_inside_of_another_pool_ends() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let fake = Fake { late: Some(2), ..Fake::default() };
        let left = pool.install(|| run((0..6).collect(), limits(u64::MAX, 3), &fake));
        assert!(left.is_empty());
    }
}
