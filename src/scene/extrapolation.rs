//! Extrapolation of highlights in a source that ends at white.
//!
//! A picture made for a display is clipped to white. A clipped light that is spread over its circle of confusion becomes
//! grey. Lee, Kim & Choi 2008, "Real-Time Depth-of-Field Rendering Using Point Splatting on Per-Pixel Layers", section 4, eq. 8: a
//! colour `F` of luminance λ above λ₀ becomes `((1 − λ_nᵝ) + λ_nᵝ γ) F`, with `λ_n = (λ − λ₀) / (1 − λ₀)`.
//!
//! The paper's values are display-coded, ours are scene-linear. λ is the luminance of the light, `0.3 r + 0.59 g + 0.11 b`,
//! coded as for a display (sRGB), so that λ₀ is on the paper's scale. The factor multiplies scene-linear light, so hues are kept and γ is
//! a gain in light: 2 is one stop. A colour brighter than white was not clipped; its gain is that of white.
//!
//! The paper applies this to bokeh, so only blurred fragments gain: none up to a CoC radius of 1 px, the whole gain from 2 px on, and a
//! linear ramp between, so that a surface that leaves focus shows no step.
//!
//! Cost: one pass over the scene, only where a plan has the effect on. Limits: the brightness that was clipped is unknown, and a
//! white wall gains as much as a lamp.

use super::layer::divisor;
use super::light::{LightStep, light_step_bounds, luminance, share_of_gain};
use super::{Layer, Scene};
use crate::error::Error;
use crate::image::{Plane, srgb_decode, srgb_encode};
use crate::parallel;
use crate::settings::PictureSettings;

/// The curve by which bright colours gain light.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Extrapolation {
    /// Display-coded luminance λ₀ above which colours gain.
    pub threshold: f32,
    /// Exponent β of the gain between the threshold and white.
    pub falloff: f32,
    /// Gain γ of white.
    pub gain: f32,
}

/// The effect of an extrapolation on a scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Gained {
    /// Number of blurred fragments above the threshold; some just below it may be counted.
    pub(super) fragments: usize,
    /// Their light.
    pub(super) light: f64,
    /// Light that is added to them.
    pub(super) added: f64,
}

impl Extrapolation {
    /// The extrapolation of `settings`.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a value out of its range.
    pub fn new(settings: &PictureSettings) -> Result<Self, Error> {
        settings.check()?;
        Ok(Self {
            threshold: settings.extrapolation_threshold.value,
            falloff: settings.extrapolation_falloff.value,
            gain: settings.extrapolation_gain.value,
        })
    }

    /// Factor on the light of a colour of display-coded luminance λ (eq. 8).
    fn gain_at(&self, luminance: f32) -> f32 {
        let normalised = (luminance.min(1.0) - self.threshold) / (1.0 - self.threshold);
        if normalised <= 0.0 {
            return 1.0;
        }
        let share = normalised.powf(self.falloff);
        (1.0 - share) + share * self.gain
    }

    /// Its effect on the fragments that are counted in `steps`.
    pub(super) fn gained(&self, steps: &[LightStep]) -> Gained {
        let mut gained = Gained::default();
        for (number, step) in steps.iter().enumerate() {
            let [from, to] = light_step_bounds(number);
            if srgb_encode(to) > self.threshold {
                gained.fragments += step.fragments;
                gained.light += step.light;
                let gain = self.gain_at(srgb_encode(0.5 * (from + to)));
                gained.added += step.gaining_light * f64::from(gain - 1.0);
            }
        }
        gained
    }

    /// Extrapolates a row of fragments. The threshold is compared with the luminance before premultiplication by alpha.
    fn apply(&self, [red, green, blue]: [&mut [f32]; 3], alpha: &[f32], coc_px: &[f32]) {
        let threshold = srgb_decode(self.threshold);
        for (x, (&alpha, &coc_px)) in alpha.iter().zip(coc_px).enumerate() {
            let light = luminance([red[x], green[x], blue[x]]);
            let share = share_of_gain(coc_px);
            if alpha > 0.0 && share > 0.0 && light > threshold * divisor(alpha) {
                let gain = self.gain_at(srgb_encode(light / divisor(alpha)));
                let gain = (1.0 - share) + share * gain;
                [&mut red[x], &mut green[x], &mut blue[x]].into_iter().for_each(|value| *value *= gain);
            }
        }
    }
}

