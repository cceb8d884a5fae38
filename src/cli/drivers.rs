//! Graphics drivers are loaded while standard error is redirected.
//!
//! Mesa warns about a missing display, which this program does not need. Standard error belongs to the whole process: the library must not
//! redirect it, the program may.

use thinlens::error::Error;
use thinlens::gpu::{self, Gpu, Survey};
use thinlens::output::exr::Codec;
use thinlens::render::{self, Bands, Job, Prepared};

/// See [`render::prepare`].
///
/// # Errors
/// Those of preparing.
pub(super) fn prepare(job: &Job) -> Result<Prepared, Error> {
    render::prepare_with(job, &|software| without_noise(|| Gpu::open(software)))
}

/// See [`render::in_bands`].
///
/// # Errors
/// Those of preparing.
pub(super) fn in_bands(job: &Job, codec: Codec) -> Result<Option<Bands>, Error> {
    render::in_bands_with(job, codec, &|software| without_noise(|| Gpu::open(software)))
}

/// See [`gpu::survey`].
pub(super) fn survey() -> Survey {
    without_noise(gpu::survey)
}

/// Runs `load`. What is written to standard error meanwhile is printed afterwards, without the lines about a missing display.
#[cfg(unix)]
fn without_noise<T>(load: impl FnOnce() -> T) -> T {
    let _redirection = unix::Redirection::begin();
    load()
}

/// Runs `load`: drivers on other systems write nothing.
#[cfg(not(unix))]
fn without_noise<T>(load: impl FnOnce() -> T) -> T {
    load()
}

#[cfg(unix)]
mod unix {
    use std::fs::File;
    use std::io::{Read, Seek, Write, stderr};
    use std::os::fd::OwnedFd;
    use std::sync::{Mutex, MutexGuard, PoisonError};

    /// Lines that contain this are dropped: a driver found no display.
    const NOISE: &str = "XDG_RUNTIME_DIR";

    /// Held while standard error is redirected: frames that load drivers at the same time would restore one another's file.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

    /// Standard error, redirected into a file until this is dropped.
    pub(super) struct Redirection {
        stderr: OwnedFd,
        file: File,
        _alone: MutexGuard<'static, ()>,
    }

    impl Redirection {
        /// `None` if standard error cannot be redirected; it then stays as it is.
        pub(super) fn begin() -> Option<Self> {
            let alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
            let (stderr, file) = (nix::unistd::dup(stderr()).ok()?, tempfile::tempfile().ok()?);
            nix::unistd::dup2_stderr(&file).ok()?;
            Some(Self { stderr, file, _alone: alone })
        }
    }

    impl Drop for Redirection {
        fn drop(&mut self) {
            let mut text = Vec::new();
            let restored = nix::unistd::dup2_stderr(&self.stderr).is_ok();
            if restored && self.file.rewind().is_ok() && self.file.read_to_end(&mut text).is_ok() {
                let text = String::from_utf8_lossy(&text);
                for line in text.lines().filter(|line| !line.contains(NOISE)) {
                    // A closed standard error has no reader: its error is dropped.
                    let _ = writeln!(stderr(), "{line}");
                }
            }
        }
    }
}
