//! `thinlens plan`.

use super::args::JobArgs;
use super::console::{Console, print, print_json};
use super::drivers::prepare;
use super::failure::Failure;
use super::flags::keys_to_flags;
use super::inspect::{write_device, write_peels, write_plan};
use super::sequence::{self, FramesArgs};
use clap::Args;
use serde::Serialize;
use serde_json::json;
use std::fmt::{self, Write};
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use thinlens::compare::Candidate;
use thinlens::cost::{Calibration, Prediction, predict};
use thinlens::error::Error;
use thinlens::methods::{Method, Plan, Registry};
use thinlens::output::atomic;
use thinlens::probes::{ErrorEstimate, ProbeSet};
use thinlens::render::{Job, Prepared};
use thinlens::scene::EffectKind;
use thinlens::settings::{Origin, Settings, Sourced};
use thinlens::stack::Carry;

const EXAMPLES: &str = "\
Examples:
  thinlens plan stack.exr --preset portrait --focus 6
  thinlens plan stack.exr --preset portrait --focus 6 --all-methods
  thinlens plan stack.exr --preset portrait --method gather --views 256 --json";

/// Show what will be simulated, why, and what it will cost
///
/// The cost is the predicted time of the blur on the CPU, without reading and writing: for the requested settings, and for each quality
/// level of the method, from coarse to fine. If the method can render single pixels, the sampling error is measured at 400 pixels
/// and printed beside it. The first call times this machine for less than a second and stores the result in the user's cache
/// folder, or in the folder that `THINLENS_CACHE_DIR` names.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct PlanArgs {
    #[command(flatten)]
    job: JobArgs,
    #[command(flatten)]
    frames: FramesArgs,
    /// Show the cost of every method
    #[arg(long, help_heading = "Method")]
    all_methods: bool,
    /// Time this machine again
    #[arg(long, help_heading = "Method")]
    recalibrate: bool,
    /// Do not time this machine; use the table's costs
    #[arg(long, help_heading = "Method", conflicts_with = "recalibrate")]
    uncalibrated: bool,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// Number of pixels at which sampling errors are measured.
const PROBES: usize = 400;

/// The predicted cost and the sampling error of one setting.
#[derive(Debug, Serialize)]
struct Row {
    /// The setting in the syntax of `compare --methods`.
    name: String,
    method: &'static str,
    views: Option<usize>,
    /// Whether a render with these flags would use this setting.
    chosen: bool,
    /// `None` for a method without a cost model.
    #[serde(flatten)]
    cost: Option<Prediction>,
    /// Error against many lens rays through the stack; `None` for a method that cannot render single pixels.
    sampling_error: Option<ErrorEstimate>,
}

pub(super) fn run(args: &PlanArgs, console: &Console, methods: &Registry) -> Result<(), Failure> {
    let job = Job { methods: methods.clone(), ..args.job.job(Carry::None)? };
    if let Some(shot) = args.frames.shot(args.job.inputs(), false)? {
        let calibration = args.calibration(*console)?;
        return sequence::plan(&shot, &job, &args.frames, (*console, &calibration, args.json));
    }
    let mut prepared = prepare(&job.held()?)?;
    console.findings(&prepared.stack.findings);
    let calibration = args.calibration(*console)?;
    prepared.decide_views(&calibration)?;
    let rows = rows(&prepared, &calibration, args.all_methods)?;
    if args.json {
        print_json(&json!({
            "plan": prepared.plan,
            "device": prepared.device,
            "peels": prepared.stats.peels,
            "costs": rows,
            "calibrated": calibration.measured_at.is_some(),
            "calibration": calibration,
        }))?;
    } else {
        print(&keys_to_flags(&to_text(&prepared, &rows, &calibration).expect("text is always written")))?;
    }
    Ok(())
}

impl PlanArgs {
    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        self.frames.decisions.iter().filter_map(|file| atomic::temporary_folder(file)).collect()
    }

    /// The speed of this machine, as these flags want to know it.
    fn calibration(&self, console: Console) -> Result<Calibration, Error> {
        if self.uncalibrated { Ok(Calibration::assumed()) } else { console.calibration(self.recalibrate) }
    }
}

