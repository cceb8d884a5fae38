//! CONFIDENCE: how much of each pixel's light comes from what the stack knows, and how much from guesses.
//!
//! Two things are not known: surfaces that were guessed behind what the stack has ([`Scene::filled`]), and what rays would have met
//! that find nothing although something is behind every pixel. A picture leaves such rays out of its mean, so it does not show.
//!
//! The same method blurs the same geometry by the same plan with other colours: 1 for what is known, 0 for what is guessed. With
//! the background open, rays that find nothing count as 0 too; where it is open in the picture as well, they are known to be
//! transparent, and count as 1. Steps that only smooth the picture are left out.
//!
//! Cost: that of the blur, once more. Memory: that of the scene. Limits: only for methods that follow lens rays; the others spread what
//! they know over what they do not, and cannot tell the two apart afterwards. What is repeated past the frame's border counts as
//! known, and rays that `layer-rays` discards there count for nothing, as in the picture.

use crate::error::Error;
use crate::image::Plane;
use crate::methods::Plan;
use crate::methods::{self, METHODS, Progress};
use crate::scene::{EffectKind, Scene};

/// Checks that the method of `plan` can say how much it knows.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] if it does not follow lens rays.
pub(crate) fn check(plan: &Plan) -> Result<(), Error> {
    if plan.method.lens_sampling().is_some() {
        return Ok(());
    }
    let able = METHODS.iter().filter(|method| method.lens_sampling().is_some());
    let able: Vec<&str> = able.map(|method| method.info().name).collect();
    Err(Error::settings(format!("{} cannot say how much of its picture the stack knows", plan.method))
        .with("wanted", "a method that follows lens rays")
        .help(format!("use one of {}, or leave out --confidence", able.join(", "))))
}

