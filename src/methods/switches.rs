//! DECIDE: applies the user's switches of effects by name, which override the plan.

use super::contract::Plan;
use crate::error::Error;
use crate::scene::{EffectKind, SceneStats};
use crate::settings::Switches;

/// The effects that `switches` name, each with whether it is forced on or left out.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for an unknown name and for an effect that is both forced and left out.
pub(crate) fn requested(switches: &Switches) -> Result<Vec<(EffectKind, bool)>, Error> {
    let kinds =
        |names: &[String]| names.iter().map(|name| EffectKind::by_name(name)).collect::<Result<Vec<_>, _>>();
    let (force, without) = (kinds(&switches.force)?, kinds(&switches.without)?);
    if let Some(both) = force.iter().find(|kind| without.contains(kind)) {
        return Err(Error::settings(format!("'{0}' is both forced and left out", both.name()))
            .help(format!("use `force = {0}` or `without = {0}`, not both", both.name())));
    }
    let on = force.into_iter().map(|kind| (kind, true));
    Ok(on.chain(without.into_iter().map(|kind| (kind, false))).collect())
}

/// The switches `over`, and of `under` those that they say nothing of.
pub(crate) fn joined(under: &Switches, over: &Switches) -> Switches {
    let kind = |name: &String| EffectKind::by_name(name).ok();
    let said: Vec<_> = over.force.iter().chain(&over.without).map(kind).collect();
    let rest = |names: &[String], own: &[String]| -> Vec<String> {
        let under = names.iter().filter(|name| !said.contains(&kind(name)));
        under.chain(own).cloned().collect()
    };
    Switches { force: rest(&under.force, &over.force), without: rest(&under.without, &over.without) }
}

/// Applies `switches` to `plan`, for a scene with the statistics `stats`.
///
/// # Errors
/// Those of [`requested`], and an effect that cannot be switched.
pub(super) fn apply(plan: Plan, switches: &Switches, stats: &SceneStats) -> Result<Plan, Error> {
    let switched = requested(switches)?.into_iter().try_fold(plan, |plan, (kind, on)| {
        if plan.does(kind) != on {
            check(kind, on, stats, &plan)?;
        }
        Ok::<_, Error>(plan.forced(kind, on))
    })?;
    Ok(if switched.does(EffectKind::Blur) { switched } else { without_passes(switched) })
}

/// The plan without any pass that requires blur, requested or not: the picture is the input.
fn without_passes(mut plan: Plan) -> Plan {
    for effect in plan.effects.iter_mut().filter(|effect| effect.on && effect.name.requires_blur()) {
        effect.on = false;
        effect.reason = if effect.forced {
            "requested, but off: nothing is blurred; force blur too to enable it".to_owned()
        } else {
            "nothing is blurred: the picture is the input".to_owned()
        };
        effect.change = "it requires blur".to_owned();
    }
    plan.with_lens_effects()
}

/// Checks that `kind`, which is the opposite in `plan`, can be switched.
fn check(kind: EffectKind, on: bool, stats: &SceneStats, plan: &Plan) -> Result<(), Error> {
    let name = kind.name();
    let method = plan.method;
    if on && kind.is_pass() && !method.info().effects.contains(&kind) {
        return Err(Error::settings(format!("'{name}' cannot be forced: {method} has no such pass")).help(
            format!("leave `force = {name}` out, or use a method that has it, such as `method = shear`"),
        ));
    }
    let why = match (kind, on) {
        (EffectKind::Merge, false) => {
            format!(
                "the stack has {0} × {0} samples per pixel, which have to be merged into pixels",
                stats.supersample
            )
        }
        (EffectKind::Merge, true) => {
            "the stack has one sample per pixel: there is nothing to merge".to_owned()
        }
        (EffectKind::Translucency, false) => {
            format!(
                "{} fragments have an alpha below 1, which is part of the stack",
                stats.translucent_fragments
            )
        }
        (EffectKind::Translucency, true) => "no fragment of the stack has an alpha below 1".to_owned(),
        _ => return Ok(()),
    };
    let (done, key) = if on { ("forced", "force") } else { ("left out", "without") };
    Err(Error::settings(format!("'{name}' cannot be {done}: {why}"))
        .help(format!("leave `{key} = {name}` out")))
}
