//! A-buffer and B-buffers: contributions are splatted into two pyramids, in front of and behind focus, at the level of their
//! blur.
//!
//! Paper: A-/B-buffers, 2003, on the see-through effect, section IV. Its authors could not run it on the hardware of the time.
//! The peels are the A-buffer: a list of contributions per pixel. Each contribution is culled, kept in the in-focus image, or
//! splatted into one of two pyramids, the B-buffers: one in front of the focal plane, one behind it, each with as many levels as
//! the largest blur needs. A level holds colour and occupancy, because a pixel of full resolution covers only part of a coarse
//! one. Levels are recombined from coarse to fine, each splatted onto the next finer one. Near is composited over in-focus over
//! far.
//!
//! Not specified by the paper:
//! * Level: one halving ([`SPLAT`]) and one doubling each add `4^(l−1)·3/4` px² of variance, so level `n` has
//!   `V_n = (4ⁿ − 1)/2` on each axis. A contribution has the variance `m·c²`, with `m` the second moment of the aperture, 1/4 for
//!   a disc. It is divided between the two levels around that variance, linearly in variance, so that no edge shows where one
//!   level ends.
//! * Recombination: behind focus the finer level is nearer, in front of focus the coarser one. The nearer level is kept whole,
//!   and the other fills the remaining occupancy up to one. Occupancies are added up to saturation, not multiplied, because they
//!   are usually parts of one surface, divided between levels, which has to stay opaque. A sum over one in a single level is
//!   normalised. Behind focus, a level also leaves free the occupancy that its own surfaces have in the next finer level;
//!   otherwise these surfaces would mix with what they hide.
//! * Culling: everything behind an opaque contribution that is itself behind the focal plane is dropped. Behind any opaque
//!   contribution, what is "at a similar depth" is dropped: within `same_surface_px` of it, or within half of its CoC radius,
//!   which is one level of the pyramid. A level does not store z, so hidden contributions of that level would show through.
//!   Because occupancies add, a contribution is first attenuated by the translucent ones in front of it in its pixel and field.
//! * Past the frame the border pixels repeat. At the end, a division by coverage compensates for uncovered parts, as far as these do
//!   not show the background: it comes behind both fields ([`shared::Backdrop`]).
//!
//! Cost: peels × pixels × levels; rows without contributions to a level are skipped. Memory: the peels, three planes, and
//! for each field a pyramid without its finest level. Limits: the blur is close to a Gaussian for every aperture shape; a level
//! does not store z, so crossing surfaces of one level mix; culled contributions are missing at far edges.
//!
//! GPU backend: `shaders/methods/b_buffer.wgsl`.

mod cost;
mod field;
#[cfg(feature = "gpu")]
mod gpu;
mod parameters;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::{Method, MethodInfo, Plan, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{self, Backdrop, CoveragePlanes, Edge, Grid, Peel, Rows, SPLAT};
use crate::parallel;
use crate::scene::{EffectKind, OPAQUE_ALPHA, Scene, Workload, surface};
use crate::settings::ParameterTable;
use field::{Field, Side};
use parameters::BBufferParameters;

/// The two B-buffers.
#[derive(Debug)]
pub(in crate::methods) struct BBuffer;

impl Method for BBuffer {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "b-buffer",
            source: "A-/B-buffers 2003",
            role: Role::Paper,
            summary: "contributions splatted into two pyramids, in front of and behind focus, at the level of their blur",
            effects: &[EffectKind::Merge],
            lens_samples: None,
            steps: &["same_surface_px=0.25", "same_surface_px=0.5", "same_surface_px=1"],
            deviations: DEVIATIONS,
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<BBufferParameters>()
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let frame = scene.picture_size();
        let backdrop = Backdrop::new(&scene, plan);
        let mut peels = shared::peels(scene);
        cull(&mut peels, frame, plan.parameters.get::<BBufferParameters>().same_surface_px);
        let fields = [Side::Near, Side::Far].map(|side| Field::new(side, plan, frame));
        let levels = fields.iter().map(|field| field.coarsest).max().unwrap_or(0);
        let grid = Grid::new(frame, levels, Edge::Repeat);
        let a_buffer = ABuffer::new(peels);
        progress(0.2);
        let pyramids = fields.each_ref().map(|field| {
            let pyramid = a_buffer.pyramid(field, &grid);
            progress(if field.side == Side::Near { 0.5 } else { 0.8 });
            pyramid
        });
        let result = a_buffer.composite(&fields, &pyramids, &grid);
        progress(1.0);
        Ok(result.into_picture_before(backdrop.as_ref()))
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

/// Measured over all cases of each law, rounded outward.
const DEVIATIONS: &[Deviation] = &[
    Deviation {
        law: Law::NoCracks,
        within: [0.04, 0.1],
        reason: "splats of one surface add up to one only where their size changes slowly",
    },
    Deviation {
        law: Law::NoCracksAcrossCorners,
        within: [0.08, 0.12],
        reason: "splats of one surface add up to one only where their size changes slowly",
    },
    Deviation {
        law: Law::Locality,
        within: [0.0, 0.0012],
        reason: "the blur is a Gaussian, which reaches past the disc",
    },
    Deviation { law: Law::Edge, within: [0.06, 0.08], reason: "the blur is a Gaussian, not the disc" },
    Deviation {
        law: Law::Convergence,
        within: [32.8, 33.5],
        reason: "the blur is a Gaussian, and a level does not store z",
    },
    Deviation {
        law: Law::Supersampling,
        within: [39.2, 39.7],
        reason: "the blur is a Gaussian, not the aperture's shape",
    },
];

/// State of a pixel while its list of contributions is culled, nearest first.
#[derive(Debug, Clone, Copy)]
struct Culling {
    /// CoC radius of the last opaque contribution.
    surface_px: f32,
    /// Whether that contribution lies behind the focal plane, so that everything farther is culled.
    occluded: bool,
    /// Transmittance of the translucent contributions since then, in front of and behind the focal plane.
    transmittance: [f32; 2],
}

impl Culling {
    const EMPTY: Self = Self { surface_px: f32::NEG_INFINITY, occluded: false, transmittance: [1.0; 2] };

