//! CONFIDENCE: the share of each pixel's light that comes from surfaces in the stack, as opposed to estimates.
//!
//! Two things are unknown: the surfaces of the disocclusion fill ([`Scene::filled`]), and what the rays that hit nothing would have hit
//! although no background is visible there. The picture leaves such rays out of its mean, so they are not visible in it.
//!
//! The same method blurs the same geometry by the same plan with other colours: 1 for known surfaces, 0 for estimated ones and for rays
//! that end where the stack has nothing ([`LostRays::Black`]). Rays that end in the background are known to be transparent and count as 1.
//! Passes that only smooth the picture are left out.
//!
//! Cost: that of the blur, once more. Memory: that of the scene. Limits: only for methods that follow lens rays; the others spread known
//! light over unknown areas, and cannot separate them afterwards. Samples repeated past the frame's border count as
//! known, and rays that `layer-rays` discards there are not counted, as in the picture.

use crate::error::Error;
use crate::image::Plane;
use crate::methods::{self, LostRays, METHODS, Plan, Progress};
use crate::scene::{EffectKind, Scene};

/// Checks that the method of `plan` can measure confidence.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] if it does not follow lens rays.
pub(crate) fn check(plan: &Plan) -> Result<(), Error> {
    if plan.method.lens_sampling().is_some() {
        return Ok(());
    }
    let able = METHODS.iter().filter(|method| method.lens_sampling().is_some());
    let able: Vec<&str> = able.map(|method| method.info().name).collect();
    Err(Error::settings(format!("{} cannot measure how much of its picture the stack knows", plan.method))
        .with("expected", "a method that follows lens rays")
        .help(format!("use one of {}, or leave out `confidence`", able.join(", "))))
}

/// The share of each pixel's light, 0 … 1, that comes from surfaces of `scene`, rendered by `plan`.
///
/// # Errors
/// Those of [`check`] and of the method.
pub(crate) fn confidence(scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Plane, Error> {
    check(plan)?;
    let (width, height) = scene.picture_size();
    if !plan.does(EffectKind::Blur) {
        return Ok(Plane::filled(width, height, 1.0));
    }
    let known = with_known_surfaces_white(scene, plan.does(EffectKind::Fill));
    let [mut light, _, _, alpha] = methods::render(known, &without_color_passes(plan), progress)?.planes;
    for (light, alpha) in light.values_mut().iter_mut().zip(alpha.values()) {
        // Rounding can bring the sum of many views above 1.
        *light = (*light + 1.0 - alpha).clamp(0.0, 1.0);
    }
    Ok(light)
}

/// `plan` without the passes that depend on colour, with lost rays visible, for a scene that is filled already.
fn without_color_passes(plan: &Plan) -> Plan {
    let left_out = [
        EffectKind::Reflections,
        EffectKind::Environment,
        EffectKind::Highlights,
        EffectKind::Fill,
        EffectKind::Prefilter,
        EffectKind::Resolve,
    ];
    let reduced = left_out.into_iter().fold(plan.clone(), |plan, kind| plan.forced(kind, false));
    Plan { lost_rays: LostRays::Black, ..reduced }
}

/// `scene`, filled if `fill` is set, with a premultiplied red of 1 for known surfaces and of 0 for estimated ones.
fn with_known_surfaces_white(scene: Scene, fill: bool) -> Scene {
    // The estimated surface is the layer after the merged ones, which may be more than those of the stack.
    let mut scene = if fill { scene.merged() } else { scene };
    let known = scene.layers.len();
    if fill {
        scene = scene.filled();
    }
    for (i, layer) in scene.layers.iter_mut().enumerate() {
        let black = || Plane::zeros(layer.width(), layer.height());
        let red = if i < known { layer.alpha.clone() } else { black() };
        let color = [red, black(), black()];
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

    /// A scene of `layers`, each of which gives the CoC radius in a column, or `None` where it is empty.
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

    /// A surface in focus on the left, in front of a wall with a CoC radius of 12 px.
    const IN_FRONT: fn(usize) -> Option<f32> = |x| Some(if x < EDGE { 0.0 } else { BLUR });
    const BLUR: f32 = 12.0;

    /// The hidden part of the wall.
    const HIDDEN: fn(usize) -> Option<f32> = |x| (x < EDGE).then_some(BLUR);

    /// The part of a disc's area on the far side of a line at `distance` radii from its centre.
    fn segment(distance: f32) -> f32 {
        let t = distance.clamp(-1.0, 1.0);
        (t.acos() - t * (1.0 - t * t).sqrt()) / PI
    }

    #[test]
    fn beside_an_edge_the_hidden_part_of_the_disc_is_unknown() {
        // A ray of a pixel on the wall hits it at p + 12 u: behind the surface in front if that is left of the edge. There shear has
        // an estimated surface, the others none.
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
            assert!((found.get(EDGE - 4, HEIGHT / 2) - 1.0).abs() < 1e-3, "{method}: known in focus");
        }
    }

    #[test]
    fn a_stack_with_the_hidden_surfaces_is_fully_known() {
        for method in ["shear", "accumulate"] {
            let found = found(&[IN_FRONT, HIDDEN], method);
            let min = found.values().iter().copied().fold(1.0, f32::min);
            assert!(min > 0.999, "{method}: {min}");
        }
    }

    #[test]
    fn a_picture_in_focus_is_fully_known() {
        let found = found(&[|x| Some(if x < EDGE { 0.0 } else { 0.25 })], "shear");
        assert!(found.values().iter().all(|&share| share == 1.0));
    }

    #[test]
    fn a_transparent_background_is_known() {
        let found = found(&[|x| (x < EDGE).then_some(-6.0)], "accumulate");
        let min = found.values().iter().copied().fold(1.0, f32::min);
        assert!(min > 0.999, "{min}");
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
