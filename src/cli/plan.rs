//! `thinlens plan`.

use super::args::JobArgs;
use super::console::{Console, print, print_json};
use super::drivers::prepare;
use super::failure::Failure;
use super::flags::spoken;
use super::inspect::{write_device, write_peels, write_plan};
use clap::Args;
use serde::Serialize;
use serde_json::json;
use std::fmt::{self, Write};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use thinlens::compare::Candidate;
use thinlens::cost::{Calibration, Prediction, predict};
use thinlens::error::Error;
use thinlens::methods::{Method, Plan, Registry, Target};
use thinlens::probes::{ErrorEstimate, MANY_RAYS, ProbeSites, Probes, SEED, with_fill};
use thinlens::render::{Job, Prepared};
use thinlens::sample_budget;
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
/// The cost is that of the blur alone on the CPU, without reading and writing: of the settings asked for, and of the method's steps from
/// rough to fine. Beside it stands how far each is from the stack's truth, where the method can be asked for single pixels, from 400
/// of them. The first call times this machine for less than a second and keeps what it finds in the user's cache
/// folder, or in the one that `THINLENS_CACHE_DIR` names.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct PlanArgs {
    #[command(flatten)]
    job: JobArgs,
    /// Show the cost of every method, not of one alone
    #[arg(long, help_heading = "Method")]
    all_methods: bool,
    /// Time this machine again
    #[arg(long, help_heading = "Method")]
    recalibrate: bool,
    /// Do not time this machine: take it to be the table's
    #[arg(long, help_heading = "Method", conflicts_with = "recalibrate")]
    uncalibrated: bool,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// Pixels at which errors are looked for.
const PROBES: usize = 400;

/// What is expected of one setting.
#[derive(Debug, Serialize)]
struct Row {
    /// The setting as `compare` names it.
    name: String,
    method: &'static str,
    views: Option<usize>,
    /// Whether it is what a render with these flags would do.
    chosen: bool,
    /// None for a method that does not say its cost.
    #[serde(flatten)]
    cost: Option<Prediction>,
    /// How far it is from the stack's truth; none for a method that cannot be asked for single pixels.
    sampling_error: Option<ErrorEstimate>,
}

pub(super) fn run(args: &PlanArgs, console: &Console, methods: &Registry) -> Result<(), Failure> {
    let mut prepared = prepare(&Job { methods: methods.clone(), ..args.job.job(Carry::None)? })?;
    console.findings(&prepared.stack.findings);
    let calibration = match args.uncalibrated {
        true => Calibration::assumed(),
        false => console.calibration(args.recalibrate)?,
    };
    decide_views(&mut prepared, &calibration)?;
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
        print(&spoken(&to_text(&prepared, &rows, &calibration).expect("text is always written")))?;
    }
    Ok(())
}

/// Finds the number of lens samples where the plan has a goal instead, as a render would.
fn decide_views(prepared: &mut Prepared, calibration: &Calibration) -> Result<(), Error> {
    let Prepared { scene, stats, plan, .. } = prepared;
    let (views, reason) = match plan.target.filter(|_| plan.does(EffectKind::Blur)) {
        None => return Ok(()),
        Some(Target::Error { psnr_db, max_views }) => {
            let outcome = sample_budget::find_views(scene.clone(), plan, (psnr_db, max_views))?;
            (outcome.views, outcome.statement)
        }
        Some(Target::Time { seconds }) => {
            let views = sample_budget::views_within(stats, plan, seconds, calibration)?;
            (views, format!("as many as are expected to fit into {seconds} s"))
        }
    };
    *plan = Plan { views_reason: reason, ..plan.with_views(views) };
    Ok(())
}

