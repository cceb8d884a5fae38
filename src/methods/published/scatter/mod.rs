//! `scatter`: each pixel of the visible picture is drawn as a disc of its CoC, nearest first.
//!
//! Potmesil & Chakravarty 1981, "A Lens and Aperture Camera Model for Synthetic Image Generation". A sprite spreads the light of
//! a pixel evenly over its disc, and each pixel of the result is divided by its summed coverage. The paper adds all sprites at
//! every depth. Later comparisons sort the sprites and blend them from far to near; then each sprite attenuates everything behind
//! it, including its own surface, and the result depends on the order of sprites of equal depth. Here sprites are added from near
//! to far until the coverage of a pixel reaches the parameter `saturation`. The sprites of one surface add up to exactly one, so
//! a complete surface hides what is behind it, and a partial one hides the same part. A large `saturation` gives the plain sum of
//! the paper.
//!
//! Pixels without a surface have no sprite. The background comes behind all sprites ([`shared::Backdrop`]), in the part of a pixel that
//! is left below the saturation.
//!
//! Sprites are sorted by radius into bins 1/32 of the radius wide, and at least 1/8 px. Those of one bin are drawn with one
//! radius and added at once, so that the result does not depend on their order. Sprites of neighbouring pixels differ only at
//! their edges: a row of a bin is drawn as steps, up at each left edge and down at each right edge, and summed once. Coverage is
//! counted in whole steps, so the coverage of a pixel that no sprite covers is exactly 0.
//!
//! Cost: pixels × rows of their discs, and bins × pixels. Memory: the picture twice, and 24 bytes for each span of pixels in
//! one bin. Limits, by design: the method reads only the pinhole picture. Where a blurred foreground has no visible surface behind it
//! to share a pixel with, the division makes the whole pixel foreground, so the inner outline is sharp. On a surface of steep CoC
//! the nearer sprites saturate first, which shifts the blur towards them.

mod bins;
mod cost;
mod parameters;
mod sprite;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::{Method, MethodInfo, Plan, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{self, Backdrop, VisibleSurfaces, before, planes_from_rows};
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use bins::{Bin, Span};
use parameters::ScatterParameters;
use pulp::{Arch, NullaryFnOnce};
use sprite::Step;

/// The classic scatter filter.
#[derive(Debug)]
pub(in crate::methods) struct Scatter;

impl Method for Scatter {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "scatter",
            source: "Potmesil & Chakravarty 1981",
            role: Role::Baseline,
            summary: "each visible pixel drawn as a disc of its blur, nearest first until a pixel is fully covered",
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
        let backdrop = Backdrop::new(&scene, plan);
        let surfaces = shared::visible_surfaces(scene, plan);
        let scattered = Scattered::new(&surfaces, plan);
        if backdrop.is_none() {
            let [red, green, blue, _] = scattered.planes::<4>(progress);
            return Ok(shared::picture(vec![red, green, blue]));
        }
        let [red, green, blue, alpha, coverage] = scattered.planes::<5>(progress);
        Ok(before(shared::picture(vec![red, green, blue, alpha]), &coverage, backdrop.as_ref()))
    }
}

/// Steps that a presence of 1 is divided into: see [`Scattered::presence`].
const PRESENCE_STEPS: f32 = 65_536.0;

/// The surfaces to draw, sorted into bins.
struct Scattered<'a> {
    content: &'a [Plane],
    /// Presence of each pixel in whole steps, so that sums of coverage are exact; `None` where all are 1.
    presence: Option<Plane>,
    bins: Vec<Bin>,
    size: (usize, usize),
    saturation: f64,
}

impl<'a> Scattered<'a> {
    fn new(surfaces: &'a VisibleSurfaces, plan: &Plan) -> Self {
        let VisibleSurfaces { content, presence, coc_px } = surfaces;
        let presence = presence.clone().map(|mut presence| {
            // No fragment has less than one step, not even light without alpha, whose content is divided by what it has.
            let whole_steps = |value: &mut f32| {
                let least = if *value > 0.0 { 1.0 } else { 0.0 };
                *value = (*value * PRESENCE_STEPS).round().max(least) / PRESENCE_STEPS;
            };
            presence.values_mut().iter_mut().for_each(whole_steps);
            presence
        });
        Self {
            content,
            presence,
            bins: bins::sort(coc_px, plan.optics.aperture),
            size: (coc_px.width(), coc_px.height()),
            saturation: f64::from(plan.parameters.get::<ScatterParameters>().saturation),
        }
    }