    /// Adds the next contribution and returns the share of it that is kept.
    fn keep(&mut self, alpha: f32, coc_px: f32, same_surface_px: f32) -> f32 {
        let same_px = surface::level_gap_px(self.surface_px, same_surface_px);
        if alpha <= 0.0 || self.occluded || (coc_px - self.surface_px).abs() < same_px {
            return 0.0;
        }
        let transmittance = &mut self.transmittance[usize::from(coc_px > 0.0)];
        let share = *transmittance;
        *transmittance *= 1.0 - alpha;
        if alpha >= OPAQUE_ALPHA {
            *self = Self { surface_px: coc_px, occluded: coc_px > 0.0, transmittance: [1.0; 2] };
        }
        share
    }
}

/// Removes from the peels the contributions that the A-buffer does not need.
fn cull(peels: &mut [Peel], (width, height): (usize, usize), same_surface_px: f32) {
    let mut pixels = vec![Culling::EMPTY; width * height];
    let mut kept = vec![0.0; width * height];
    for Peel { covered, coc_px } in peels {
        let rows = pixels.chunks_mut(width.max(1)).zip(kept.chunks_mut(width.max(1)));
        parallel::for_each(rows, &|y, (pixels, kept)| {
            let contributions = covered.coverage.row(y).iter().zip(coc_px.row(y));
            for ((pixel, kept), (&alpha, &coc_px)) in pixels.iter_mut().zip(kept).zip(contributions) {
                *kept = pixel.keep(alpha, coc_px, same_surface_px);
            }
        });
        for plane in covered.content.iter_mut().chain([&mut covered.coverage]) {
            parallel::for_each_block(plane.values_mut(), &|block, values| {
                values.iter_mut().zip(&kept[block]).for_each(|(value, kept)| *value *= kept);
            });
        }
    }
}

/// Scales content and occupancy, the last plane, so that occupancy is at most one.
fn normalise(planes: &mut [Plane]) {
    let Some((occupancy, content)) = planes.split_last_mut() else { return };
    for plane in content {
        parallel::for_each_block(plane.values_mut(), &|block, values| {
            let values = values.iter_mut().zip(&occupancy.values()[block]);
            values.for_each(|(value, occupancy)| *value /= occupancy.max(1.0));
        });
    }
    parallel::for_each_block(occupancy.values_mut(), &|_, values| {
        values.iter_mut().for_each(|occupancy| *occupancy = occupancy.min(1.0));
    });
}

/// For each row of `peel`, the range of its signed CoC radii in pixels; an empty range where the row is empty.
fn ranges_px(peel: &Peel) -> Vec<[f32; 2]> {
    let range = |y: usize| {
        let contributions = peel.covered.coverage.row(y).iter().zip(peel.coc_px.row(y));
        let present = contributions.filter(|(coverage, _)| **coverage > 0.0);
        present
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[near, far], (_, &coc)| [near.min(coc), far.max(coc)])
    };
    parallel::map(peel.coc_px.height(), &range)
}

/// The contributions of every pixel.
struct ABuffer {
    peels: Vec<Peel>,
    /// [`ranges_px`] of each peel.
    ranges_px: Vec<Vec<[f32; 2]>>,
    /// Number of planes: those of content, and one of occupancy.
    channels: usize,
}

impl ABuffer {
    fn new(peels: Vec<Peel>) -> Self {
        let ranges_px = peels.iter().map(ranges_px).collect();
        let channels = peels.first().map_or(0, |peel| peel.covered.content.len()) + 1;
        Self { peels, ranges_px, channels }
    }