/// The settings asked for, and the steps of their method or of every method.
fn rows(prepared: &Prepared, calibration: &Calibration, all_methods: bool) -> Result<Vec<Row>, Error> {
    let Prepared { scene, stats, plan, .. } = prepared;
    let filled = with_fill(scene, plan);
    let probes = plan
        .does(EffectKind::Blur)
        .then(|| Probes::new(ProbeSites::new(&filled, plan, PROBES, SEED), MANY_RAYS));
    let chosen = prepared.methods.iter().filter(|method| all_methods || *method == plan.method);
    let mut rows = Vec::new();
    for method in chosen {
        let mut of_method = steps(method, prepared)?;
        if method == plan.method && !of_method.iter().any(|(_, step)| is_same(step, plan)) {
            of_method.insert(0, (asked_for(plan), plan.clone()));
        }
        for (name, step) in of_method {
            let foreseen = probes.as_ref().map(|probes| probes.predict(scene, &step)).transpose()?;
            rows.push(Row {
                name,
                method: step.method.name(),
                views: step.views,
                chosen: is_same(&step, plan),
                cost: predict(stats, &step, calibration),
                sampling_error: foreseen.flatten(),
            });
        }
    }
    Ok(rows)
}

/// The steps of `method`, each with its plan.
fn steps(method: &'static dyn Method, prepared: &Prepared) -> Result<Vec<(String, Plan)>, Error> {
    let Prepared { settings, stats, methods, .. } = prepared;
    // A step says its own number of views; the requested one is another method's, or no step.
    let effort = Sourced { value: None, origin: Origin::Default };
    let settings = Settings { effort, ..settings.clone() };
    let plan = |step: &Candidate| methods.plan(stats, &step.settings(&settings)?);
    Candidate::steps_of(method)?.iter().map(|step| Ok((step.to_string(), plan(step)?))).collect()
}

/// Whether two plans have the same work done.
fn is_same(a: &Plan, b: &Plan) -> bool {
    a.method == b.method && a.views == b.views && a.parameters == b.parameters
}

/// The name of settings that are no step.
fn asked_for(plan: &Plan) -> String {
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
    writeln!(text, "expected of the blur, on the CPU")?;
    writeln!(text, "  {:<42}{:>9}{:>9}  sampling error, 95 % certainty", "settings", "CPU s", "wall s")?;
    for Row { name, chosen, cost, sampling_error, .. } in rows {
        let star = if *chosen { '*' } else { ' ' };
        let error = sampling_error.map_or_else(|| "-".to_owned(), |error| error.summary());
        let [cpu, wall] = match cost {
            Some(cost) => [cost.cpu_seconds, cost.seconds].map(|seconds| format!("{seconds:.3}")),
            None => ["?", "?"].map(str::to_owned),
        };
        writeln!(text, "{star} {name:<42}{cpu:>9}{wall:>9}  {error}")?;
    }
    writeln!(text, "* as asked for")?;
    if rows.iter().any(|row| row.sampling_error.is_none()) {
        writeln!(text, "- paints its picture as a whole: `thinlens compare` measures its error")?;
    }
    writeln!(text, "{}", provenance(calibration))?;
    Ok(text)
}

/// Whether the figures hold for this machine, and since when.
fn provenance(calibration: &Calibration) -> String {
    let Calibration { machine, measured_at, .. } = calibration;
    let machine_name = format!("{}, {} threads", machine.cpu, machine.threads);
    match measured_at {
        None => format!(
            "not calibrated: this machine ({machine_name}) is taken to be as fast as the one where the costs were measured"
        ),
        Some(at) => {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            let ago = in_words(now.saturating_sub(Duration::from_secs(*at)));
            format!(
                "calibrated for this machine ({machine_name}) by timing three methods on a made scene, {ago}; \
                 --recalibrate does it again"
            )
        }
    }
}

/// How long ago something was.
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
    fn an_age_is_said_in_its_largest_unit() {
        let words = |seconds| in_words(Duration::from_secs(seconds));
        assert_eq!(words(59), "just now");
        assert_eq!(words(60), "1 minute ago");
        assert_eq!(words(3 * 3600 + 5), "3 hours ago");
        assert_eq!(words(2 * 86_400), "2 days ago");
    }
}