    /// Content, divided by coverage, and, last, coverage.
    fn planes<const N: usize>(&self, progress: &Progress<'_>) -> [Plane; N] {
        let arch = Arch::new();
        let new_row = || Row::new(self.size.0, self.content.len());
        // The coverage of a complete surface.
        let complete = self.saturation.min(1.0) as f32;
        planes_from_rows(self.size, progress, &new_row, &|row, y, planes: &mut [_; N]| {
            row.clear();
            arch.dispatch(DrawRow { row, scattered: self, y });
            let Some((coverages, content)) = planes.split_last_mut() else { return };
            for (plane, sums) in content.iter_mut().zip(&row.content) {
                for ((value, &sum), &coverage) in plane.iter_mut().zip(sums).zip(&row.coverage) {
                    *value = if coverage > 0.0 { (sum / coverage) as f32 } else { 0.0 };
                }
            }
            for (result, coverage) in coverages.iter_mut().zip(&row.coverage) {
                *result = *coverage as f32;
            }
            self.add_outside(y, coverages);
            coverages.iter_mut().for_each(|coverage| *coverage = (*coverage / complete).min(1.0));
        })
    }
}

impl Scattered<'_> {
    /// Adds to the coverage of row `y` that of sprites outside the frame, as if they were like those of the pixels that they cover.
    fn add_outside(&self, y: usize, coverages: &mut [f32]) {
        let Some(presence) = &self.presence else { return };
        let presence = presence.row(y);
        for bin in &self.bins {
            for x in bin.columns(y) {
                coverages[x] += presence[x] * (1.0 - bin.sprite.share_within(self.size, [x, y])) as f32;
            }
        }
    }
}

/// A row of the result.
struct Row {
    /// Steps of one bin along the row: of its coverage, and of each channel.
    coverage_steps: Vec<f64>,
    content_steps: Vec<Vec<f64>>,
    /// Sums over the bins so far.
    coverage: Vec<f64>,
    content: Vec<Vec<f64>>,
    /// For each pixel, the share of a bin that fits below the saturation.
    shares: Vec<f64>,
}

impl Row {
    fn new(width: usize, channels: usize) -> Self {
        let row = || vec![0.0; width];
        let rows = || vec![row(); channels];
        Self { coverage_steps: row(), content_steps: rows(), coverage: row(), content: rows(), shares: row() }
    }

    fn clear(&mut self) {
        self.coverage.fill(0.0);
        self.content.iter_mut().for_each(|sums| sums.fill(0.0));
    }

    /// Adds one step of a sprite for all pixels of `span`; `content` has the row of the span for each channel, and `presence` its
    /// presence where that is not 1.
    #[inline(always)]
    fn add_step<'a>(
        &mut self,
        (span, step): (&Span, Step),
        presence: Option<&[f32]>,
        content: impl Iterator<Item = &'a [f32]>,
    ) {
        let width = self.coverage_steps.len();
        let (from, to) = (i64::from(span.from) + i64::from(step.dx), i64::from(span.to) + i64::from(step.dx));
        // Steps left of the frame are added at its first pixel; steps right of it have no effect.
        let outside = (-from).clamp(0, to - from) as usize;
        let inside = (from.max(0) as usize).min(width)..(to.max(0) as usize).min(width);
        let columns = span.from as usize..span.to as usize;
        let add = |sums: &mut [f64], values: &[f32]| {
            let values = &values[columns.clone()];
            if outside > 0 {
                sums[0] += step.height * values[..outside].iter().map(|&value| f64::from(value)).sum::<f64>();
            }
            for (sum, &value) in sums[inside.clone()].iter_mut().zip(&values[outside..]) {
                *sum += step.height * f64::from(value);
            }
        };
        self.content_steps.iter_mut().zip(content).for_each(|(sums, values)| add(sums, values));
        if let Some(presence) = presence {
            return add(&mut self.coverage_steps, presence);
        }
        if outside > 0 {
            self.coverage_steps[0] += step.height * outside as f64;
        }
        self.coverage_steps[inside].iter_mut().for_each(|sum| *sum += step.height);
    }

    /// Integrates the steps of `columns`, adds the share that fits below `saturation`, and clears the steps.
    #[inline(always)]
    fn add_bin(&mut self, columns: std::ops::Range<usize>, intensity: f64, saturation: f64) {
        let mut covered = 0.0;
        let rows = self.coverage_steps[columns.clone()].iter_mut().zip(&mut self.coverage[columns.clone()]);
        for ((step, coverage), share) in rows.zip(&mut self.shares[columns.clone()]) {
            covered += std::mem::take(step);
            let added = covered * intensity;
            let remaining = saturation - *coverage;
            let kept = added.min(remaining).max(0.0);
            *coverage += kept;
            *share = if covered > 0.0 { kept / covered } else { 0.0 };
        }
        for (steps, content) in self.content_steps.iter_mut().zip(&mut self.content) {
            let mut sum = 0.0;
            let rows = steps[columns.clone()].iter_mut().zip(&mut content[columns.clone()]);
            for ((step, content), &share) in rows.zip(&self.shares[columns.clone()]) {
                sum += std::mem::take(step);
                *content += sum * share;
            }
        }
    }
}

