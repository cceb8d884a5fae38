//! How fast this machine is, against the one where the table of costs was made.
//!
//! A small scene made in code is blurred by one method of each kind of work, in turns, a few times; the quickest run counts, since
//! whatever else the machine does can only slow it down. The result is kept in a file of the user's cache folder, under the
//! machine's name. A file that cannot be read, is of another machine, version or table of costs, or cannot be written, costs a calibration, not
//! the command.

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

/// How many kinds of work there are.
const KIND_COUNT: usize = WorkKind::ALL.len();

/// Processor seconds of a calibration's runs on the machine that the terms of costs were measured on.
const MADE_SECONDS: [f64; KIND_COUNT] = [0.0318, 0.0190, 0.0140];

/// The environment variable that names the folder of calibrations.
pub const CACHE_VARIABLE: &str = "THINLENS_CACHE_DIR";

/// Each method runs at least so often in a calibration.
const MIN_RUNS: usize = 3;

/// Runs are begun until so many seconds have passed: half a second tells a quick spell from a slow one on a shared machine.
const ENOUGH_SECONDS: f64 = 0.6;

/// A machine that gives its threads less than this share of a core each, in every kind of work, has something else to do.
const IDLE_SHARE: f64 = 0.6;

/// Width and height of the picture that a calibration blurs.
const SIZE: (usize, usize) = (512, 288);

/// How a machine does one kind of work.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Factor {
    /// Processor time over that of the table's machine.
    pub cpu: f64,
    /// Processor time over wall time: how many threads' worth of work is done at once.
    pub speed_up: f64,
}

/// How fast a machine is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Calibration {
    /// The machine.
    pub(crate) machine: Machine,
    /// When it was measured, in seconds since 1970; `None`: not at all.
    pub measured_at: Option<u64>,
    /// In the order of [`Kind`].
    pub factors: [Factor; KIND_COUNT],
    /// Processor seconds of the table's machine that the factors are over: another table's factors tell nothing.
    pub over_seconds: [f64; KIND_COUNT],
}

/// What became of the calibration's file; for the user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark(pub String);

impl Calibration {
    /// This machine, not measured: taken to be as fast as the table's, with all threads at work.
    pub fn assumed() -> Self {
        let machine = Machine::this();
        let factor = Factor { cpu: 1.0, speed_up: machine.threads as f64 };
        Self { machine, measured_at: None, factors: [factor; KIND_COUNT], over_seconds: MADE_SECONDS }
    }

    /// Measures this machine, in less than a second.
    ///
    /// # Errors
    /// Those of the methods, which on the CPU have none.
    pub fn measure() -> Result<Self, Error> {
        // More digits would be noise.
        let rounded = |value: f64| (value * 1e4).round() / 1e4;
        let factors = timed()?.map(|(kind, cpu_seconds, speed_up)| Factor {
            cpu: rounded(cpu_seconds / MADE_SECONDS[kind as usize]),
            speed_up: rounded(speed_up),
        });
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
        Ok(Self { machine: Machine::this(), measured_at: Some(now), factors, over_seconds: MADE_SECONDS })
    }

    /// What is kept of this machine in `folder`; measured where nothing is, or `again` asks for it, and then kept.
    ///
    /// # Errors
    /// Those of [`Self::measure`]; what is wrong with the file is a remark.
    pub fn load_or_measure(folder: Option<&Path>, again: bool) -> Result<(Self, Vec<Remark>), Error> {
        let machine = Machine::this();
        let file = folder.map(|folder| folder.join(machine.file_name()));
        let mut remarks = Vec::new();
        if let Some(file) = file.as_ref().filter(|file| !again && file.exists()) {
            match Self::load(file, &machine) {
                Ok(calibration) => return Ok((calibration, remarks)),
                Err(why) => remarks.push(Remark(format!("{}: {why}; measured afresh", file.display()))),
            }
        }
        let calibration = Self::measure()?;
        if calibration.was_busy() {
            remarks.push(Remark(
                "other work kept this machine busy while it was timed, and wall seconds follow that; \
                 --recalibrate when it is idle"
                    .to_owned(),
            ));
        }
        match file.map(|file| calibration.save(&file)) {
            Some(Ok(())) => {}
            Some(Err(error)) => remarks.push(Remark(format!("the calibration is not kept: {error}"))),
            None => remarks.push(Remark(format!("no folder to keep it in; name one in {CACHE_VARIABLE}"))),
        }
        Ok((calibration, remarks))
    }

