//! The stack for rays: the fragments of each sample are contiguous in memory, nearest first.
//!
//! A ray tests all layers of a sample at once, so the planes are interleaved into lists. The fragments of a sample are sorted by
//! CoC radius, independent of the order of the peels; those of one CoC radius are one fragment, because a ray that has hit it goes on
//! behind it. Positions are in samples. Memory: that of the scene, which is consumed.

use super::nbuffer::{NBuffer, Window};
use crate::parallel;
use crate::scene::Scene;
use glam::Vec2;
#[cfg(feature = "gpu")]
use std::ops::Range;

/// The fragments of all samples.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Fragments {
    width: usize,
    height: usize,
    /// Maximum number of fragments per sample.
    depth: usize,
    /// `[row][column][fragment]`: CoC radius in picture pixels, ascending; infinite past the last fragment.
    coc_px: Vec<f32>,
    /// The same layout for red, green, blue (premultiplied) and alpha.
    color: Vec<[f32; 4]>,
}

impl Fragments {
    /// The fragments of `scene`.
    pub(in crate::methods) fn new(scene: Scene) -> Self {
        let (width, height, depth) = (scene.width(), scene.height(), scene.layers.len());
        let mut coc_px = vec![f32::INFINITY; width * height * depth];
        let mut color = vec![[0.0; 4]; width * height * depth];
        let in_row = (width * depth).max(1);
        for (k, layer) in scene.layers.into_iter().enumerate() {
            let rows = coc_px.chunks_mut(in_row).zip(color.chunks_mut(in_row));
            parallel::for_each(rows, &|y, (coc_px, color)| {
                for x in (0..width).filter(|&x| layer.alpha.get(x, y) > 0.0) {
                    let [r, g, b] = layer.color_at(x, y);
                    // Insertion sort: a sample that lacks a peel has the next farther one at its index.
                    let list = x * depth..x * depth + k + 1;
                    let coc = layer.coc_px.get(x, y);
                    let index = coc_px[list.clone()].partition_point(|&other| other <= coc);
                    let own = [r, g, b, layer.alpha.get(x, y)];
                    if let Some(before) = (list.start + index).checked_sub(1).filter(|&i| i >= list.start)
                        && coc_px[before] == coc
                    {
                        color[before] = over(color[before], own);
                        continue;
                    }
                    coc_px[list.clone()][index..].rotate_right(1);
                    color[list.clone()][index..].rotate_right(1);
                    coc_px[list.start + index] = coc;
                    color[list.start + index] = own;
                }
            });
        }
        Self { width, height, depth, coc_px, color }
    }

    /// `width × height` samples, each with the CoC radii of `list(x, y)`, nearest first; all opaque, with the CoC radius as
    /// brightness.
    #[cfg(test)]
    pub(in crate::methods) fn from_lists(
        (width, height): (usize, usize),
        list: impl Fn(usize, usize) -> Vec<f32>,
    ) -> Self {
        let lists: Vec<Vec<f32>> = (0..width * height).map(|i| list(i % width, i / width)).collect();
        let depth = lists.iter().map(Vec::len).max().unwrap_or(0);
        let padded = lists.into_iter().flat_map(|mut list| {
            list.resize(depth, f32::INFINITY);
            list
        });
        let coc_px: Vec<f32> = padded.collect();
        let color = coc_px.iter().map(|&coc| [coc, coc, coc, 1.0]).collect();
        Self { width, height, depth, coc_px, color }
    }

    /// Maximum number of fragments per sample.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn depth(&self) -> usize {
        self.depth
    }

    /// CoC radii of the fragments of `rows`, `[row][column][fragment]`; infinite where there is no fragment.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn coc_px_of_rows(&self, rows: Range<usize>) -> &[f32] {
        let row = self.width * self.depth;
        &self.coc_px[rows.start * row..rows.end * row]
    }

    /// Red, green, blue (premultiplied) and alpha of the fragments of `rows`, in the same layout.
    #[cfg(feature = "gpu")]
    pub(in crate::methods) fn color_of_rows(&self, rows: Range<usize>) -> &[[f32; 4]] {
        let row = self.width * self.depth;
        &self.color[rows.start * row..rows.end * row]
    }

    /// Width and height in samples.
    pub(in crate::methods) fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Index of the sample at `position`; past the border, the nearest border sample.
    #[inline(always)]
    pub(in crate::methods) fn sample_at(&self, position: Vec2) -> usize {
        // The cast saturates at 0.
        let x = (position.x as usize).min(self.width - 1);
        let y = (position.y as usize).min(self.height - 1);
        y * self.width + x
    }

    /// CoC radii of the fragments of `sample`, nearest first; infinite past the last one.
    #[inline(always)]
    pub(in crate::methods) fn coc_px(&self, sample: usize) -> &[f32] {
        &self.coc_px[sample * self.depth..(sample + 1) * self.depth]
    }

    /// Red, green, blue (premultiplied) and alpha of fragment `k` of `sample`.
    #[inline(always)]
    pub(in crate::methods) fn color(&self, sample: usize, k: usize) -> [f32; 4] {
        self.color[sample * self.depth + k]
    }
}

