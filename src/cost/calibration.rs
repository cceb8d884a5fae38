//! The speed of this machine relative to the machine where the cost terms were measured.
//!
//! A small generated scene is blurred by one method of each kind of work, alternating, a few times. The fastest run counts, since
//! other load can only slow a run down. The result is stored in a file in the user's cache folder, under the machine's name. If the file
//! cannot be read or written, or belongs to another machine, version or set of cost terms, the machine is calibrated again; the command does
//! not fail.

use crate::error::Error;
use crate::image::Plane;
use crate::machine::Machine;
use crate::methods::{self, Registry, WorkKind};
use crate::scene::{Layer, Scene};
use crate::settings::{Effort, Origin, ParameterValues, Settings, Values};
use crate::stack::StackKind;
use crate::usage::Stopwatch;
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Number of kinds of work.
const KIND_COUNT: usize = WorkKind::ALL.len();

/// Processor seconds of a calibration's runs on the machine where the cost terms were measured.
const BASELINE_SECONDS: [f64; KIND_COUNT] = [0.0312, 0.0553, 0.0229];

/// The environment variable that names the folder of calibrations.
pub const CACHE_VARIABLE: &str = "THINLENS_CACHE_DIR";

/// Smallest number of runs of each method in a calibration.
const MIN_RUNS: usize = 3;

/// Time during which new runs begin: about half a second, to cover fast and slow periods of a shared machine.
const ENOUGH_SECONDS: f64 = 0.6;

/// Share of a core per thread below which, in every kind of work, the machine counts as busy with other work.
const IDLE_SHARE: f64 = 0.6;

/// Width and height of the picture that a calibration blurs.
const SIZE: (usize, usize) = (512, 288);

/// The speed of a machine at one kind of work.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Factor {
    /// Processor time relative to the machine of the cost terms.
    pub cpu: f64,
    /// Processor time over wall time: the number of threads that work at the same time.
    pub speed_up: f64,
}

/// The speed of a machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Calibration {
    /// The machine.
    pub(crate) machine: Machine,
    /// Time of the measurement, in seconds since 1970; `None` if not measured.
    pub measured_at: Option<u64>,
    /// In the order of [`WorkKind::ALL`].
    pub factors: [Factor; KIND_COUNT],
    /// Processor seconds of the baseline machine that the factors are relative to. Factors of another baseline are not valid.
    pub over_seconds: [f64; KIND_COUNT],
}

/// A remark for the user about the calibration's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark(pub String);

impl Calibration {
    /// This machine without a measurement: as fast as the baseline machine, with all threads at work.
    pub fn assumed() -> Self {
        let machine = Machine::this();
        let factor = Factor { cpu: 1.0, speed_up: machine.threads as f64 };
        Self { machine, measured_at: None, factors: [factor; KIND_COUNT], over_seconds: BASELINE_SECONDS }
    }

    /// Measures this machine, in less than a second.
    ///
    /// # Errors
    /// Those of the methods, which on the CPU have none.
    pub fn measure() -> Result<Self, Error> {
        // Further digits are noise.
        let rounded = |value: f64| (value * 1e4).round() / 1e4;
        let factors = timed()?.map(|(kind, cpu_seconds, speed_up)| Factor {
            cpu: rounded(cpu_seconds / BASELINE_SECONDS[kind as usize]),
            speed_up: rounded(speed_up),
        });
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
        Ok(Self { machine: Machine::this(), measured_at: Some(now), factors, over_seconds: BASELINE_SECONDS })
    }

    /// The calibration of this machine stored in `folder`. It is measured and stored if there is none, or if `again` is set.
    ///
    /// # Errors
    /// Those of [`Self::measure`]; a problem with the file is a remark.
    pub fn load_or_measure(folder: Option<&Path>, again: bool) -> Result<(Self, Vec<Remark>), Error> {
        let machine = Machine::this();
        let file = folder.map(|folder| folder.join(machine.file_name()));
        let mut remarks = Vec::new();
        if let Some(file) = file.as_ref().filter(|file| !again && file.exists()) {
            match Self::load(file, &machine) {
                Ok(calibration) => return Ok((calibration, remarks)),
                Err(why) => remarks.push(Remark(format!("{}: {why}; measured again", file.display()))),
            }
        }
        let calibration = Self::measure()?;
        if calibration.was_busy() {
            remarks.push(Remark(
                "this machine was busy with other work during calibration, so predicted wall times are too long; \
                 repeat it with `recalibrate` when the machine is idle"
                    .to_owned(),
            ));
        }
        match file.map(|file| calibration.save(&file)) {
            Some(Ok(())) => {}
            Some(Err(error)) => remarks.push(Remark(format!("the calibration is not stored: {error}"))),
            None => remarks.push(Remark(format!(
                "the calibration is not stored: there is no cache folder; name one in {CACHE_VARIABLE}"
            ))),
        }
        Ok((calibration, remarks))
    }

    /// The speed of the machine at work of `kind`.
    pub fn factor(&self, kind: WorkKind) -> Factor {
        self.factors[kind as usize]
    }

