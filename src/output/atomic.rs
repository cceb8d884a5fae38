//! Atomic writes: a file is written completely or not at all.
//!
//! A file is written under a temporary name in the folder of its destination and then renamed, so that a reader
//! never sees an incomplete picture and a failed run does not change the previous one. Destinations that cannot be replaced by a rename
//! (standard output, named `-`; devices and pipes) are written to memory first and then sent as a whole.
//!
//! The content is on the disk before the rename: after a failure of power or of the machine there is the old file or the new one, and
//! a disk that is full only when it takes the data is noticed. The rename itself is left to the system, so the newest file may be the old
//! one then. A killed process leaves a temporary file, which [`temporary::remove_stale`] removes.

use super::temporary;
use crate::error::Error;
use std::fs::{self, File, Metadata, OpenOptions, Permissions};
use std::io::{self, BufWriter, Cursor, Seek, Write};
use std::path::{Path, PathBuf};

/// Symbolic links that are followed at most from one to the next, as Linux does.
const MAX_LINKS: usize = 40;

/// The output that a writer writes to.
pub trait Target: Write + Seek + Send {}

impl<T: Write + Seek + Send> Target for T {}

/// The destination of a write.
enum Destination {
    Stdout,
    /// A device or a pipe, which a rename would destroy.
    Device,
    /// A file in an existing folder, with symbolic links resolved.
    File {
        path: PathBuf,
        replaced: Option<Permissions>,
    },
}

/// Writes the file `path` with `fill`; `-` is standard output.
///
/// A new file has the permissions of the process's umask, a replaced file keeps its own. If `fill` or the disk fails, the
/// file at `path` is unchanged.
///
/// # Errors
/// Those of [`check_writable`], those of `fill`, and those of the disk.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Target) -> Result<(), Error>) -> Result<(), Error> {
    let send = |stream: io::Result<&mut dyn Write>, bytes: &[u8]| {
        stream
            .and_then(|stream| stream.write_all(bytes).and_then(|()| stream.flush()))
            .map_err(|error| failed(path, error))
    };
    match destination(path)? {
        Destination::Stdout => {
            let mut buffer = Cursor::new(Vec::new());
            fill(&mut buffer)?;
            send(Ok(&mut io::stdout().lock()), buffer.get_ref())
        }
        Destination::Device => {
            let mut buffer = Cursor::new(Vec::new());
            fill(&mut buffer)?;
            let mut device =
                OpenOptions::new().write(true).open(path).map_err(|error| failed(path, error))?;
            send(Ok(&mut device), buffer.get_ref())
        }
        Destination::File { path: file, replaced } => replace(path, &file, replaced, fill),
    }
}

/// Writes `text` to the file `path`, as [`write()`] does.
///
/// # Errors
/// As [`write()`].
pub fn write_text(path: &Path, text: &str) -> Result<(), Error> {
    write(path, |target| target.write_all(text.as_bytes()).map_err(|error| failed(path, error)))
}

/// Checks, before any work starts, that [`write()`] can write the file `path`.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] if the folder is missing or is not a folder, and if `path` is a folder;
/// [`crate::error::ErrorKind::Output`] if the folder or the file is write-protected.
pub fn check_writable(path: &Path) -> Result<(), Error> {
    match destination(path)? {
        Destination::Stdout | Destination::Device => Ok(()),
        Destination::File { path: file, .. } => {
            temporary::create(folder(&file)).map(drop).map_err(|error| failed(path, error))
        }
    }
}

/// The folder of the temporary file that [`write()`] makes for `path`; `None` for what is not written by way of one.
pub fn temporary_folder(path: &Path) -> Option<PathBuf> {
    match destination(path) {
        Ok(Destination::File { path: file, .. }) => Some(folder(&file).to_owned()),
        _ => None,
    }
}

