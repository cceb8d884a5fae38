//! The size of a blur, in the figures that the cost of a method depends on: a reading of the scene's statistics.
//!
//! Figures are of the picture, not of samples: a supersampled stack is merged before most methods look at it.

use super::spread::{Block, Blocks, COC_STEPS, coc_step};
use super::stats::{SceneStats, bright_step_floor};
use std::f64::consts::PI;

/// The statistics of a scene and how often its lens is sampled, and what follows from them for the work of a blur.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Workload<'a> {
    /// The scene's statistics.
    pub stats: &'a SceneStats,
    /// Lens rays a pixel: those of all colours, where colours have rays of their own; 0 where the lens is not sampled.
    pub rays: usize,
}

/// The stretches of CoC depth in front of the rays of a pixel, means over the picture.
#[derive(Debug, Clone, Copy, Default)]
pub struct Depths {
    /// From the nearest that a ray of the pixel can meet to what the pixel shows.
    pub before_px: f64,
    /// From the nearest that there is at all to what the pixel shows.
    pub whole_px: f64,
}

/// Discs, all together.
#[derive(Debug, Clone, Copy, Default)]
pub struct Discs {
    /// How many there are.
    pub count: f64,
    /// Their rows.
    pub rows: f64,
}

/// The middle of a step of CoC radii.
fn middle(step: usize) -> f64 {
    let span = coc_step(step);
    0.5 * (span.start + span.end)
}

impl<'a> Workload<'a> {
    /// Samples a pixel along each axis.
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

    /// Layers of the stack.
    pub fn layers(&self) -> f64 {
        self.stats.layers as f64
    }

    /// Samples of all layers.
    pub fn samples(&self) -> f64 {
        self.pixels() * self.supersample().powi(2) * self.layers()
    }

    /// Samples of all layers, where they have to be merged first.
    pub fn merged(&self) -> f64 {
        if self.stats.supersample > 1 { self.samples() } else { 0.0 }
    }

    /// Lens samples a pixel, those of every set.
    pub fn views(&self) -> f64 {
        self.rays as f64
    }

    /// Size of the largest CoC radii in front of and behind focus.
    pub fn reach_px(&self) -> [f64; 2] {
        let [near, far] = self.stats.coc_range_px.map(f64::from);
        [(-near).max(0.0), far.max(0.0)]
    }

    /// The sum over the fragments of the nearest layer, and of all others, of `figure` of their CoC radius, for each picture
    /// pixel's worth.
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

    /// Mean area of the part of a disc of radius `coc_px` around a pixel of the picture that lies within the picture.
    pub fn disc_px(&self, coc_px: f64) -> f64 {
        self.size().map(|side| share_inside(coc_px, side)).iter().product::<f64>() * PI * coc_px * coc_px
    }

    /// Mean number of the disc's rows that lie within the picture.
    pub fn disc_rows(&self, coc_px: f64) -> f64 {
        1.0 + share_inside(coc_px, self.size()[1]) * 2.0 * coc_px
    }

    /// How often a pixel of the nearest layer differs from the one before it in its row.
    pub fn edge_density(&self) -> f64 {
        let front: f64 = self.sums(|_| 1.0)[0];
        let edges = self.stats.spread.edges[0] / self.supersample();
        if front > 0.0 { (edges / front).min(1.0) } else { 0.0 }
    }

    /// The discs of blurred fragments that are brighter than `threshold`.
    pub fn discs(&self, threshold: f32) -> Discs {
        let mut discs = Discs::default();
        // A threshold within a step takes part of it; the whole of it is near enough.
        let bright = self
            .stats
            .bright
            .iter()
            .enumerate()
            .filter(|(step, bright)| bright.fragments > 0 && bright_step_floor(step + 1) > threshold);
        for (_, bright) in bright {
            let count = bright.fragments as f64;
            discs.count += count;
            discs.rows += count * 2.0 * (bright.disc_area_px / count / PI).sqrt();
        }
        discs
    }

