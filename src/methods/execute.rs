//! Carrying out a plan: on the CPU, or on a GPU with the CPU to fall back on.

use super::contract::{Plan, Progress};
use super::target::Target;
use crate::error::Error;
use crate::gpu::{self, Gpu};
use crate::image::Image;
use crate::scene::{EffectKind, Scene};

/// Carries out `plan`: the picture of `scene`, of its picture size.
///
/// # Errors
/// Those of the method.
pub fn render(scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
    if !plan.does(EffectKind::Blur) {
        return Ok(scene.into_pinhole());
    }
    plan.method.blur(scene, plan, progress)
}

/// Why `plan` cannot be carried out on a GPU, if it cannot.
pub(crate) fn cpu_only_reason(plan: &Plan) -> Option<String> {
    match plan.target {
        _ if !gpu::IS_SUPPORTED => Some(gpu::LOOKED_FOR.to_owned()),
        _ if plan.method.gpu().is_none() => Some(format!("{} runs on the CPU alone", plan.method)),
        Some(Target::Time { .. }) => Some("the time that views take is known for the CPU only".to_owned()),
        _ => None,
    }
}

/// Carries out `plan` as [`render`] does, on `gpu`; where that fails, on the CPU, and says what failed.
///
/// # Errors
/// Those of the method on the CPU.
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