/// The error of a write to `path` that the operating system refused.
pub fn failed(path: &Path, error: io::Error) -> Error {
    let (what, help) = match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            ("no space left for the output file", Some("free some space, or write to another disk"))
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => (
            "no permission to write the output file",
            Some("write to another folder, or change the folder's permissions"),
        ),
        io::ErrorKind::FileTooLarge => (
            "the output file is larger than the system allows",
            Some("raise the limit of the shell (`ulimit -f`), or write to another disk"),
        ),
        io::ErrorKind::BrokenPipe => ("the reader of the output has closed it", None),
        _ => ("the output file cannot be written", None),
    };
    let error = Error::output(what).in_file(path).caused_by(error);
    match help {
        Some(help) => error.help(help),
        None => error,
    }
}

/// Writes a temporary file beside `file` and renames it; `path` is the name in errors.
fn replace(
    path: &Path,
    file: &Path,
    replaced: Option<Permissions>,
    fill: impl FnOnce(&mut dyn Target) -> Result<(), Error>,
) -> Result<(), Error> {
    let mut temporary = temporary::create(folder(file)).map_err(|error| failed(path, error))?;
    let mut writer = BufWriter::with_capacity(1 << 18, temporary.as_file_mut());
    fill(&mut writer)?;
    writer.flush().map_err(|error| failed(path, error))?;
    drop(writer);
    if let Some(permissions) = replaced {
        temporary.as_file().set_permissions(permissions).map_err(|error| failed(path, error))?;
    }
    synchronise(temporary.as_file()).map_err(|error| failed(path, error))?;
    temporary.persist(file).map(|_: File| ()).map_err(|error| failed(path, error.error))
}

/// Waits until the content of `file` is on the disk, where the file system can tell.
fn synchronise(file: &File) -> io::Result<()> {
    match file.sync_data() {
        Err(error) if matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => {
            Ok(())
        }
        outcome => outcome,
    }
}

fn destination(path: &Path) -> Result<Destination, Error> {
    if path == Path::new("-") {
        return Ok(Destination::Stdout);
    }
    if path.to_string_lossy().ends_with(std::path::is_separator) {
        return Err(is_a_folder(path));
    }
    match path.metadata() {
        Ok(metadata) => existing(path, &metadata),
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            let file = end_of_links(path).map_err(|error| failed(path, error))?;
            check_folder(&file)?;
            Ok(Destination::File { path: file, replaced: None })
        }
        Err(error) => Err(failed(path, error)),
    }
}

/// The file that does not exist yet at the end of the symbolic links at `path`: a rename would replace the link, not the file.
fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    let mut file = path.to_owned();
    for _ in 0..MAX_LINKS {
        if !file.is_symlink() {
            return Ok(file);
        }
        // A relative target is relative to the link's folder; an absolute one replaces it.
        file = folder(&file).join(fs::read_link(&file)?);
    }
    Err(io::Error::other("the links lead to one another"))
}

fn is_a_folder(path: &Path) -> Error {
    Error::settings("the output is a folder").in_file(path).help("name a file in that folder")
}

fn existing(path: &Path, metadata: &Metadata) -> Result<Destination, Error> {
    if metadata.is_dir() {
        return Err(is_a_folder(path));
    }
    if !metadata.is_file() {
        return Ok(Destination::Device);
    }
    if metadata.permissions().readonly() {
        return Err(Error::output("the output file exists and is write-protected")
            .in_file(path)
            .help("remove it, make it writable, or write to another file"));
    }
    // A rename would replace a symbolic link, not its target.
    let path = path.canonicalize().map_err(|error| failed(path, error))?;
    Ok(Destination::File { path, replaced: Some(metadata.permissions()) })
}

/// The folder of `path`.
fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

/// Creates `folder`, and the folders that it lies in.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] if a file is in the way, [`crate::error::ErrorKind::Output`] if the system refuses.
pub fn create_folder(folder: &Path) -> Result<(), Error> {
    fs::create_dir_all(folder).map_err(|cause| match cause.kind() {
        io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory => {
            Error::settings("the output folder cannot be created: a file is in the way")
                .in_file(folder)
                .caused_by(cause)
                .help("choose another folder")
        }
        _ => Error::output("the output folder cannot be created")
            .in_file(folder)
            .caused_by(cause)
            .help("choose another folder, or change the permissions"),
    })
}

