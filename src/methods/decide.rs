//! DECIDE: makes the [`Plan`] for a method and a scene, with reasons, from the scene's effects and the method's own passes.

use super::contract::{LostRays, Method, Plan};
use super::switches;
use super::target::{MAX_VIEWS, Target};
use crate::error::Error;
use crate::lens::Optics;
use crate::scene::{Effect, EffectKind, Extrapolation, Inputs, Scene, SceneStats, effects};
use crate::settings::{Effort, Origin, Parameters, Quality, Settings};

/// Makes the plan of `method` for a scene with the statistics `stats`. The method that `settings` name is not used.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for an invalid aperture, a parameter of the method or of highlight extrapolation out of
/// its range, a number of views out of range, and an effect requested by name that is unknown or cannot be switched.
pub fn plan_for(method: &'static dyn Method, stats: &SceneStats, settings: &Settings) -> Result<Plan, Error> {
    let info = method.info();
    let parameters = method.parameters().read(info.name, &settings.parameters)?;
    let Sampling { views, target, reason: views_reason } = Sampling::decide(method, settings, &parameters)?;
    let method_reason = match settings.method.value.as_str() {
        "auto" => "auto: no known method is as accurate in as little time".to_owned(),
        _ => format!("requested by {}", settings.method.origin),
    };
    let averages_jitter = averages_jitter(stats);
    let jitter = 1.0 - stats.antialiased as f32 * (1.0 - averages_jitter);
    let optics = Optics::new(settings, &stats.field)?;
    let extrapolation = Extrapolation::new(&settings.picture)?;
    let known_views = if target.is_none() { views } else { None };
    let inputs =
        Inputs { stats, views: known_views, jitter, optics: &optics, extrapolation, passes: info.effects };
    let own = method.decide(&inputs, &parameters)?;
    let plan = Plan {
        method,
        method_reason,
        views,
        target,
        views_reason,
        averages_jitter,
        averages_px: if stats.supersample > 1 { 1.0 / stats.supersample as f32 } else { 0.0 },
        optics: optics.clone(),
        effects: in_order(method, effects::decide(&inputs), own),
        optics_requested: optics,
        coc_range_px: stats.coc_range_px,
        barely_blurred_lights: stats.barely_blurred_lights,
        extrapolation,
        parameters,
        lost_rays: LostRays::LeftOut,
    };
    switches::apply(plan.with_lens_effects(), &settings.switches, stats)
}

/// Extent of the views' positions in a pixel whose colours are averages over it. A full pixel would average twice, and none would show the
/// samples as squares: half of it, and more where the average is coarse or only that of colour.
fn averages_jitter(stats: &SceneStats) -> f32 {
    match (stats.supersample, stats.layers) {
        // The mean of S × S point samples is itself aliased, as far as a sample is wide.
        (2.., _) => 0.5 + 0.5 / stats.supersample as f32,
        // Colour is averaged, and depth is a point sample.
        (_, 1) => 0.75,
        _ => 0.5,
    }
}

/// The decisions of the scene and the method's `own`, in the order of [`EffectKind::ALL`]; passes that the method lacks are off.
fn in_order(method: &dyn Method, of_scene: Vec<Effect>, own: Vec<Effect>) -> Vec<Effect> {
    let passes = method.info().effects;
    let decided: Vec<Effect> = of_scene.into_iter().chain(own).collect();
    let about = |kind: EffectKind| {
        let found = decided.iter().find(|effect| effect.name == kind);
        found.filter(|_| !kind.is_pass() || passes.contains(&kind)).cloned().unwrap_or_else(|| {
            let change = format!("{method} cannot do it: `thinlens methods` lists those that can");
            Effect::new(kind, false, format!("{method} has no such pass"), change)
        })
    };
    EffectKind::ALL.into_iter().map(about).collect()
}

/// How the lens is sampled.
struct Sampling {
    /// Lens samples per pixel; `None` for a method that does not sample the lens.
    views: Option<usize>,
    /// What they have to reach, where their number is not fixed.
    target: Option<Target>,
    /// Reason for these.
    reason: String,
}

