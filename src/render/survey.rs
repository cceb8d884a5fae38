//! The first pass over a frame that is rendered in bands: what is decided for the whole of it.
//!
//! Every row is read once, without its surroundings. The statistics of the parts add up to those of the frame, and the plan follows from
//! these as it would from the whole frame: one plan for all bands. The number of lens samples for a target is the largest that any part
//! needs.

use super::job::{self, Job};
use super::{stages, units};
use crate::error::Error;
use crate::finding::Finding;
use crate::lens::{Optics, ThinLens};
use crate::methods::{Plan, Target};
use crate::output::report::StackReport;
use crate::sample_budget::{self, Outcome};
use crate::scene::{DepthInUse, EffectKind, SceneStats};
use crate::settings::{Border, DepthConvention, Focus, Settings};
use crate::stack::{self, Footprint, ReadOptions, Stack, Window};
use std::ops::Range;

/// Rows around a focus point that are read with it: what a stack concludes of a pixel depends on fewer.
const ROWS_AROUND_FOCUS: usize = 32;

/// What is known of a frame after the first pass.
#[derive(Debug)]
pub(super) struct Survey {
    /// Its first rows as read, without peels, with the windows of the whole frame and all findings.
    pub(super) stack: Stack,
    pub(super) summary: StackReport,
    pub(super) settings: Settings,
    pub(super) lens: ThinLens,
    pub(super) plan: Plan,
    /// How the number of lens samples was found, where the plan had a goal instead.
    pub(super) outcome: Option<Outcome>,
    /// How far fragments contribute, in picture pixels.
    pub(super) reach_px: usize,
}

/// The job's stack, cut to `rows`, counted from the top of the data window. Its depth is of the `convention` that other rows of the same
/// frame have, if that is known.
pub(super) fn read_rows(
    job: &Job,
    footprint: &Footprint,
    rows: Range<usize>,
    convention: Option<DepthConvention>,
) -> Result<Stack, Error> {
    // Coordinates are below 2^30: the header guard checks them.
    let y = |row: usize| footprint.top + row as i32;
    let mut options = ReadOptions { rows: Some(y(rows.start)..y(rows.end)), ..job::read_options(job) };
    options.convention = options.convention.or(convention);
    stack::read(&job.sources, &options)
}

/// Surveys the frame of `job` in parts of `rows` rows.
///
/// # Errors
/// Those of reading, of the lens and of the plan; a focus that needs more of the frame than a part.
pub(super) fn survey(job: &Job, footprint: &Footprint, rows: usize) -> Result<Survey, Error> {
    let parts = (0..footprint.height).step_by(rows.max(1));
    let mut parts = parts.map(|top| top..(top + rows).min(footprint.height));
    let first = parts.next().unwrap_or(0..footprint.height);
    let mut stack = read_rows(job, footprint, first, None)?;
    let (settings, of_keys) = job::resolve(job, &stack.camera)?;
    let (lens, of_focus) = focused(job, footprint, (&stack, &settings), rows)?;
    let mut summary = StackReport::from(&stack);
    let mut sum = Sum::of(&mut stack, job, &settings, &lens)?;
    let convention = stack.convention;
    for part in parts {
        let mut stack = read_rows(job, footprint, part, Some(convention))?;
        sum.add(Sum::of(&mut stack, job, &settings, &lens)?);
    }
    stack.findings = sum.findings;
    stack.findings.extend(of_keys.into_iter().chain(of_focus));
    stack.findings.extend(units::doubt(&sum.in_use, &settings, lens.focus_distance));
    stack.findings.extend(stages::default_lens(&stack, &settings));
    stack.frame.data.height = footprint.height;
    (summary.height, summary.antialiased) = (footprint.height, sum.stats.antialiased);
    if settings.picture.border.value == Border::Transparent && sum.reach_px > 0 {
        // Rays that end beyond the frame end in the background.
        sum.stats.background_pixels = sum.stats.background_pixels.max(1);
    }
    let mut plan = job.methods.plan(&sum.stats, &settings)?;
    if let Some(outcome) = &sum.outcome {
        plan = plan.with_views(outcome.views);
        stack.findings.push(outcome.finding());
    }
    let Sum { outcome, reach_px, .. } = sum;
    Ok(Survey { stack, summary, settings, lens, plan, outcome, reach_px })
}

/// What the parts add up to.
struct Sum {
    stats: SceneStats,
    in_use: DepthInUse,
    outcome: Option<Outcome>,
    reach_px: usize,
    findings: Vec<Finding>,
}

