//! Highlights that a source which ends at white has lost, extrapolated.
//!
//! A picture made for a display is clipped to white. Spread over its circle of confusion, a light that was clipped comes out
//! grey. Lee, Kim & Choi 2008, "Real-Time Depth-of-Field Rendering Using Point Splatting on Per-Pixel Layers", section 4, eq. 8: a
//! colour `F` of luminance λ above λ₀ becomes `((1 − λ_nᵝ) + λ_nᵝ γ) F`, with `λ_n = (λ − λ₀) / (1 − λ₀)`.
//!
//! The paper's values are those of a display, ours are scene-linear. λ is the luminance of the light, `0.3 r + 0.59 g + 0.11 b`,
//! coded as for a display (sRGB), so that λ₀ is on the paper's scale. The factor multiplies light, so that hues stay and γ is a gain
//! in light: 2 is one stop. What is brighter than white was not clipped and tells nothing: its gain is that of white.
//!
//! The paper means bokeh, so only what is blurred gains: nothing up to a CoC radius of 1 px, all of it from 2 px on, and in
//! between in proportion, so that a surface on its way out of focus shows no step.
//!
//! Cost: one look at the scene, and that only where a plan asks for it. Limits: how much brighter a light was nobody knows, and a
//! white wall gains as a lamp does.

use super::light::{LightStep, light_step_ends, luminance, share_of_gain};
use super::{Layer, Scene};
use crate::error::Error;
use crate::image::{srgb_decode, srgb_encode};
use crate::settings::PictureSettings;
use rayon::prelude::*;

/// How bright colours are made brighter.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Extrapolation {
    /// Display-coded luminance λ₀ above which they are.
    pub threshold: f32,
    /// Exponent β by which the gain sets in.
    pub falloff: f32,
    /// Gain γ of white.
    pub gain: f32,
}