impl Sampling {
    /// Lens sampling that `settings` request, as far as `method` supports it.
    fn decide(method: &dyn Method, settings: &Settings, parameters: &Parameters) -> Result<Self, Error> {
        let Some(own) = method.lens_samples(parameters) else {
            let reason = format!("{method} does not sample the lens");
            return Ok(Self { views: None, target: None, reason });
        };
        let its_own = || format!("{method}'s own number");
        let (effort, reason) = match settings.effort.value {
            Some(effort) => (Some(effort), format!("{effort}, requested by {}", settings.effort.origin)),
            None if settings.method.value == "auto" => {
                (Some(Effort::Quality(Quality::Final)), "auto is of final quality".to_owned())
            }
            None => (None, its_own()),
        };
        let (target, reason) = match effort.and_then(Target::from_effort) {
            Some(_) if method.lens_sampling().is_none() => (None, its_own()),
            target => (target, reason),
        };
        let views = if let Some(Effort::Views(views)) = effort { views } else { own };
        if views == 0 || views > MAX_VIEWS {
            return Err(Error::settings(format!("the number of views must be from 1 to {MAX_VIEWS}"))
                .with("found", views.to_string())
                .help("set it with `views`, or in the preset's [method]"));
        }
        Ok(Self { views: Some(views), target, reason })
    }
}

/// Checks that `method` supports the effort that a flag requests. `able` are the names of methods that can search for a number of
/// samples. A preset's effort is ignored by methods that do not support it.
pub(super) fn check_effort(
    method: &dyn Method,
    settings: &Settings,
    able: impl Iterator<Item = &'static str>,
) -> Result<(), Error> {
    let effort = &settings.effort;
    let Some(requested) = effort.value.filter(|_| effort.origin == Origin::Flag) else { return Ok(()) };
    if !method.samples_lens() {
        return Err(Error::settings(format!("{method} does not sample the lens"))
            .with("found", requested.to_string())
            .help(format!("leave it out; `thinlens methods {method}` lists the method's parameters")));
    }
    if matches!(requested, Effort::Views(_)) || method.lens_sampling().is_some() {
        return Ok(());
    }
    let able: Vec<&str> = able.collect();
    Err(Error::settings(format!("{method} cannot search for the number of samples that {requested} takes"))
        .help(format!("request a number with `views`, or use a method that can: {}", able.join(", "))))
}

