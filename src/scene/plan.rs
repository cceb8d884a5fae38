//! DECIDE: what will be simulated, what will not, and why.

use super::effects::{self, Given};
use super::sampling::{Goal, Sampling};
use super::{Extrapolation, Facts, bright_step_floor};
use crate::error::Error;
use crate::lens::Optics;
use crate::settings::{MethodParameters, Settings};
use crate::stack::StackKind;

/// An effect that a plan switches on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectKind {
    /// Any blur at all; off, the picture is the input.
    Blur,
    /// Samples of a supersampled stack gathered into coverage peels.
    Merge,
    /// Light that a source which ends at white has lost, guessed.
    HighlightExtrapolation,
    /// Exact discs for bright fragments.
    Highlights,
    /// Guessed surfaces where the stack knows of none.
    Fill,
    /// Fragments that let light through.
    Translucency,
    /// Background through which the output stays transparent.
    OpenBackground,
    /// Smoothing over the gaps between lens samples.
    Prefilter,
    /// Anti-aliasing of point-sampled, in-focus pixels.
    Resolve,
    /// Sides of the aperture that bulge.
    BladeCurvature,
    /// An aperture that is narrower than high.
    Squeeze,
    /// An aperture with the shape of a picture.
    ApertureImage,
    /// A rim that cuts into the aperture towards the frame's corners.
    CatsEye,
    /// An aperture whose edge focuses elsewhere than its middle.
    SphericalAberration,
    /// Red and blue that focus elsewhere than green.
    AxialColor,
    /// Red and blue pictures larger or smaller than that of green.
    LateralColor,
    /// Corners that are darker than the middle.
    Vignetting,
}

/// One decision, with its reason in words and numbers.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Effect {
    /// Which effect.
    pub name: EffectKind,
    /// Whether it will be simulated.
    pub on: bool,
    /// Why.
    pub reason: String,
    /// What the choice that was not the plan's own would change, with a number where the facts have one.
    pub change: String,
    /// Whether the user asked for it, instead of the plan.
    pub forced: bool,
}

/// What a plan must know of the method that is to carry it out.
#[derive(Debug, Clone, Copy)]
pub struct Abilities {
    /// Name of the method.
    pub method: &'static str,
    /// The steps beside the blur itself that the method has.
    pub effects: &'static [EffectKind],
    /// Lens samples a pixel that its parameters ask for; `None` for a method that does not sample the lens.
    pub lens_samples: Option<usize>,
    /// Whether it can look for the number of lens samples that reaches a [`Goal`].
    pub seeks: bool,
}

/// What a method is to do: a pure function of facts and settings, and the only thing it reads beside the scene.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Plan {
    /// Name of the method.
    pub method: &'static str,
    /// Why this method.
    pub method_reason: String,
    /// Lens samples a pixel; `None` for a method that does not sample the lens. Where there is a goal, the method's own number until
    /// the one that reaches it is found.
    pub views: Option<usize>,
    /// What the number of views is to reach, where it is not given.
    pub goal: Option<Goal>,
    /// Why this number of views, or this goal.
    pub views_reason: String,
    /// Where in the pixel the views lie, as a share of its width: 1 for samples at points, less for colours that are
    /// averages over the pixel already.
    pub jitter: f32,
    /// Width of the square that a fragment stands for, in picture pixels; 0 when its colour is an average over the pixel,
    /// which has softened every edge already.
    pub fragment_px: f32,
    /// What rays know of the lens beside its focus: the aperture's shape, what cuts it off, aberrations.
    pub optics: Optics,
    /// The same with all that was asked for, whether it shows or not.
    #[serde(skip)]
    pub optics_asked_for: Optics,
    /// Smallest and largest signed CoC radius in picture pixels.
    pub coc_range_px: [f32; 2],
    /// Brightness from which a fragment is drawn as an exact disc; infinite when none is.
    pub highlight_threshold: f32,
    /// How highlights are extrapolated, where they are.
    pub extrapolation: Extrapolation,
    /// Every effect, on or off.
    pub effects: Vec<Effect>,
    /// The methods' own parameters.
    pub parameters: MethodParameters,
}

impl Plan {
    /// The most lens samples a pixel: the error of this many is below what a half float can hold.
    pub const MAX_VIEWS: usize = 1 << 16;

