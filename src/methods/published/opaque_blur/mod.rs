//! Opaque image blur: sub-images by depth, blurred by a filter that never lowers their opacity.
//!
//! Kraus 2011, "Using Opaque Image Blur for Real-Time Depth-of-Field Rendering". Only the pinhole picture is read. For each
//! sub-image, farthest first: its pixels are matted out by depth (section 3, `shared/sub_images.rs`), blurred by the
//! opaque image blur (section 4) and composited over the result (eq. 6). The opaque blur of sub-image `i` is a pyramid of `|i|`
//! levels, 4×4 box analysis and biquadratic B-spline synthesis, with two syntheses from one analysis: the ordinary one,
//! `RGBA_blur`, and a glow of alpha, `A_syn = A_exp + A_ana − A_exp·A_ana` at each level (eqs. 8, 9), which is at least
//! the alpha of the sub-image itself everywhere. The result is `RGBA_blur · A_glow / A_blur` (eq. 7). So the blur uncovers
//! nothing that the pinhole picture hides, and silhouettes are too opaque, a drawback that the paper states.
//!
//! Not specified by the paper: the border of transparent black is at least one pixel wide, and wide enough to round the frame up
//! to multiples of 2^levels (`shared/pyramid`). Past it every level is transparent. Pixels that matting and glow leave partly
//! uncovered, by rounding only, are divided by coverage at the end.
//!
//! The paper states a radius of 1.7·2^(n−1) px for the blur of `n` levels. Its standard deviation is `√(2(4ⁿ − 1)/3)`, that of a
//! disc of radius 2.8, 6.3, 13.0 …: the radius of the paper describes the core of the kernel, and everything is blurred nearly
//! twice as far as by a disc. `first_radius_px = 3.2` makes the variances agree.
//!
//! Cost: pixels × sub-images, about two for each doubling of the largest CoC radius, for every scene. Memory: six
//! planes and a pyramid. Limits: one colour and depth per pixel; no aperture shape; behind focus no sub-image is blurred by
//! more than `r_∞`, so the blur of everything beyond the last possible sub-image is up to half too small.
//!
//! GPU backend: `shaders/methods/opaque_blur.wgsl`.

