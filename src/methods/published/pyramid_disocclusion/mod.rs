//! Sub-images by depth, in which pyramid interpolation fills the parts that nearer ones hide.
//!
//! Kraus & Strengert 2007, "Depth-of-Field Rendering by Pyramidal Image Processing", as described by Kraus 2011, "Using Opaque
//! Image Blur for Real-Time Depth-of-Field Rendering", which compares itself with it. Only the pinhole picture is read. For each
//! sub-image, farthest first: pixels nearer than its range are culled; the holes are filled from their surroundings, depth
//! included; the filled picture is matted by depth (`shared/sub_images.rs`), blurred by a pyramid of `|i|` levels, 4×4 box
//! analysis and biquadratic B-spline synthesis, and composited over the result.
//!
//! The 2007 paper itself was not available. These choices are not specified by the 2011 paper. Culling is soft: a pixel is
//! kept in the share `ω` that rises from `z_(i−2)` to `z_(i−1)`, so that no slanted surface is cut. Filling is pull-push. Pull: a
//! coarse sample is the mean of the known finer samples, and its known share is raised to what the best known quarter of its area
//! would give. Push: each level adds the expanded coarser level in the share that it does not know itself. The pyramid has as
//! many levels as the largest blur, because no blur shows more of a hole. The part that even the coarsest level does not know is
//! the mean of everything known. Depth is interpolated as CoC radius, which unlike depth stays finite, and is linear across a
//! flat surface. Past the frame the border pixels repeat, depth included, in place of the larger framebuffer of the paper.
//!
//! Cost: pixels × sub-images as for `opaque-blur`, each with one more pyramid, of the full size. Memory: twelve planes and
//! two pyramids. Limits: one colour and depth per pixel, hidden parts are guessed; no aperture shape; the blur radii are those of
//! `opaque-blur`, with the same limits: nearly twice as far as that of a disc, and too small far behind focus.
//!
//! GPU backend: `shaders/methods/pyramid_disocclusion.wgsl`.

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
use crate::parallel;
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use parameters::PyramidDisocclusionParameters;

/// Sub-images with disocclusion.
#[derive(Debug)]
pub(in crate::methods) struct PyramidDisocclusion;

