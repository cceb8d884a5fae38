//! Graphics drivers are looked for while standard error is led aside.
//!
//! Mesa complains that there is no screen, which nothing here needs. Standard error belongs to the whole process, so that no library may
//! lead it aside, but the program may.

use thinlens::error::Error;
use thinlens::gpu::{self, Gpu, Survey};
use thinlens::render::{self, Job, Prepared};

/// See [`render::prepare`].
///
/// # Errors
/// Those of preparing.
pub(super) fn prepare(job: &Job) -> Result<Prepared, Error> {
    render::prepare_with(job, &|software| without_noise(|| Gpu::open(software)))
}

/// See [`gpu::survey`].
pub(super) fn survey() -> Survey {
    without_noise(gpu::survey)
}

/// What `look` returns. What is written on standard error meanwhile comes out at its end, but for the lines about the screen.
#[cfg(unix)]
fn without_noise<T>(look: impl FnOnce() -> T) -> T {
    let _diversion = unix::Diversion::begin();
    look()
}

/// What `look` returns: drivers of other systems write nothing.
#[cfg(not(unix))]
fn without_noise<T>(look: impl FnOnce() -> T) -> T {
    look()
}

#[cfg(unix)]
mod unix {
    use std::fs::File;
    use std::io::{Read, Seek, Write, stderr};
    use std::os::fd::OwnedFd;

    /// Lines with this are not worth a user's attention: a driver looks for a screen.
    const NOISE: &str = "XDG_RUNTIME_DIR";

    /// Standard error, led into a file until this is dropped.
    pub(super) struct Diversion {
        stderr: OwnedFd,
        written: File,
    }

    impl Diversion {
        /// `None` where standard error cannot be led aside: then it stays as it is.
        pub(super) fn begin() -> Option<Self> {
            let (stderr, written) = (nix::unistd::dup(stderr()).ok()?, tempfile::tempfile().ok()?);
            nix::unistd::dup2_stderr(&written).ok()?;
            Some(Self { stderr, written })
        }
    }

    impl Drop for Diversion {
        fn drop(&mut self) {
            let mut text = Vec::new();
            let restored = nix::unistd::dup2_stderr(&self.stderr).is_ok();
            if restored && self.written.rewind().is_ok() && self.written.read_to_end(&mut text).is_ok() {
                let text = String::from_utf8_lossy(&text);
                for line in text.lines().filter(|line| !line.contains(NOISE)) {
                    // A standard error that cannot be written to has nobody who reads it.
                    let _ = writeln!(stderr(), "{line}");
                }
            }
        }
    }
}
