//! A-buffer and B-buffers: contributions splatted at the resolution that their blur asks for, near and far apart.
//!
//! The A-/B-buffer paper of 2003 on the see-through effect, section IV, whose authors could not run it on the hardware of
//! their day. The peels are the A-buffer, a list of contributions a pixel. Each is culled, kept in the in-focus image, or splatted
//! into one of two pyramids, the B-buffers: one before the focal plane, one behind it, as deep as the largest blur asks.
//! A level holds colour and occupancy, since a pixel of full resolution covers a coarse one in part only. Levels are
//! recombined from coarse to fine, each splatted onto the one directly above it, and near is laid over in-focus over far.
//!
//! Where the paper is silent:
//! * Level: one halving ([`SPLAT`]) and one doubling add `4^(l−1)·3/4` px² of variance each, so level `n` has
//!   `V_n = (4ⁿ − 1)/2` on each axis; a contribution's own is `m·c²`, `m` the aperture's second moment, 1/4 for a disc. It is
//!   divided between the two levels around that, linearly in variance, so that nothing shows where one level ends.
//! * Recombination: behind focus the finer level is nearer, before it the coarser. The nearer one is kept whole and the
//!   other fills what is left of one: occupancies add up to saturation rather than multiply, for most often they are
//!   parts of one surface, divided between levels, which has to stay opaque. More than one in a single level is normalised.
//!   Behind focus a level also keeps free what the next finer one has of its own surfaces, which would else mix with what
//!   they hide.
//! * Culling: behind an opaque contribution that is itself behind the focal plane all is dropped, and behind any opaque one
//!   what is "at a similar depth": within `same_surface_px` of it, or within half of its CoC radius, which is a level of
//!   the pyramid; z is forgotten there, and the hidden would show through. Since occupancies add, a contribution is first dimmed by the
//!   translucent ones before it in its pixel and field. An open background is a contribution of every pixel: what hides it
//!   lets it through again at its blurred edge.
//! * Past the frame its border's pixels go on. What is left uncovered at the end is made up for by a division by coverage.
//!
//! Cost: (peels + 1) × pixels × levels; rows without contributions to a level are skipped. Memory: the peels, three
//! planes, and a pyramid a field without its finest level. Limits: the blur is near a Gaussian whatever the aperture's shape;
//! z is forgotten within a level, so crossing surfaces of one level mix; what the culling drops is missed at far edges.
//!
//! GPU twin: `shaders/methods/b_buffer.wgsl`.

mod cost;
mod parameters;
mod field;
#[cfg(feature = "gpu")]
mod gpu;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{Method, MethodInfo, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{self, CoveragePlanes, Edge, Grid, Peel, Rows, SPLAT};
use crate::scene::surface;
use crate::scene::{EffectKind, OPAQUE_ALPHA, Scene, Workload};
use crate::settings::ParameterTable;
use field::{Field, Side};
use parameters::BBufferParameters;
use rayon::prelude::*;

/// The two B-buffers.
#[derive(Debug)]
pub(in crate::methods) struct BBuffer;

impl Method for BBuffer {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "b-buffer",
            source: "A-/B-buffers 2003",
            role: Role::Paper,
            summary: "contributions splatted into two pyramids, before and behind focus, at the level of their blur",
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
        let mut peels = shared::peels(scene, plan);
        cull(&mut peels, frame, plan.parameters.get::<BBufferParameters>().same_surface_px);
        let fields = [Side::Near, Side::Far].map(|side| Field::new(side, plan, frame));
        let levels = fields.iter().map(|field| field.top).max().unwrap_or(0);
        let grid = Grid::new(frame, levels, Edge::Repeat);
        let a_buffer = ABuffer::new(peels);
        progress(0.2);
        let pyramids = fields.each_ref().map(|field| {
            let pyramid = a_buffer.pyramid(field, &grid);
            progress(if field.side == Side::Near { 0.5 } else { 0.8 });
            pyramid
        });
        let result = a_buffer.matte(&fields, &pyramids, &grid);
        progress(1.0);
        Ok(result.into_picture())
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

/// Figures of the laws' cases, rounded outward.
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
        law: Law::Convergence,
        within: [32.8, 33.5],
        reason: "the blur is a Gaussian, and z is forgotten within a level",
    },
    Deviation {
        law: Law::Supersampling,
        within: [39.2, 39.7],
        reason: "the blur is a Gaussian, not the aperture's shape",
    },
];

/// What is known of a pixel while its list of contributions is culled, nearest first.
#[derive(Debug, Clone, Copy)]
struct Culling {
    /// CoC radius of the last opaque contribution.
    surface_px: f32,
    /// Whether that lies behind the focal plane.
    closed: bool,
    /// What the translucent contributions since then let through, before and behind the focal plane.
    transmitted: [f32; 2],
}

impl Culling {
    const OPEN: Self = Self { surface_px: f32::NEG_INFINITY, closed: false, transmitted: [1.0; 2] };

