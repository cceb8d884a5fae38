//! The amount of work of a blur: figures that the cost of a method depends on, derived from the scene's statistics.
//!
//! Figures are per picture pixel, not per sample, because a supersampled stack is merged before most methods read it.

use super::bright::bright_step_floor;
use super::merge::max_merged_layers;
use super::peel_stats::PeelStats;
use super::spread::{Block, Blocks, COC_STEPS, coc_step};
use super::stats::SceneStats;
use std::f64::consts::PI;

/// The statistics of a scene and its number of lens rays, and the figures of work that follow from them.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Workload<'a> {
    /// The scene's statistics.
    pub stats: &'a SceneStats,
    /// Lens rays per pixel, over all colours where each colour has its own rays; 0 where the lens is not sampled.
    pub rays: usize,
    /// Whether rays may end in a transparent background.
    pub shows_background: bool,
}

/// Intervals of CoC depth in front of the visible surface, means over the picture's pixels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Depths {
    /// From the nearest fragment that a ray of the pixel can hit to the pixel's visible surface.
    pub before_px: f64,
    /// From the nearest fragment of the scene to the pixel's visible surface.
    pub whole_px: f64,
}

/// Sums over a set of discs.
#[derive(Debug, Clone, Copy, Default)]
pub struct Discs {
    /// Number of discs.
    pub count: f64,
    /// Number of their rows.
    pub rows: f64,
}

/// The centre of a step of CoC radii.
fn middle(step: usize) -> f64 {
    let span = coc_step(step);
    0.5 * (span.start + span.end)
}

impl<'a> Workload<'a> {
    /// Samples per pixel along each axis.
    pub fn supersample(&self) -> f64 {
        self.stats.supersample as f64
    }

    /// Width and height of the picture.
    pub fn size(&self) -> [f64; 2] {
        [self.stats.picture_size.0 as f64, self.stats.picture_size.1 as f64]
    }

    /// Pixels of the picture.
    pub fn pixels(&self) -> f64 {
        self.size()[0] * self.size()[1]
    }

    /// Pixels of the picture where some rays may end in a transparent background, or 0.
    pub fn pixels_before_background(&self) -> f64 {
        if self.shows_background { self.pixels() } else { 0.0 }
    }

    /// Number of samples that are composited: none if the nearest layer hides all others everywhere, otherwise all.
    pub fn composited(&self) -> f64 {
        let hides = |peel: &PeelStats| peel.covered >= 1.0 && peel.translucent <= 0.0;
        let is_one_layer = self.stats.supersample == 1 && self.stats.peels.first().is_some_and(hides);
        if is_one_layer { 0.0 } else { self.pixels() * self.supersample().powi(2) }
    }

    /// Number of layers of the stack.
    pub fn layers(&self) -> f64 {
        self.stats.layers as f64
    }

    /// Number of layers at one sample per pixel: of a supersampled stack the most that its samples are merged into.
    pub fn merged_layers(&self) -> f64 {
        if self.stats.supersample > 1 { max_merged_layers(self.stats.layers) as f64 } else { self.layers() }
    }

    /// Number of samples of all layers.
    pub fn samples(&self) -> f64 {
        self.pixels() * self.supersample().powi(2) * self.layers()
    }

    /// Number of samples that are merged: those of all layers of a supersampled stack, otherwise 0.
    pub fn merged(&self) -> f64 {
        if self.stats.supersample > 1 { self.samples() } else { 0.0 }
    }

    /// Lens samples per pixel, over all sets of rays.
    pub fn views(&self) -> f64 {
        self.rays as f64
    }

    /// The largest absolute CoC radii in front of and behind focus.
    pub fn reach_px(&self) -> [f64; 2] {
        let [near, far] = self.stats.coc_range_px.map(f64::from);
        [(-near).max(0.0), far.max(0.0)]
    }