mod cost;
#[cfg(feature = "gpu")]
mod gpu;
mod parameters;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::{Method, MethodInfo, Plan, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{self, BOX, CoveragePlanes, Edge, Grid, Rows, SubImages, Visible};
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use parameters::OpaqueBlurParameters;

/// The opaque image blur.
#[derive(Debug)]
pub(in crate::methods) struct OpaqueBlur;

impl Method for OpaqueBlur {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "opaque-blur",
            source: "Kraus 2011",
            role: Role::Paper,
            summary: "sub-images by depth of the pinhole picture, blurred without ever lowering their opacity",
            effects: &[EffectKind::Merge],
            lens_samples: None,
            steps: &["first_radius_px=3.4", "first_radius_px=1.7", "first_radius_px=0.85"],
            deviations: DEVIATIONS,
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<OpaqueBlurParameters>()
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let frame = scene.picture_size();
        let images = sub_images(&scene, plan);
        let visible = shared::visible(scene, plan);
        let mut result = CoveragePlanes::unknown(frame.0, frame.1, visible.content.len());
        let count = images.far_to_near().count();
        for (done, i) in images.far_to_near().enumerate() {
            composite(&visible, &images, i, &mut result);
            progress((done + 1) as f32 / count as f32);
        }
        Ok(result.into_picture())
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

/// The sub-images of the picture of `scene`.
fn sub_images(scene: &Scene, plan: &Plan) -> SubImages {
    let first_radius_px = plan.parameters.get::<OpaqueBlurParameters>().first_radius_px;
    SubImages::new(first_radius_px, plan.coc_range_px, scene.coc_infinity_px, scene.picture_size())
}

/// Measured over all cases of each law, rounded outward.
const DEVIATIONS: &[Deviation] = &[
    Deviation {
        law: Law::SeeThrough,
        within: [0.0, 1e-5],
        reason: "no blur lowers an opacity (section 4), and a pinhole picture shows nothing behind the bar",
    },
    Deviation {
        law: Law::Transparency,
        within: [0.999, 1.74],
        reason: "the glow makes silhouettes too opaque (section 5)",
    },
    Deviation {
        law: Law::Energy,
        within: [0.999, 1.34],
        reason: "eq. 7 rescales to the glow, next to transparent black at the border",
    },
    Deviation {
        law: Law::Place,
        within: [0.4, 0.54],
        reason: "the 4×4 box shifts the centre of a sample by half a pixel in the coarser level",
    },
    Deviation {
        law: Law::Spread,
        within: [3.3, 8.5],
        reason: "1.7·2^(n−1) px is the core of the kernel of n levels, whose variance is that of a larger disc",
    },
    Deviation {
        law: Law::Locality,
        within: [0.0006, 0.0021],
        reason: "the blur is a Gaussian, which reaches past the disc",
    },
    Deviation {
        law: Law::Edge,
        within: [0.08, 0.49],
        reason: "the glow makes silhouettes too opaque (section 5)",
    },
    Deviation {
        law: Law::Convergence,
        within: [28.0, 29.5],
        reason: "one pinhole picture, a Gaussian of a few sizes, too opaque silhouettes",
    },
    Deviation {
        law: Law::Supersampling,
        within: [21.8, 22.6],
        reason: "a pixel at an edge has one depth; silhouettes are too opaque",
    },
];

/// Mattes sub-image `i`, applies the opaque blur and composites it over `result`.
fn composite(visible: &Visible, images: &SubImages, i: i32, result: &mut CoveragePlanes) {
    let frame = (result.coverage.width(), result.coverage.height());
    let grid = Grid::new(frame, i.unsigned_abs() as usize, Edge::Clear);
    let channels = visible.content.len();
    let matte = |y: usize, rows: &mut Rows| matte_row(visible, images, i, y, &grid, rows);
    let blurred = (i != 0).then(|| blur_and_glow(&grid, channels + 1, &matte));
    let scratch = || {
        let rows = |count: usize| vec![vec![0.0; grid.sizes[0].0]; count];
        (rows(channels + 1), rows(channels + 2), Vec::new())
    };
    result.for_rows(&scratch, &|(matted, expanded, blend), y, result| {
        matte_row(visible, images, i, y, &grid, matted);
        let Some(blurred) = &blurred else {
            grid.lay_row_over(matted, result);
            return;
        };
        grid.expand_row(blurred, y + grid.origin.1, blend, expanded);
        if let [colors @ .., alpha, glow] = expanded.as_mut_slice() {
            add_glow(glow, &matted[channels]);
            rescale(colors, alpha, glow);
        }
        grid.lay_row_over(&expanded[..=channels], result);
    });
}

/// Row `y` of sub-image `i`: content and, last, alpha.
fn matte_row(visible: &Visible, images: &SubImages, i: i32, y: usize, grid: &Grid, rows: &mut Rows) {
    if let [contents @ .., weights] = rows.as_mut_slice() {
        let weights = grid.frame_part_mut(weights);
        images.weigh(i, visible.coc_px.row(y), weights);
        for (row, plane) in contents.iter_mut().zip(&visible.content) {
            let values = grid.frame_part_mut(row).iter_mut().zip(plane.row(y)).zip(&*weights);
            values.for_each(|((value, &content), &weight)| *value = content * weight);
        }
    }
}

/// Level 1 of the blurred content, the blurred alpha and the glow of alpha of the picture whose rows `matte` writes.
fn blur_and_glow(grid: &Grid, channels: usize, matte: &(dyn Fn(usize, &mut Rows) + Sync)) -> Vec<Plane> {
    let mut analysed = vec![grid.reduce_frame(channels, BOX, matte)];
    for level in 1..grid.sizes.len() - 1 {
        analysed.push(grid.reduce_level(level, &analysed[level - 1], BOX));
    }
    let coarsest = analysed.pop().unwrap_or_default();
    let glow = coarsest.last().cloned();
    let coarsest: Vec<Plane> = coarsest.into_iter().chain(glow).collect();
    analysed.iter().enumerate().rev().fold(coarsest, |coarse, (finer, analysed)| {
        grid.expand(finer + 1, &coarse, &|y, rows| {
            add_glow(&mut rows[channels], analysed[channels - 1].row(y));
        })
    })
}

/// `A_syn = A_exp + A_ana − A_exp·A_ana` (eq. 9).
fn add_glow(expanded: &mut [f32], analysed: &[f32]) {
    expanded.iter_mut().zip(analysed).for_each(|(syn, &ana)| *syn += ana - *syn * ana);
}

/// Blurred alpha up to this is 0: there is nothing to rescale. The smallest alpha at the edge of a kernel is far larger.
const MIN_ALPHA: f32 = 1e-30;

/// `RGBA_sub = RGBA_blur · A_glow / A_blur` (eq. 7).
fn rescale(colors: &mut [Vec<f32>], alpha: &mut [f32], glow: &[f32]) {
    for color in colors {
        for ((value, &alpha), &glow) in color.iter_mut().zip(&*alpha).zip(glow) {
            *value *= if alpha > MIN_ALPHA { glow / alpha } else { 0.0 };
        }
    }
    for (alpha, &glow) in alpha.iter_mut().zip(glow) {
        *alpha = if *alpha > MIN_ALPHA { glow } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The blur and the glow of `alpha`, at full size.
    fn glow_of(alpha: &Plane, levels: usize) -> [Plane; 2] {
        let grid = Grid::new((alpha.width(), alpha.height()), levels, Edge::Clear);
        let matte =
            |y: usize, rows: &mut Rows| grid.frame_part_mut(&mut rows[0]).copy_from_slice(alpha.row(y));
        let level = blur_and_glow(&grid, 1, &matte);
        let planes = grid.expand(0, &level, &|_, _| ());
        let part = |k: usize| {
            Plane::from_fn(alpha.width(), alpha.height(), |x, y| {
                planes[k].get(x + grid.origin.0, y + grid.origin.1)
            })
        };
        let mut glow = part(1);
        (0..alpha.height()).for_each(|y| add_glow(glow.row_mut(y), alpha.row(y)));
        [part(0), glow]
    }

    #[test]
    fn adding_glow_multiplies_transmittances() {
        // 1 − (1 − ½)(1 − ¼) = 5/8 (eq. 8).
        let mut alpha = [0.5, 0.0, 1.0];
        add_glow(&mut alpha, &[0.25, 0.5, 0.75]);
        assert_eq!(alpha, [0.625, 0.5, 1.0]);
    }

    #[test]
    fn glow_is_at_least_alpha_and_at_most_one() {
        let alpha = Plane::from_fn(37, 22, |x, y| ((x * 7 + y * 13) % 11) as f32 / 10.0 * f32::from(x > 9));
        for levels in 1..8 {
            let [_, glow] = glow_of(&alpha, levels);
            for (&glow, &alpha) in glow.values().iter().zip(alpha.values()) {
                assert!(glow >= alpha && glow <= 1.0 + 1e-6, "{levels} levels: {alpha} became {glow}");
            }
        }
    }

    #[test]
    fn glow_reaches_no_further_than_the_blur() {
        let alpha = Plane::from_fn(64, 64, |x, y| f32::from(x == 31 && y == 40));
        let [blur, glow] = glow_of(&alpha, 3);
        let beyond =
            glow.values().iter().zip(blur.values()).filter(|(glow, blur)| **glow > 0.0 && **blur <= 0.0);
        assert_eq!(beyond.count(), 0, "pixels that only the glow reaches");
    }

    #[test]
    fn rescaled_colours_keep_their_ratio_to_alpha_and_empty_pixels_stay_empty() {
        let (mut colors, mut alpha) = (vec![vec![0.3, 1e-32, 0.0]], vec![0.5, 1e-32, 0.0]);
        rescale(&mut colors, &mut alpha, &[0.75, 0.5, 0.0]);
        // 0.3 · 0.75 / 0.5
        assert!((colors[0][0] - 0.45).abs() < 1e-6, "{colors:?}");
        assert_eq!((&colors[0][1..], &alpha[..]), (&[0.0, 0.0][..], &[0.75, 0.0, 0.0][..]));
    }
}
