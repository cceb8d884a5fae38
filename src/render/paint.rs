//! From plan to picture: where it is carried out, and how many lens samples it takes.

use crate::cost::Calibration;
use crate::error::Error;
use crate::gpu::{self, Device, DeviceChoice, Gpu};
use crate::image::{Image, Plane};
use crate::methods::{self, METHODS, Plan, Progress, Target};
use crate::sample_budget::{self, Outcome};
use crate::scene::{EffectKind, Scene, SceneStats};

/// A picture by a plan.
#[derive(Debug)]
pub(super) struct Painted {
    pub(super) image: Image,
    /// How the number of lens samples was found, where the plan has a goal instead.
    pub(super) outcome: Option<Outcome>,
    /// Why the GPU did not make it, where it should have.
    pub(super) fault: Option<Error>,
}

/// The picture of `scene` by `plan` on `gpu`.
pub(super) fn on_gpu(
    gpu: &Gpu,
    scene: Scene,
    plan: &Plan,
    progress: &Progress<'_>,
) -> Result<Painted, Error> {
    let outcome = match plan.target {
        Some(Target::Error { psnr_db, max_views }) => {
            Some(sample_budget::find_views(scene.clone(), plan, (psnr_db, max_views))?)
        }
        _ => None,
    };
    let views = outcome.as_ref().map(|outcome| outcome.views).or(plan.views);
    let (image, fault) = methods::render_on(gpu, scene, &Plan { views, ..plan.clone() }, progress)?;
    Ok(Painted { image, outcome, fault })
}

/// The same on the CPU.
pub(super) fn on_cpu(
    scene: Scene,
    (stats, plan): (&SceneStats, &Plan),
    calibration: &Calibration,
    progress: &Progress<'_>,
) -> Result<Painted, Error> {
    let (image, outcome) = match plan.target.filter(|_| plan.does(EffectKind::Blur)) {
        Some(Target::Error { psnr_db, max_views }) => {
            sample_budget::render_to_target(scene, plan, (psnr_db, max_views), progress)?
        }
        Some(Target::Time { seconds }) => {
            sample_budget::render_within(scene, (stats, plan), seconds, calibration, progress)?
        }
        None => {
            let image = methods::render(scene, plan, progress)?;
            return Ok(Painted { image, outcome: None, fault: None });
        }
    };
    Ok(Painted { image, outcome: Some(outcome), fault: None })
}

/// What a picture by `plan` shows of its alpha: the red of `scene`, blurred as its picture is, on `gpu` if there is one. No light is drawn.
pub(super) fn shown_alpha(
    gpu: Option<&Gpu>,
    scene: Scene,
    plan: &Plan,
    progress: &Progress<'_>,
) -> Result<Plane, Error> {
    let plan = Plan { target: None, ..plan.clone().forced(EffectKind::Highlights, false) };
    let image = match gpu {
        Some(gpu) => methods::render_on(gpu, scene, &plan, progress)?.0,
        None => methods::render(scene, &plan, progress)?,
    };
    let [mut alpha, ..] = image.planes;
    alpha.values_mut().iter_mut().for_each(|alpha| *alpha = alpha.clamp(0.0, 1.0));
    Ok(alpha)
}

/// Where to carry out `plan`, and the GPU if it is one; `demanded` is the one that `choice` insists on.
pub(super) fn device(
    choice: DeviceChoice,
    demanded: Option<Gpu>,
    plan: &Plan,
    open: gpu::Open<'_>,
) -> Result<(Device, Option<Gpu>), Error> {
    if !plan.does(EffectKind::Blur) {
        return Ok((Device::cpu("there is nothing to blur"), None));
    }
    let cpu_only_reason = methods::cpu_only_reason(plan);
    if let (DeviceChoice::Gpu, Some(cpu_only_reason)) = (choice, &cpu_only_reason) {
        let able = METHODS.iter().filter(|method| method.gpu().is_some());
        let able: Vec<&str> = able.map(|method| method.info().name).collect();
        return Err(Error::settings(cpu_only_reason.clone())
            .help(format!("use `device = auto`; methods that run on a GPU: {}", able.join(", "))));
    }
    Ok(gpu::choose(choice, demanded, cpu_only_reason, open))
}