    /// The blocks of the picture.
    fn blocks(&self) -> &'a Blocks {
        &self.stats.spread.blocks
    }

    /// Calls `look` with every block and all blocks within `reach(block)` pixels of it; `reach` may be infinite.
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

    /// What lies before the pixels of the picture, as the rays of each can meet it.
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

    /// The sum over the pixels of the picture of `figure` of the radius within which all lies that spreads over the pixel.
    pub fn reached(&self, figure: impl Fn(f64) -> f64) -> f64 {
        let blocks = &self.blocks().blocks;
        let [near, _] = self.reach_px();
        let side = self.blocks().side_px as f64;
        let mut sum = 0.0;
        for (at, block) in blocks.iter().enumerate() {
            let own = figure(if block.front > 0.0 { block.front_size_px / block.front } else { 0.0 });
            let raised = self.around(at, near).map(|(block, gap)| {
                let radius = -f64::from(block.near_px);
                // The nearest fragment may be anywhere in its block: the share of this one that its disc covers.
                let share = if gap > 0.0 { (radius - gap) / side + 0.25 } else { 2.0 * radius / side };
                share.clamp(0.0, 1.0) * (figure(radius.max(0.0)) - own)
            });
            sum += own + raised.fold(0.0, f64::max);
        }
        sum * self.pixels() / blocks.len().max(1) as f64
    }

    /// Rows of the picture, in whole blocks, that hold something with a CoC radius within `span`.
    pub fn rows_with(&self, span: [f64; 2]) -> f64 {
        let rows = self.row_ranges();
        let holding = rows.iter().filter(|range| range[0] <= span[1] && range[1] >= span[0]).count();
        self.size()[1] * holding as f64 / rows.len().max(1) as f64
    }

    /// Slices of CoC radii `width_px` wide near focus, growing past 32 of them by a 32nd part, that some fragment is in, summed
    /// over the rows of the picture that they can reach.
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

    /// Slices that some fragment is in.
    pub fn slices(&self, width_px: f64) -> f64 {
        self.occupied(width_px).map(|(slices, _)| slices).sum()
    }

    /// For each step of CoC radii on either side of focus that some fragment is in: how many slices it has, and its signed
    /// ends.
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

    /// CoC radii of each row of blocks, from and to.
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

/// Share of a stretch of half length `reach_px`, around any point of a line of length `side`, that lies on the line.
fn share_inside(reach_px: f64, side: f64) -> f64 {
    match reach_px {
        0.0 => 1.0,
        reach if reach < side => 1.0 - reach / (2.0 * side),
        reach => side / (2.0 * reach),
    }
}

/// How many slices lie between focus and CoC radius `coc_px`, see [`Workload::row_slices`].
fn position(coc_px: f64, width_px: f64) -> f64 {
    const EVEN: f64 = 32.0;
    let steps = coc_px.abs() / width_px;
    if steps <= EVEN { steps.copysign(coc_px) } else { (EVEN * (1.0 + (steps / EVEN).ln())).copysign(coc_px) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_of_a_stretch_that_lies_inside_is_its_mean_over_all_places() {
        for (reach, side) in [(3.0, 10.0), (9.0, 10.0), (10.0, 10.0), (25.0, 10.0)] {
            let inside = |place: f64| (place + reach).min(side) - (place - reach).max(0.0);
            let mean = (0..10_000).map(|i| inside(side * (f64::from(i) + 0.5) / 1e4)).sum::<f64>() / 1e4;
            let expected = mean / (2.0 * reach);
            assert!((share_inside(reach, side) - expected).abs() < 1e-4, "{reach} on {side}: {expected}");
        }
    }

    #[test]
    fn slices_are_even_near_focus_and_grow_past_it() {
        assert_eq!(position(-4.0, 0.5), -8.0);
        let grown = position(33.0, 0.5) - position(32.0, 0.5);
        assert!((grown - 1.0).abs() < 0.05, "a 32nd part of 32 px: {grown}");
    }
}
