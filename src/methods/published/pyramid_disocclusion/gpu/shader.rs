//! The shader, and what the program and it agree on.

use super::super::{BEST_QUARTER, MIN_KNOWN};
use crate::gpu::{Constant, Mirrored, Shader, mirrored};
use crate::methods::shared::{
    COVERAGE_PLANES_WGSL, FIRST_LEVEL_WGSL, Frame, Matting, PYRAMID_WGSL, SUB_IMAGES_WGSL, Step, VISIBLE_WGSL,
};

/// Values of a level that one workgroup sums.
pub(super) const PART_VALUES: u32 = 4096;

/// Threads of such a workgroup.
const PART_THREADS: u32 = 256;

/// The shader of all passes.
pub(super) static SHADER: Shader = Shader {
    name: "pyramid_disocclusion",
    constants: &[
        ("BEST_QUARTER", Constant::Float(BEST_QUARTER)),
        ("PART_THREADS", Constant::Uint(PART_THREADS)),
        ("PART_VALUES", Constant::Uint(PART_VALUES)),
    ],
    parts: &[
        COVERAGE_PLANES_WGSL,
        VISIBLE_WGSL,
        PYRAMID_WGSL,
        FIRST_LEVEL_WGSL,
        SUB_IMAGES_WGSL,
        include_str!("../../../../../shaders/methods/pyramid_disocclusion.wgsl"),
    ],
    structs: &[Step::LAYOUT, Frame::LAYOUT, Matting::LAYOUT, Means::LAYOUT],
};

mirrored! {
    /// Means of the known content and CoC radius.
    pub(super) struct Means {
        red: f32,
        green: f32,
        blue: f32,
        alpha: f32,
        coc_px: f32,
    }
}

impl Means {
    /// The means from sums of content, of CoC radii and of known shares; `None` where nothing is known.
    pub(super) fn from_totals(totals: &[f64]) -> Option<Self> {
        let (&known, values) = totals.split_last().filter(|(known, _)| **known > MIN_KNOWN)?;
        let means: Vec<f32> = values.iter().map(|total| (total / known) as f32).collect();
        let (&coc_px, content) = means.split_last()?;
        let mean = |channel: usize| content.get(channel).copied().unwrap_or(0.0);
        Some(Self { red: mean(0), green: mean(1), blue: mean(2), alpha: mean(3), coc_px })
    }
}
