//! `scatter`: each pixel of the visible picture becomes a disc of its CoC, nearest first.
//!
//! Potmesil & Chakravarty 1981, "A Lens and Aperture Camera Model for Synthetic Image Generation". A sprite spreads a
//! pixel's light evenly over its disc, and a pixel of the result is divided by the coverage that it got. The paper adds all
//! sprites, whatever their depth; those who compare with it sort them and blend from far to near, where however every sprite
//! dims what is behind it, its own surface too, and the order among equals decides. Here they are added from near to far
//! until a pixel's coverage reaches the parameter `saturation`: sprites of one surface add up to exactly one, so a whole
//! surface hides what is behind it, and part of one the same part. A large `saturation` is the paper's plain sum.
//!
//! Sprites whose radii differ by less than a 32nd part (an eighth of a pixel, where that is more) are drawn with one radius
//! and added as one, so that nothing depends on an order among them. Sprites of neighbouring pixels share all but their
//! rims: a bin's row is drawn as steps, up at each left rim and down at each right one, and summed once. Coverage is counted
//! in whole numbers, so what no sprite covers is not covered at all.
//!
//! Cost: pixels × rows of their discs, and bins × pixels. Memory: the picture twice, and 24 bytes for each run of pixels in
//! one bin. Limits, by design: knows only what the pinhole sees, so where a blurred front shows no back to share a pixel
//! with, the division makes all of the pixel front: its inside outline is sharp. On a surface steep in CoC the nearer
//! sprites saturate first, which shifts its blur towards them.

mod cost;
mod parameters;
mod bins;
mod sprite;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{Method, MethodInfo, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::planes_from_rows;
use crate::methods::shared::{self, Visible};
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use bins::{Bin, Run};
use parameters::ScatterParameters;
use pulp::{Arch, NullaryFnOnce};
use sprite::Step;

/// The classic.
#[derive(Debug)]
pub(in crate::methods) struct Scatter;

impl Method for Scatter {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "scatter",
            source: "Potmesil & Chakravarty 1981",
            role: Role::Baseline,
            summary: "each visible pixel a disc of its blur, nearest first until a pixel is full",
            effects: &[EffectKind::Merge],
            lens_samples: None,
            steps: &["saturation=0.5", "saturation=1", "saturation=2"],
            deviations: DEVIATIONS,
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<ScatterParameters>()
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let Visible { content, coc_px } = shared::visible(scene, plan);
        let (width, height) = (coc_px.width(), coc_px.height());
        let bins = bins::sort(&coc_px, plan.optics.aperture);
        let saturation = f64::from(plan.parameters.get::<ScatterParameters>().saturation);
        let channels = content.len();
        let arch = Arch::new();
        let new_row = || Row::new(width, channels);
        let planes = planes_from_rows((width, height), progress, new_row, |row, y, planes: &mut [_; 4]| {
            row.clear();
            arch.dispatch(DrawRow { row, bins: &bins, content: &content, y, saturation });
            for (plane, sums) in planes.iter_mut().zip(&row.content) {
                for ((value, &sum), &coverage) in plane.iter_mut().zip(sums).zip(&row.coverage) {
                    *value = (sum / coverage) as f32;
                }
            }
        });
        Ok(shared::picture(planes.into_iter().take(channels).collect()))
    }
}

/// A row of the result. A pixel's own sprite covers it, so that no coverage stays 0.
struct Row {
    /// Steps of one bin along the row: of its coverage, and of each channel.
    covered: Vec<f64>,
    steps: Vec<Vec<f64>>,
    /// What the bins so far have left here.
    coverage: Vec<f64>,
    content: Vec<Vec<f64>>,
    /// Share of a bin that finds room, pixel by pixel.
    shares: Vec<f64>,
}

impl Row {
    fn new(width: usize, channels: usize) -> Self {
        let row = || vec![0.0; width];
        let rows = || vec![row(); channels];
        Self { covered: row(), steps: rows(), coverage: row(), content: rows(), shares: row() }
    }

    fn clear(&mut self) {
        self.coverage.fill(0.0);
        self.content.iter_mut().for_each(|sums| sums.fill(0.0));
    }

    /// Adds the steps of a sprite's row for all pixels of `run`, `content` being its row of each channel.
    #[inline(always)]
    fn add_steps<'a>(&mut self, run: &Run, step: Step, content: impl Iterator<Item = &'a [f32]>) {
        let width = self.covered.len();
        let (from, to) = (i64::from(run.from) + i64::from(step.dx), i64::from(run.to) + i64::from(step.dx));
        // What begins left of the frame has begun at its first pixel; what begins right of it never does.
        let outside = (-from).clamp(0, to - from) as usize;
        let inside = (from.max(0) as usize).min(width)..(to.max(0) as usize).min(width);
        let columns = run.from as usize..run.to as usize;
        if outside > 0 {
            self.covered[0] += step.height * outside as f64;
        }
        self.covered[inside.clone()].iter_mut().for_each(|sum| *sum += step.height);
        for (sums, values) in self.steps.iter_mut().zip(content) {
            let values = &values[columns.clone()];
            if outside > 0 {
                sums[0] += step.height * values[..outside].iter().map(|&value| f64::from(value)).sum::<f64>();
            }
            for (sum, &value) in sums[inside.clone()].iter_mut().zip(&values[outside..]) {
                *sum += step.height * f64::from(value);
            }
        }
    }

    /// Sums up the steps of `columns`, adds what finds room below `saturation`, and forgets the steps.
    #[inline(always)]
    fn add_bin(&mut self, columns: std::ops::Range<usize>, intensity: f64, saturation: f64) {
        let mut covered = 0.0;
        let rows = self.covered[columns.clone()].iter_mut().zip(&mut self.coverage[columns.clone()]);
        for ((step, coverage), share) in rows.zip(&mut self.shares[columns.clone()]) {
            covered += std::mem::take(step);
            let added = covered * intensity;
            let room = saturation - *coverage;
            let taken = added.min(room).max(0.0);
            *coverage += taken;
            *share = if covered > 0.0 { taken / covered } else { 0.0 };
        }
        for (steps, content) in self.steps.iter_mut().zip(&mut self.content) {
            let mut sum = 0.0;
            let rows = steps[columns.clone()].iter_mut().zip(&mut content[columns.clone()]);
            for ((step, content), &share) in rows.zip(&self.shares[columns.clone()]) {
                sum += std::mem::take(step);
                *content += sum * share;
            }
        }
    }
}