    /// Level 1 of the pyramid of a field, with all coarser levels recombined onto it; `None` where the field has only level 0.
    fn pyramid(&self, field: &Field, grid: &Grid) -> Option<Vec<Plane>> {
        (1..=field.coarsest).rev().fold(None, |coarser, n| {
            // Behind focus, one more: the occupancy of the same surfaces in the next finer level.
            let channels = self.channels + usize::from(field.side == Side::Far);
            let finest = grid.reduce_frame(channels, SPLAT, &|y, rows| {
                rows.iter_mut().for_each(|row| grid.frame_part_mut(row).fill(0.0));
                self.add_row(field, n, y, grid, rows);
            });
            let mut own = (1..n).fold(finest, |finer, level| grid.reduce_level(level, &finer, SPLAT));
            let Some(coarser) = coarser else {
                own.truncate(self.channels);
                normalise(&mut own);
                return Some(own);
            };
            Some(grid.expand(n, &coarser, &|y, rows| {
                let own: Vec<&[f32]> = own.iter().map(|plane| plane.row(y)).collect();
                let (own, in_finer) = own.split_at(self.channels);
                field.combine(own, in_finer.first().copied(), rows);
            }))
        })
    }

    /// Adds row `y` of the contributions that go to level `n`, at level 0, to rows of content and occupancy. If there is one more
    /// row, it receives the occupancy that these contributions have in the next finer level.
    fn add_row(&self, field: &Field, n: usize, y: usize, grid: &Grid, rows: &mut Rows) {
        let mut weights = Vec::new();
        for (peel, ranges_px) in self.peels.iter().zip(&self.ranges_px) {
            if !field.may_have(n, ranges_px[y]) {
                continue;
            }
            let coc_px = peel.coc_px.row(y);
            weights.resize(coc_px.len(), 0.0);
            field.weigh(n, coc_px, &mut weights);
            for (row, plane) in
                rows.iter_mut().zip(peel.covered.content.iter().chain([&peel.covered.coverage]))
            {
                let values = grid.frame_part_mut(row).iter_mut().zip(plane.row(y)).zip(&weights);
                values.for_each(|((sum, &value), &weight)| *sum += value * weight);
            }
            if let Some(row) = rows.get_mut(self.channels) {
                field.finer_share(n, coc_px, &mut weights);
                let occupancy = peel.covered.coverage.row(y).iter().zip(&weights);
                let values = grid.frame_part_mut(row).iter_mut().zip(occupancy);
                values.for_each(|(sum, (&occupancy, &weight))| *sum += occupancy * weight);
            }
        }
    }

    /// Composites near over in-focus over far.
    fn composite(
        &self,
        fields: &[Field; 2],
        pyramids: &[Option<Vec<Plane>>; 2],
        grid: &Grid,
    ) -> CoveragePlanes {
        let (width, height) =
            self.peels.first().map_or((0, 0), |peel| (peel.coc_px.width(), peel.coc_px.height()));
        let mut result = CoveragePlanes::unknown(width, height, self.channels - 1);
        let rows = || vec![vec![0.0; grid.sizes[0].0]; self.channels];
        let [near, far] = fields;
        result.for_rows(&|| (rows(), rows(), Vec::new()), &|(own, row, blend), y, result| {
            let mut composite_field =
                |field: &Field, pyramid: &Option<Vec<Plane>>, result: &mut [&mut [f32]]| {
                    match pyramid {
                        Some(pyramid) => grid.expand_row(pyramid, y + grid.origin.1, blend, row),
                        None => row.iter_mut().for_each(|row| row.fill(0.0)),
                    }
                    own.iter_mut().for_each(|row| row.fill(0.0));
                    self.add_row(field, 0, y, grid, own);
                    let own: Vec<&[f32]> = own.iter().map(Vec::as_slice).collect();
                    field.combine(&own, None, row);
                    grid.lay_row_over(row, result);
                };
            composite_field(far, &pyramids[1], result);
            self.composite_in_focus(y, near.in_focus_px, result);
            composite_field(near, &pyramids[0], result);
        });
        result
    }