/// `front` composited over `behind`, both premultiplied.
fn over(front: [f32; 4], behind: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|k| front[k] + (1.0 - front[3]) * behind[k])
}

/// A grid of square blocks of samples, coarse enough that data per block are small compared with the stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::methods) struct Blocks {
    /// Samples along a block's side.
    pub side: usize,
    /// Blocks in a row.
    pub columns: usize,
    /// Rows of blocks.
    pub rows: usize,
}

impl Blocks {
    /// Maximum number of blocks.
    const MAX_BLOCKS: usize = 1 << 16;

    /// The blocks of `fragments`: 8 samples wide, doubled until there are at most `MAX_BLOCKS`.
    pub(in crate::methods) fn of(fragments: &Fragments) -> Self {
        let (width, height) = fragments.size();
        let mut side = 8;
        while width.div_ceil(side) * height.div_ceil(side) > Self::MAX_BLOCKS {
            side *= 2;
        }
        Self { side, columns: width.div_ceil(side), rows: height.div_ceil(side) }
    }

    /// The blocks that overlap the rectangle from `min` to `max`, clipped to the frame.
    #[inline]
    pub(in crate::methods) fn window(&self, min: Vec2, max: Vec2) -> Window {
        let side = self.side as f32;
        let (min, max) = (min / side, max / side);
        let range = |from: f32, to: f32, cells: usize| {
            let from = (from as usize).min(cells - 1);
            from..(to as usize).clamp(from, cells - 1) + 1
        };
        Window { x: range(min.x, max.x, self.columns), y: range(min.y, max.y, self.rows) }
    }

    /// The N-buffer of the minimum of `value(sample)` over each block, for windows of up to `longest` samples.
    pub(in crate::methods) fn least(
        &self,
        fragments: &Fragments,
        longest: f32,
        value: impl Fn(usize) -> f32 + Sync,
    ) -> NBuffer {
        let (width, height) = fragments.size();
        let block = |column: usize, row: usize| {
            let (x, y) = (column * self.side, row * self.side);
            let rows = y..(y + self.side).min(height);
            let samples = rows.flat_map(|y| (x..(x + self.side).min(width)).map(move |x| y * width + x));
            samples.map(&value).fold(f32::INFINITY, f32::min)
        };
        let row = |row: usize| (0..self.columns).map(|column| block(column, row)).collect();
        let values = parallel::flat_map(self.rows, &row);
        NBuffer::new(self.columns, values, (longest / self.side as f32) as usize + 2)
    }
}

/// A number from 0 to 1 that depends on its arguments alone.
#[cfg(test)]
pub(in crate::methods) fn noise(x: usize, y: usize, seed: usize) -> f32 {
    let bits = (x * 73_856_093) ^ (y * 19_349_663) ^ (seed * 83_492_791);
    ((bits ^ (bits >> 13)).wrapping_mul(0x5bd1_e995) >> 7 & 0xffff) as f32 / 65_535.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::scene::Layer;
    use crate::stack::StackKind;

    #[test]
    fn fragments_are_sorted_by_coc_without_gaps() {
        let layer = |coc, alpha| Layer {
            color: std::array::from_fn(|_| Plane::filled(2, 1, coc)),
            alpha: Plane::from_fn(2, 1, |x, _| if x == 0 { 1.0 } else { alpha }),
            coc_px: Plane::filled(2, 1, coc),
        };
        let layers = vec![layer(3.0, 0.0), layer(-1.0, 0.0), layer(7.0, 0.5)];
        let fragments = Fragments::new(Scene::new(layers, StackKind::PointSampled, 1, 10.0));
        assert_eq!(fragments.coc_px(0), [-1.0, 3.0, 7.0], "sorted, although the peels were not");
        assert_eq!(fragments.coc_px(1), [7.0, f32::INFINITY, f32::INFINITY], "the only one is the first");
        assert_eq!(fragments.color(1, 0), [7.0, 7.0, 7.0, 0.5]);
    }

    #[test]
    fn fragments_of_one_depth_are_one_and_the_first_peel_is_in_front() {
        let layer = |value: f32, alpha| Layer {
            color: std::array::from_fn(|_| Plane::filled(1, 1, value)),
            alpha: Plane::filled(1, 1, alpha),
            coc_px: Plane::filled(1, 1, 3.0),
        };
        let one = |layers| Fragments::new(Scene::new(layers, StackKind::PointSampled, 1, 10.0));
        let veiled = one(vec![layer(0.25, 0.5), layer(1.0, 1.0)]);
        assert_eq!((veiled.coc_px(0)[1], veiled.color(0, 0)), (f32::INFINITY, [0.75, 0.75, 0.75, 1.0]));
        let lit = one(vec![layer(4.0, crate::stack::LIGHT_ALPHA), layer(0.25, 1.0)]);
        assert_eq!(lit.color(0, 0)[0], 4.25, "light without alpha adds to what it lies on");
    }
}
