//! What is decided once for pictures that belong together, and kept for each of them: the frames of a shot.
//!
//! A plan follows the statistics of its own scene. Between two frames that differ little an effect can go on or off, and the number of lens
//! samples can double. Decisions are taken from the plans of some of the pictures ([`Decisions::of`], [`Decisions::join`]), and a job that is
//! pinned to them ([`Decisions::pin`]) has the same in every picture.

use super::job::Job;
use crate::methods::Plan;
use crate::sample_budget::Outcome;
use crate::scene::EffectKind;
use crate::settings::{Effort, Values};
use serde::{Deserialize, Serialize};

/// Key of the parameter that holds the brightness from which on highlights are exact discs, in methods that draw them.
const HIGHLIGHT_THRESHOLD: &str = "highlight_threshold";

/// Decisions for pictures that belong together.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Decisions {
    /// Name of the method; `None` leaves it to the job.
    pub method: Option<String>,
    /// Lens samples per pixel; `None` for a method that does not sample the lens.
    pub views: Option<usize>,
    /// Effects that are on in every picture, in the order of [`EffectKind::ALL`]. No facts of the stack: see [`is_decided`].
    pub force: Vec<EffectKind>,
    /// Brightness from which on highlights are exact discs, in scene-linear units; `None` where there are no such discs, or where the
    /// method has no such parameter.
    pub highlight_threshold: Option<f32>,
}

/// Whether `kind` is a decision: forced on where the scene does not need it, it makes no picture wrong. Samples to merge and translucent
/// fragments are facts of the stack, and the extrapolation of highlights is continuous in the fragments that have them.
fn is_decided(kind: EffectKind) -> bool {
    !matches!(kind, EffectKind::Merge | EffectKind::Translucency | EffectKind::HighlightExtrapolation)
}

impl Decisions {
    /// The decisions of one picture: of its `plan`, with the number of lens samples of `outcome` where that was searched for.
    pub fn of(plan: &Plan, outcome: Option<&Outcome>) -> Self {
        let has_threshold = plan.parameters.table().get(HIGHLIGHT_THRESHOLD).is_some();
        Self {
            method: Some(plan.method.name().to_owned()),
            views: outcome.map(|outcome| outcome.views).or(plan.views),
            force: EffectKind::ALL.into_iter().filter(|kind| is_decided(*kind) && plan.does(*kind)).collect(),
            highlight_threshold: plan.strength(EffectKind::Highlights).filter(|_| has_threshold),
        }
    }

    /// Adds the decisions of another picture: the larger number of lens samples, the effects of both, and the higher threshold, which
    /// keeps the discs of both within their budget. The method stays, where there is one.
    pub fn join(&mut self, other: &Self) {
        if self.method.is_none() {
            self.method.clone_from(&other.method);
        }
        self.views = self.views.max(other.views);
        let both = |kind: &EffectKind| self.force.contains(kind) || other.force.contains(kind);
        self.force = EffectKind::ALL.into_iter().filter(both).collect();
        let higher = |a: f32, b: f32| a.max(b);
        self.highlight_threshold = match (self.highlight_threshold, other.highlight_threshold) {
            (Some(own), Some(others)) => Some(higher(own, others)),
            (own, others) => own.or(others),
        };
    }