    /// Composites the in-focus contributions of row `y` over `result`: content and, last, coverage.
    fn composite_in_focus(&self, y: usize, in_focus_px: f32, result: &mut [&mut [f32]]) {
        for (peel, ranges_px) in self.peels.iter().zip(&self.ranges_px).rev() {
            let [near, far] = ranges_px[y];
            if near > in_focus_px || far < -in_focus_px {
                continue;
            }
            let planes = peel.covered.content.iter().chain([&peel.covered.coverage]);
            for (back, plane) in result.iter_mut().zip(planes) {
                let front = plane.row(y).iter().zip(peel.covered.coverage.row(y)).zip(peel.coc_px.row(y));
                for (back, ((&front, &coverage), &coc_px)) in back.iter_mut().zip(front) {
                    let in_focus = coc_px.abs() <= in_focus_px;
                    *back = if in_focus { front + (1.0 - coverage) * *back } else { *back };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The kept share of each contribution of a pixel; contributions are alpha and CoC radius in pixels, nearest first.
    fn kept(contributions: &[(f32, f32)]) -> Vec<f32> {
        let mut pixel = Culling::EMPTY;
        contributions.iter().map(|&(alpha, coc_px)| pixel.keep(alpha, coc_px, 0.5)).collect()
    }

    #[test]
    fn behind_an_opaque_contribution_behind_focus_everything_is_culled() {
        assert_eq!(kept(&[(1.0, 3.0), (1.0, 9.0)]), [1.0, 0.0]);
        assert_eq!(
            kept(&[(1.0, -3.0), (1.0, 2.0), (0.5, 9.0)]),
            [1.0, 1.0, 0.0],
            "at any position in the list"
        );
        assert_eq!(kept(&[(1.0, -3.0), (1.0, 9.0)]), [1.0, 1.0], "blur of a near one shows what it hides");
        assert_eq!(kept(&[(1.0, 0.0), (1.0, 9.0)]), [1.0, 1.0], "its blur shows beside one in focus");
    }

    #[test]
    fn contributions_at_a_similar_depth_as_the_last_opaque_one_are_culled() {
        assert_eq!(kept(&[(1.0, -0.4), (1.0, 0.0), (1.0, 0.2)]), [1.0, 0.0, 1.0], "half a pixel");
        assert_eq!(kept(&[(1.0, -8.0), (1.0, -4.1), (1.0, -3.9)]), [1.0, 0.0, 1.0], "a level of the pyramid");
    }

    #[test]
    fn translucent_contributions_attenuate_farther_ones_of_the_same_field() {
        assert_eq!(kept(&[(0.5, -3.0), (0.5, -2.0), (0.5, 4.0), (1.0, 6.0)]), [1.0, 0.5, 1.0, 0.5]);
    }

    /// One contribution of occupancy 0.8, at pixel 17, 30 of a frame of 64 × 64.
    fn single(coc_px: f32) -> ABuffer {
        let plane = |value: f32| Plane::from_fn(64, 64, |x, y| if (x, y) == (17, 30) { value } else { 0.0 });
        ABuffer::new(vec![Peel {
            covered: CoveragePlanes { content: vec![plane(0.4); 3], coverage: plane(0.8) },
            coc_px: plane(coc_px),
        }])
    }

    #[test]
    fn the_total_occupancy_of_a_contribution_is_its_alpha() {
        // A variance of 2.25 px² lies between V_1 = 1.5 and V_2 = 7.5, so levels 1 and 2 hold all of it. They are returned
        // combined as level 1, of which a sample is a mean over 4 pixels.
        let field = Field { side: Side::Far, coarsest: 2, in_focus_px: 0.5, second_moment: 0.25 };
        let grid = Grid::new((64, 64), 2, Edge::Repeat);
        let level = single(3.0).pyramid(&field, &grid).unwrap();
        let total: f32 = level[3].values().iter().sum();
        assert!((4.0 * total - 0.8).abs() < 1e-5, "{total}");
        let color: f32 = level[0].values().iter().sum();
        assert!((4.0 * color - 0.4).abs() < 1e-5, "{color}");
    }
}