/// Draws row `y` of all sprites; compiled for each instruction set.
struct DrawRow<'a> {
    row: &'a mut Row,
    scattered: &'a Scattered<'a>,
    y: usize,
}

impl NullaryFnOnce for DrawRow<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { row, scattered: Scattered { content, presence, bins, saturation, .. }, y } = self;
        let width = row.coverage_steps.len();
        for bin in bins {
            let mut reached = width..0;
            for span in bin.spans_reaching(y) {
                let steps = bin.sprite.row(y as i32 - span.y as i32);
                let (Some(first), Some(last)) = (steps.first(), steps.last()) else { continue };
                let presence = presence.as_ref().map(|presence| presence.row(span.y as usize));
                for &step in steps {
                    let content = content.iter().map(|plane| plane.row(span.y as usize));
                    row.add_step((span, step), presence, content);
                }
                let from = (i64::from(span.from) + i64::from(first.dx)).clamp(0, width as i64) as usize;
                let to = (i64::from(span.to) + i64::from(last.dx)).clamp(0, width as i64) as usize;
                reached = reached.start.min(from)..reached.end.max(to);
            }
            if !reached.is_empty() {
                row.add_bin(reached, bin.sprite.intensity, *saturation);
            }
        }
    }
}

/// Measured over all cases of each law.
const DEVIATIONS: &[Deviation] = &[
    Deviation {
        law: Law::SeeThrough,
        within: [0.0, 0.001],
        reason: "one picture shows nothing behind a blurred foreground, and pixels in focus do not spread",
    },
    Deviation {
        law: Law::Convergence,
        within: [31.2, 33.0],
        reason: "surfaces that the visible picture hides have no sprites",
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
        let scattered = Scattered {
            content: &[plane(values)],
            presence: None,
            bins: bins::sort(&plane(coc), Aperture::DISC),
            size: (values.len(), 1),
            saturation,
        };
        DrawRow { row: &mut row, scattered: &scattered, y: 0 }.call();
        row.content[0].iter().zip(&row.coverage).map(|(sum, coverage)| sum / coverage).collect()
    }

    #[test]
    fn a_sharp_pixel_hides_sprites_that_reach_it_from_behind() {
        assert_eq!(scattered(&[0.0, 1.0, 0.0], &[5.0, 0.0, 5.0], 1.0)[1], 1.0, "covered by itself");
    }

    #[test]
    fn near_sprites_cover_part_of_a_sharp_pixel() {
        let intensity = sprite::Sprite::new(Aperture::DISC, -2.0, (3, 1)).intensity;
        // The middle pixel lies wholly inside the discs of both its neighbours.
        let share = 2.0 * intensity * sprite::FULL_COVERAGE;
        let result = scattered(&[1.0, 0.0, 1.0], &[-2.0, 0.0, -2.0], 1.0)[1];
        assert!((result - share).abs() < 1e-12, "{result}, expected {share}");
    }

    #[test]
    fn farther_sprites_are_hidden_past_saturation() {
        // The first pixel is covered completely by its own sprite of radius 0; the disc of its neighbour reaches it.
        let [hidden, added] =
            [1.0, 10.0].map(|saturation| scattered(&[0.0, 1.0], &[0.0, 3.0], saturation)[0]);
        assert_eq!(hidden, 0.0, "saturated");
        assert!(added > 0.0, "below saturation, sprites of every depth are summed: {added}");
    }

    #[test]
    fn the_order_of_sprites_of_equal_depth_has_no_effect() {
        let values = [0.9, 0.1, 0.5, 0.3, 0.7];
        let coc = [-3.0, -3.05, -3.0, -2.98, -3.0];
        let forward = scattered(&values, &coc, 0.5);
        let mut mirrored: [[f32; 5]; 2] = [values, coc];
        mirrored.iter_mut().for_each(|row| row.reverse());
        let mut backward = scattered(&mirrored[0], &mirrored[1], 0.5);
        backward.reverse();
        for (a, b) in forward.iter().zip(backward) {
            assert!((a - b).abs() < 1e-12, "{a}, mirrored {b}");
        }
    }

    #[test]
    fn sprites_that_begin_outside_the_frame_cover_pixels_inside_it() {
        // Every sprite covers every pixel evenly, so each pixel is the mean.
        let result = scattered(&[0.0, 3.0, 0.0], &[40.0; 3], 1.0);
        assert!(result.iter().all(|value| (value - 1.0).abs() < 1e-12), "{result:?}");
    }
}