    /// `job` with these decisions. What it leaves out by name stays out, and a number of lens samples that its flags set stays.
    #[must_use]
    pub fn pin(&self, job: &Job) -> Job {
        let mut job = job.clone();
        let given = job.flags.effort.filter(|effort| matches!(effort, Effort::Views(_)));
        let left_out = |kind: &EffectKind| {
            job.switches
                .without
                .iter()
                .any(|name| EffectKind::by_name(name).is_ok_and(|other| other == *kind))
        };
        let new: Vec<EffectKind> = self.force.iter().copied().filter(|kind| !left_out(kind)).collect();
        for kind in new {
            if !job
                .switches
                .force
                .iter()
                .any(|name| EffectKind::by_name(name).is_ok_and(|other| other == kind))
            {
                job.switches.force.push(kind.name().to_owned());
            }
        }
        job.flags = Values {
            method: self.method.clone().or(job.flags.method),
            effort: given.or(self.views.map(Effort::Views)).or(job.flags.effort),
            ..job.flags
        };
        // Parameters of later entries outrank those of earlier ones.
        job.parameters.extend(self.highlight_threshold.map(|value| format!("{HIGHLIGHT_THRESHOLD}={value}")));
        job
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::render::{Prepared, prepare_stack};
    use crate::settings::Switches;
    use crate::stack::{Frame, Peel, ReadOptions, Stack};

    /// A stack of one opaque peel, grey, with a light of `brightness` in its middle, and `depth` of all of it.
    fn stack(brightness: f32, depth: f32) -> Stack {
        let color = Plane::from_fn(64, 48, |x, y| if (x, y) == (32, 24) { brightness } else { 0.25 });
        let peel = Peel {
            color: [color.clone(), color.clone(), color],
            alpha: Plane::filled(64, 48, 1.0),
            depth: Plane::filled(64, 48, depth),
        };
        Stack::from_peels(vec![peel], Frame::from_size(64, 48), &ReadOptions::default()).unwrap()
    }

    fn job() -> Job {
        let values = Values {
            focal_length_mm: Some(120.0),
            f_number: Some(1.4),
            focus: Some(crate::settings::Focus::Distance(2.0)),
            method: Some("shear".to_owned()),
            effort: Some(Effort::Views(32)),
            ..Values::default()
        };
        Job { flags: values, ..Job::default() }
    }

    fn prepared(brightness: f32, depth: f32, job: &Job) -> Prepared {
        prepare_stack(stack(brightness, depth), job).unwrap()
    }

    #[test]
    fn a_pinned_job_decides_for_a_dark_frame_what_was_decided_for_a_bright_one() {
        let bright = prepared(50.0, 8.0, &job());
        assert!(bright.plan.does(EffectKind::Highlights), "a light out of focus: {:?}", bright.plan);
        assert!(!prepared(0.25, 8.0, &job()).plan.does(EffectKind::Highlights), "no light");
        let decisions = Decisions::of(&bright.plan, None);
        let pinned = decisions.pin(&job());
        let dark = prepared(0.25, 8.0, &pinned);
        assert_eq!(Decisions::of(&dark.plan, None), decisions, "the same in both frames");
    }

    #[test]
    fn what_the_user_leaves_out_stays_out_and_facts_are_not_forced() {
        let without = Switches { without: vec!["highlights".to_owned()], ..Switches::default() };
        let decisions = Decisions {
            force: vec![EffectKind::Blur, EffectKind::Highlights],
            ..Decisions::of(&prepared(50.0, 8.0, &job()).plan, None)
        };
        let pinned = decisions.pin(&Job { switches: without, ..job() });
        assert_eq!(pinned.switches.force, ["blur"]);
        assert!(!prepared(50.0, 8.0, &pinned).plan.does(EffectKind::Highlights));
    }

    #[test]
    fn joined_decisions_have_the_larger_number_both_sets_of_effects_and_the_higher_threshold() {
        let mut first = Decisions {
            method: Some("shear".to_owned()),
            views: Some(64),
            force: vec![EffectKind::Resolve],
            highlight_threshold: Some(2.0),
        };
        let second = Decisions {
            method: None,
            views: Some(128),
            force: vec![EffectKind::Blur],
            highlight_threshold: Some(3.0),
        };
        first.join(&second);
        let expected = Decisions {
            method: Some("shear".to_owned()),
            views: Some(128),
            force: vec![EffectKind::Blur, EffectKind::Resolve],
            highlight_threshold: Some(3.0),
        };
        assert_eq!(first, expected);
        let mut none = Decisions::default();
        none.join(&expected);
        assert_eq!(none, expected, "nothing was decided before");
    }

    #[test]
    fn decisions_are_read_back_as_written() {
        let decisions = Decisions::of(&prepared(50.0, 8.0, &job()).plan, None);
        let text = toml::to_string(&decisions).unwrap();
        assert_eq!(toml::from_str::<Decisions>(&text).unwrap(), decisions, "{text}");
        assert!(toml::from_str::<Decisions>("numbr = 3").is_err(), "a slip is refused");
    }
}