/// The requested settings, and the quality levels of their method or of every method.
fn rows(prepared: &Prepared, calibration: &Calibration, all_methods: bool) -> Result<Vec<Row>, Error> {
    let Prepared { scene, stats, plan, .. } = prepared;
    let probes = plan.does(EffectKind::Blur).then(|| ProbeSet::new(scene, plan, PROBES).filled());
    let chosen = prepared.methods.iter().filter(|method| all_methods || *method == plan.method);
    let mut rows = Vec::new();
    for method in chosen {
        let mut levels = quality_levels(method, prepared)?;
        if method == plan.method && !levels.iter().any(|(_, level)| is_same(level, plan)) {
            levels.insert(0, (setting_name(plan), plan.clone()));
        }
        for (name, level) in levels {
            rows.push(Row {
                name,
                method: level.method.name(),
                views: level.views,
                chosen: is_same(&level, plan),
                cost: predict(stats, &level, calibration),
                sampling_error: probes.as_ref().and_then(|probes| probes.predict(&level)),
            });
        }
    }
    Ok(rows)
}

/// The quality levels of `method`, each with its plan.
fn quality_levels(method: &'static dyn Method, prepared: &Prepared) -> Result<Vec<(String, Plan)>, Error> {
    let Prepared { settings, stats, methods, .. } = prepared;
    // A quality level has its own number of views, which the requested one must not override.
    let effort = Sourced { value: None, origin: Origin::Default };
    let settings = Settings { effort, ..settings.clone() };
    let plan = |level: &Candidate| methods.plan(stats, &level.settings(&settings)?);
    Candidate::quality_levels(method)?.iter().map(|level| Ok((level.to_string(), plan(level)?))).collect()
}

/// Whether two plans do the same work.
fn is_same(a: &Plan, b: &Plan) -> bool {
    a.method == b.method && a.views == b.views && a.parameters == b.parameters
}

/// The name of settings that are not a quality level.
fn setting_name(plan: &Plan) -> String {
    match plan.views {
        Some(views) => format!("{}:{views}", plan.method),
        None => plan.method.to_string(),
    }
}

fn to_text(prepared: &Prepared, rows: &[Row], calibration: &Calibration) -> Result<String, fmt::Error> {
    let mut text = String::new();
    write_peels(&mut text, &prepared.stats.peels)?;
    write_plan(&mut text, &prepared.plan)?;
    write_device(&mut text, &prepared.device)?;
    writeln!(text, "predicted cost of the blur, on the CPU")?;
    writeln!(text, "  {:<42}{:>9}{:>9}  sampling error, 95 % interval", "settings", "CPU s", "wall s")?;
    for Row { name, chosen, cost, sampling_error, .. } in rows {
        let star = if *chosen { '*' } else { ' ' };
        let error = sampling_error.map_or_else(|| "-".to_owned(), |error| error.summary());
        let [cpu, wall] = match cost {
            Some(cost) => [cost.cpu_seconds, cost.seconds].map(|seconds| format!("{seconds:.3}")),
            None => ["?", "?"].map(str::to_owned),
        };
        writeln!(text, "{star} {name:<42}{cpu:>9}{wall:>9}  {error}")?;
    }
    writeln!(text, "* the requested settings")?;
    if rows.iter().any(|row| row.sampling_error.is_none()) {
        writeln!(
            text,
            "- not measured: the method renders whole pictures only; `thinlens compare` measures its error"
        )?;
    }
    writeln!(text, "{}", provenance(calibration))?;
    Ok(text)
}

/// Whether the predictions are calibrated for this machine, and how old the calibration is.
fn provenance(calibration: &Calibration) -> String {
    let Calibration { machine, measured_at, .. } = calibration;
    let machine_name = format!("{}, {} threads", machine.cpu, machine.threads);
    match measured_at {
        None => format!(
            "not calibrated: this machine ({machine_name}) is assumed to be as fast as the one where the costs were measured"
        ),
        Some(at) => {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            let ago = in_words(now.saturating_sub(Duration::from_secs(*at)));
            format!(
                "calibrated for this machine ({machine_name}) by timing three methods on a synthetic scene, {ago}; \
                 --recalibrate repeats it"
            )
        }
    }
}

/// `age` in its largest unit.
fn in_words(age: Duration) -> String {
    let seconds = age.as_secs();
    let units = [("day", 86_400), ("hour", 3600), ("minute", 60)];
    let count =
        units.into_iter().map(|(unit, length)| (unit, seconds / length)).find(|(_, count)| *count > 0);
    match count {
        None => "just now".to_owned(),
        Some((unit, 1)) => format!("1 {unit} ago"),
        Some((unit, count)) => format!("{count} {unit}s ago"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_age_is_printed_in_its_largest_unit() {
        let words = |seconds| in_words(Duration::from_secs(seconds));
        assert_eq!(words(59), "just now");
        assert_eq!(words(60), "1 minute ago");
        assert_eq!(words(3 * 3600 + 5), "3 hours ago");
        assert_eq!(words(2 * 86_400), "2 days ago");
    }
}
