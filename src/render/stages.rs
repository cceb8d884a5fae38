//! The stages of a job from stack to plan: lens, scene, decision.

use super::environment::Reflecting;
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::lens::{LensSpec, Optics, SHARP_COC_PX, Sharpness, ThinLens, aperture_radius};
use crate::methods::{Plan, Registry};
use crate::scene::{self, DepthInUse, EffectKind, Focused, FrameNumber, Scene, SceneStats};
use crate::settings::{Border, DepthConvention, Origin, Settings};
use crate::stack::depth::DepthScale;
use crate::stack::{Peel, Stack};

/// The lens that `settings` set for `stack`, with the number of its frame, and the depths between which it is sharp.
pub(super) fn lens(
    stack: &mut Stack,
    settings: &Settings,
    frame: Option<FrameNumber>,
) -> Result<(ThinLens, Sharpness), Error> {
    let scale = depth_scale(stack, settings)?;
    let focus = &settings.lens.focus.value;
    let Focused { distance, reason, is_elsewhere } = scene::focus_distance(stack, &scale, focus, frame)?;
    let finding = |reason| Finding { warning: is_elsewhere, ..Finding::note("focus", reason) };
    stack.findings.extend(reason.map(finding));
    let radius = aperture_radius(settings.lens.squeeze.value, stack.frame.usable_pixel_aspect());
    let picture_width = stack.frame.display.width as f32 / stack.supersample as f32 * radius;
    let spec = lens_spec(settings, distance);
    let lens = ThinLens::new(&spec, picture_width)?;
    Ok((lens, spec.sharpness(picture_width, SHARP_COC_PX)))
}

/// The depths of `stack`, and how much `lens` blurs them.
pub(super) fn depth_in_use(stack: &Stack, settings: &Settings, lens: &ThinLens) -> Result<DepthInUse, Error> {
    Ok(DepthInUse::of(stack, lens, &depth_scale(stack, settings)?))
}

/// A note about settings of the lens that are left at their defaults for a file of Blender, which writes nothing of its camera.
pub(super) fn default_lens(stack: &Stack, settings: &Settings) -> Option<Finding> {
    let is_blenders = stack.is_by_blender();
    let lens = &settings.lens;
    let mut defaults = Vec::new();
    if lens.focal_length_mm.origin == Origin::Default {
        defaults.push((format!("{} mm", lens.focal_length_mm.value), "focal_length_mm"));
    }
    if lens.f_number.origin == Origin::Default {
        defaults.push((format!("f/{}", lens.f_number.value), "f_number"));
    }
    if lens.sensor_width_mm.origin == Origin::Default {
        defaults.push((format!("a sensor of {} mm", lens.sensor_width_mm.value), "sensor_width_mm"));
    }
    let values: Vec<&str> = defaults.iter().map(|(value, _)| value.as_str()).collect();
    let keys: Vec<String> = defaults.iter().map(|(_, key)| format!("`{key}`")).collect();
    let text = format!(
        "the file of Blender does not say its lens: {} by default; set {} as its camera has them",
        values.join(", "),
        keys.join(", ")
    );
    (is_blenders && !defaults.is_empty()).then(|| Finding::note("camera", text))
}

/// From stack to plan; the stack's peels move into the scene.
pub(super) fn decide(
    stack: &mut Stack,
    settings: &Settings,
    lens: &ThinLens,
    methods: &Registry,
) -> Result<(Scene, SceneStats, Plan), Error> {
    let scene = scene(stack, settings, lens)?;
    stack.findings.extend(limited(&scene));
    let astray_px = Optics::new(settings, &scene.field)?.max_displacement_px();
    let scene = bordered(scene, settings.picture.border.value, astray_px, &mut stack.findings);
    let (scene, stats, plan) = methods.prepare(scene, settings)?;
    stack.findings.extend(not_round(stack.frame.usable_pixel_aspect(), &plan));
    Ok((scene, stats, plan))
}

/// The scene of `stack`, whose peels move into it, with the environment that its surfaces reflect.
pub(super) fn scene(stack: &mut Stack, settings: &Settings, lens: &ThinLens) -> Result<Scene, Error> {
    let reflecting = Reflecting::of(stack, settings)?;
    let scene = Scene::from_stack(stack, lens, &depth_scale(stack, settings)?);
    let environment = reflecting.and_then(|reflecting| reflecting.shading(&scene));
    Ok(Scene { environment, ..scene })
}