    /// Whether the threads had much less than a core each during the calibration.
    fn was_busy(&self) -> bool {
        let threads = self.machine.threads.min(self.machine.cores) as f64;
        self.factors.iter().all(|factor| factor.speed_up < IDLE_SHARE * threads)
    }

    /// The calibration of `machine` in `file`, or the reason why it cannot be used.
    fn load(file: &Path, machine: &Machine) -> Result<Self, String> {
        let text = std::fs::read_to_string(file).map_err(|error| format!("cannot be read ({error})"))?;
        let calibration: Self =
            serde_json::from_str(&text).map_err(|error| format!("is no calibration ({error})"))?;
        let usable = |factor: &Factor| {
            [factor.cpu, factor.speed_up].iter().all(|value| value.is_finite() && *value > 0.0)
        };
        if calibration.machine != *machine {
            return Err("is for another machine or version".to_owned());
        }
        if calibration.over_seconds != BASELINE_SECONDS {
            return Err("is for other cost terms".to_owned());
        }
        if calibration.measured_at.is_none() || !calibration.factors.iter().all(usable) {
            return Err("has invalid factors".to_owned());
        }
        Ok(calibration)
    }

    fn save(&self, file: &Path) -> Result<(), Error> {
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder).map_err(|error| {
                Error::output("the cache folder cannot be created").in_file(folder).caused_by(error)
            })?;
        }
        crate::output::report::write_json(file, self)
    }
}

/// The folder of calibrations: the one that [`CACHE_VARIABLE`] names, otherwise `thinlens` in the user's cache folder.
pub fn cache_folder() -> Option<PathBuf> {
    cache_folder_of(std::env::consts::OS, |name| std::env::var_os(name))
}

/// [`cache_folder`] of the system `os` with the environment variables `variable`.
fn cache_folder_of(os: &str, variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let path = |name: &str| variable(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(folder) = path(CACHE_VARIABLE) {
        return Some(folder);
    }
    let user = match os {
        "windows" => path("LOCALAPPDATA"),
        "macos" => path("HOME").map(|home| home.join("Library/Caches")),
        // The XDG standard says that relative paths are to be ignored.
        _ => path("XDG_CACHE_HOME")
            .filter(|path| path.is_absolute())
            .or_else(|| path("HOME").map(|home| home.join(".cache"))),
    };
    user.map(|folder| folder.join("thinlens"))
}

/// For each kind of work: the smallest processor seconds of the calibration's runs, and the speed-up by threads.
///
/// # Errors
/// Those of the methods, which on the CPU have none.
pub fn timed() -> Result<[(WorkKind, f64, f64); KIND_COUNT], Error> {
    let scene = test_scene(SIZE);
    let stats = scene.analyze();
    let threads = rayon::current_num_threads() as f64;
    let mut best = WorkKind::ALL.map(|kind| (kind, f64::INFINITY, 1.0_f64));
    let whole = Stopwatch::start();
    let mut runs = 0;
    while runs < MIN_RUNS || whole.seconds() < ENOUGH_SECONDS {
        runs += 1;
        for (kind, seconds, speed_up) in &mut best {
            let plan = Registry::default().plan(&stats, &settings(*kind))?;
            let scene = scene.clone();
            let watch = Stopwatch::start();
            methods::render(scene, &plan, &|_| {})?;
            let wall = watch.seconds().max(1e-9);
            // On a system that does not report processor time, all threads are assumed to work.
            let cpu = match watch.cpu_seconds() {
                0.0 => wall * threads,
                cpu => cpu,
            };
            *seconds = seconds.min(cpu);
            *speed_up = speed_up.max(cpu / wall).min(threads);
        }
    }
    Ok(best)
}

/// The method that represents a kind of work in a calibration, and its views.
fn calibrated_by(kind: WorkKind) -> (&'static str, Option<usize>) {
    match kind {
        WorkKind::Rows => ("shear", Some(16)),
        WorkKind::Rays => ("accumulate", Some(2)),
        WorkKind::Planes => ("opaque-blur", None),
    }
}

/// The settings of a calibration's run of `kind`.
fn settings(kind: WorkKind) -> Settings {
    let (method, views) = calibrated_by(kind);
    let values =
        Values { method: Some(method.to_owned()), effort: views.map(Effort::Views), ..Values::default() };
    Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default())
}