    /// Decides what a method with these `abilities` is to do about a scene that shows `facts` under `settings`.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for an aperture that cannot be, a parameter of the method or of extrapolated
    /// highlights out of its range, a number of views out of range, and an effect asked for that is not known or cannot be switched.
    pub fn decide(facts: &Facts, settings: &Settings, abilities: Abilities) -> Result<Self, Error> {
        let parameters = settings.parameters.clone();
        parameters.check(abilities.method)?;
        let Sampling { views, goal, reason: views_reason } = Sampling::decide(settings, abilities)?;
        let method_reason = match settings.method.value.as_str() {
            "auto" => "auto: nothing known is as accurate in as little time".to_owned(),
            _ => format!("asked for by {}", settings.method.origin),
        };
        let wanted = parameters.shear.highlight_threshold;
        if wanted != 0.0 && wanted.is_nan() | (wanted < bright_step_floor(0)) {
            return Err(Error::settings(
                "a highlight is brighter than white: its threshold must be 1 or more, or 0 for none",
            )
            .with("found", wanted.to_string())
            .help("set highlight_threshold in the preset's [method.shear]"));
        }
        let jitter = if facts.kind == StackKind::PointSampled { 1.0 } else { 0.5 };
        let settled = if goal.is_none() { views } else { None };
        let optics = Optics::new(settings, &facts.field)?;
        let extrapolation = Extrapolation::new(&settings.picture)?;
        let given =
            Given { facts, parameters: &parameters, views: settled, jitter, optics: &optics, extrapolation };
        let (highlight_threshold, effects) = effects::decide(&given, &abilities);
        let plan = Self {
            method: abilities.method,
            method_reason,
            views,
            goal,
            views_reason,
            jitter,
            fragment_px: match facts.kind {
                StackKind::PointSampled | StackKind::Supersampled => 1.0 / facts.supersample as f32,
                StackKind::BeautyDepth | StackKind::Coverage | StackKind::RendererAntialiased => 0.0,
            },
            optics: optics.clone(),
            optics_asked_for: optics,
            coc_range_px: facts.coc_range_px,
            highlight_threshold,
            extrapolation,
            effects,
            parameters,
        };
        plan.outlined().switched(&settings.switches, facts, &abilities)
    }

    /// Lens samples a pixel, for a method that samples the lens.
    ///
    /// # Panics
    /// If the plan is for one that does not.
    pub fn lens_samples(&self) -> usize {
        self.views.expect("a plan for a method that samples the lens says how often")
    }

    /// Whether the plan asks for `kind`.
    pub fn does(&self, kind: EffectKind) -> bool {
        self.effects.iter().any(|effect| effect.name == kind && effect.on)
    }