/// What an extrapolation does to a scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Gained {
    /// Blurred fragments above the threshold; those just below it may be among them.
    pub(super) fragments: usize,
    /// Their light.
    pub(super) light: f64,
    /// What is added to it.
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

    /// What it does to fragments that are counted in `steps`.
    pub(super) fn gained(&self, steps: &[LightStep]) -> Gained {
        let mut gained = Gained::default();
        for (number, step) in steps.iter().enumerate() {
            let [from, to] = light_step_ends(number);
            if srgb_encode(to) > self.threshold {
                gained.fragments += step.fragments;
                gained.light += step.light;
                let gain = self.gain_at(srgb_encode(0.5 * (from + to)));
                gained.added += step.gaining_light * f64::from(gain - 1.0);
            }
        }
        gained
    }

    /// Extrapolates a row of fragments. The luminance of the colour decides, not of its share of the pixel.
    fn apply(&self, [red, green, blue]: [&mut [f32]; 3], alpha: &[f32], coc_px: &[f32]) {
        let threshold = srgb_decode(self.threshold);
        for (x, (&alpha, &coc_px)) in alpha.iter().zip(coc_px).enumerate() {
            let light = luminance([red[x], green[x], blue[x]]);
            let share = share_of_gain(coc_px);
            if alpha > 0.0 && share > 0.0 && light > threshold * alpha {
                let gain = self.gain_at(srgb_encode(light / alpha));
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
            let [red, green, blue] = color.each_mut().map(|plane| plane.values_mut().par_chunks_mut(width));
            let given = alpha.values().par_chunks(width).zip(coc_px.values().par_chunks(width));
            red.zip(green).zip(blue).zip(given).for_each(|(((red, green), blue), (alpha, coc_px))| {
                extrapolation.apply([red, green, blue], alpha, coc_px);
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
        assert_eq!(PAPER.gain_at(500.0), 2.0, "and what was never clipped no more than white");
    }

    #[test]
    fn the_threshold_is_that_of_a_display() {
        // Displayed as 0.9: scene-linear 0.787, whose gain is that of 0.9, 1.125.
        let light = srgb_decode(0.9);
        let [red, ..] = applied([light; 3], 1.0, 5.0);
        assert!((red / light - 1.125).abs() < 1e-4, "{}", red / light);
        assert_eq!(applied([0.6; 3], 1.0, 5.0), [0.6; 3], "0.6 of light is displayed as 0.797");
    }

    #[test]
    fn the_hue_of_a_highlight_stays() {
        let color = [1.0, 0.9, 0.2];
        let gained = applied(color, 1.0, 5.0);
        let factors: [f32; 3] = std::array::from_fn(|k| gained[k] / color[k]);
        // 0.853 of light is displayed as 0.932: λ_n = 0.662, its cube 0.290.
        assert!(factors.iter().all(|factor| (factor - 1.290).abs() < 1e-3), "{factors:?}");
    }

    #[test]
    fn luminance_is_that_of_the_colour_whatever_its_coverage() {
        let [red, ..] = applied([0.5; 3], 0.5, 3.0);
        assert!((red - 1.0).abs() < 1e-5, "half a pixel of white doubles as white does: {red}");
        assert_eq!(applied([0.7; 3], 0.0, 3.0), [0.7; 3], "where nothing is, nothing gains");
    }

    #[test]
    fn what_is_in_focus_stays_and_what_leaves_it_gains_by_and_by() {
        for (coc_px, light) in [(0.0, 1.0), (-1.0, 1.0), (1.5, 1.5), (-1.5, 1.5), (2.0, 2.0), (-40.0, 2.0)] {
            let [red, ..] = applied([1.0; 3], 1.0, coc_px);
            assert!((red - light).abs() < 1e-5, "CoC radius {coc_px}: {red}, expected {light}");
        }
    }

    /// A scene of white and of grey at these CoC radii, of a source of this range; white is a quarter of it.
    fn scene(color_range: ColorRange, coc_px: f32) -> Scene {
        let plane = Plane::from_fn(8, 4, |x, _| if x < 2 { 1.0 } else { 0.25 });
        let layer = Layer {
            color: [plane.clone(), plane.clone(), plane],
            alpha: Plane::filled(8, 4, 1.0),
            coc_px: Plane::filled(8, 4, coc_px),
        };
        Scene { color_range, ..Scene::new(vec![layer], StackKind::BeautyDepth, 1, 10.0) }
    }

    /// The scene as a method sees it, what it shows, and the decision.
    fn settled(scene: Scene, force: &[&str]) -> (Scene, SceneStats, Effect) {
        let force = force.iter().map(|name| (*name).to_owned()).collect();
        let settings = Settings::resolve(&[], ParameterValues::default());
        let settings = Settings { switches: Switches { force, ..Switches::default() }, ..settings };
        let (scene, stats, plan) = methods::Registry::default().prepare(scene, &settings).unwrap();
        let mut effects = plan.effects.into_iter();
        (scene, stats, effects.find(|effect| effect.name == EffectKind::HighlightExtrapolation).unwrap())
    }

    #[test]
    fn a_source_that_ends_at_white_has_its_blurred_highlights_extrapolated_and_the_plan_says_by_how_much() {
        let given = scene(ColorRange::UpToWhite, 5.0);
        let (found, stats, effect) = settled(given.clone(), &[]);
        assert!(effect.on && effect.reason.contains("8 blurred fragments (25.0 %)"), "{effect:?}");
        assert!(
            effect.reason.contains("gain 100 % of light") && effect.change.contains("50 % less"),
            "{effect:?}"
        );
        let [light, before] = [&found, &given].map(|scene| scene.layers[0].color[1].get(0, 0));
        assert!((light - 2.0 * before).abs() < 1e-5, "{light}");
        assert_eq!(found.layers[0].color[1].get(5, 0), 0.25, "grey is not changed");
        assert_eq!(stats.light, given.analyze().light, "decided from what the source had");
        assert_eq!(stats.bright, found.analyze().bright, "all else is of what methods see");
    }

    #[test]
    fn where_nothing_was_clipped_or_nothing_is_blurred_the_scene_stays_as_it_is() {
        let (linear, focused) = (scene(ColorRange::Unbounded, 5.0), scene(ColorRange::UpToWhite, 0.9));
        for given in [linear.clone(), focused] {
            let (found, _, effect) = settled(given.clone(), &[]);
            assert!(!effect.on && found == given, "{effect:?}");
        }
        let (found, _, effect) = settled(linear, &["highlight-extrapolation"]);
        assert!(effect.on && effect.forced && effect.reason.contains("scene-linear"), "{effect:?}");
        assert!(found.layers[0].color[0].get(0, 0) > 1.99, "but it can be asked for");
    }

    #[test]
    fn values_out_of_their_range_are_refused_by_name() {
        let values = Values { extrapolation_gain: Some(0.5), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        let error = Extrapolation::new(&settings.picture).unwrap_err().to_string();
        assert!(error.contains("gain") && error.contains("from 1 to 1000"), "{error}");
    }
}
