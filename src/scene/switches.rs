//! DECIDE, against the plan: effects that the user asks for by name, or does without.

use super::effects;
use super::plan::{Effect, EffectKind, Plan};
use super::{Abilities, Facts};
use crate::error::Error;
use crate::settings::{ShearParameters, Switches, nearest};

/// The effect called `name`.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for an unknown name, with the nearest known one and all of them.
fn effect_by_name(name: &str) -> Result<EffectKind, Error> {
    EffectKind::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
        let known = EffectKind::ALL.map(EffectKind::name);
        let list = format!("the effects are {}", known.join(", "));
        let help = match nearest(name, &known) {
            Some(near) => format!("did you mean '{near}'? {list}"),
            None => list,
        };
        Error::settings(format!("there is no effect called '{name}'")).help(help)
    })
}

/// The effects of `switches`, each with whether it is to be on.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for an unknown name, and for an effect that is both asked for and left out.
pub fn asked_for(switches: &Switches) -> Result<Vec<(EffectKind, bool)>, Error> {
    let kinds =
        |names: &[String]| names.iter().map(|name| effect_by_name(name)).collect::<Result<Vec<_>, _>>();
    let (force, without) = (kinds(&switches.force)?, kinds(&switches.without)?);
    if let Some(both) = force.iter().find(|kind| without.contains(kind)) {
        return Err(Error::settings(format!("'{0}' is both forced and left out", both.name()))
            .help(format!("give --force {0} or --without {0}, not both", both.name())));
    }
    let on = force.into_iter().map(|kind| (kind, true));
    Ok(on.chain(without.into_iter().map(|kind| (kind, false))).collect())
}

impl Plan {
    /// The plan with what `switches` ask of a method with these `abilities`, for a scene that shows `facts`.
    ///
    /// # Errors
    /// Those of [`asked_for`], and an effect that cannot be switched.
    pub(super) fn switched(
        self,
        switches: &Switches,
        facts: &Facts,
        abilities: &Abilities,
    ) -> Result<Self, Error> {
        let switched = asked_for(switches)?.into_iter().try_fold(self, |plan, (kind, on)| {
            if plan.does(kind) != on {
                check(kind, on, facts, abilities)?;
            }
            Ok::<_, Error>(plan.forced(kind, on))
        })?;
        Ok(if switched.does(EffectKind::Blur) { switched } else { switched.without_steps() })
    }

    /// The plan of a picture that is the input: no step is taken, not even one that was asked for.
    fn without_steps(mut self) -> Self {
        for effect in self.effects.iter_mut().filter(|effect| effect.on && effect.name.goes_with_blur()) {
            effect.on = false;
            effect.reason = if effect.forced {
                "asked for, and yet off: nothing is blurred; force blur too to have it".to_owned()
            } else {
                "nothing is blurred: the picture is the input".to_owned()
            };
            effect.change = "it goes with blur".to_owned();
        }
        self.outlined()
    }

    /// The same plan with `kind` switched on or off, whatever the facts say. What has a strength of 0 gets its default.
    #[must_use]
    pub fn forced(mut self, kind: EffectKind, on: bool) -> Self {
        self.effects.iter_mut().filter(|effect| effect.name == kind).for_each(|effect| effect.ask(on));
        let (own, default) = (&mut self.parameters.shear, ShearParameters::default());
        match kind {
            EffectKind::Prefilter if on && own.prefilter <= 0.0 => own.prefilter = default.prefilter,
            EffectKind::Resolve if on && own.resolve <= 0.0 => own.resolve = default.resolve,
            EffectKind::Highlights if on && self.highlight_threshold.is_infinite() => {
                self.highlight_threshold = effects::highlight_threshold(&self.parameters);
            }
            _ => {}
        }
        self.outlined()
    }
}

/// Checks that `kind`, which the plan has the other way, can be switched.
fn check(kind: EffectKind, on: bool, facts: &Facts, abilities: &Abilities) -> Result<(), Error> {
    let name = kind.name();
    if on && kind.is_step() && !abilities.effects.contains(&kind) {
        return Err(Error::settings(format!(
            "'{name}' cannot be forced: {} has no such step",
            abilities.method
        ))
        .help(format!(
            "leave --force {name} out, or name a method that has it, such as shear, with --method"
        )));
    }
    let why = match (kind, on) {
        (EffectKind::Merge, false) => {
            format!("the stack has {0} × {0} samples a pixel, which are no picture pixels", facts.supersample)
        }
        (EffectKind::Merge, true) => "the stack has one sample a pixel: there is nothing to merge".to_owned(),
        (EffectKind::Translucency, false) => {
            format!(
                "{} fragments have an alpha below 1, which is part of the stack",
                facts.translucent_fragments
            )
        }
        (EffectKind::Translucency, true) => "no fragment of the stack has an alpha below 1".to_owned(),
        _ => return Ok(()),
    };
    let (done, flag) = if on { ("forced", "--force") } else { ("left out", "--without") };
    Err(Error::settings(format!("'{name}' cannot be {done}: {why}")).help(format!("leave {flag} {name} out")))
}

impl Effect {
    /// Switches it, on the user's word.
    fn ask(&mut self, on: bool) {
        let own = if self.on { "on" } else { "off" };
        let also = if self.on == on { "also " } else { "" };
        if !self.forced {
            self.reason = format!("asked for; the plan's own choice was {also}{own}: {}", self.reason);
        }
        (self.on, self.forced) = (on, true);
    }
}