    /// The plan with the lens as its effects have it.
    pub(super) fn outlined(mut self) -> Self {
        let does = |kind| self.does(kind);
        let asked = &self.optics_asked_for;
        let strength = |kind, strength: f32| if does(kind) { strength } else { 0.0 };
        let colors = |kind, colors: [f32; 3]| if does(kind) { colors } else { [0.0; 3] };
        self.optics = Optics {
            aperture: asked.aperture.simplified(does(EffectKind::BladeCurvature), does(EffectKind::Squeeze)),
            image: asked.image.clone().filter(|_| does(EffectKind::ApertureImage)),
            cats_eye: strength(EffectKind::CatsEye, asked.cats_eye),
            spherical_px: strength(EffectKind::SphericalAberration, asked.spherical_px),
            axial_px: colors(EffectKind::AxialColor, asked.axial_px),
            lateral_px: colors(EffectKind::LateralColor, asked.lateral_px),
            vignetting: strength(EffectKind::Vignetting, asked.vignetting),
        };
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Field;
    use crate::scene::{BRIGHT_STEPS, BrightStep};
    use crate::settings::{Effort, Origin, Values};
    use crate::stack::ColorRange;

    /// A method that has every step.
    const ABLE: Abilities = Abilities {
        method: "shear",
        effects: &[
            EffectKind::Merge,
            EffectKind::Highlights,
            EffectKind::Fill,
            EffectKind::Prefilter,
            EffectKind::Resolve,
        ],
        lens_samples: Some(64),
        seeks: true,
    };

    fn facts() -> Facts {
        Facts {
            picture_size: (100, 100),
            layers: 4,
            kind: StackKind::PointSampled,
            supersample: 1,
            coc_range_px: [-8.0, 3.0],
            fragments: 20_000,
            translucent_fragments: 0,
            focused_fragments: 500,
            open_samples: 0,
            bright: [BrightStep::default(); BRIGHT_STEPS],
            color_range: ColorRange::Unbounded,
            light: Vec::new(),
            limited_fragments: 0,
            spread: crate::scene::Spread::default(),
            field: Field::of_picture(100, 100),
            peels: Vec::new(),
        }
    }

    fn decide(facts: &Facts, values: &Values) -> Result<Plan, Error> {
        let settings = Settings::resolve(&[(Origin::Flag, values)], MethodParameters::default());
        Plan::decide(facts, &settings, ABLE)
    }

    fn plan(facts: &Facts) -> Plan {
        decide(facts, &Values::default()).unwrap()
    }

    #[test]
    fn what_stays_within_its_pixel_is_not_blurred() {
        let blurs = |range| plan(&Facts { coc_range_px: range, ..facts() }).does(EffectKind::Blur);
        assert_eq!(
            [blurs([-0.5, 0.5]), blurs([-0.6, 0.0]), blurs([0.0, 0.51])],
            [false, true, true],
            "half a pixel"
        );
    }

    #[test]
    fn only_point_samples_are_spread_over_the_pixel_and_resolved() {
        for (kind, jitter, fragment_px) in [
            (StackKind::PointSampled, 1.0, 1.0),
            (StackKind::Coverage, 0.5, 0.0),
            (StackKind::BeautyDepth, 0.5, 0.0),
            (StackKind::RendererAntialiased, 0.5, 0.0),
        ] {
            let plan = plan(&Facts { kind, ..facts() });
            assert_eq!((plan.jitter, plan.fragment_px), (jitter, fragment_px), "{kind:?}");
            assert_eq!(plan.does(EffectKind::Resolve), kind == StackKind::PointSampled, "{kind:?}");
        }
        let supersampled = plan(&Facts { kind: StackKind::Supersampled, supersample: 4, ..facts() });
        assert_eq!(supersampled.fragment_px, 0.25, "a sample is a quarter of a pixel wide");
        assert!(supersampled.does(EffectKind::Merge), "samples become coverage");
    }

    #[test]
    fn surfaces_are_guessed_only_where_peels_are_few() {
        let fills = |layers| plan(&Facts { layers, ..facts() }).does(EffectKind::Fill);
        assert_eq!([fills(1), fills(2), fills(3), fills(4)], [true, true, false, false], "one and two");
    }

    /// Facts with `fragments` of brightness 2 to 2.8 and one of 1000, whose discs cover 300 px each.
    fn lights(fragments: usize) -> Facts {
        let step = |fragments| BrightStep { fragments, disc_area_px: 300.0 * fragments as f64 };
        let mut facts = facts();
        (facts.bright[2], facts.bright[19]) = (step(fragments), step(1));
        facts
    }

    #[test]
    fn a_bright_area_does_not_become_a_million_discs() {
        let few = plan(&lights(100));
        assert!(few.does(EffectKind::Highlights) && few.highlight_threshold <= 2.0, "all of them: {few:?}");
        let many = plan(&lights(9000));
        assert!(many.does(EffectKind::Highlights), "the brightest is still a disc");
        assert!(many.highlight_threshold > 2.8, "the area is not: {}", many.highlight_threshold);
        let reason =
            &many.effects.iter().find(|effect| effect.name == EffectKind::Highlights).unwrap().reason;
        assert!(reason.contains("raised"), "and the plan says so: {reason}");
    }

    #[test]
    fn numbers_that_cannot_be_are_refused_by_name() {
        let refused = |values| decide(&facts(), &values).unwrap_err().to_string();
        assert!(
            refused(Values { effort: Some(Effort::Views(0)), ..Values::default() })
                .contains("number of views"),
            "zero views"
        );
        assert!(
            refused(Values { blades: Some(2), ..Values::default() }).contains("3 to 100 blades"),
            "two blades"
        );
        let mut settings = Settings::resolve(&[], MethodParameters::default());
        settings.parameters.shear.highlight_threshold = 0.4;
        let error = Plan::decide(&facts(), &settings, ABLE).unwrap_err().to_string();
        assert!(error.contains("brighter than white"), "{error}");
    }

    #[test]
    fn a_method_is_not_said_to_do_what_it_has_no_step_for() {
        let blind = Abilities { method: "scatter", effects: &[], lens_samples: None, seeks: false };
        let values = Values { effort: Some(Effort::Views(32)), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Header, &values)], MethodParameters::default());
        let plan = Plan::decide(&lights(100), &settings, blind).unwrap();
        assert!(!plan.does(EffectKind::Highlights), "no discs");
        assert_eq!(plan.views, None, "a preset's views are not meant for it");
    }

    #[test]
    fn a_parameter_out_of_its_range_is_refused_with_range_and_default() {
        let mut settings = Settings::resolve(&[], MethodParameters::default());
        settings.parameters.shear.views = 0;
        let error = Plan::decide(&facts(), &settings, ABLE).unwrap_err().to_string();
        let expected = "'views' of [method.shear] must be a whole number from 1 to 65536 (the default is 64)";
        assert!(error.contains(expected), "{error}");
    }

    #[test]
    fn a_forced_effect_says_that_it_was_asked_for() {
        let plan = plan(&facts()).forced(EffectKind::Fill, true);
        assert!(plan.does(EffectKind::Fill), "on");
        assert!(plan.effects.iter().any(|effect| effect.reason.starts_with("asked for")), "with the reason");
    }
}