impl Method for PyramidDisocclusion {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "pyramid-disocclusion",
            source: "Kraus & Strengert 2007",
            role: Role::Baseline,
            summary: "sub-images by depth of the pinhole picture, parts that nearer ones hide filled from their surroundings",
            effects: &[EffectKind::Merge],
            lens_samples: None,
            steps: &["first_radius_px=3.4", "first_radius_px=1.7", "first_radius_px=0.85"],
            deviations: DEVIATIONS,
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<PyramidDisocclusionParameters>()
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let frame = scene.picture_size();
        let (images, grid) = sub_images(&scene, plan);
        let visible = shared::visible(scene, plan);
        let mut result = CoveragePlanes::unknown(frame.0, frame.1, visible.content.len());
        let count = images.far_to_near().count();
        for (done, i) in images.far_to_near().enumerate() {
            if let Some(disoccluded) = disocclude(&visible, &images, i, &grid) {
                composite(&disoccluded, &images, i, &grid, &mut result);
            }
            progress((done + 1) as f32 / count as f32);
        }
        Ok(result.into_picture())
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

/// The sub-images of the picture of `scene`, and the grid of all their pyramids.
fn sub_images(scene: &Scene, plan: &Plan) -> (SubImages, Grid) {
    let first_radius_px = plan.parameters.get::<PyramidDisocclusionParameters>().first_radius_px;
    let (frame, coc_infinity_px) = (scene.picture_size(), scene.coc_infinity_px);
    let images = SubImages::new(first_radius_px, plan.coc_range_px, coc_infinity_px, frame);
    let grid = Grid::new(frame, images.max_levels().max(1), Edge::Repeat);
    (images, grid)
}

/// If the known shares of the coarsest level sum up to less than this, the sum is rounding, and nothing is known.
const MIN_KNOWN: f64 = 1e-6;

/// Measured over all cases of each law, rounded outward.
const DEVIATIONS: &[Deviation] = &[
    Deviation {
        law: Law::Sharpness,
        within: [0.27, 0.3],
        reason: "the part that the bar hides is interpolated from its surroundings",
    },
    Deviation {
        law: Law::Transparency,
        within: [0.999, 1.46],
        reason: "the depth in a filled hole may fall into the sub-image of the near object itself",
    },
    Deviation {
        law: Law::Energy,
        within: [0.985, 1.001],
        reason: "border pixels repeat past the frame, and the blur reaches them",
    },
    Deviation {
        law: Law::Place,
        within: [0.4, 0.51],
        reason: "the 4×4 box shifts the centre of a sample by half a pixel in the coarser level",
    },
    Deviation {
        law: Law::Spread,
        within: [2.8, 4.95],
        reason: "1.7·2^(n−1) px is the core of the kernel of n levels, whose variance is that of a larger disc",
    },
    Deviation {
        law: Law::Locality,
        within: [0.001, 0.0065],
        reason: "the blur is a Gaussian, which reaches past the disc, and holes are filled from their surroundings",
    },
    Deviation {
        law: Law::Edge,
        within: [0.13, 0.29],
        reason: "the blur is a Gaussian, and the depth in a filled hole may be that of the near object itself",
    },
    Deviation {
        law: Law::Convergence,
        within: [29.8, 30.8],
        reason: "one pinhole picture, a Gaussian of a few sizes, hidden parts are guessed",
    },
    Deviation { law: Law::Supersampling, within: [25.0, 25.8], reason: "a pixel at an edge has one depth" },
];

/// The picture without the pixels nearer than sub-image `i`, holes filled: content and, last, CoC radius, at level 0 of `grid`.
/// `None` where all pixels are nearer.
fn disocclude(visible: &Visible, images: &SubImages, i: i32, grid: &Grid) -> Option<Vec<Plane>> {
    let channels = visible.content.len() + 2;
    let keep = |y: usize, rows: &mut Rows| keep_row(visible, images, i, y, grid, rows);
    let mut pulled: Vec<Vec<Plane>> = Vec::new();
    for level in 0..grid.sizes.len() - 1 {
        let mut coarse = match pulled.last() {
            None => grid.reduce_frame(channels, BOX, &keep),
            Some(finer) => grid.reduce_level(level, finer, BOX),
        };
        raise_known(&mut coarse);
        pulled.push(coarse);
    }
    let mut filled = filled_with_mean(pulled.pop()?)?;
    for (finer, known) in pulled.iter().enumerate().rev() {
        filled = grid.expand(finer + 1, &filled, &|y, rows| {
            let known: Vec<&[f32]> = known.iter().map(|plane| plane.row(y)).collect();
            complete_row(&known, rows);
        });
    }
    Some(grid.expand(0, &filled, &|y, rows| {
        let mut known = vec![vec![0.0; grid.sizes[0].0]; channels];
        if let Some(y) = grid.frame_row(y) {
            keep(y, &mut known);
            known.iter_mut().for_each(|row| grid.complete(row));
        }
        let known: Vec<&[f32]> = known.iter().map(Vec::as_slice).collect();
        complete_row(&known, rows);
    }))
}

/// Row `y` of the pixels that are not nearer than sub-image `i`: content and CoC radius times the kept share, and that share.
fn keep_row(visible: &Visible, images: &SubImages, i: i32, y: usize, grid: &Grid, rows: &mut Rows) {
    if let [values @ .., kept] = rows.as_mut_slice() {
        let kept = grid.frame_part_mut(kept);
        images.weigh_not_nearer(i, visible.coc_px.row(y), kept);
        for (row, plane) in values.iter_mut().zip(visible.content.iter().chain([&visible.coc_px])) {
            let row = grid.frame_part_mut(row).iter_mut().zip(plane.row(y)).zip(&*kept);
            row.for_each(|((value, &known), &kept)| *value = known * kept);
        }
    }
}

/// A quarter of the fine samples of which a coarse sample is a mean.
const BEST_QUARTER: f32 = 0.25;

/// Raises the known share of coarse samples, the last plane, to what the best known quarter of their area could give, and scales
/// their values with it: a known neighbour is a better guess than a distant mean.
fn raise_known(planes: &mut [Plane]) {
    let Some((known, values)) = planes.split_last_mut() else { return };
    let raise = |known: f32| 1.0 / known.max(BEST_QUARTER);
    for plane in values {
        parallel::for_each_block(plane.values_mut(), &|block, values| {
            values.iter_mut().zip(&known.values()[block]).for_each(|(value, &known)| *value *= raise(known));
        });
    }
    parallel::for_each_block(known.values_mut(), &|_, values| {
        values.iter_mut().for_each(|known| *known *= raise(*known));
    });
}

/// The coarsest level, whose unknown share is filled with the mean of everything known; `None` where nothing is known.
fn filled_with_mean(mut planes: Vec<Plane>) -> Option<Vec<Plane>> {
    let total = |plane: &Plane| plane.values().iter().map(|&value| f64::from(value)).sum::<f64>();
    let known = planes.pop()?;
    let total_known = Some(total(&known)).filter(|&sum| sum > MIN_KNOWN)?;
    for plane in &mut planes {
        let mean = (total(plane) / total_known) as f32;
        let values = plane.values_mut().iter_mut().zip(known.values());
        values.for_each(|(value, &known)| *value += (1.0 - known) * mean);
    }
    Some(planes)
}

/// Adds the `known` rows of a level to those `expanded` from the coarser one, which get the share that the level does not know.
/// The last known row is the known share.
fn complete_row(known: &[&[f32]], expanded: &mut Rows) {
    let Some((share, values)) = known.split_last() else { return };
    for (expanded, known) in expanded.iter_mut().zip(values) {
        for ((value, &known), &share) in expanded.iter_mut().zip(*known).zip(*share) {
            *value = known + (1.0 - share) * *value;
        }
    }
}

/// Mattes sub-image `i` of the disoccluded picture, blurs it and composites it over `result`.
fn composite(disoccluded: &[Plane], images: &SubImages, i: i32, grid: &Grid, result: &mut CoveragePlanes) {
    let Some((coc_px, content)) = disoccluded.split_last() else { return };
    let channels = content.len() + 1;
    let matte = |y: usize, rows: &mut Rows| {
        if let [values @ .., weights] = rows.as_mut_slice() {
            images.weigh(i, coc_px.row(y), weights);
            for (row, plane) in values.iter_mut().zip(content) {
                let row = row.iter_mut().zip(plane.row(y)).zip(&*weights);
                row.for_each(|((value, &content), &weight)| *value = content * weight);
            }
        }
    };
    let levels = i.unsigned_abs() as usize;
    let blurred = (levels > 0).then(|| {
        let finest = grid.reduce(0, channels, BOX, &matte);
        let coarsest = (1..levels).fold(finest, |finer, level| grid.reduce_level(level, &finer, BOX));
        (1..levels).rev().fold(coarsest, |coarser, level| grid.expand(level, &coarser, &|_, _| ()))
    });
    let scratch = || (vec![vec![0.0; grid.sizes[0].0]; channels], Vec::new());
    result.for_rows(&scratch, &|(rows, blend), y, result| {
        let y = y + grid.origin.1;
        match &blurred {
            Some(blurred) => grid.expand_row(blurred, y, blend, rows),
            None => matte(y, rows),
        }
        grid.lay_row_over(rows, result);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two halves: left of column 10 a near surface of brightness 9, from there on a far one of brightness `x`.
    fn two_halves() -> Visible {
        let content = |_: usize| Plane::from_fn(32, 16, |x, _| if x < 10 { 9.0 } else { x as f32 });
        let coc_px = Plane::from_fn(32, 16, |x, _| if x < 10 { -8.0 } else { 4.0 });
        Visible { content: (0..3).map(content).collect(), coc_px }
    }

    fn disoccluded(visible: &Visible, i: i32) -> Option<Vec<Plane>> {
        let images = SubImages::new(2.0, [-8.0, 8.0], 100.0, (32, 16));
        disocclude(visible, &images, i, &Grid::new((32, 16), images.max_levels(), Edge::Repeat))
    }

    #[test]
    fn pixels_that_are_not_culled_stay_unchanged() {
        let planes = disoccluded(&two_halves(), 0).unwrap();
        for (x, y) in [(10, 0), (17, 5), (31, 15)] {
            assert_eq!([planes[0].get(x, y), planes[3].get(x, y)], [x as f32, 4.0], "pixel {x}, {y}");
        }
    }

    #[test]
    fn holes_are_filled_from_their_surroundings_without_culled_pixels() {
        let planes = disoccluded(&two_halves(), 0).unwrap();
        for x in 0..10 {
            assert_eq!(planes[3].get(x, 7), 4.0, "the depth around the hole, column {x}");
        }
        // Nearest to the hole are columns 10 to 13.
        assert!((10.0..13.0).contains(&planes[0].get(9, 7)), "beside the edge: {}", planes[0].get(9, 7));
        assert!((10.0..31.0).contains(&planes[0].get(0, 7)), "far from it: {}", planes[0].get(0, 7));
    }

    #[test]
    fn the_nearest_sub_image_has_no_holes() {
        let planes = disoccluded(&two_halves(), -3).unwrap();
        assert_eq!([planes[0].get(3, 3), planes[3].get(3, 3)], [9.0, -8.0], "unchanged");
    }

    #[test]
    fn a_sub_image_is_skipped_where_all_pixels_are_nearer() {
        let mut near = two_halves();
        near.coc_px = Plane::filled(32, 16, -8.0);
        assert_eq!(disoccluded(&near, 2), None);
    }
}
