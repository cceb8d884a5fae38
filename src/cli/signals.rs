//! Signals that end the program: it removes its temporary files first, and its exit code is 128 + the signal's number.
//!
//! They are handled by a thread of their own. Elsewhere than on Unix nothing is handled; the next run removes what is left.

use std::io;
use std::path::PathBuf;

#[cfg(not(unix))]
pub(super) use elsewhere::Signals;
#[cfg(unix)]
pub(super) use unix::Signals;

#[cfg(unix)]
mod unix {
    use super::{PathBuf, io};
    use nix::sys::resource::{Resource, getrlimit, setrlimit};
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::flag;
    use signal_hook::iterator::Signals as Received;
    use signal_hook::low_level;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread;
    use thinlens::output::temporary;

    /// The signals of this process are handled.
    #[derive(Debug)]
    pub(in super::super) struct Signals {
        ending: Arc<AtomicBool>,
    }

    impl Signals {
        /// Handles signals from now on, for a program that writes into `folders`.
        ///
        /// # Errors
        /// The system has no thread or no descriptor left.
        pub(in super::super) fn handle(folders: Vec<PathBuf>) -> io::Result<Self> {
            let ending = Arc::new(AtomicBool::new(false));
            let handled = handled();
            // Before the flags: who waits because of one is sure of the thread.
            let mut received = Received::new(&handled)?;
            for &signal in &handled {
                flag::register(signal, Arc::clone(&ending))?;
            }
            thread::Builder::new().name("signals".to_owned()).spawn(move || {
                if let Some(signal) = received.forever().next() {
                    temporary::remove_own(&folders, stop_opening_files);
                    low_level::exit(128 + signal);
                }
            })?;
            // A handler that does nothing: a write beyond the limit then returns an error instead of ending the program.
            flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
            Ok(Self { ending })
        }

        /// Waits for the end if a signal asks for it, so that a write that fails for lack of its file is not told as a failure.
        pub(in super::super) fn wait_if_ending(&self) {
            while self.ending.load(Ordering::SeqCst) {
                thread::park();
            }
        }
    }

    /// The signals that end the program, without those that it was started to ignore, as by `nohup`.
    fn handled() -> Vec<i32> {
        let ignored = ignored();
        let is_ignored = |signal: i32| match ignored {
            Some(mask) => mask >> (signal - 1) & 1 != 0,
            // Not known: what nohup sets must stay.
            None => signal == SIGHUP,
        };
        [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|&signal| !is_ignored(signal)).collect()
    }

    /// The signals that this process ignores, one bit each from the lowest; `None` where the system does not say.
    fn ignored() -> Option<u64> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
        u64::from_str_radix(mask.trim(), 16).ok()
    }

    /// No thread opens a file any more.
    fn stop_opening_files() {
        if let Ok((_, most)) = getrlimit(Resource::RLIMIT_NOFILE) {
            // Where the limit cannot be set, a file that is being created just now is left for the next run.
            let _ = setrlimit(Resource::RLIMIT_NOFILE, 0, most);
        }
    }
}

#[cfg(not(unix))]
mod elsewhere {
    use super::{PathBuf, io};

    /// Nothing is handled.
    #[derive(Debug)]
    pub(in super::super) struct Signals;

    impl Signals {
        /// Does nothing.
        ///
        /// # Errors
        /// None.
        pub(in super::super) fn handle(_folders: Vec<PathBuf>) -> io::Result<Self> {
            Ok(Self)
        }

        /// Does nothing.
        pub(in super::super) fn wait_if_ending(&self) {}
    }
}
