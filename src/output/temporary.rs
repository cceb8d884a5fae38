//! Temporary files beside outputs: their names, which of them are left over, and their removal.
//!
//! A temporary file is called `.thinlens-HOST-PID-RANDOM.tmp` and is locked while it is written. It is left over if its process is dead
//! and nobody holds the lock. Where locks are not supported, the process alone decides, and of other machines the age of the file.

use std::fs::{self, File, ReadDir, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::NamedTempFile;

const PREFIX: &str = ".thinlens-";
const SUFFIX: &str = ".tmp";
/// A temporary file of another machine, whose processes are not seen from here, is left over after this time without a change.
const OLD: Duration = Duration::from_secs(24 * 60 * 60);

/// An empty, locked temporary file in `folder`, removed when dropped.
///
/// # Errors
/// Those of the system.
pub(super) fn create(folder: &Path) -> io::Result<NamedTempFile> {
    let prefix = own_prefix();
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX);
    // The default of `tempfile` is 0600, but other users of a render farm must be able to read the frame.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let temporary = builder.tempfile_in(folder)?;
    // Some file systems have no locks: there the number of the process alone says that the file is in use.
    let _ = temporary.as_file().try_lock();
    Ok(temporary)
}

/// Removes what ended processes left in `folder`; returns the number of files. A folder that cannot be read has none.
pub fn remove_stale(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    temporaries(entries).filter(|(path, name)| is_stale(path, name) && fs::remove_file(path).is_ok()).count()
}

/// Removes the temporary files of this process from `folders`, for a process that is about to end. `stop_creating` is called once the
/// folders are open, and makes sure that no thread creates further files.
pub fn remove_own(folders: &[PathBuf], stop_creating: impl FnOnce()) {
    // Twice: a file that was being created during the first pass is seen by the second.
    let open = || folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).collect::<Vec<_>>();
    let passes = [open(), open()];
    stop_creating();
    let own = own_prefix();
    for (path, name) in passes.into_iter().flatten().flat_map(temporaries) {
        if name.starts_with(&own) {
            // In the second pass most are gone.
            let _ = fs::remove_file(path);
        }
    }
}

/// Path and name of every temporary file of this program.
fn temporaries(entries: ReadDir) -> impl Iterator<Item = (PathBuf, String)> {
    let named =
        entries.flatten().filter_map(|entry| Some((entry.path(), entry.file_name().into_string().ok()?)));
    named.filter(|(_, name)| name.starts_with(PREFIX) && name.ends_with(SUFFIX))
}

/// How the names of this process's temporary files begin.
fn own_prefix() -> String {
    format!("{PREFIX}{}-{}-", host(), std::process::id())
}

/// The machine's name, of letters, digits, dots and hyphens.
fn host() -> String {
    #[cfg(unix)]
    let name = nix::unistd::gethostname().ok().and_then(|name| name.into_string().ok());
    #[cfg(not(unix))]
    let name = std::env::var("COMPUTERNAME").ok();
    let plain =
        |letter: char| if letter.is_ascii_alphanumeric() || ".-".contains(letter) { letter } else { '_' };
    let name: String = name.unwrap_or_default().chars().map(plain).collect();
    if name.is_empty() { "unknown".to_owned() } else { name }
}

/// Host and process in the name of a temporary file; `None` for names of other programs and versions.
fn origin(name: &str) -> Option<(&str, u32)> {
    let inner = name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX)?;
    let (origin, _random) = inner.rsplit_once('-')?;
    let (host, process) = origin.rsplit_once('-')?;
    Some((host, process.parse().ok()?))
}

/// Whether nobody writes the temporary file any more.
fn is_stale(path: &Path, name: &str) -> bool {
    let ended =
        origin(name).is_some_and(|(host_of_file, process)| host_of_file == host() && is_dead(process));
    (ended || is_old(path)) && !is_locked(path)
}

/// Whether another process holds the lock of the file. A lock that cannot be asked for counts as free.
fn is_locked(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
}

fn is_old(path: &Path) -> bool {
    let modified = path.metadata().and_then(|metadata| metadata.modified());
    modified.is_ok_and(|modified| modified.elapsed().is_ok_and(|age| age > OLD))
}

/// Whether there is no process of this number on this machine.
#[cfg(unix)]
fn is_dead(process: u32) -> bool {
    let process = i32::try_from(process).ok().filter(|&process| process > 0).map(nix::unistd::Pid::from_raw);
    let asked = process.map(|process| nix::sys::signal::kill(process, None));
    matches!(asked, None | Some(Err(nix::errno::Errno::ESRCH)))
}

/// Not known: the age of the file decides.
#[cfg(not(unix))]
fn is_dead(_process: u32) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    /// The number of a process that has ended.
    #[cfg(unix)]
    fn ended_process() -> u32 {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        child.id()
    }

    /// A file of that name in `folder`, last changed `age` ago.
    fn file(folder: &Path, name: &str, age: Duration) -> File {
        let file = File::create(folder.join(name)).unwrap();
        file.set_modified(SystemTime::now() - age).unwrap();
        file
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[cfg(unix)]
    #[test]
    fn what_a_dead_process_left_is_removed_and_what_a_living_one_writes_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let left = format!(".thinlens-{}-{}-aaaaaa.tmp", host(), ended_process());
        drop(file(folder.path(), &left, Duration::ZERO));
        let written = create(folder.path()).unwrap();
        let written = written.path().file_name().unwrap().to_str().unwrap();
        assert_eq!(origin(written), Some((host().as_str(), std::process::id())));
        assert_eq!((remove_stale(folder.path()), names(folder.path())), (1, vec![written.to_owned()]));
    }

    #[cfg(unix)]
    #[test]
    fn a_file_whose_lock_is_held_is_kept_whoever_seems_to_own_it_and_however_old_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let name = format!(".thinlens-{}-{}-aaaaaa.tmp", host(), ended_process());
        let held = file(folder.path(), &name, 2 * OLD);
        held.lock().unwrap();
        assert_eq!(remove_stale(folder.path()), 0);
        drop(held);
        assert_eq!(remove_stale(folder.path()), 1);
    }

    #[test]
    fn a_file_of_another_machine_or_version_is_removed_after_a_day_and_other_files_never() {
        let folder = tempfile::tempdir().unwrap();
        for (age, mark) in [(OLD / 2, "new"), (OLD * 2, "old")] {
            drop(file(folder.path(), &format!(".thinlens-far-away-1-{mark}.tmp"), age));
            drop(file(folder.path(), &format!(".thinlens-{mark}.tmp"), age));
            drop(file(folder.path(), &format!("{mark}.exr"), age));
            drop(file(folder.path(), &format!(".other-{mark}.tmp"), age));
        }
        assert_eq!(remove_stale(folder.path()), 2);
        let kept = [".other-new.tmp", ".other-old.tmp", ".thinlens-far-away-1-new.tmp", ".thinlens-new.tmp"];
        assert_eq!(names(folder.path()), [&kept[..], &["new.exr", "old.exr"]].concat());
    }

    #[test]
    fn a_process_that_ends_removes_its_own_files_and_none_of_others() {
        let folder = tempfile::tempdir().unwrap();
        let other = format!(".thinlens-{}-1-aaaaaa.tmp", host());
        drop(file(folder.path(), &other, Duration::ZERO));
        let first = create(folder.path()).unwrap();
        let mut last = None;
        let folders = [folder.path().to_owned(), folder.path().join("missing")];
        remove_own(&folders, || last = Some(create(folder.path()).unwrap()));
        assert_eq!(names(folder.path()), [other]);
        drop((first, last));
    }
}
