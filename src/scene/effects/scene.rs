//! Decisions about the picture as a whole: blur, merging of samples, translucency, transparent background.

use super::inputs::{Inputs, percent};
use super::words::{Effect, EffectKind, NO_EFFECT};
use crate::scene::stats::SceneStats;
use std::f32::consts::PI;

/// CoC radius in picture pixels up to which a blur is left out: less than a hundredth of a pixel's lens rays would end in a neighbour.
const BLUR_FROM_PX: f32 = 0.01;

pub(super) fn blur(inputs: &Inputs<'_>) -> Effect {
    let stats = inputs.stats;
    let shift = inputs.longest_shift_px();
    // A mirror in focus everywhere still shows what is not.
    let largest = inputs.max_blur_px().max(inputs.largest_movement_px());
    let [near, far] = stats.coc_range_px;
    if largest <= BLUR_FROM_PX {
        let reason = format!("the largest CoC radius is {largest:.4} px: no blur is visible");
        let share = 100.0 * share_outside_pixel(largest, inputs.jitter);
        let change = format!("with it, at most {share:.1} % of a pixel's lens rays would end in a neighbour");
        return Effect::new(EffectKind::Blur, false, reason, change);
    }
    let counts = stats.spread.steps.map(|step| step.front.iter().chain(&step.behind).sum::<usize>());
    let all: usize = counts.iter().sum();
    let share = percent(all - counts[0], all);
    let change = format!(
        "without it, about {share:.1} % of the fragments would be sharp instead of up to {:.1} px wide",
        2.0 * largest
    );
    let aberrations =
        if shift > 0.0 { format!(", aberrations of up to {shift:.2} px") } else { String::new() };
    let reason = format!("CoC radii from {near:.1} (near) to {far:.1} px (far){aberrations}");
    Effect::new(EffectKind::Blur, true, reason, change)
}

/// Share of a pixel's lens rays that end outside its square, where the pixel and its neighbours have CoC radius `coc_px` and rays
/// start within `jitter` of the pixel's width: the mean over a disc, which contains every aperture.
fn share_outside_pixel(coc_px: f32, jitter: f32) -> f32 {
    /// Steps of the mean along radius and angle.
    const STEPS: usize = 64;
    // Share of rays, evenly spread within the jitter, that an offset along one axis moves out of the pixel.
    let leaves = |offset: f32| ((0.5 * jitter + offset.abs() - 0.5) / jitter).clamp(0.0, 1.0);
    let ring = |i: usize| {
        let radius = coc_px * ((i as f32 + 0.5) / STEPS as f32).sqrt();
        let at = |k: usize| (k as f32 + 0.5) / STEPS as f32 * 0.5 * PI;
        let stays = |angle: f32| (1.0 - leaves(radius * angle.cos())) * (1.0 - leaves(radius * angle.sin()));
        (0..STEPS).map(|k| 1.0 - stays(at(k))).sum::<f32>() / STEPS as f32
    };
    (0..STEPS).map(ring).sum::<f32>() / STEPS as f32
}

pub(super) fn merge(stats: &SceneStats) -> Effect {
    match stats.supersample {
        1 => Effect::new(EffectKind::Merge, false, "one sample per pixel", "there are no samples to merge"),
        s => Effect::new(
            EffectKind::Merge,
            true,
            format!("{s} × {s} samples per pixel become coverage peels"),
            "it cannot be left out: the samples are finer than the picture's pixels",
        ),
    }
}

pub(super) fn translucency(stats: &SceneStats) -> Effect {
    let count = stats.translucent_fragments;
    let reason = format!("{count} fragments are translucent");
    let share = percent(count, stats.fragments);
    let change = match count {
        0 => "it cannot be added: every alpha is 1".to_owned(),
        _ => format!("it cannot be left out: {share:.1} % of the fragments have an alpha below 1"),
    };
    Effect::new(EffectKind::Translucency, count > 0, reason, change)
}

pub(super) fn transparent_background(stats: &SceneStats) -> Effect {
    let count = stats.background_pixels;
    if count == 0 {
        return Effect::new(
            EffectKind::TransparentBackground,
            false,
            "no pixel shows the background: lens rays that hit nothing are left out of the mean",
            "with it, no effect: there is no background that a ray could end in",
        );
    }
    let share = percent(count, stats.picture_size.0 * stats.picture_size.1);
    Effect::new(
        EffectKind::TransparentBackground,
        true,
        format!("{count} pixels show the background: the picture is transparent where lens rays end in it"),
        format!("without it, blurred edges in front of the {share:.1} % that show it would become opaque"),
    )
}

pub(super) fn reflections(stats: &SceneStats) -> Effect {
    let decided =
        |on, reason: String, change: String| Effect::new(EffectKind::Reflections, on, reason, change);
    let Some(reflections) = &stats.reflections else {
        let reason = "no channel says what surfaces reflect, or they reflect nothing".to_owned();
        return decided(false, reason, "with it, no effect".to_owned());
    };
    let reflecting = percent(reflections.reflecting_fragments, stats.fragments);
    let moving = percent(reflections.moving_fragments, stats.fragments);
    let largest = reflections.largest_movement_px;
    if reflections.moving_fragments == 0 {
        let reason = format!(
            "{reflecting:.1} % of the fragments reflect, and the lens moves what they show by {largest:.2} px at most, or to nothing else"
        );
        return decided(
            false,
            reason,
            "with it, no reflection would move by more than half a pixel".to_owned(),
        );
    }
    let reason = format!(
        "{reflecting:.1} % of the fragments reflect, and the lens moves what {moving:.1} % show, by up to {largest:.1} px"
    );
    let change = format!(
        "without it, {moving:.1} % of the fragments would be focused at their surface instead of at what they reflect"
    );
    decided(true, reason, change)
}

pub(super) fn environment(stats: &SceneStats) -> Effect {
    let kind = EffectKind::Environment;
    let Some(found) = &stats.environment else {
        let reason = "no fragment reflects an environment: `environment` has its picture";
        return Effect::new(kind, false, reason, NO_EFFECT);
    };
    let share = percent(found.fragments, stats.fragments);
    let movement = found.largest_movement_px;
    let reason = format!(
        "{share:.1} % of the fragments reflect the environment, and the lens moves their view by up to {movement:.1} px"
    );
    let change = "without it, they would show every point of the lens what its centre sees";
    Effect::new(kind, movement > BLUR_FROM_PX, reason, change)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_leave_the_pixel_in_proportion_to_how_far_the_disc_reaches_past_its_sides() {
        assert_eq!(share_outside_pixel(0.0, 1.0), 0.0, "a pinhole");
        assert_eq!(share_outside_pixel(0.25, 0.5), 0.0, "rays within half the pixel, moved by a quarter");
        // Small discs leave by either side alone: 2 · E|c·u_x| = 2 c · 4 / (3π).
        let c = 0.01;
        let expected = 2.0 * c * 4.0 / (3.0 * PI);
        let found = share_outside_pixel(c, 1.0);
        assert!((found / expected - 1.0).abs() < 0.01, "{found}");
        assert!(share_outside_pixel(0.5, 1.0) < 0.45, "at half a pixel less than half");
    }
}