    /// How the machine does work of `kind`.
    pub fn of(&self, kind: WorkKind) -> Factor {
        self.factors[kind as usize]
    }

    /// Whether the threads got much less than a core each while they were timed.
    fn was_busy(&self) -> bool {
        let threads = self.machine.threads.min(self.machine.cores) as f64;
        self.factors.iter().all(|factor| factor.speed_up < IDLE_SHARE * threads)
    }

    /// The calibration of `machine` in `file`, or why there is none.
    fn load(file: &Path, machine: &Machine) -> Result<Self, String> {
        let text = std::fs::read_to_string(file).map_err(|error| format!("cannot be read ({error})"))?;
        let calibration: Self =
            serde_json::from_str(&text).map_err(|error| format!("is no calibration ({error})"))?;
        let usable = |factor: &Factor| {
            [factor.cpu, factor.speed_up].iter().all(|value| value.is_finite() && *value > 0.0)
        };
        if calibration.machine != *machine {
            return Err("is of another machine or version".to_owned());
        }
        if calibration.over_seconds != MADE_SECONDS {
            return Err("is of another table of costs".to_owned());
        }
        if calibration.measured_at.is_none() || !calibration.factors.iter().all(usable) {
            return Err("has factors that cannot be".to_owned());
        }
        Ok(calibration)
    }

    fn save(&self, file: &Path) -> Result<(), Error> {
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder).map_err(|error| {
                Error::output("the cache folder cannot be made").in_file(folder).caused_by(error)
            })?;
        }
        crate::output::report::write_json(file, self)
    }
}

/// The folder that calibrations are kept in: what [`CACHE_VARIABLE`] names, else `thinlens` in the user's cache folder.
pub fn cache_folder() -> Option<PathBuf> {
    cache_folder_of(std::env::consts::OS, |name| std::env::var_os(name))
}