/// Analyzes `scene`, makes its plan by `decide`, and applies highlight extrapolation where the plan has it on.
///
/// Returns the scene, its statistics and the plan. The statistics are those of the returned scene, except [`SceneStats::light`],
/// which is that of the original scene: the plan was decided from it.
///
/// # Errors
/// Those of `decide`.
pub(super) fn prepare(
    scene: Scene,
    decide: impl Fn(&SceneStats) -> Result<Plan, Error>,
) -> Result<(Scene, SceneStats, Plan), Error> {
    let stats = scene.analyze();
    let plan = decide(&stats)?;
    if !plan.does(EffectKind::HighlightExtrapolation) {
        return Ok((scene, stats, plan));
    }
    let scene = scene.extrapolated(&plan.extrapolation);
    let stats = SceneStats { light: stats.light, ..scene.analyze() };
    let plan = decide(&stats)?;
    Ok((scene, stats, plan))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Field;
    use crate::methods::accumulate::Accumulate;
    use crate::methods::published::{gather::Gather, peel_rays::PeelRays, scatter::Scatter};
    use crate::methods::shear::Shear;
    use crate::scene::{BRIGHT_STEPS, BrightStep, ReflectionStats, Spread};
    use crate::settings::{ParameterValues, Sourced, Values};
    use crate::stack::ColorRange;

    fn stats() -> SceneStats {
        SceneStats {
            picture_size: (100, 100),
            layers: 4,
            antialiased: 0.0,
            supersample: 1,
            coc_range_px: [-8.0, 3.0],
            fragments: 20_000,
            translucent_fragments: 0,
            focused_fragments: 500,
            background_pixels: 0,
            barely_blurred_lights: 0.0,
            bright: [BrightStep::default(); BRIGHT_STEPS],
            color_range: ColorRange::Unbounded,
            light: Vec::new(),
            limited_fragments: 0,
            reflections: None,
            environment: None,
            spread: Spread::default(),
            field: Field::from_picture_size(100, 100),
            peels: Vec::new(),
        }
    }

    fn decide(stats: &SceneStats, values: &Values) -> Result<Plan, Error> {
        let settings = Settings::resolve(&[(Origin::Flag, values)], ParameterValues::default());
        plan_for(&Shear, stats, &settings)
    }

    fn plan(stats: &SceneStats) -> Plan {
        decide(stats, &Values::default()).unwrap()
    }

    /// The error that a parameter of `shear` causes.
    fn parameter_refused(key: &str, value: impl Into<serde_json::Value>) -> String {
        let mut settings = Settings::resolve(&[], ParameterValues::default());
        settings.parameters.set("shear", key, value);
        plan_for(&Shear, &stats(), &settings).unwrap_err().to_string()
    }

    #[test]
    fn a_mirror_in_focus_is_blurred_and_smoothed_for_what_it_shows() {
        let views = Values { effort: Some(Effort::Views(64)), ..Values::default() };
        let with_64_views = |stats: &SceneStats| decide(stats, &views).unwrap();
        let moving = |px: f32| {
            let mut found = ReflectionStats::default();
            (found.moving_fragments, found.largest_movement_px) = (100, px);
            with_64_views(&SceneStats { coc_range_px: [0.0; 2], reflections: Some(found), ..stats() })
        };
        let does = |plan: &Plan| [EffectKind::Blur, EffectKind::Prefilter].map(|kind| plan.does(kind));
        assert_eq!(does(&moving(8.0)), [true; 2], "64 views of 8 px lie 1.8 px apart");
        assert_eq!(does(&moving(0.6)), [true, false], "and of 0.6 px without a gap");
        assert_eq!(
            does(&plan(&SceneStats { coc_range_px: [0.0; 2], ..stats() })),
            [false; 2],
            "without a mirror"
        );
    }

    #[test]
    fn a_scene_within_a_hundredth_of_a_pixel_of_focus_is_not_blurred() {
        let blurs = |range| plan(&SceneStats { coc_range_px: range, ..stats() }).does(EffectKind::Blur);
        assert_eq!(
            [blurs([-0.01, 0.01]), blurs([-0.02, 0.0]), blurs([0.0, 0.011])],
            [false, true, true],
            "a hundredth of a pixel"
        );
    }

    #[test]
    fn only_point_samples_are_jittered_over_the_whole_pixel_and_resolved() {
        for (antialiased, jitter) in [(0.0, 1.0), (0.5, 0.75), (1.0, 0.5)] {
            let plan = plan(&SceneStats { antialiased, ..stats() });
            assert_eq!((plan.jitter(antialiased as f32), plan.averages_px), (jitter, 0.0), "{antialiased}");
            assert_eq!(plan.does(EffectKind::Resolve), antialiased < 1.0, "{antialiased}");
        }
        let supersampled = plan(&SceneStats { antialiased: 1.0, supersample: 4, ..stats() });
        assert_eq!(supersampled.jitter(1.0), 0.625, "half a pixel, and half a sample");
        assert_eq!(supersampled.averages_px, 0.25, "a sample is a quarter of a pixel wide");
        assert!(supersampled.does(EffectKind::Merge), "samples become coverage");
    }

    #[test]
    fn the_disocclusion_fill_is_on_for_one_and_two_layers_only() {
        let fills = |layers| plan(&SceneStats { layers, ..stats() }).does(EffectKind::Fill);
        assert_eq!([fills(1), fills(2), fills(3), fills(4)], [true, true, false, false], "one and two");
    }

    /// Statistics with `fragments` of luminance 2 to 2.8 and one of 1000, whose discs cover 300 px each.
    fn lights(fragments: usize) -> SceneStats {
        let step = |fragments| BrightStep {
            fragments,
            discs: fragments as f64,
            disc_area_px: 300.0 * fragments as f64,
        };
        let mut stats = stats();
        (stats.bright[2], stats.bright[19]) = (step(fragments), step(1));
        stats
    }

    #[test]
    fn the_highlight_threshold_rises_until_a_bright_area_is_not_drawn_as_discs() {
        let few = plan(&lights(100));
        assert!(
            few.does(EffectKind::Highlights) && few.strength(EffectKind::Highlights) <= Some(2.0),
            "all of them: {few:?}"
        );
        let many = plan(&lights(9000));
        assert!(many.does(EffectKind::Highlights), "the brightest is still a disc");
        let threshold = many.strength(EffectKind::Highlights).unwrap();
        // Discs may cover eight times the picture's 10 000 pixels. The brightest takes 300, and of the half stop from 2 to 2.83 the
        // brightest part gets the rest.
        let share = (80_000.0 - 300.0) / (9000.0 * 300.0);
        let expected = 2f32.powf(1.5 - 0.5 * share);
        assert!((threshold - expected).abs() < 1e-3, "{threshold}, expected {expected}");
        let reason = &many.effect(EffectKind::Highlights).reason;
        assert!(reason.contains("raised"), "and the plan says so: {reason}");
    }

    #[test]
    fn values_out_of_range_are_refused_by_name() {
        let refused = |values| decide(&stats(), &values).unwrap_err().to_string();
        assert!(
            refused(Values { effort: Some(Effort::Views(0)), ..Values::default() })
                .contains("number of views"),
            "zero views"
        );
        assert!(
            refused(Values { blades: Some(2), ..Values::default() }).contains("3 to 100 blades"),
            "two blades"
        );
        let error = parameter_refused("highlight_threshold", 0.4);
        assert!(error.contains("must be 1 (white) or more"), "{error}");
    }

    #[test]
    fn passes_that_a_method_lacks_are_off() {
        let values = Values { effort: Some(Effort::Views(32)), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Header, &values)], ParameterValues::default());
        let plan = plan_for(&Scatter, &lights(100), &settings).unwrap();
        assert!(!plan.does(EffectKind::Highlights), "no discs");
        assert_eq!(plan.views, None, "a preset's views have no effect on it");
        let names: Vec<EffectKind> = plan.effects.iter().map(|effect| effect.name).collect();
        assert_eq!(names, EffectKind::ALL, "a decision about every effect, in order");
    }

    #[test]
    fn a_parameter_out_of_its_range_is_refused_with_range_and_default() {
        let expected = "'views' of shear must be a whole number from 1 to 65536 (the default is 64)";
        let error = parameter_refused("views", 0);
        assert!(error.contains(expected), "{error}");
    }

    #[test]
    fn a_forced_effect_says_that_it_was_requested() {
        let plan = plan(&stats()).forced(EffectKind::Fill, true);
        assert!(plan.does(EffectKind::Fill), "on");
        assert!(plan.effects.iter().any(|effect| effect.reason.starts_with("requested")), "with the reason");
    }

    #[test]
    fn a_flag_that_a_method_does_not_support_is_refused_and_a_presets_value_is_not() {
        let checked = |method: &'static dyn Method, effort, origin| {
            let settings = Settings::resolve(&[], ParameterValues::default());
            let settings = Settings { effort: Sourced { value: Some(effort), origin }, ..settings };
            check_effort(method, &settings, ["shear", "accumulate"].into_iter())
                .map_err(|error| error.to_string())
        };
        let refused = |method, effort| checked(method, effort, Origin::Flag).unwrap_err();
        assert!(refused(&Scatter, Effort::Views(32)).contains("scatter does not sample the lens"));
        let target = refused(&Gather, Effort::TargetDb(40.0));
        assert!(target.contains("`target_db = 40`") && target.contains("shear, accumulate"), "{target}");
        assert_eq!(checked(&Gather, Effort::Views(32), Origin::Flag), Ok(()));
        assert_eq!(checked(&PeelRays, Effort::TimeBudget(1.0), Origin::Flag), Ok(()));
        assert_eq!(checked(&Accumulate, Effort::TargetDb(40.0), Origin::Flag), Ok(()));
        assert_eq!(checked(&Scatter, Effort::TargetDb(40.0), Origin::Header), Ok(()), "ignored");
    }
}
