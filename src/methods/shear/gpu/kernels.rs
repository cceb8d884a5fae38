//! The shader of `shear`, and the constants and structures that it shares with the program.

use crate::gpu::{Constant, Mirrored, Shader, mirrored};
use crate::methods::shared::{
    LENS_RAY_WGSL, LensRay, REFLECTED_LIGHT_CONSTANTS, REFLECTED_LIGHT_WGSL, Reflecting,
};
use crate::methods::shear::bins::LEVELS;
use crate::methods::shear::bins::MAX_BINS;
use crate::methods::shear::keys::{BIN_SHIFT, CHANGES_PEEL, EXTRA_MASK, EXTRA_SHIFT, NO_KEY, OPAQUE};
use crate::methods::shear::mirrors::SAME_PX;
use crate::methods::shear::near::{FROM_PX, FULL_FROM_PX};
use crate::methods::shear::paint::MIN_TRANSMITTANCE;
use crate::methods::shear::sums::MIN_HIT_VIEWS;
use crate::scene::MAX_TRANSLUCENT_LAYERS;

/// The shader.
pub(super) static SHADER: Shader = Shader {
    name: "shear",
    constants: &[
        ("MIN_TRANSMITTANCE", Constant::Float(MIN_TRANSMITTANCE)),
        ("MIN_HIT_VIEWS", Constant::Float(MIN_HIT_VIEWS)),
        ("NEAR_FROM_PX", Constant::Float(FROM_PX)),
        ("NEAR_FULL_FROM_PX", Constant::Float(FULL_FROM_PX)),
        ("BIN_SHIFT", Constant::Uint(BIN_SHIFT)),
        ("EXTRA_SHIFT", Constant::Uint(EXTRA_SHIFT)),
        ("EXTRA_MASK", Constant::Uint(EXTRA_MASK)),
        ("OPAQUE", Constant::Uint(OPAQUE)),
        ("CHANGES_PEEL", Constant::Uint(CHANGES_PEEL)),
        ("NO_KEY", Constant::Uint(NO_KEY)),
        ("BIN_BITS", Constant::Uint(MAX_BINS.ilog2())),
        ("HALF_MAX_BINS", Constant::Uint((MAX_BINS / 2) as u32)),
        ("LEVELS", Constant::Uint(LEVELS as u32)),
        ("MAX_TRANSLUCENT_LAYERS", Constant::Uint(MAX_TRANSLUCENT_LAYERS as u32)),
        ("TILE", Constant::Uint(TILE as u32)),
        ("BLOCK", Constant::Uint(BLOCK as u32)),
        ("SQUARE", Constant::Uint(SQUARE as u32)),
        ("MIRROR_SAME_PX", Constant::Float(SAME_PX)),
        ("STEEP", Constant::Float(LensRay::STEEP)),
        REFLECTED_LIGHT_CONSTANTS[0],
        REFLECTED_LIGHT_CONSTANTS[1],
        REFLECTED_LIGHT_CONSTANTS[2],
    ],
    parts: &[
        LENS_RAY_WGSL,
        REFLECTED_LIGHT_WGSL,
        include_str!("../../../../shaders/methods/shear.wgsl"),
        include_str!("../../../../shaders/methods/shear_lists.wgsl"),
    ],
    structs: &[Params::LAYOUT, View::LAYOUT, Reflecting::LAYOUT],
};

/// Side of the shader's tiles, in pixels: twice that of its workgroups. Each turn has an eighth of a tile's rows, so that smaller tiles would
/// have lists for few pixels each.
pub(super) const TILE: usize = 32;

/// Side of the shader's blocks, in pixels.
pub(super) const BLOCK: usize = 4;

/// Initial capacity of a list of groups. Most lists have one or two entries; lists are built again if one is longer.
pub(super) const LIST_ENTRIES: usize = 16;

/// Side of the shader's squares, in tiles.
pub(super) const SQUARE: usize = 2;

/// Bytes of a colour.
pub(super) const TEXEL_BYTES: usize = size_of::<[f32; 4]>();

/// Layers whose keys share a texel.
pub(super) const LAYERS_PER_TEXEL: usize = 4;

/// Planes of sums: red, green, blue, rays that hit something in focus, rays that end in the background, lost rays, and rays that the
/// barrel hides.
pub(super) const SUMS: usize = 7;

/// Further planes of sums with near light: its red, green and blue, rays that near surfaces stop, and their CoC radius.
pub(super) const NEAR_SUMS: usize = 5;

mirrored! {
    /// The parameters of all kernels, documented in the shader.
    pub(super) struct Params {
        width: u32,
        height: u32,
        source_start: u32,
        source_rows: u32,
        band_start: u32,
        band_rows: u32,
        layers: u32,
        bins: u32,
        words: u32,
        entries: u32,
        focused_start: u32,
        focused_end: u32,
        near_end: u32,
        near_pairs_from: u32,
        near_fours_from: u32,
        near_eights_from: u32,
        near_sixteens_from: u32,
        views: u32,
        batch_views: u32,
        turns: u32,
        lost_are_black: u32,
        channels: u32,
        blends: u32,
        near_share_plane: u32,
        cats_eye: f32,
        axis_x_px: f32,
        axis_y_px: f32,
        half_diagonal_px: f32,
        softness: f32,
    }
}

mirrored! {
    /// A lens sample, documented in the shader.
    pub(super) struct View {
        lens_x: f32,
        lens_y: f32,
        jitter_x: f32,
        jitter_y: f32,
        shift_x: f32,
        shift_y: f32,
        at_infinity: u32,
    }
}