impl Scene {
    /// The scene with its highlights extrapolated.
    #[must_use]
    pub fn extrapolated(mut self, extrapolation: &Extrapolation) -> Self {
        let width = self.width().max(1);
        for Layer { color, alpha, coc_px } in &mut self.layers {
            parallel::for_each_row_of(color.each_mut().map(Plane::values_mut), width, &|y, color| {
                extrapolation.apply(color, alpha.row(y), coc_px.row(y));
            });
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::methods;
    use crate::scene::{Effect, EffectKind, SceneStats};
    use crate::settings::{Origin, ParameterValues, Settings, Switches, Values};
    use crate::stack::{ColorRange, StackKind};

    const PAPER: Extrapolation = Extrapolation { threshold: 0.8, falloff: 3.0, gain: 2.0 };

    /// `color` of `alpha` and `coc_px`, extrapolated.
    fn applied(mut color: [f32; 3], alpha: f32, coc_px: f32) -> [f32; 3] {
        PAPER.apply(color.each_mut().map(std::slice::from_mut), &[alpha], &[coc_px]);
        color
    }

    #[test]
    fn only_what_is_brighter_than_the_threshold_gains() {
        assert_eq!(PAPER.gain_at(0.8), 1.0, "at the threshold");
        assert_eq!(PAPER.gain_at(-3.0), 1.0, "below it");
        // λ_n = ½, its cube ⅛: 7/8 + 2/8.
        assert!((PAPER.gain_at(0.9) - 1.125).abs() < 1e-5, "halfway to white");
        assert_eq!(PAPER.gain_at(1.0), 2.0, "white gains γ");
        assert_eq!(PAPER.gain_at(500.0), 2.0, "brighter than white, unclipped: as much as white");
    }

    #[test]
    fn the_threshold_is_a_display_value() {
        // Displayed as 0.9: scene-linear 0.787, whose gain is that of 0.9, 1.125.
        let light = srgb_decode(0.9);
        let [red, ..] = applied([light; 3], 1.0, 5.0);
        assert!((red / light - 1.125).abs() < 1e-4, "{}", red / light);
        assert_eq!(applied([0.6; 3], 1.0, 5.0), [0.6; 3], "0.6 of light is displayed as 0.797");
    }

    #[test]
    fn the_hue_of_a_highlight_is_kept() {
        let color = [1.0, 0.9, 0.2];
        let gained = applied(color, 1.0, 5.0);
        let factors: [f32; 3] = std::array::from_fn(|k| gained[k] / color[k]);
        // 0.853 of light is displayed as 0.932: λ_n = 0.662, its cube 0.290.
        assert!(factors.iter().all(|factor| (factor - 1.290).abs() < 1e-3), "{factors:?}");
    }

    #[test]
    fn the_gain_does_not_depend_on_coverage() {
        let [red, ..] = applied([0.5; 3], 0.5, 3.0);
        assert!((red - 1.0).abs() < 1e-5, "half a pixel of white doubles as white does: {red}");
        assert_eq!(applied([0.7; 3], 0.0, 3.0), [0.7; 3], "an empty sample does not gain");
    }

    #[test]
    fn nothing_gains_in_focus_and_the_gain_rises_with_the_blur() {
        for (coc_px, light) in [(0.0, 1.0), (-1.0, 1.0), (1.5, 1.5), (-1.5, 1.5), (2.0, 2.0), (-40.0, 2.0)] {
            let [red, ..] = applied([1.0; 3], 1.0, coc_px);
            assert!((red - light).abs() < 1e-5, "CoC radius {coc_px}: {red}, expected {light}");
        }
    }

    /// A scene at CoC radius `coc_px`, a quarter of it white and the rest grey, of a source of this range.
    fn scene(color_range: ColorRange, coc_px: f32) -> Scene {
        let plane = Plane::from_fn(8, 4, |x, _| if x < 2 { 1.0 } else { 0.25 });
        let layer = Layer {
            color: [plane.clone(), plane.clone(), plane],
            alpha: Plane::filled(8, 4, 1.0),
            coc_px: Plane::filled(8, 4, coc_px),
        };
        Scene { color_range, ..Scene::new(vec![layer], StackKind::BeautyDepth, 1, 10.0) }
    }

    /// The scene as a method gets it, its statistics, and the decision.
    fn prepared(scene: Scene, force: &[&str]) -> (Scene, SceneStats, Effect) {
        let force = force.iter().map(|name| (*name).to_owned()).collect();
        let settings = Settings::resolve(&[], ParameterValues::default());
        let settings = Settings { switches: Switches { force, ..Switches::default() }, ..settings };
        let (scene, stats, plan) = methods::Registry::default().prepare(scene, &settings).unwrap();
        let mut effects = plan.effects.into_iter();
        (scene, stats, effects.find(|effect| effect.name == EffectKind::HighlightExtrapolation).unwrap())
    }

    #[test]
    fn a_source_that_ends_at_white_has_its_blurred_highlights_extrapolated_and_the_plan_says_by_how_much() {
        let input = scene(ColorRange::UpToWhite, 5.0);
        let (found, stats, effect) = prepared(input.clone(), &[]);
        assert!(effect.on && effect.reason.contains("8 blurred fragments (25.0 %)"), "{effect:?}");
        assert!(
            effect.reason.contains("gain 100 % of light") && effect.change.contains("50 % less"),
            "{effect:?}"
        );
        let [light, before] = [&found, &input].map(|scene| scene.layers[0].color[1].get(0, 0));
        assert!((light - 2.0 * before).abs() < 1e-5, "{light}");
        assert_eq!(found.layers[0].color[1].get(5, 0), 0.25, "grey is not changed");
        assert_eq!(stats.light, input.analyze().light, "light is that of the source");
        assert_eq!(
            stats.bright,
            found.analyze().bright,
            "all other statistics are of the extrapolated scene"
        );
    }

    #[test]
    fn the_scene_is_unchanged_where_nothing_was_clipped_or_nothing_is_blurred() {
        let (linear, focused) = (scene(ColorRange::Unbounded, 5.0), scene(ColorRange::UpToWhite, 0.9));
        for input in [linear.clone(), focused] {
            let (found, _, effect) = prepared(input.clone(), &[]);
            assert!(!effect.on && found == input, "{effect:?}");
        }
        let (found, _, effect) = prepared(linear, &["highlight-extrapolation"]);
        assert!(effect.on && effect.forced && effect.reason.contains("scene-linear"), "{effect:?}");
        assert!(found.layers[0].color[0].get(0, 0) > 1.99, "it can be forced on");
    }

    #[test]
    fn a_value_out_of_range_is_refused_by_name() {
        let values = Values { extrapolation_gain: Some(0.5), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        let error = Extrapolation::new(&settings.picture).unwrap_err().to_string();
        assert!(error.contains("gain") && error.contains("from 1 to 1000"), "{error}");
    }
}