    /// The sums of `figure` of the CoC radius over the fragments of the nearest layer, and over those of all others, in picture pixels: a
    /// sample counts by the share of a pixel that it is.
    pub fn sums(&self, figure: impl Fn(f64) -> f64) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for (number, step) in self.stats.spread.steps.iter().enumerate() {
            let each = figure(middle(number)) / self.supersample().powi(2);
            for (sum, counts) in sums.iter_mut().zip([step.front, step.behind]) {
                *sum += each * counts.iter().sum::<usize>() as f64;
            }
        }
        sums
    }

    /// Area within the picture of a disc of radius `coc_px` around a pixel, the mean over all pixels.
    pub fn disc_px(&self, coc_px: f64) -> f64 {
        self.size().map(|side| share_inside(coc_px, side)).iter().product::<f64>() * PI * coc_px * coc_px
    }

    /// Number of the disc's rows within the picture, the mean over all pixels.
    pub fn disc_rows(&self, coc_px: f64) -> f64 {
        1.0 + share_inside(coc_px, self.size()[1]) * 2.0 * coc_px
    }

    /// Share of the pixels of the nearest layer that show another surface than the pixel before them in the row.
    pub fn edge_density(&self) -> f64 {
        let front: f64 = self.sums(|_| 1.0)[0];
        let edges = self.stats.spread.edges[0] / self.supersample();
        if front > 0.0 { (edges / front).min(1.0) } else { 0.0 }
    }

    /// The discs of blurred fragments that are brighter than `threshold`.
    pub fn discs(&self, threshold: f32) -> Discs {
        let mut discs = Discs::default();
        // A step that contains the threshold is counted whole, which is accurate enough.
        let bright = self
            .stats
            .bright
            .iter()
            .enumerate()
            .filter(|(step, bright)| bright.discs > 0.0 && bright_step_floor(step + 1) > threshold);
        for (_, bright) in bright {
            let count = bright.discs;
            discs.count += count;
            discs.rows += count * 2.0 * (bright.disc_area_px / count / PI).sqrt();
        }
        discs
    }

    /// The blocks of the picture.
    fn blocks(&self) -> &'a Blocks {
        &self.stats.spread.blocks
    }

    /// The blocks within `reach_px` pixels of block `at`, which may be infinite, each with its distance in pixels.
    fn around(&self, at: usize, reach_px: f64) -> impl Iterator<Item = (&'a Block, f64)> {
        let &Blocks { side_px, columns, ref blocks } = self.blocks();
        let (side, rows) = (side_px as f64, blocks.len() / columns.max(1));
        let steps = (reach_px / side).ceil().min(1e6) as usize;
        let (x, y) = (at % columns, at / columns);
        let span = move |at: usize, count: usize| at.saturating_sub(steps)..(at + steps + 1).min(count);
        span(y, rows).flat_map(move |row| {
            span(x, columns).map(move |column| {
                let gap = |a: usize, b: usize| (a.abs_diff(b) as f64 - 0.5).max(0.0) * side;
                (&blocks[row * columns + column], gap(row, y).hypot(gap(column, x)))
            })
        })
    }

    /// The CoC depth that the rays of a pixel pass before they hit its visible surface.
    pub fn depths(&self) -> Depths {
        let whole = self.stats.coc_range_px.map(f64::from);
        let mut sum = Depths::default();
        let blocks = &self.blocks().blocks;
        for (at, block) in blocks.iter().enumerate() {
            let shown = if block.front > 0.0 { block.front_coc_px / block.front } else { whole[1] };
            let mut range = whole;
            for _ in 0..2 {
                let reach = range[0].abs().max(range[1].abs()) + 0.5;
                let within = self.around(at, reach).filter(|(_, gap)| *gap <= reach);
                let ends = within.map(|(block, _)| [block.near_px, block.far_px].map(f64::from));
                range = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |range, ends| {
                    [range[0].min(ends[0]), range[1].max(ends[1])]
                });
                if range[0] > range[1] {
                    break;
                }
            }
            if range[0] <= range[1] {
                sum.before_px += (shown - range[0]).max(0.0);
            }
            sum.whole_px += (shown - whole[0]).max(0.0);
        }
        let count = blocks.len().max(1) as f64;
        Depths { before_px: sum.before_px / count, whole_px: sum.whole_px / count }
    }

    /// The sum over the picture's pixels of `figure` of the radius that contains all fragments whose discs cover the pixel.
    pub fn reached(&self, figure: impl Fn(f64) -> f64) -> f64 {
        let blocks = &self.blocks().blocks;
        let [near, _] = self.reach_px();
        let side = self.blocks().side_px as f64;
        let mut sum = 0.0;
        for (at, block) in blocks.iter().enumerate() {
            let own = figure(if block.front > 0.0 { block.front_size_px / block.front } else { 0.0 });
            let raised = self.around(at, near).map(|(block, gap)| {
                let radius = -f64::from(block.near_px);
                // Share of this block that the nearest fragment's disc covers; the fragment may lie anywhere in its block.
                let share = if gap > 0.0 { (radius - gap) / side + 0.25 } else { 2.0 * radius / side };
                share.clamp(0.0, 1.0) * (figure(radius.max(0.0)) - own)
            });
            sum += own + raised.fold(0.0, f64::max);
        }
        sum * self.pixels() / blocks.len().max(1) as f64
    }

    /// Number of pixels past which rays reach something behind their nearest fragment: those as near to it as CoC radii differ. From blocks, which
    /// miss about half of them where CoC radii differ by less than a block is wide.
    pub fn pixels_over_hidden(&self) -> f64 {
        let Blocks { side_px, ref blocks, .. } = *self.blocks();
        let [near, far] = self.stats.coc_range_px.map(f64::from);
        let (mut over, mut front) = (0.0, 0.0);
        for (at, block) in blocks.iter().enumerate().filter(|(_, block)| block.front > 0.0) {
            let own = block.front_coc_px / block.front;
            let shares = self.around(at, far - near).map(|(other, gap)| {
                let behind = f64::from(other.far_px) - own - gap;
                (behind / side_px as f64).clamp(0.0, 1.0)
            });
            over += block.front * shares.fold(0.0, f64::max);
            front += block.front;
        }
        if front > 0.0 { self.pixels() * over / front } else { 0.0 }
    }

    /// Number of rows of the picture, in whole blocks, with a CoC radius within `span`.
    pub fn rows_with(&self, span: [f64; 2]) -> f64 {
        let rows = self.row_ranges();
        let holding = rows.iter().filter(|range| range[0] <= span[1] && range[1] >= span[0]).count();
        self.size()[1] * holding as f64 / rows.len().max(1) as f64
    }

    /// Number of occupied slices of CoC radii, summed over the rows of the picture that each can reach. Slices are `width_px` wide near
    /// focus; past the 32nd each is a 32nd part wider than the one before.
    pub fn row_slices(&self, width_px: f64) -> f64 {
        let rows = self.row_ranges();
        let height = self.size()[1] / rows.len().max(1) as f64;
        let side = self.blocks().side_px as f64;
        let mut sum = 0.0;
        for (slices, span) in self.occupied(width_px) {
            let reach = span[0].abs().max(span[1].abs());
            let has = |range: &[f64; 2]| range[0] <= span[1] && range[1] >= span[0];
            let holding: Vec<usize> = (0..rows.len()).filter(|&row| has(&rows[row])).collect();
            let reaches = |row: usize| {
                holding.iter().any(|held| (held.abs_diff(row) as f64 - 0.5).max(0.0) * side <= reach)
            };
            sum += slices * height * (0..rows.len()).filter(|&row| reaches(row)).count() as f64;
        }
        sum
    }

    /// Number of slices that contain a fragment, see [`Workload::row_slices`].
    pub fn slices(&self, width_px: f64) -> f64 {
        self.occupied(width_px).map(|(slices, _)| slices).sum()
    }

    /// For each step of CoC radii on either side of focus that contains a fragment: its number of slices, and its signed bounds.
    fn occupied(&self, width_px: f64) -> impl Iterator<Item = (f64, [f64; 2])> {
        let [near, far] = self.stats.coc_range_px.map(f64::from);
        let steps = &self.stats.spread.steps;
        (0..COC_STEPS).flat_map(move |step| [(step, 0), (step, 1)]).filter_map(move |(step, side)| {
            let count = steps[step].front[side] + steps[step].behind[side];
            let span = coc_step(step);
            let ends = if side == 0 { [-span.end, -span.start] } else { [span.start, span.end] };
            let ends = [ends[0].max(near), ends[1].min(far)];
            (count > 0 && ends[0] <= ends[1]).then(|| {
                let slices = position(ends[1], width_px) - position(ends[0], width_px);
                (slices.min(count as f64), ends)
            })
        })
    }

    /// Smallest and largest CoC radius of each row of blocks.
    fn row_ranges(&self) -> Vec<[f64; 2]> {
        let rows = self.blocks().blocks.chunks(self.blocks().columns.max(1));
        rows.map(|row| {
            let near = row.iter().map(|block| block.near_px).fold(f32::INFINITY, f32::min);
            let far = row.iter().map(|block| block.far_px).fold(f32::NEG_INFINITY, f32::max);
            [near, far].map(f64::from)
        })
        .collect()
    }
}

