//! The terms of a plan: the effects, and the decision about one of them.

use crate::error::Error;
use crate::settings::nearest;

/// What switching an effect on would change, where its strength is 0.
pub(super) const NO_EFFECT: &str = "with it, no effect";

/// An effect that a plan switches on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum EffectKind {
    /// Any blur at all; off, the picture is the input.
    Blur,
    /// Samples of a supersampled stack merged into coverage peels.
    Merge,
    /// Highlights of a source that ends at white made brighter: an estimate of the light that was clipped.
    HighlightExtrapolation,
    /// Exact discs for bright fragments.
    Highlights,
    /// Disocclusion fill: surfaces estimated where the stack has none.
    Fill,
    /// Fragments with an alpha below 1.
    Translucency,
    /// Transparent background: lens rays that end in the background make the picture transparent.
    #[serde(rename = "open-background")]
    TransparentBackground,
    /// Reflections that the lens moves: mirrors are focused at what they show.
    Reflections,
    /// Reflections of an environment, shaded anew for each point of the lens.
    Environment,
    /// Smoothing over the gaps between lens samples.
    Prefilter,
    /// Anti-aliasing of point-sampled, in-focus pixels.
    Resolve,
    /// Curved sides of the aperture.
    BladeCurvature,
    /// An anamorphic aperture, narrower than high.
    Squeeze,
    /// An aperture with the shape of a picture.
    ApertureImage,
    /// A lens barrel that cuts into the aperture towards the frame's corners.
    CatsEye,
    /// An aperture whose edge focuses at another distance than its centre.
    SphericalAberration,
    /// Red and blue that focus at another distance than green.
    AxialColor,
    /// Red and blue pictures of another size than the green one.
    LateralColor,
    /// Corners that are darker than the centre.
    Vignetting,
}

/// Another name of [`EffectKind::TransparentBackground`].
const TRANSPARENT_BACKGROUND: &str = "transparent-background";

impl EffectKind {
    /// Every effect, in the order of plans.
    pub const ALL: [Self; 19] = [
        Self::Blur,
        Self::Merge,
        Self::HighlightExtrapolation,
        Self::Highlights,
        Self::Fill,
        Self::Translucency,
        Self::TransparentBackground,
        Self::Reflections,
        Self::Environment,
        Self::Prefilter,
        Self::Resolve,
        Self::BladeCurvature,
        Self::Squeeze,
        Self::ApertureImage,
        Self::CatsEye,
        Self::SphericalAberration,
        Self::AxialColor,
        Self::LateralColor,
        Self::Vignetting,
    ];

    /// Its name in reports, presets and flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blur => "blur",
            Self::Merge => "merge",
            Self::HighlightExtrapolation => "highlight-extrapolation",
            Self::Highlights => "highlights",
            Self::Fill => "fill",
            Self::Translucency => "translucency",
            Self::TransparentBackground => "open-background",
            Self::Reflections => "reflections",
            Self::Environment => "environment",
            Self::Prefilter => "prefilter",
            Self::Resolve => "resolve",
            Self::BladeCurvature => "blade-curvature",
            Self::Squeeze => "squeeze",
            Self::ApertureImage => "aperture-image",
            Self::CatsEye => "cats-eye",
            Self::SphericalAberration => "spherical-aberration",
            Self::AxialColor => "axial-color",
            Self::LateralColor => "lateral-color",
            Self::Vignetting => "vignetting",
        }
    }

    /// The effect called `name`; `transparent-background` is another name of [`Self::TransparentBackground`].
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for an unknown name, with the nearest known one and all of them.
    pub fn by_name(name: &str) -> Result<Self, Error> {
        if name == TRANSPARENT_BACKGROUND {
            return Ok(Self::TransparentBackground);
        }
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name);
            let list = format!("the effects are {}", known.join(", "));
            let names = [&known[..], &[TRANSPARENT_BACKGROUND]].concat();
            let help = match nearest(name, &names) {
                Some(near) => format!("did you mean '{near}'? {list}"),
                None => list,
            };
            Error::settings(format!("there is no effect called '{name}'")).help(help)
        })
    }

    /// Whether it is a pass that only some methods have.
    pub fn is_pass(self) -> bool {
        match self {
            Self::Blur
            | Self::HighlightExtrapolation
            | Self::Translucency
            | Self::TransparentBackground
            | Self::LateralColor
            | Self::Vignetting => false,
            Self::Merge
            | Self::Highlights
            | Self::Fill
            | Self::Reflections
            | Self::Environment
            | Self::Prefilter
            | Self::Resolve
            | Self::BladeCurvature
            | Self::Squeeze
            | Self::ApertureImage
            | Self::CatsEye
            | Self::SphericalAberration
            | Self::AxialColor => true,
        }
    }

    /// Whether it has no effect where nothing is blurred.
    pub fn requires_blur(self) -> bool {
        self.is_pass() || self == Self::HighlightExtrapolation
    }
}

/// One decision, with its reason.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Effect {
    /// Which effect.
    pub name: EffectKind,
    /// Whether it will be simulated.
    pub on: bool,
    /// The reason, with numbers.
    pub reason: String,
    /// What the opposite choice would change, with a number where the statistics have one.
    pub change: String,
    /// Whether the user requested this choice; otherwise it is the plan's own.
    pub forced: bool,
    /// The number that the effect uses when it is on, where it has one: a strength, a weight or a threshold.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strength: Option<f32>,
    /// The number that it uses when it is forced on, where that is another one.
    #[serde(skip)]
    pub(crate) strength_if_forced: Option<f32>,
}

impl Effect {
    /// A decision by the plan itself.
    pub fn new(name: EffectKind, on: bool, reason: impl Into<String>, change: impl Into<String>) -> Self {
        let (reason, change) = (reason.into(), change.into());
        Self { name, on, reason, change, forced: false, strength: None, strength_if_forced: None }
    }

    /// The decision with the number that the effect uses.
    #[must_use]
    pub fn with_strength(self, strength: f32) -> Self {
        Self { strength: Some(strength), ..self }
    }

    /// The decision with the number that the effect uses if it is forced on.
    #[must_use]
    pub(crate) fn with_strength_if_forced(self, strength: f32) -> Self {
        Self { strength_if_forced: Some(strength), ..self }
    }

    /// Switches it at the user's request.
    pub(crate) fn force(&mut self, on: bool) {
        let own = if self.on { "on" } else { "off" };
        let also = if self.on == on { "also " } else { "" };
        if !self.forced {
            self.reason = format!("requested; the plan's own choice was {also}{own}: {}", self.reason);
        }
        (self.on, self.forced) = (on, true);
        self.strength = self.strength_if_forced.filter(|_| on).or(self.strength);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_is_known_by_its_names_and_a_slip_by_the_nearest() {
        for kind in EffectKind::ALL {
            assert_eq!(EffectKind::by_name(kind.name()).unwrap(), kind);
        }
        let alias = EffectKind::by_name("transparent-background").unwrap();
        assert_eq!((alias, alias.name()), (EffectKind::TransparentBackground, "open-background"));
        for (slip, near) in
            [("transparent-backgrounds", "transparent-background"), ("pre-filter", "prefilter")]
        {
            let error = EffectKind::by_name(slip).unwrap_err().to_string();
            assert!(error.contains(&format!("did you mean '{near}'?")), "{error}");
        }
    }
}