impl Sum {
    /// What is known of the part `stack`, whose peels are taken.
    fn of(stack: &mut Stack, job: &Job, settings: &Settings, lens: &ThinLens) -> Result<Self, Error> {
        let mut findings = std::mem::take(&mut stack.findings);
        let in_use = stages::depth_in_use(stack, settings, lens)?;
        let scene = stages::scene(stack, settings, lens)?;
        findings.extend(stages::limited(&scene));
        let astray_px = Optics::new(settings, &scene.field)?.max_displacement_px();
        let (stats, reach_px) = (scene.analyze(), scene.reach_px(astray_px));
        let plan = job.methods.plan(&stats, settings)?;
        let outcome = match plan.target.filter(|_| plan.does(EffectKind::Blur)) {
            Some(Target::Error { psnr_db, max_views }) => {
                Some(sample_budget::find_views(scene, &plan, (psnr_db, max_views))?)
            }
            _ => None,
        };
        Ok(Self { stats, in_use, outcome, reach_px, findings })
    }

    /// Adds the part below. Of findings that differ, the first about a matter stays, and every warning.
    fn add(&mut self, below: Self) {
        self.stats = self.stats.clone().joined(&below.stats);
        self.in_use = self.in_use.joined(below.in_use);
        self.reach_px = self.reach_px.max(below.reach_px);
        let more = |below: &Outcome| self.outcome.as_ref().is_none_or(|own| below.views > own.views);
        if below.outcome.as_ref().is_some_and(more) {
            self.outcome = below.outcome;
        }
        for finding in below.findings {
            let is_known = |known: &Finding| {
                known.about == finding.about && (known.text == finding.text || !finding.warning)
            };
            if !self.findings.iter().any(is_known) {
                self.findings.push(finding);
            }
        }
    }
}

/// The lens of the frame, and what was found of its focus. `stack` are the first rows; as many as are
/// needed to find the focus are read, at most `most_rows`.
fn focused(
    job: &Job,
    footprint: &Footprint,
    (stack, settings): (&Stack, &Settings),
    most_rows: usize,
) -> Result<(ThinLens, Vec<Finding>), Error> {
    let rows = rows_of_focus(&settings.lens.focus.value, stack.frame.display, footprint)?;
    if rows.len() > most_rows {
        return Err(Error::limits(
            "the points of the focus keys lie too far apart for a frame that is rendered in bands",
        )
        .with(
            "found",
            format!("{} rows from the first to the last point, {most_rows} fit into memory", rows.len()),
        )
        .help("give the distances with `focus_distance`, or allow more memory with `memory`"));
    }
    let mut around = read_rows(job, footprint, rows, Some(stack.convention))?;
    let known = around.findings.len();
    let (lens, _) = stages::lens(&mut around, settings, job::frame_number(job))?;
    Ok((lens, around.findings.split_off(known)))
}

/// The rows of samples from which the distance of `focus` is found; `display` is the display window in the files.
///
/// # Errors
/// An object: its distance is the median over all of the picture.
fn rows_of_focus(focus: &Focus, display: Window, footprint: &Footprint) -> Result<Range<usize>, Error> {
    let last = footprint.height.saturating_sub(1);
    let around = |row: f32| {
        let row = row.floor() + display.y as f32 - footprint.top as f32;
        let row = (row.max(0.0) as usize).min(last) / footprint.supersample * footprint.supersample;
        let margin = ROWS_AROUND_FOCUS * footprint.supersample;
        row.saturating_sub(margin)..(row + margin).min(footprint.height)
    };
    match focus {
        Focus::Distance(_) => Ok(around(0.0)),
        Focus::Point([_, y]) => Ok(around(y * footprint.supersample as f32)),
        Focus::Centre => Ok(around(0.5 * display.height as f32)),
        Focus::Object(name) => Err(Error::settings("an object's distance is that of all its pixels, and the frame is rendered in bands")
            .with("found", format!("`focus_object = {name}`"))
            .help("pick a point on it with `focus_point = [X, Y]`, give its distance with `focus_distance`, or allow more memory with `memory`")),
        Focus::Keys(keys) => {
            let rows = keys.iter().map(|key| rows_of_focus(&key.focus, display, footprint));
            let joined = |a: Range<usize>, b: Range<usize>| a.start.min(b.start)..a.end.max(b.end);
            let all = rows.collect::<Result<Vec<_>, Error>>()?;
            Ok(all.into_iter().reduce(joined).unwrap_or_else(|| around(0.0)))
        }
    }
}