/// The share of each pixel's light, 0 … 1, that comes from what `scene` knows, as `plan` has it.
///
/// # Errors
/// Those of [`check`] and of the method.
pub(crate) fn confidence(scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Plane, Error> {
    check(plan)?;
    let (width, height) = scene.picture_size();
    if !plan.does(EffectKind::Blur) {
        return Ok(Plane::filled(width, height, 1.0));
    }
    let known = known_as_white(scene, plan.does(EffectKind::Fill));
    let [mut light, _, _, alpha] = methods::render(known, &bare(plan), progress)?.planes;
    let open = plan.does(EffectKind::TransparentBackground);
    for (light, alpha) in light.values_mut().iter_mut().zip(alpha.values()) {
        let transparent = if open { 1.0 - alpha } else { 0.0 };
        // Sums of many views round to a little more than 1.
        *light = (*light + transparent).clamp(0.0, 1.0);
    }
    Ok(light)
}

/// `plan` without the steps that are about colour, for a scene whose surfaces are guessed already.
fn bare(plan: &Plan) -> Plan {
    let left_out = [EffectKind::Highlights, EffectKind::Fill, EffectKind::Prefilter, EffectKind::Resolve];
    let bare = left_out.into_iter().fold(plan.clone(), |plan, kind| plan.forced(kind, false));
    bare.forced(EffectKind::TransparentBackground, true)
}

/// `scene`, with guessed surfaces if there are `guesses`, its red 1 where something is known and 0 where it is guessed.
fn known_as_white(scene: Scene, guesses: bool) -> Scene {
    let known = scene.layers.len();
    let mut scene = if guesses { scene.filled() } else { scene };
    for (i, layer) in scene.layers.iter_mut().enumerate() {
        let none = || Plane::zeros(layer.width(), layer.height());
        let red = if i < known { layer.alpha.clone() } else { none() };
        let color = [red, none(), none()];
        layer.color = color;
    }
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Layer;
    use crate::settings::{Effort, Origin, ParameterValues, Settings, Values};
    use crate::stack::StackKind;
    use std::f32::consts::PI;

    const WIDTH: usize = 128;
    const HEIGHT: usize = 48;

    /// Column of the edge.
    const EDGE: usize = 64;

    /// A scene of `layers`, each of which says what is in a column: its CoC radius, or nothing.
    fn scene(layers: &[fn(usize) -> Option<f32>]) -> Scene {
        let layer = |column: &fn(usize) -> Option<f32>| Layer {
            color: std::array::from_fn(|_| Plane::filled(WIDTH, HEIGHT, 0.3)),
            alpha: Plane::from_fn(WIDTH, HEIGHT, |x, _| if column(x).is_some() { 1.0 } else { 0.0 }),
            coc_px: Plane::from_fn(WIDTH, HEIGHT, |x, _| column(x).unwrap_or(0.0)),
        };
        Scene::new(layers.iter().map(layer).collect(), StackKind::PointSampled, 1, 40.0)
    }

    fn plan(scene: &Scene, method: &str) -> Plan {
        let effort = (method != "scatter").then_some(Effort::Views(512));
        let values = Values { method: Some(method.to_owned()), effort, ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        methods::Registry::default().plan(&scene.analyze(), &settings).unwrap()
    }

    fn found(layers: &[fn(usize) -> Option<f32>], method: &str) -> Plane {
        let scene = scene(layers);
        let plan = plan(&scene, method);
        confidence(scene, &plan, &|_| {}).unwrap()
    }

    /// Something in focus on the left, that hides half of a wall 12 px behind it.
    const IN_FRONT: fn(usize) -> Option<f32> = |x| Some(if x < EDGE { 0.0 } else { BLUR });
    const BLUR: f32 = 12.0;

    /// What it hides.
    const HIDDEN: fn(usize) -> Option<f32> = |x| (x < EDGE).then_some(BLUR);

    /// The part of a disc's area on the far side of a line at `distance` radii from its centre.
    fn segment(distance: f32) -> f32 {
        let t = distance.clamp(-1.0, 1.0);
        (t.acos() - t * (1.0 - t * t).sqrt()) / PI
    }

    #[test]
    fn beside_an_edge_the_lens_guesses_the_part_of_its_disc_that_the_edge_hides() {
        // A ray of a pixel on the wall meets it at p + 12 u: behind the edge wherever that is left of it. shear has a
        // guess there, the others nothing.
        for method in ["shear", "accumulate", "peel-rays", "layer-rays"] {
            let found = found(&[IN_FRONT], method);
            for x in (EDGE..EDGE + 20).step_by(2) {
                let expected = 1.0 - segment((x as f32 + 0.5 - EDGE as f32) / BLUR);
                let share = found.get(x, HEIGHT / 2);
                assert!(
                    (share - expected).abs() < 0.02,
                    "{method}, column {x}: {share}, expected {expected}"
                );
            }
            assert!((found.get(EDGE - 4, HEIGHT / 2) - 1.0).abs() < 1e-3, "{method}: in focus all is known");
        }
    }

    #[test]
    fn a_stack_that_has_what_is_hidden_knows_everything() {
        for method in ["shear", "accumulate"] {
            let found = found(&[IN_FRONT, HIDDEN], method);
            let least = found.values().iter().copied().fold(1.0, f32::min);
            assert!(least > 0.999, "{method}: {least}");
        }
    }

    #[test]
    fn a_picture_in_focus_is_known_whatever_is_behind_it() {
        let found = found(&[|x| Some(if x < EDGE { 0.0 } else { 0.25 })], "shear");
        assert!(found.values().iter().all(|&share| share == 1.0));
    }

    #[test]
    fn an_open_background_is_known_to_be_open() {
        let found = found(&[|x| (x < EDGE).then_some(-6.0)], "accumulate");
        let least = found.values().iter().copied().fold(1.0, f32::min);
        assert!(least > 0.999, "{least}");
    }

    #[test]
    fn methods_that_follow_no_rays_are_refused_by_name() {
        let scene = scene(&[IN_FRONT]);
        let plan = plan(&scene, "scatter");
        let error = check(&plan).unwrap_err().to_string();
        assert!(error.contains("scatter cannot") && error.contains("shear, accumulate"), "{error}");
        assert!(confidence(scene, &plan, &|_| {}).is_err());
    }
}