/// Draws row `y` of all sprites; to be compiled for each instruction set.
struct DrawRow<'a> {
    row: &'a mut Row,
    /// Nearest first.
    bins: &'a [Bin],
    content: &'a [Plane],
    y: usize,
    saturation: f64,
}

impl NullaryFnOnce for DrawRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { row, bins, content, y, saturation } = self;
        let width = row.covered.len();
        for bin in bins {
            let mut reached = width..0;
            for run in bin.runs_reaching(y) {
                let steps = bin.sprite.row(y as i32 - run.y as i32);
                let (Some(first), Some(last)) = (steps.first(), steps.last()) else { continue };
                for &step in steps {
                    row.add_steps(run, step, content.iter().map(|plane| plane.row(run.y as usize)));
                }
                let from = (i64::from(run.from) + i64::from(first.dx)).clamp(0, width as i64) as usize;
                let to = (i64::from(run.to) + i64::from(last.dx)).clamp(0, width as i64) as usize;
                reached = reached.start.min(from)..reached.end.max(to);
            }
            if !reached.is_empty() {
                row.add_bin(reached, bin.sprite.intensity, saturation);
            }
        }
    }
}

/// Measured over all cases of each law.
const DEVIATIONS: &[Deviation] = &[
    Deviation {
        law: Law::SeeThrough,
        within: [0.0, 0.001],
        reason: "one picture knows nothing behind a blurred front, and what is in focus spreads nowhere",
    },
    Deviation {
        law: Law::Transparency,
        within: [0.999, 1.27],
        reason: "inside a near outline all coverage there is comes from the front, and is divided to be whole",
    },
    Deviation {
        law: Law::Convergence,
        within: [31.2, 33.0],
        reason: "what the visible picture hides has no sprites",
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Aperture;

    /// A row of grey `values` with CoC radii `coc`, scattered.
    fn scattered(values: &[f32], coc: &[f32], saturation: f64) -> Vec<f64> {
        let plane = |values: &[f32]| Plane::from_fn(values.len(), 1, |x, _| values[x]);
        let mut row = Row::new(values.len(), 1);
        let bins = bins::sort(&plane(coc), Aperture::DISC);
        DrawRow { row: &mut row, bins: &bins, content: &[plane(values)], y: 0, saturation }.call();
        row.content[0].iter().zip(&row.coverage).map(|(sum, coverage)| sum / coverage).collect()
    }

    #[test]
    fn a_sharp_pixel_hides_what_spreads_over_it_from_behind() {
        assert_eq!(scattered(&[0.0, 1.0, 0.0], &[5.0, 0.0, 5.0], 1.0)[1], 1.0, "full of itself");
    }

    #[test]
    fn a_near_sprite_takes_its_share_of_a_sharp_pixel_and_leaves_the_rest() {
        let intensity = sprite::Sprite::new(Aperture::DISC, -2.0, (3, 1)).intensity;
        // The middle pixel lies wholly inside the discs of both its neighbours.
        let share = 2.0 * intensity * sprite::WHOLE;
        let result = scattered(&[1.0, 0.0, 1.0], &[-2.0, 0.0, -2.0], 1.0)[1];
        assert!((result - share).abs() < 1e-12, "{result}, expected {share}");
    }

    #[test]
    fn past_saturation_nothing_farther_shows() {
        // One pixel's own sprite of radius 0 covers all of it; its neighbour's disc reaches it.
        let [hidden, added] =
            [1.0, 10.0].map(|saturation| scattered(&[0.0, 1.0], &[0.0, 3.0], saturation)[0]);
        assert_eq!(hidden, 0.0, "full");
        assert!(added > 0.0, "with room left, sprites are summed whatever their depth: {added}");
    }

    #[test]
    fn the_order_of_equals_does_not_matter() {
        let values = [0.9, 0.1, 0.5, 0.3, 0.7];
        let coc = [-3.0, -3.05, -3.0, -2.98, -3.0];
        let there = scattered(&values, &coc, 0.5);
        let mut mirrored: [[f32; 5]; 2] = [values, coc];
        mirrored.iter_mut().for_each(|row| row.reverse());
        let mut back = scattered(&mirrored[0], &mirrored[1], 0.5);
        back.reverse();
        for (a, b) in there.iter().zip(back) {
            assert!((a - b).abs() < 1e-12, "{a}, mirrored {b}");
        }
    }

    #[test]
    fn sprites_that_begin_outside_the_frame_are_there_at_its_border() {
        // Everything covers everything, evenly: the mean.
        let result = scattered(&[0.0, 3.0, 0.0], &[40.0; 3], 1.0);
        assert!(result.iter().all(|value| (value - 1.0).abs() < 1e-12), "{result:?}");
    }
}