/// Share of an interval of half length `reach_px` that lies on a line of length `side`, the mean over all centres on the line.
fn share_inside(reach_px: f64, side: f64) -> f64 {
    match reach_px {
        0.0 => 1.0,
        reach if reach < side => 1.0 - reach / (2.0 * side),
        reach => side / (2.0 * reach),
    }
}

/// Signed number of slices between focus and CoC radius `coc_px`, see [`Workload::row_slices`].
fn position(coc_px: f64, width_px: f64) -> f64 {
    const EVEN: f64 = 32.0;
    let steps = coc_px.abs() / width_px;
    if steps <= EVEN { steps.copysign(coc_px) } else { (EVEN * (1.0 + (steps / EVEN).ln())).copysign(coc_px) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::scene::{Layer, Scene};
    use crate::stack::StackKind;

    #[test]
    fn the_share_of_an_interval_inside_is_its_mean_over_all_centres() {
        for (reach, side) in [(3.0, 10.0), (9.0, 10.0), (10.0, 10.0), (25.0, 10.0)] {
            let inside = |place: f64| (place + reach).min(side) - (place - reach).max(0.0);
            let mean = (0..10_000).map(|i| inside(side * (f64::from(i) + 0.5) / 1e4)).sum::<f64>() / 1e4;
            let expected = mean / (2.0 * reach);
            assert!((share_inside(reach, side) - expected).abs() < 1e-4, "{reach} on {side}: {expected}");
        }
    }

    #[test]
    fn pixels_over_hidden_ones_lie_as_near_to_an_edge_as_coc_radii_differ() {
        let (width, height) = (512, 64);
        // The mean over the places of the edge in a block.
        let over_hidden = |[left_px, right_px]: [f32; 2]| {
            let at_edge = |edge: usize| {
                let coc_px = Plane::from_fn(width, height, |x, _| if x < edge { left_px } else { right_px });
                let color = std::array::from_fn(|_| Plane::zeros(width, height));
                let layer = Layer { color, alpha: Plane::filled(width, height, 1.0), coc_px };
                let stats = Scene::new(vec![layer], StackKind::PointSampled, 1, 20.0).analyze();
                Workload { stats: &stats, rays: 1, shows_background: false }.pixels_over_hidden()
            };
            (248..264).map(at_edge).sum::<f64>() / 16.0
        };
        assert_eq!(over_hidden([3.0, 3.0]), 0.0, "one surface hides nothing");
        for jump_px in [4.0, 8.0, 16.0, 30.0_f32] {
            let [found, mirrored] =
                [[-0.5, 0.5], [0.5, -0.5]].map(|ends| over_hidden(ends.map(|end| end * jump_px)));
            let expected = f64::from(jump_px) * height as f64;
            // A block has one depth: an edge within it counts half.
            let ratio = found / expected;
            assert!((0.45..1.2).contains(&ratio), "{jump_px} px: {found}, not {expected}");
            assert!((mirrored / found - 1.0).abs() < 0.15, "{jump_px} px: {found}, mirrored {mirrored}");
        }
    }

    #[test]
    fn slices_are_even_near_focus_and_grow_past_it() {
        assert_eq!(position(-4.0, 0.5), -8.0);
        let grown = position(33.0, 0.5) - position(32.0, 0.5);
        assert!((grown - 1.0).abs() < 0.05, "a 32nd part of 32 px: {grown}");
    }
}
