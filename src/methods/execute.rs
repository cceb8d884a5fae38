//! Executes a plan: on the CPU, or on a GPU with the CPU as fallback.

use super::contract::{Plan, Progress};
use super::target::Target;
use crate::error::Error;
use crate::gpu::{self, Gpu};
use crate::image::Image;
use crate::scene::{EffectKind, Scene};

/// Renders `scene` by `plan` on the CPU, at the scene's picture size.
///
/// # Errors
/// Those of [`Method::blur`](super::Method::blur).
pub fn render(scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
    if !plan.does(EffectKind::Blur) {
        return Ok(scene.into_pinhole());
    }
    plan.method.blur(scene, plan, progress)
}

/// Why `plan` has to run on the CPU; `None` if it can run on a GPU.
pub(crate) fn cpu_only_reason(plan: &Plan) -> Option<String> {
    match plan.target {
        _ if !gpu::IS_SUPPORTED => Some(gpu::LOOKED_FOR.to_owned()),
        _ if plan.method.gpu().is_none() => Some(format!("{} runs on the CPU only", plan.method)),
        _ if plan.does(EffectKind::Environment) => {
            Some("the environment is shaded on the CPU only".to_owned())
        }
        Some(Target::Time { .. }) => Some("the time per view is known for the CPU only".to_owned()),
        _ => None,
    }
}

/// Renders `scene` by `plan` on `gpu`; if that fails, on the CPU, and returns the GPU's error with the picture.
///
/// # Errors
/// Those of [`render`].
pub fn render_on(
    gpu: &Gpu,
    scene: Scene,
    plan: &Plan,
    progress: &Progress<'_>,
) -> Result<(Image, Option<Error>), Error> {
    let backend = plan.method.gpu().filter(|_| plan.does(EffectKind::Blur));
    let fault = match backend.map(|backend| backend.blur(gpu, &scene, plan, progress)) {
        Some(Ok(image)) => return Ok((image, None)),
        Some(Err(fault)) => Some(fault),
        None => None,
    };
    render(scene, plan, progress).map(|image| (image, fault))
}
