//! [`ReflectedLight`] on a GPU: the fragments that reflect, of the whole picture, in a list.
//!
//! Memory: 64 bytes a fragment that reflects, and 4 a sample of each layer.

use super::reflected_light::{ReflectedLight, Reflecting as Sample, STEPS};
use crate::error::Error;
use crate::gpu::{Buffer, Constant, Gpu, mirrored};
use crate::scene::surface::JOIN_PX;

/// Text of the shader's functions on lens rays.
pub(in crate::methods) const LENS_RAY_WGSL: &str = include_str!("../../../shaders/shared/lens_ray.wgsl");

/// Text of the shader's functions on what rays see reflected; it comes after [`LENS_RAY_WGSL`].
pub(in crate::methods) const REFLECTED_LIGHT_WGSL: &str =
    include_str!("../../../shaders/shared/reflected_light.wgsl");

/// Constants that [`REFLECTED_LIGHT_WGSL`] needs.
pub(in crate::methods) const REFLECTED_LIGHT_CONSTANTS: [(&str, Constant); 2] =
    [("REFLECTION_STEPS", Constant::Uint(STEPS as u32)), ("REFLECTION_JOIN_PX", Constant::Float(JOIN_PX))];

/// Smaller than any CoC radius: replaces negative infinity, which WGSL does not guarantee.
const NEVER_PX: f32 = -3e38;

mirrored! {
    /// The samples of the whole stack.
    pub(in crate::methods) struct Reflecting {
        /// Columns of samples.
        columns: i32,
        /// Rows of samples.
        rows: i32,
        /// Layers.
        layers: u32,
        /// Samples per pixel along each axis.
        supersample: f32,
    }
}

/// What surfaces reflect, on a GPU.
#[derive(Debug)]
pub(in crate::methods) struct ReflectingBuffers {
    params: Buffer,
    at: Buffer,
    fragments: Buffer,
    /// Whether anything moves.
    pub reflects: bool,
}

impl ReflectingBuffers {
    /// Uploads `reflected`, or nothing.
    ///
    /// # Errors
    /// Too little memory on the GPU.
    pub(in crate::methods) fn new(gpu: &Gpu, reflected: Option<&ReflectedLight>) -> Result<Self, Error> {
        let (mut at, mut fragments) = (Vec::new(), Vec::new());
        let mut params = Reflecting { columns: 1, rows: 1, layers: 0, supersample: 1.0 };
        if let Some(reflected) = reflected {
            let [columns, rows] = reflected.size();
            params = Reflecting {
                columns: columns as i32,
                rows: rows as i32,
                layers: reflected.layers().len() as u32,
                supersample: reflected.supersample(),
            };
            at.reserve(columns * rows * reflected.layers().len());
            for layer in reflected.layers() {
                for index in 0..columns * rows {
                    let sample = layer.map(|samples| &samples[index]).filter(|sample| sample.surface > 0);
                    fragments.extend(sample.into_iter().flat_map(|sample| reflected.words(sample)));
                    at.push(if sample.is_some() { (fragments.len() / 4) as u32 } else { 0 });
                }
            }
        }
        // No buffer may be empty.
        at.resize(at.len().max(1), 0);
        fragments.resize(fragments.len().max(4), [0.0; 4]);
        Ok(Self {
            params: gpu.uniform(&params)?,
            at: gpu.upload("places that reflect", &at)?,
            fragments: gpu.upload("fragments that reflect", &fragments)?,
            reflects: reflected.is_some(),
        })
    }

    /// The buffers with their binding numbers in the shader.
    pub(in crate::methods) fn bindings(&self) -> [(u32, &Buffer); 3] {
        [(20, &self.params), (21, &self.at), (22, &self.fragments)]
    }
}

impl ReflectedLight {
    /// A fragment in the layout of the shader.
    fn words(&self, sample: &Sample) -> [[f32; 4]; 4] {
        let [red, green, blue] = sample.light;
        let [near, far] = sample.mirrored_px.map(|px| px.clamp(NEVER_PX, -NEVER_PX));
        let farthest = self.farthest_px(sample.surface).max(NEVER_PX);
        [
            [red, green, blue, sample.coc_px],
            sample.movement,
            [near, far, sample.flat, sample.curved],
            [farthest, f32::from_bits(sample.surface), 0.0, 0.0],
        ]
    }
}
