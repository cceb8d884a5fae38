//! `shear` on a GPU: `shaders/methods/shear.wgsl`.
//!
//! The CPU does what is done once per fragment, whatever the number of views, with the code of the CPU path and row by row
//! during the upload: bins, keys and the prefilter. It also computes the shifts of views, and draws the few discs of highlights
//! while the GPU paints. The rows that a band ([`band`]) reads extend past it by the reach of views and prefilter.
//!
//! Rows take turns with several sets of views, and lists are kept for each set. Where colours are averages in some places only, the
//! picture is painted with both kinds of views and blended by pixel.
//!
//! Memory: 20 bytes per fragment and 190 per pixel, 250 with near light. Translucent scenes have 32 layers at most.

mod band;
mod frame;
mod kernels;

use super::highlights::{self, Highlight};
use super::mirrors::Mirrors;
use super::picture;
use super::prepare::{self, Painted};
use crate::error::Error;
use crate::gpu::{Gpu, Shader, bands};
use crate::image::{Image, Plane};
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::scene::{EffectKind, Layer, Scene};
use band::BandBuffers;
use frame::Frame;
use kernels::SHADER;
use std::borrow::Cow;

/// `shear` on a GPU.
#[derive(Debug)]
pub(super) struct ShearGpu;

impl GpuBackend for ShearGpu {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let (layers, highlights, mirrors) = painted(scene, plan);
        let frame = Frame::new(gpu, scene, (&layers, mirrors), plan)?;
        let (painted, discs) = rayon::join(|| paint(&frame, progress), || draw_discs(&frame, &highlights));
        let (mut image, focused_share) = painted?;
        if let Some(discs) = discs {
            add_light(&mut image, &discs);
        }
        if let Some(resolve) = &frame.picture.resolve {
            resolve.soften(&mut image, focused_share);
        }
        Ok(image)
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// [`prepare::painted`] of a scene that is not modified.
fn painted<'a>(scene: &'a Scene, plan: &Plan) -> (Cow<'a, [Layer]>, Vec<Highlight>, Option<Mirrors>) {
    let changing = [EffectKind::Highlights, EffectKind::Fill, EffectKind::Reflections];
    if !changing.into_iter().any(|kind| plan.does(kind)) && scene.supersample == 1 {
        return (Cow::Borrowed(&scene.layers), Vec::new(), None);
    }
    let Painted { layers, highlights, mirrors } = prepare::painted(scene.clone(), plan);
    (Cow::Owned(layers), highlights, mirrors)
}

/// Adds the colours of `light` to `image`.
fn add_light(image: &mut Image, light: &Image) {
    for (plane, light) in image.planes.iter_mut().zip(&light.planes).take(3) {
        plane.values_mut().iter_mut().zip(light.values()).for_each(|(value, light)| *value += light);
    }
}

/// Paints all bands. Returns the picture with smooth near light and, for each pixel, the share of rays that hit something in focus.
fn paint(frame: &Frame<'_>, progress: &Progress<'_>) -> Result<(Image, Plane), Error> {
    let (width, height) = frame.picture.size;
    let mut planes: Vec<Plane> = (0..frame.planes()).map(|_| Plane::zeros(width, height)).collect();
    let bands = bands(height, frame.reach(), frame.max_rows())?;
    for (i, band) in bands.iter().enumerate() {
        let share = |done: f32| progress((i as f32 + done) / bands.len() as f32);
        let picture = BandBuffers::new(frame, band)?.picture(&share)?;
        let values = band.rows.start * width..band.rows.end * width;
        let mut parts: Vec<&mut [f32]> =
            planes.iter_mut().map(|plane| &mut plane.values_mut()[values.clone()]).collect();
        frame.gpu.read_into(&picture, &mut parts)?;
    }
    Ok(picture::smoothed(planes, frame.near.as_ref()))
}

/// The discs of `highlights` on a transparent picture; `None` without highlights.
fn draw_discs(frame: &Frame<'_>, highlights: &[Highlight]) -> Option<Image> {
    if highlights.is_empty() {
        return None;
    }
    let (bins, layers, picture) = (&frame.bins, frame.layers, &frame.picture);
    let (width, height) = picture.size;
    let mut discs = Image::transparent(width, height);
    highlights::draw(&mut discs, highlights, (picture.plan, picture.field), (layers, bins));
    Some(discs)
}