    /// The share of the next contribution that is kept.
    fn keep(&mut self, alpha: f32, coc_px: f32, same_surface_px: f32) -> f32 {
        let same_px = surface::level_gap_px(self.surface_px, same_surface_px);
        if alpha <= 0.0 || self.closed || (coc_px - self.surface_px).abs() < same_px {
            return 0.0;
        }
        let transmitted = &mut self.transmitted[usize::from(coc_px > 0.0)];
        let share = *transmitted;
        *transmitted *= 1.0 - alpha;
        if alpha >= OPAQUE_ALPHA {
            *self = Self { surface_px: coc_px, closed: coc_px > 0.0, transmitted: [1.0; 2] };
        }
        share
    }
}

/// Takes from the peels what the A-buffer need not keep.
fn cull(peels: &mut [Peel], (width, height): (usize, usize), same_surface_px: f32) {
    let mut pixels = vec![Culling::OPEN; width * height];
    let mut kept = vec![0.0; width * height];
    for Peel { covered, coc_px } in peels {
        let contributions = covered.coverage.values().par_iter().zip(coc_px.values());
        let pixels = pixels.par_iter_mut().zip(&mut kept);
        pixels.zip(contributions).for_each(|((pixel, kept), (&alpha, &coc_px))| {
            *kept = pixel.keep(alpha, coc_px, same_surface_px);
        });
        for plane in covered.content.iter_mut().chain([&mut covered.coverage]) {
            plane.values_mut().par_iter_mut().zip(&kept).for_each(|(value, kept)| *value *= kept);
        }
    }
}

/// Brings occupancy, the last plane, down to one where it is over.
fn normalise(planes: &mut [Plane]) {
    let Some((occupancy, content)) = planes.split_last_mut() else { return };
    for plane in content {
        let values = plane.values_mut().par_iter_mut().zip(occupancy.values());
        values.for_each(|(value, occupancy)| *value /= occupancy.max(1.0));
    }
    occupancy.values_mut().par_iter_mut().for_each(|occupancy| *occupancy = occupancy.min(1.0));
}

/// For each row of `peel`, the range of its CoC radii; an empty one where the row is empty.
fn ranges_px(peel: &Peel) -> Vec<[f32; 2]> {
    let range = |y: usize| {
        let contributions = peel.covered.coverage.row(y).iter().zip(peel.coc_px.row(y));
        let present = contributions.filter(|(coverage, _)| **coverage > 0.0);
        present
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[near, far], (_, &coc)| [near.min(coc), far.max(coc)])
    };
    (0..peel.coc_px.height()).into_par_iter().map(range).collect()
}

/// The contributions of every pixel.
struct ABuffer {
    peels: Vec<Peel>,
    /// Of each peel, [`ranges_px`].
    ranges_px: Vec<Vec<[f32; 2]>>,
    /// Planes of content, and one of occupancy.
    channels: usize,
}

impl ABuffer {
    fn new(peels: Vec<Peel>) -> Self {
        let ranges_px = peels.iter().map(ranges_px).collect();
        let channels = peels.first().map_or(0, |peel| peel.covered.content.len()) + 1;
        Self { peels, ranges_px, channels }
    }

    /// Level 1 of a field's pyramid, all coarser levels recombined onto it; none where the field has no such level.
    fn pyramid(&self, field: &Field, grid: &Grid) -> Option<Vec<Plane>> {
        (1..=field.top).rev().fold(None, |coarser, n| {
            // Behind focus, one more: what the finer level has of the same surfaces.
            let channels = self.channels + usize::from(field.side == Side::Far);
            let finest = grid.reduce_frame(channels, SPLAT, |y, rows| {
                rows.iter_mut().for_each(|row| grid.frame_part_mut(row).fill(0.0));
                self.add_row(field, n, y, grid, rows);
            });
            let mut own = (1..n).fold(finest, |finer, level| grid.reduce_level(level, &finer, SPLAT));
            let Some(coarser) = coarser else {
                own.truncate(self.channels);
                normalise(&mut own);
                return Some(own);
            };
            Some(grid.expand(n, &coarser, |y, rows| {
                let own: Vec<&[f32]> = own.iter().map(|plane| plane.row(y)).collect();
                let (own, shared) = own.split_at(self.channels);
                field.unite(own, shared.first().copied(), rows);
            }))
        })
    }

    /// Adds row `y` of level 0 of the contributions that go to level `n` to rows of content and occupancy; if there is one
    /// row more, it is for the occupancy that they have in the finer level.
    fn add_row(&self, field: &Field, n: usize, y: usize, grid: &Grid, rows: &mut Rows) {
        let mut weights = Vec::new();
        for (peel, ranges_px) in self.peels.iter().zip(&self.ranges_px) {
            if !field.has(n, ranges_px[y]) {
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
                field.share_of_finer(n, coc_px, &mut weights);
                let occupancy = peel.covered.coverage.row(y).iter().zip(&weights);
                let values = grid.frame_part_mut(row).iter_mut().zip(occupancy);
                values.for_each(|(sum, (&occupancy, &weight))| *sum += occupancy * weight);
            }
        }
    }