/// [`cache_folder`] of a system called `os` with the environment `variable`.
fn cache_folder_of(os: &str, variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let path = |name: &str| variable(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(folder) = path(CACHE_VARIABLE) {
        return Some(folder);
    }
    let user = match os {
        "windows" => path("LOCALAPPDATA"),
        "macos" => path("HOME").map(|home| home.join("Library/Caches")),
        // The standard has relative paths ignored.
        _ => path("XDG_CACHE_HOME")
            .filter(|path| path.is_absolute())
            .or_else(|| path("HOME").map(|home| home.join(".cache"))),
    };
    user.map(|folder| folder.join("thinlens"))
}

/// For each kind of work: least processor seconds of the calibration's run, and the speed-up by threads.
///
/// # Errors
/// Those of the methods, which on the CPU have none.
pub fn timed() -> Result<[(WorkKind, f64, f64); KIND_COUNT], Error> {
    let scene = made(SIZE);
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
            // A system that does not tell processor time has all threads at work.
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

/// The method that stands for a kind of work in a calibration, and its views.
fn calibrated_by(kind: WorkKind) -> (&'static str, Option<usize>) {
    match kind {
        WorkKind::Rows => ("shear", Some(16)),
        WorkKind::Rays => ("accumulate", Some(2)),
        WorkKind::Planes => ("opaque-blur", None),
    }
}

/// What a calibration of `kind` runs.
fn settings(kind: WorkKind) -> Settings {
    let (method, views) = calibrated_by(kind);
    let values =
        Values { method: Some(method.to_owned()), effort: views.map(Effort::Views), ..Values::default() };
    Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default())
}

/// Two layers: upright bars before focus over a floor that slants from behind focus to before it, and the floor again.
pub(super) fn made((width, height): (usize, usize)) -> Scene {
    let is_bar = |x: usize| x % 48 < 16;
    let floor = |y: usize| 10.0 - 20.0 * y as f32 / height as f32;
    let texture = |x: usize, y: usize| ((x * 7) ^ (y * 13)) as f32 % 64.0 / 64.0;
    let layer = |is_there: &dyn Fn(usize) -> bool, coc: &dyn Fn(usize, usize) -> f32| {
        let within = |x: usize, value: f32| if is_there(x) { value } else { 0.0 };
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
    fn what_was_kept_is_read_back_as_it_was_and_not_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let invented = invented();
        invented.save(&folder.path().join("deeper").join(invented.machine.file_name())).unwrap();
        let (kept, remarks) =
            Calibration::load_or_measure(Some(&folder.path().join("deeper")), false).unwrap();
        assert_eq!((kept, remarks), (invented, vec![]));
    }

    #[test]
    fn a_file_that_is_no_calibration_of_this_machine_is_measured_afresh_and_said() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(Machine::this().file_name());
        let elsewhere =
            Calibration { machine: Machine { cpu: "another".to_owned(), ..Machine::this() }, ..invented() };
        let still = Factor { cpu: 0.0, speed_up: 1.0 };
        let cannot_be = Calibration { factors: [still; KIND_COUNT], ..invented() };
        let other_table = Calibration { over_seconds: [1.0; KIND_COUNT], ..invented() };
        let json = |value: &Calibration| serde_json::to_string(value).unwrap();
        for (text, why) in [
            ("{ not JSON".to_owned(), "is no calibration"),
            (json(&elsewhere), "another machine"),
            (json(&cannot_be), "cannot be"),
            (json(&other_table), "another table"),
        ] {
            std::fs::write(&file, text).unwrap();
            let (measured, remarks) = Calibration::load_or_measure(Some(folder.path()), false).unwrap();
            assert!(remarks[0].0.contains(why), "{remarks:?}");
            assert!(measured.factors.iter().all(|factor| factor.cpu > 0.0 && factor.speed_up >= 1.0));
            assert_eq!(Calibration::load(&file, &Machine::this()), Ok(measured), "kept in its place");
        }
    }

    #[test]
    fn threads_that_share_one_core_say_that_the_machine_is_busy() {
        let with = |speed_up: [f64; 3]| {
            let machine = Machine { threads: 8, cores: 8, ..Machine::this() };
            let factors = speed_up.map(|speed_up| Factor { cpu: 1.0, speed_up });
            Calibration { machine, factors, ..invented() }.was_busy()
        };
        assert_eq!([with([1.0; 3]), with([1.0, 7.8, 1.0]), with([6.0; 3])], [true, false, false]);
    }

    #[test]
    fn asked_to_it_measures_again() {
        let folder = tempfile::tempdir().unwrap();
        invented().save(&folder.path().join(Machine::this().file_name())).unwrap();
        let (again, _) = Calibration::load_or_measure(Some(folder.path()), true).unwrap();
        assert!(again.measured_at > invented().measured_at);
    }

    #[test]
    fn a_folder_that_takes_no_file_costs_a_calibration_and_not_the_command() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "in the way").unwrap();
        let (measured, remarks) = Calibration::load_or_measure(Some(&file), false).unwrap();
        assert!(measured.measured_at.is_some());
        let says = |remarks: &[Remark], what: &str| remarks.iter().any(|remark| remark.0.contains(what));
        assert!(says(&remarks, "not kept"), "{remarks:?}");
        let (_, remarks) = Calibration::load_or_measure(None, false).unwrap();
        assert!(says(&remarks, CACHE_VARIABLE), "{remarks:?}");
    }

    #[test]
    fn the_cache_folder_is_the_variables_or_the_systems() {
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
