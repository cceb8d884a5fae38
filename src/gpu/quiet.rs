//! What drivers write on stderr while adapters are looked for.

/// What `act` returns. Lines that it writes on stderr come out at its end, but for those that say nothing.
#[cfg(unix)]
pub(super) fn quietly<T>(act: impl FnOnce() -> T) -> T {
    let _diversion = unix::Diversion::begin();
    act()
}

/// What `act` returns: other systems' drivers write nothing.
#[cfg(not(unix))]
pub(super) fn quietly<T>(act: impl FnOnce() -> T) -> T {
    act()
}

#[cfg(unix)]
mod unix {
    use std::fs::File;
    use std::io::{Read, Seek, Write, stderr};
    use std::os::fd::OwnedFd;
    use std::sync::{Mutex, MutexGuard, PoisonError};

    /// Lines with this are not worth a user's attention: a driver looks for a screen, which nothing here needs.
    const NOISE: &str = "XDG_RUNTIME_DIR";

    /// There is one stderr for all threads.
    static DIVERTED: Mutex<()> = Mutex::new(());

    /// Stderr, led into a file.
    pub(super) struct Diversion {
        stderr: OwnedFd,
        written: File,
        _alone: MutexGuard<'static, ()>,
    }

    impl Diversion {
        /// `None` where stderr cannot be diverted: then it stays as it is.
        pub(super) fn begin() -> Option<Self> {
            let alone = DIVERTED.lock().unwrap_or_else(PoisonError::into_inner);
            let (stderr, written) = (nix::unistd::dup(stderr()).ok()?, tempfile::tempfile().ok()?);
            nix::unistd::dup2_stderr(&written).ok()?;
            Some(Self { stderr, written, _alone: alone })
        }
    }

    impl Drop for Diversion {
        fn drop(&mut self) {
            let mut text = Vec::new();
            let restored = nix::unistd::dup2_stderr(&self.stderr).is_ok();
            if restored && self.written.rewind().is_ok() && self.written.read_to_end(&mut text).is_ok() {
                let text = String::from_utf8_lossy(&text);
                for line in text.lines().filter(|line| !line.contains(NOISE)) {
                    // A stderr that cannot be written to has nobody who reads it.
                    let _ = writeln!(stderr(), "{line}");
                }
            }
        }
    }
}