    /// Near over in-focus over far.
    fn matte(&self, fields: &[Field; 2], pyramids: &[Option<Vec<Plane>>; 2], grid: &Grid) -> CoveragePlanes {
        let (width, height) =
            self.peels.first().map_or((0, 0), |peel| (peel.coc_px.width(), peel.coc_px.height()));
        let mut result = CoveragePlanes::unknown(width, height, self.channels - 1);
        let rows = || vec![vec![0.0; grid.sizes[0].0]; self.channels];
        let [near, far] = fields;
        result.for_rows(
            || (rows(), rows(), Vec::new()),
            |(own, row, blend), y, result| {
                let mut lay = |field: &Field, pyramid: &Option<Vec<Plane>>, result: &mut [&mut [f32]]| {
                    match pyramid {
                        Some(pyramid) => grid.expand_row(pyramid, y + grid.origin.1, blend, row),
                        None => row.iter_mut().for_each(|row| row.fill(0.0)),
                    }
                    own.iter_mut().for_each(|row| row.fill(0.0));
                    self.add_row(field, 0, y, grid, own);
                    let own: Vec<&[f32]> = own.iter().map(Vec::as_slice).collect();
                    field.unite(&own, None, row);
                    grid.lay_row_over(row, result);
                };
                lay(far, &pyramids[1], result);
                self.lay_in_focus(y, near.in_focus_px, result);
                lay(near, &pyramids[0], result);
            },
        );
        result
    }

    /// Lays the in-focus contributions of row `y` over `result`, content and, last, coverage.
    fn lay_in_focus(&self, y: usize, in_focus_px: f32, result: &mut [&mut [f32]]) {
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

    /// Which of a pixel's contributions, alpha and CoC radius nearest first, are kept, in what share.
    fn kept(contributions: &[(f32, f32)]) -> Vec<f32> {
        let mut pixel = Culling::OPEN;
        contributions.iter().map(|&(alpha, coc_px)| pixel.keep(alpha, coc_px, 0.5)).collect()
    }

    #[test]
    fn behind_an_opaque_contribution_behind_focus_everything_is_culled() {
        assert_eq!(kept(&[(1.0, 3.0), (1.0, 9.0)]), [1.0, 0.0]);
        assert_eq!(
            kept(&[(1.0, -3.0), (1.0, 2.0), (0.5, 9.0)]),
            [1.0, 1.0, 0.0],
            "wherever it is in the list"
        );
        assert_eq!(kept(&[(1.0, -3.0), (1.0, 9.0)]), [1.0, 1.0], "what a near one hides is seen through it");
        assert_eq!(kept(&[(1.0, 0.0), (1.0, 9.0)]), [1.0, 1.0], "and beside one in focus");
    }

    #[test]
    fn contributions_at_nearly_the_depth_of_the_winner_are_culled() {
        assert_eq!(kept(&[(1.0, -0.4), (1.0, 0.0), (1.0, 0.2)]), [1.0, 0.0, 1.0], "half a pixel");
        assert_eq!(kept(&[(1.0, -8.0), (1.0, -4.1), (1.0, -3.9)]), [1.0, 0.0, 1.0], "a level of the pyramid");
    }

    #[test]
    fn translucent_contributions_dim_one_another_within_a_field() {
        assert_eq!(kept(&[(0.5, -3.0), (0.5, -2.0), (0.5, 4.0), (1.0, 6.0)]), [1.0, 0.5, 1.0, 0.5]);
    }

    /// A contribution of occupancy 0.8 at pixel 17, 30 of a frame of 64 × 64.
    fn single(coc_px: f32) -> ABuffer {
        let plane = |value: f32| Plane::from_fn(64, 64, |x, y| if (x, y) == (17, 30) { value } else { 0.0 });
        ABuffer::new(vec![Peel {
            covered: CoveragePlanes { content: vec![plane(0.4); 3], coverage: plane(0.8) },
            coc_px: plane(coc_px),
        }])
    }

    #[test]
    fn a_contribution_occupies_as_much_in_all_as_its_alpha() {
        // A variance of 2.25 px² lies between V_1 = 1.5 and V_2 = 7.5, so all of it is in levels 1 and 2, which come back
        // together as level 1; a sample of that is a mean over 4 pixels.
        let field = Field { side: Side::Far, top: 2, in_focus_px: 0.5, second_moment: 0.25 };
        let grid = Grid::new((64, 64), 2, Edge::Repeat);
        let level = single(3.0).pyramid(&field, &grid).unwrap();
        let total: f32 = level[3].values().iter().sum();
        assert!((4.0 * total - 0.8).abs() < 1e-5, "{total}");
        let color: f32 = level[0].values().iter().sum();
        assert!((4.0 * color - 0.4).abs() < 1e-5, "{color}");
    }
}
