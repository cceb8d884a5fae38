//! The digest of a job: 128 bits that change with everything that determines the picture's file.
//!
//! Nothing of the stack is read: a file counts by its base name, size and time of modification, so that the digest costs a few system
//! calls and is the same on every machine that sees the same files, wherever they are mounted. What only costs time or is written to
//! another file does not count: threads, memory limits, reports, masks.

use super::job::{self, Job};
use crate::error::Error;
use crate::output::Encoding;
use crate::settings::{ParameterValues, Values};
use crate::stack::{ReadOptions, Source};
use siphasher::sip128::{Hasher128 as _, SipHasher13};
use std::fmt::Debug;
use std::fs;
use std::hash::Hasher as _;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The digest of the picture that `job` makes, stored as `encoding` says: 32 hexadecimal digits.
///
/// It covers the version of thinlens, the files read, the settings of preset and flags, the parameters, effects, the device as
/// requested, the read options, the frame number where keys depend on it, and `encoding`. The same job gives the same digest on
/// every machine and with any number of threads.
///
/// # Errors
/// [`crate::error::ErrorKind::Input`] for a file that is not there or cannot be examined.
pub fn digest(job: &Job, encoding: &Encoding) -> Result<String, Error> {
    let Job {
        sources,
        frame: _, // within `number`
        read_options,
        methods,
        preset,
        flags,
        parameters,
        switches,
        device,
        verify: _,     // measured, not changed
        confidence: _, // another file
        memory: _,     // a limit
    } = job;
    let mut all = Fields(SipHasher13::new());
    all.add("version", env!("CARGO_PKG_VERSION"));
    for source in sources {
        all.source(source)?;
    }
    for path in named_files(job) {
        all.source(&read_options.held.source(path))?;
    }
    all.read_options(read_options);
    let names: Vec<_> = methods.iter().map(|method| method.name()).collect();
    all.show("methods", &names);
    let layers = preset.iter().map(|named| &named.preset.values).chain([flags]);
    layers.for_each(|values| all.show("values", &without_folders(values)));
    if let Some(named) = preset {
        all.parameters(&named.preset.parameters);
    }
    all.show("parameters", parameters);
    all.show("switches", switches);
    all.show("device", device);
    let number = job::has_keys(job).then(|| job::frame_number(job).map(|frame| frame.number)).flatten();
    all.show("frame", &number);
    let Encoding { precision, codec, exposure_stops } = encoding;
    all.show("encoding", &(precision, codec, exposure_stops));
    Ok(format!("{:032x}", all.0.finish128().as_u128()))
}

/// The files that settings and read options of `job` name.
fn named_files(job: &Job) -> impl Iterator<Item = &Path> {
    let last = |pick: fn(&Values) -> Option<&PathBuf>| {
        job::user_layers(job).filter_map(move |(_, values)| pick(values)).last()
    };
    let beauty = last(|values| values.beauty.as_ref()).or(job.read_options.beauty.as_ref());
    let holdout = last(|values| values.holdout.as_ref()).or(job.read_options.holdout.as_ref());
    let aperture = last(|values| values.aperture_image.as_ref());
    let environment = last(|values| values.environment.as_ref());
    [job.read_options.depth_file.as_ref(), beauty, holdout, aperture, environment]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
}

/// `values` with the base names of files.
fn without_folders(values: &Values) -> Values {
    let base = |path: &Option<PathBuf>| path.as_deref().map(|path| PathBuf::from(base_name(path)));
    Values {
        aperture_image: base(&values.aperture_image),
        environment: base(&values.environment),
        beauty: base(&values.beauty),
        holdout: base(&values.holdout),
        ..values.clone()
    }
}

/// The last part of `path`.
fn base_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Named fields on their way into a hash. Each text is preceded by its length, so that no two sequences of fields have the same bytes.
struct Fields(SipHasher13);

impl Fields {
    fn bytes(&mut self, bytes: &[u8]) {
        self.0.write(&(bytes.len() as u64).to_le_bytes());
        self.0.write(bytes);
    }

    fn add(&mut self, name: &str, value: &str) {
        self.bytes(name.as_bytes());
        self.bytes(value.as_bytes());
    }

    /// A value as its debug text: it has every field of the value, those that are added later included.
    fn show(&mut self, name: &str, value: &impl Debug) {
        self.add(name, &format!("{value:?}"));
    }

    fn source(&mut self, source: &Source) -> Result<(), Error> {
        match source {
            Source::File(path) => self.file(path),
            Source::Memory { name, bytes } => {
                self.add("memory", name);
                self.bytes(bytes);
                Ok(())
            }
        }
    }

    fn file(&mut self, path: &Path) -> Result<(), Error> {
        let fail = |error: io::Error| {
            let missing = error.kind() == io::ErrorKind::NotFound;
            let what = if missing { "no such file" } else { "the file cannot be examined" };
            Error::input(what).in_file(path).caused_by(error)
        };
        let metadata = fs::metadata(path).map_err(fail)?;
        let modified = metadata.modified().map_err(fail)?;
        self.add("file", &base_name(path));
        self.show("size", &metadata.len());
        self.show("modified", &nanoseconds(modified));
        Ok(())
    }

    fn read_options(&mut self, options: &ReadOptions) {
        let ReadOptions {
            convention,
            supersample,
            kind,
            near,
            far,
            alpha,
            color_channel,
            depth_channel,
            view,
            depth_file: _, // a file
            beauty: _,     // a file
            holdout: _,    // a file
            merge,
            carry,
            objects,
            max_bytes: _, // a limit
            held: _,      // the contents of files
            rows: _,      // a part of the picture
        } = options;
        self.show("depth", &(convention, supersample, kind, near, far, alpha));
        self.show("channels", &(color_channel, depth_channel, view, merge, carry, objects));
    }

    fn parameters(&mut self, parameters: &ParameterValues) {
        for value in parameters.iter() {
            self.add(&format!("{}.{}", value.method, value.key), &value.value.to_string());
        }
    }
}

/// Nanoseconds from the start of 1970 to `time`, negative before it.
fn nanoseconds(time: SystemTime) -> i128 {
    let whole = |duration: std::time::Duration| i128::try_from(duration.as_nanos()).unwrap_or(i128::MAX);
    match time.duration_since(UNIX_EPOCH) {
        Ok(after) => whole(after),
        Err(before) => -whole(before.duration()),
    }
}
