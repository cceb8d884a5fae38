//! Code that several methods use: the stack as content and coverage, the background behind it, sorted fragments and N-buffers for
//! rays, samplers that render each pixel independently, the area of a discrete disc, image pyramids, sub-images by depth, and GPU
//! planes, ray batches and the limit of translucent layers.

mod backdrop;
mod content;
mod dilation;
mod disc;
mod fragments;
mod lens_ray;
mod nbuffer;
#[cfg(feature = "gpu")]
mod planes;
mod pyramid;
#[cfg(feature = "gpu")]
mod ray_batches;
mod ray_jitter;
#[cfg(feature = "gpu")]
mod ray_stack;
mod ray_sum;
mod rays;
mod reflected_light;
#[cfg(feature = "gpu")]
mod reflected_light_gpu;
mod rows;
mod sub_image_work;
mod sub_images;
#[cfg(feature = "gpu")]
mod translucency;

pub(super) use backdrop::{Backdrop, before, known};
pub(super) use content::{
    CoveragePlanes, Peel, Visible, VisibleSurfaces, peels, picture, presence, visible, visible_surfaces,
};
pub(super) use dilation::{LAST_LEVEL, dilate, level, radius_px};
pub(super) use disc::{DiscAreas, soft_area};
#[cfg(test)]
pub(super) use fragments::noise;
pub(super) use fragments::{Blocks, Fragments};
pub(super) use lens_ray::LensRay;
pub(super) use nbuffer::NBuffer;
#[cfg(feature = "gpu")]
pub(super) use planes::{
    COVERAGE_PLANES_WGSL, Frame, OTHER_COVERAGE_PLANES_WGSL, Planes, RowNeeds, VISIBLE_WGSL, at_pixels,
    bands_of, picture_before, picture_in_bands, picture_of_bands,
};
pub(super) use pyramid::{BOX, Edge, Grid, Rows, SPLAT, max_levels};
#[cfg(feature = "gpu")]
pub(super) use pyramid::{FIRST_LEVEL_WGSL, Levels, PYRAMID_WGSL, Step, corners, reach};
#[cfg(feature = "gpu")]
pub(super) use ray_batches::{
    Batch, Batches, RAY_SUMS, RAY_SUMS_CONSTANT, RayBindings, RayEnds, picture_of_batches,
};
pub(super) use ray_jitter::RayJitter;
#[cfg(feature = "gpu")]
pub(super) use ray_stack::{
    NBUFFER_WORDS, RAY_STACK, RAY_STACK_CONSTANTS, RayStack, RayViews, Stack, StackRows, View, bits,
    nbuffer_words,
};
#[cfg(feature = "gpu")]
pub(super) use ray_sum::MIN_HIT;
pub(super) use ray_sum::RaySum;
pub(super) use rays::{RaySampler, Tracer};
pub(super) use reflected_light::{Met, ReflectedLight};
#[cfg(feature = "gpu")]
pub(super) use reflected_light_gpu::{
    LENS_RAY_WGSL, REFLECTED_LIGHT_CONSTANTS, REFLECTED_LIGHT_WGSL, Reflecting, ReflectingBuffers,
};
pub(super) use rows::{WriteRow, fill_rows, planes_from_rows};
pub(super) use sub_image_work::sub_image_pixels;
pub(super) use sub_images::SubImages;
#[cfg(feature = "gpu")]
pub(super) use sub_images::{Matting, SUB_IMAGES_WGSL};
#[cfg(feature = "gpu")]
pub(super) use translucency::has_translucent;