/// The warning that the method of `plan` takes pixels for square, if they are not.
fn not_round(pixel_aspect: f32, plan: &Plan) -> Option<Finding> {
    let can = plan.method.info().effects.contains(&EffectKind::Squeeze);
    let text = format!(
        "{} blurs as if pixels were square, and they are {pixel_aspect} times as wide as high: set `method = shear`",
        plan.method
    );
    (pixel_aspect != 1.0 && plan.does(EffectKind::Blur) && !can).then(|| Finding::warning("frame", text))
}

/// The scene whose red is what the fragments of `stack` show of their alpha, with the border of the stack's own scene; `None` without a
/// holdout. Takes [`Stack::shown`].
pub(super) fn shown(stack: &mut Stack, settings: &Settings, lens: &ThinLens) -> Result<Option<Scene>, Error> {
    let shown = std::mem::take(&mut stack.shown);
    if shown.is_empty() {
        return Ok(None);
    }
    let white = |(peel, red): (&Peel, Plane)| {
        let black = Plane::zeros(red.width(), red.height());
        Peel { color: [red, black.clone(), black], alpha: peel.alpha.clone(), depth: peel.depth.clone() }
    };
    let mut peels = stack.peels.iter().zip(shown).map(white).collect();
    std::mem::swap(&mut stack.peels, &mut peels);
    // What the stack reflects is not its alpha's.
    let shading = std::mem::take(&mut stack.shading);
    let scene = Scene::from_stack(stack, lens, &depth_scale(stack, settings)?);
    (stack.peels, stack.shading) = (peels, shading);
    let astray_px = Optics::new(settings, &scene.field)?.max_displacement_px();
    Ok(Some(bordered(scene, settings.picture.border.value, astray_px, &mut Vec::new())))
}

/// The warning about fragments of `scene` whose CoC radius was limited, if there are any.
pub(super) fn limited(scene: &Scene) -> Option<Finding> {
    let (width, height) = scene.picture_size();
    let limit = scene::coc_limit_px(width, height);
    let text = format!(
        "the CoC radius of {} fragments, so near the lens or of so much blur, was limited to {limit} px",
        scene.limited_fragments
    );
    (scene.limited_fragments > 0).then(|| Finding::warning("coc", text))
}

/// `scene` extended beyond the frame as `border` says, with a finding.
pub(super) fn bordered(scene: Scene, border: Border, astray_px: f32, findings: &mut Vec<Finding>) -> Scene {
    let content = match border {
        Border::Clamp => return scene,
        Border::Mirror => "its reflection",
        Border::Transparent => "nothing",
    };
    let reach_px = scene.reach_px(astray_px);
    let scene = scene.padded(border, reach_px);
    let [columns, rows] = scene.outside_px;
    findings.push(Finding::note(
        "border",
        format!(
            "{columns} columns and {rows} rows of {content} on either side of the frame, as far as the blur reaches"
        ),
    ));
    if columns.min(rows) < reach_px {
        let text = format!(
            "the blur reaches {reach_px} px beyond the frame; farther out, the last row or column is repeated"
        );
        findings.push(Finding::warning("border", text));
    }
    scene
}

/// The conversion of the stack's depth into planar depth.
pub(super) fn depth_scale(stack: &Stack, settings: &Settings) -> Result<DepthScale, Error> {
    let set = [settings.lens.near.value, settings.lens.far.value];
    // Depth that has 1 near was turned around as it was read.
    let [near, far] = if stack.near_is_one { [set[1], set[0]] } else { set };
    if stack.convention == DepthConvention::Normalised && far <= near {
        return Err(Error::settings("the far end of normalised depth must lie beyond its near end")
            .with("found", format!("near {}, far {}", set[0], set[1]))
            .help("set the distances of depth 0 and depth 1, `near` and `far`: both, if depth 1 is near"));
    }
    let focal_lengths = settings.lens.focal_length_mm.value / settings.lens.sensor_width_mm.value;
    Ok(DepthScale {
        convention: stack.convention,
        near_clip: settings.lens.near_clip.value,
        near_far: [near, far],
        focal_px: focal_lengths * stack.frame.display.width as f32,
    })
}

fn lens_spec(settings: &Settings, focus_distance: f32) -> LensSpec {
    LensSpec {
        focal_length_mm: settings.lens.focal_length_mm.value,
        f_number: settings.lens.f_number.value,
        focus_distance,
        sensor_width_mm: settings.lens.sensor_width_mm.value,
        sensor_distance: settings.lens.sensor_distance.value,
        metres_per_unit: settings.lens.metres_per_unit.value,
    }
}