/// Two layers: vertical bars in front of focus over a floor that slopes from behind focus to in front of it, and the floor behind the
/// bars.
pub(super) fn test_scene((width, height): (usize, usize)) -> Scene {
    let is_bar = |x: usize| x % 48 < 16;
    let floor = |y: usize| 10.0 - 20.0 * y as f32 / height as f32;
    let texture = |x: usize, y: usize| ((x * 7) ^ (y * 13)) as f32 % 64.0 / 64.0;
    let layer = |is_covered: &dyn Fn(usize) -> bool, coc: &dyn Fn(usize, usize) -> f32| {
        let within = |x: usize, value: f32| if is_covered(x) { value } else { 0.0 };
        Layer {
            color: std::array::from_fn(|_| Plane::from_fn(width, height, |x, y| within(x, texture(x, y)))),
            alpha: Plane::from_fn(width, height, |x, _| within(x, 1.0)),
            coc_px: Plane::from_fn(width, height, |x, y| within(x, coc(x, y))),
        }
    };
    let layers = vec![
        layer(&|_| true, &|x, y| if is_bar(x) { -12.0 } else { floor(y) }),
        layer(&is_bar, &|_, y| floor(y)),
    ];
    Scene::new(layers, StackKind::PointSampled, 1, 20.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A calibration of this machine, without measuring.
    fn invented() -> Calibration {
        let factor = Factor { cpu: 1.5, speed_up: 1.25 };
        Calibration {
            measured_at: Some(1_700_000_000),
            factors: [factor; KIND_COUNT],
            ..Calibration::assumed()
        }
    }

    #[test]
    fn a_stored_calibration_is_read_back_unchanged_and_not_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let invented = invented();
        invented.save(&folder.path().join("deeper").join(invented.machine.file_name())).unwrap();
        let (stored, remarks) =
            Calibration::load_or_measure(Some(&folder.path().join("deeper")), false).unwrap();
        assert_eq!((stored, remarks), (invented, vec![]));
    }

    #[test]
    fn an_unusable_file_is_reported_and_the_machine_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(Machine::this().file_name());
        let elsewhere =
            Calibration { machine: Machine { cpu: "another".to_owned(), ..Machine::this() }, ..invented() };
        let zero = Factor { cpu: 0.0, speed_up: 1.0 };
        let invalid = Calibration { factors: [zero; KIND_COUNT], ..invented() };
        let other_baseline = Calibration { over_seconds: [1.0; KIND_COUNT], ..invented() };
        let json = |value: &Calibration| serde_json::to_string(value).unwrap();
        for (text, why) in [
            ("{ not JSON".to_owned(), "is no calibration"),
            (json(&elsewhere), "another machine"),
            (json(&invalid), "invalid factors"),
            (json(&other_baseline), "other cost terms"),
        ] {
            std::fs::write(&file, text).unwrap();
            let (measured, remarks) = Calibration::load_or_measure(Some(folder.path()), false).unwrap();
            assert!(remarks[0].0.contains(why), "{remarks:?}");
            assert!(measured.factors.iter().all(|factor| factor.cpu > 0.0 && factor.speed_up >= 1.0));
            assert_eq!(Calibration::load(&file, &Machine::this()), Ok(measured), "the file is replaced");
        }
    }

    #[test]
    fn a_machine_whose_threads_share_a_core_is_busy() {
        let with = |speed_up: [f64; 3]| {
            let machine = Machine { threads: 8, cores: 8, ..Machine::this() };
            let factors = speed_up.map(|speed_up| Factor { cpu: 1.0, speed_up });
            Calibration { machine, factors, ..invented() }.was_busy()
        };
        assert_eq!([with([1.0; 3]), with([1.0, 7.8, 1.0]), with([6.0; 3])], [true, false, false]);
    }

    #[test]
    fn a_stored_calibration_is_measured_again_on_request() {
        let folder = tempfile::tempdir().unwrap();
        invented().save(&folder.path().join(Machine::this().file_name())).unwrap();
        let (again, _) = Calibration::load_or_measure(Some(folder.path()), true).unwrap();
        assert!(again.measured_at > invented().measured_at);
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_a_remark_and_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "in the way").unwrap();
        let (measured, remarks) = Calibration::load_or_measure(Some(&file), false).unwrap();
        assert!(measured.measured_at.is_some());
        let says = |remarks: &[Remark], what: &str| remarks.iter().any(|remark| remark.0.contains(what));
        assert!(says(&remarks, "not stored"), "{remarks:?}");
        let (_, remarks) = Calibration::load_or_measure(None, false).unwrap();
        assert!(says(&remarks, CACHE_VARIABLE), "{remarks:?}");
    }

    #[test]
    fn the_cache_folder_is_that_of_the_variable_or_of_the_system() {
        let folder = |os: &str, variables: &[(&str, &str)]| {
            cache_folder_of(os, |name| {
                variables.iter().find(|(known, _)| *known == name).map(|(_, value)| OsString::from(value))
            })
        };
        let path = |text: &str| Some(PathBuf::from(text));
        assert_eq!(folder("linux", &[(CACHE_VARIABLE, "/a"), ("HOME", "/h")]), path("/a"));
        assert_eq!(folder("linux", &[("XDG_CACHE_HOME", "/x"), ("HOME", "/h")]), path("/x/thinlens"));
        assert_eq!(folder("linux", &[("XDG_CACHE_HOME", "x"), ("HOME", "/h")]), path("/h/.cache/thinlens"));
        assert_eq!(folder("macos", &[("HOME", "/h")]), path("/h/Library/Caches/thinlens"));
        assert_eq!(folder("windows", &[("LOCALAPPDATA", "l")]), Some(Path::new("l").join("thinlens")));
        assert_eq!(folder("linux", &[("HOME", "")]), None);
    }
}