fn check_folder(path: &Path) -> Result<(), Error> {
    let folder = folder(path);
    match folder.metadata() {
        Ok(metadata) if metadata.is_dir() => Ok(()),
        Ok(_) => Err(Error::settings("the output's folder is not a folder").in_file(path)),
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            Err(Error::settings("the output's folder does not exist")
                .in_file(path)
                .help(format!("create it: mkdir -p {}", folder.display())))
        }
        Err(error) => Err(failed(path, error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").unwrap();
        let result = write(&path, |target| {
            target.write_all(b"half of the n").unwrap();
            Err(Error::output("stop"))
        });
        assert!(result.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_write_replaces_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "old and long").unwrap();
        write(&path, |target| {
            target.write_all(b"new").unwrap();
            Ok(())
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_new_file_has_the_permissions_of_the_umask_and_a_replaced_one_keeps_its_own() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o777;
        let (plain, ours) = (folder.path().join("plain"), folder.path().join("ours"));
        fs::write(&plain, "").unwrap();
        write(&ours, |_| Ok(())).unwrap();
        assert_eq!(mode(&ours), mode(&plain));
        fs::set_permissions(&ours, Permissions::from_mode(0o640)).unwrap();
        write(&ours, |_| Ok(())).unwrap();
        assert_eq!(mode(&ours), 0o640);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_its_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write(&link, |target| {
            target.write_all(b"new").unwrap();
            Ok(())
        })
        .unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_file_that_does_not_exist_yet_is_followed() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("store")).unwrap();
        symlink("store/file", at("near")).unwrap();
        symlink(at("near"), at("far")).unwrap();
        write_text(&at("far"), "new").unwrap();
        assert!(at("far").is_symlink() && at("near").is_symlink());
        assert_eq!(fs::read(at("store/file")).unwrap(), b"new");
        assert_eq!(names(&at("store")), ["file"]);
        symlink("gone/file", at("nowhere")).unwrap();
        let error = check_writable(&at("nowhere")).unwrap_err().to_string();
        assert!(error.contains("does not exist") && error.contains("gone"), "{error}");
        symlink("ring", at("ring")).unwrap();
        assert!(check_writable(&at("ring")).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_an_error_and_stays_a_device() {
        let path = Path::new("/dev/full");
        let error = write(path, |target| {
            target.write_all(b"something").unwrap();
            Ok(())
        })
        .unwrap_err();
        assert!(
            error.to_string().starts_with("no space left for the output file\n  in: /dev/full"),
            "{error}"
        );
        assert!(!path.is_file() && path.exists());
    }

    #[test]
    fn a_missing_folder_is_reported_before_any_work_with_a_command_that_creates_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("missing/a.exr");
        let text = check_writable(&path).unwrap_err().to_string();
        assert!(text.contains("does not exist") && text.contains("mkdir -p"), "{text}");
        assert!(text.contains(&path.display().to_string()), "{text}");
    }

    #[test]
    fn a_folder_and_a_write_protected_file_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check_writable(folder.path()).unwrap_err().to_string().contains("is a folder"));
        let named_as_one = folder.path().join("new/");
        assert!(check_writable(&named_as_one).unwrap_err().to_string().contains("is a folder"));
        let file = folder.path().join("file");
        fs::write(&file, "kept").unwrap();
        assert!(check_writable(&file.join("a.exr")).unwrap_err().to_string().contains("folder"));
        let mut permissions = file.metadata().unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&file, permissions).unwrap();
        assert!(check_writable(&file).unwrap_err().to_string().contains("write-protected"));
        assert!(write(&file, |_| Ok(())).is_err());
        assert_eq!(fs::read(&file).unwrap(), b"kept");
    }

    #[test]
    fn checking_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        check_writable(&folder.path().join("a.exr")).unwrap();
        check_writable(Path::new("-")).unwrap();
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn the_error_of_a_folder_without_permission_has_a_help() {
        let error = failed(Path::new("a/b.exr"), io::Error::from(io::ErrorKind::PermissionDenied));
        assert!(
            error.to_string().contains("  in: a/b.exr") && error.to_string().contains("help:"),
            "{error}"
        );
    }
}
