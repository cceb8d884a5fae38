//! What is left of a run that is ended from outside: the old file or the new one, whole, and nothing else after the next run.

#![cfg(unix)]

use super::program::{STACK, names, run, stderr, thinlens};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use thinlens::stack::{Source, is_complete};

/// A render that takes some tens of milliseconds.
const RENDER: [&str; 12] = [
    "render", STACK, "-o", "out.exr", "--device", "cpu", "--preset", "portrait", "--focus", "6", "--views",
    "64",
];

/// When a signal is sent.
#[derive(Debug, Clone, Copy)]
enum Moment {
    /// This long after the start.
    After(Duration),
    /// As soon as a temporary file is seen, but not that of the check before the work.
    WhileWriting,
}

/// Moments from the start of a render to its end.
fn moments() -> impl Iterator<Item = Moment> {
    let after = [20, 40, 80, 160].into_iter().map(|ms| Moment::After(Duration::from_millis(ms)));
    after.chain([Moment::WhileWriting])
}

fn start(folder: &Path) -> Child {
    thinlens(folder, &RENDER).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

fn has_temporary(folder: &Path) -> bool {
    fs::read_dir(folder).unwrap().flatten().any(|entry| entry.file_name().to_string_lossy().ends_with(".tmp"))
}

/// Sends `signal` to `child`, which works in `folder`, at the `moment`, unless it has ended by then; returns how it ended.
fn end(mut child: Child, signal: Signal, moment: Moment, folder: &Path) -> ExitStatus {
    match moment {
        Moment::After(time) => thread::sleep(time),
        Moment::WhileWriting => {
            let started = Instant::now();
            let working = Duration::from_millis(30);
            while child.try_wait().unwrap().is_none()
                && (started.elapsed() < working || !has_temporary(folder))
            {}
        }
    }
    // An ended child is not waited for yet, so its number is not another process's.
    let _ = kill(Pid::from_raw(i32::try_from(child.id()).unwrap()), signal);
    child.wait().unwrap()
}

/// Asserts that `out.exr` in `folder` is `old` or a whole picture.
fn assert_old_or_new(folder: &Path, old: &[u8], when: &str) {
    let out = folder.join("out.exr");
    let is_old = fs::read(&out).unwrap() == old;
    assert!(is_old || is_complete(&Source::file(&out)).unwrap(), "{when}");
}

#[test]
fn a_signal_leaves_no_temporary_file_and_the_exit_code_names_it() {
    for (signal, code) in [(Signal::SIGINT, 130), (Signal::SIGTERM, 143), (Signal::SIGHUP, 129)] {
        for moment in moments() {
            let folder = tempfile::tempdir().unwrap();
            fs::write(folder.path().join("out.exr"), "old").unwrap();
            let status = end(start(folder.path()), signal, moment, folder.path());
            let when = format!("{signal} {moment:?}: {status}");
            // On a slow machine a signal may come before the program runs, on a fast one after it has ended.
            let ended =
                [Some(code), Some(0)].contains(&status.code()) || status.signal() == Some(signal as i32);
            assert!(ended, "{when}");
            assert_eq!(names(folder.path()), ["out.exr"], "{when}");
            assert_old_or_new(folder.path(), b"old", &when);
        }
    }
}

#[test]
fn what_a_killed_run_leaves_is_removed_by_the_next_run() {
    for moment in moments() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("out.exr"), "old").unwrap();
        let status = end(start(folder.path()), Signal::SIGKILL, moment, folder.path());
        assert_old_or_new(folder.path(), b"old", &format!("{moment:?}: {status}"));
        let next = run(folder.path(), &RENDER);
        assert_eq!(next.status.code(), Some(0), "{}", stderr(&next));
        assert_eq!(names(folder.path()), ["out.exr"], "{moment:?}");
        assert!(is_complete(&Source::file(folder.path().join("out.exr"))).unwrap());
    }
}

#[test]
fn a_run_says_what_it_removed() {
    let folder = tempfile::tempdir().unwrap();
    let host = nix::unistd::gethostname().unwrap().into_string().unwrap();
    let mut ended = Command::new("true").spawn().unwrap();
    ended.wait().unwrap();
    fs::write(folder.path().join(format!(".thinlens-{host}-{}-abcdef.tmp", ended.id())), "half").unwrap();
    let output = run(folder.path(), &RENDER);
    assert!(stderr(&output).contains("removed 1 temporary file"), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["out.exr"]);
}

/// Runs a render from a shell that executes `before` first.
fn after_shell(folder: &Path, before: &str) -> Command {
    let program = thinlens(folder, &RENDER);
    let words = std::iter::once(program.get_program()).chain(program.get_args());
    let mut shell = Command::new("sh");
    shell.current_dir(folder).args(["-c", &format!("{before}; exec \"$@\""), "sh"]).args(words);
    shell.stdin(Stdio::null()).stderr(Stdio::piped());
    shell
}

#[test]
fn a_hangup_that_nohup_ignores_stays_ignored() {
    if !Path::new("/proc/self/status").exists() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let child = after_shell(folder.path(), "trap '' HUP").spawn().unwrap();
    let status = end(child, Signal::SIGHUP, Moment::After(Duration::from_millis(30)), folder.path());
    assert_eq!(status.code(), Some(0));
    assert_eq!(names(folder.path()), ["out.exr"]);
}

#[test]
fn a_file_above_the_limit_of_the_shell_is_an_error_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let output = after_shell(folder.path(), "ulimit -f 8").output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    for words in ["larger than the system allows", "in: out.exr", "ulimit -f"] {
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn two_runs_with_one_output_both_succeed_and_leave_one_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut both = [start(folder.path()), start(folder.path())];
    for child in &mut both {
        assert_eq!(child.wait().unwrap().code(), Some(0));
    }
    assert_eq!(names(folder.path()), ["out.exr"]);
    assert!(is_complete(&Source::file(folder.path().join("out.exr"))).unwrap());
}
