//! Which fragments some view may show. Most of what deeper peels hold lies behind surfaces that hide it from the whole lens, and gets no
//! spans.
//!
//! **Law.** A view moves bin `b` by whole pixels `s_b`; where bins are narrower than a pixel, the shifts of neighbouring bins differ by a
//! pixel at most along each axis. Take a square of the first peel in which all samples are opaque and each belongs to one surface with its
//! neighbours. Two by two samples then have a bin in common ([`super::keys`]), so that the samples, in each bin that they cover, are the
//! vertices of a surface without holes. A view maps the faces of that surface to squares of a pixel's size (four samples in a bin) and to
//! parallelograms no larger than these (two samples from one bin to the next), and no centre of a pixel lies inside any of them. Let `F` be
//! a fragment behind the middle of the square, none of whose bins is nearer than the square's farthest, and let the square reach farther to
//! all sides than any view moves its bins against those of `F`. Then its border goes once around the pixel on which a view puts `F`, so that
//! a vertex of the surface lies on that pixel too. The ray ends there before it comes to `F`. Past the picture's border the border's samples
//! are repeated, and the same holds of them.
//!
//! Squares are made of blocks of samples, so that some of what no view shows is kept. What is left out changes nothing of what rays meet. A row
//! in whose reach no view moves what is left is painted for one of the views, which may round the last bit otherwise.
//!
//! Cost: a pass over the samples, and a few look-ups a block and layer. Memory: some bytes a block and layer.

mod depths;
mod front;
mod grid;

use super::bins::Bins;
use crate::scene::Layer;
use depths::Depths;
use front::Front;
use grid::{BLOCK, Grid};
use std::ops::Range;

/// The columns in which each layer has fragments that some view may show, for each row of blocks: ranges, in order and apart.
#[derive(Debug)]
pub(super) struct Shown {
    /// For each layer and row of blocks.
    columns: Vec<Vec<Columns>>,
    /// For each row of blocks, where a layer behind the first has any, and the blocks around: no key of what is shown depends on other
    /// fragments of these layers.
    around: Vec<Columns>,
}

/// Ranges of columns.
type Columns = Vec<Range<usize>>;

impl Shown {
    /// All fragments of `layers`.
    pub(super) fn all(layers: &[Layer]) -> Self {
        let (width, height) = layers.first().map_or((0, 0), |layer| (layer.width(), layer.height()));
        let everywhere = vec![vec![0..width]; height.div_ceil(BLOCK)];
        Self { columns: vec![everywhere.clone(); layers.len()], around: everywhere }
    }

    /// The fragments of `layers` that some view may show if it moves them by `bins`.
    pub(super) fn new(layers: &[Layer], bins: &Bins) -> Self {
        let [front, deeper @ ..] = layers else { return Self::all(layers) };
        if deeper.is_empty() {
            return Self::all(layers);
        }
        let (width, grid) = (front.width(), Grid::of(front));
        let front = Front::new(front);
        let shown: Vec<Vec<bool>> =
            deeper.iter().map(|layer| shown_blocks(&Depths::new(layer), &front, bins)).collect();
        let around = grid.map(|place| {
            let mut near = grid.around(place, 1);
            near.any(|block| shown.iter().any(|shown| shown[block]))
        });
        let ranges = |blocks: &[bool]| blocks.chunks(grid.columns).map(|row| columns(row, width)).collect();
        let all = vec![vec![0..width]; grid.rows];
        let columns = std::iter::once(all).chain(shown.iter().map(|blocks| ranges(blocks))).collect();
        Self { columns, around: ranges(&around) }
    }

    /// The columns in which row `y` of layer `layer` has fragments that some view may show.
    pub(super) fn columns(&self, layer: usize, y: usize) -> &[Range<usize>] {
        &self.columns[layer][y / BLOCK]
    }

    /// The columns of row `y` of layer `layer` on which the keys of what is shown depend.
    pub(super) fn around(&self, layer: usize, y: usize) -> &[Range<usize>] {
        if layer == 0 { self.columns(0, y) } else { &self.around[y / BLOCK] }
    }
}

/// The columns, of `width`, of the `blocks` of a row that are set.
fn columns(blocks: &[bool], width: usize) -> Columns {
    let mut first = 0;
    let alike = blocks.chunk_by(|one, next| one == next).filter_map(|alike| {
        let range = first * BLOCK..((first + alike.len()) * BLOCK).min(width);
        first += alike.len();
        alike[0].then_some(range)
    });
    alike.collect()
}

/// For each block of a layer of these `depths`, whether it has fragments that some view may show behind `front`.
fn shown_blocks(depths: &Depths, front: &Front, bins: &Bins) -> Vec<bool> {
    depths
        .grid
        .map(|place| depths.bins(place, bins).is_some_and(|of_block| !front.hides(place, of_block, bins)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::lens::{Aperture, views};
    use crate::methods::contract::LostRays;
    use crate::methods::shear::canvas::{Canvas, Shear};
    use crate::methods::shear::keys::Extent;
    use crate::methods::shear::lanes::LANES;
    use crate::methods::shear::row_sums::RowSums;
    use crate::methods::shear::spans;
    use pulp::Arch;

    const SIZE: (usize, usize) = (120, 72);

    /// A layer of fragments, `(alpha, coc_px)` each.
    fn layer(fragment: impl Fn(usize, usize) -> (f32, f32)) -> Layer {
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(SIZE.0, SIZE.1, value);
        // No two fragments near one another are equal.
        let color = std::array::from_fn(|k| plane(&|x, y| ((x * 7 + y * 131 + k * 17) % 1009) as f32));
        Layer { color, alpha: plane(&|x, y| fragment(x, y).0), coc_px: plane(&|x, y| fragment(x, y).1) }
    }

    /// The bins of `layers`.
    fn bins(layers: &[Layer]) -> Bins {
        let of_all = |limit: f32, choose: fn(f32, f32) -> f32| {
            layers.iter().flat_map(|layer| layer.coc_px.values()).copied().fold(limit, choose)
        };
        Bins::new([of_all(f32::INFINITY, f32::min), of_all(f32::NEG_INFINITY, f32::max)], 0.5)
    }

    /// Share of the samples of layer `number` that are shown.
    fn share(layers: &[Layer], number: usize) -> f64 {
        let shown = Shown::new(layers, &bins(layers));
        let of_row = |y| shown.columns(number, y).iter().map(ExactSizeIterator::len).sum::<usize>();
        (0..SIZE.1).map(of_row).sum::<usize>() as f64 / (SIZE.0 * SIZE.1) as f64
    }

    /// The rows of the picture, with what is `shown` of `layers`.
    fn picture(layers: &[Layer], bins: &Bins, shown: &Shown) -> Vec<[f32; 10]> {
        let spans = spans::find(layers, bins, Extent::HalfWay, shown);
        let shears: Vec<Shear> =
            views(64, Aperture::DISC).iter().map(|view| Shear::new(view, bins)).collect();
        let (mirrors, barrel, background) = (None, None, None);
        let lost_rays = LostRays::LeftOut;
        let canvas = Canvas {
            layers,
            spans: &spans,
            bins,
            mirrors,
            barrel,
            aberration_px: 0.0,
            background,
            lost_rays,
        };
        let row = |y| {
            let mut sums = RowSums::new(SIZE.0, true);
            sums.add(&canvas, (y, &canvas.bins_in_reach(y)), &shears, Arch::new());
            let value = |x: usize| sums.means(x / LANES, lost_rays).map(|mean| mean.0[x % LANES]);
            (0..SIZE.0).map(value).collect::<Vec<_>>()
        };
        (0..SIZE.1).flat_map(row).collect()
    }

    #[test]
    fn what_is_not_shown_changes_no_bit_of_the_picture() {
        let mut random = fastrand::Rng::with_seed(22);
        let mut left_out = 0;
        for number in 0..60 {
            let mut value = |low: f32, high: f32| low + (high - low) * random.f32();
            // A rough slope with a step and a hole, or none of these, and two surfaces behind it, of which one crosses it here and there.
            let (start, slope) = (value(-28.0, 20.0), [value(-0.2, 0.2), value(-0.2, 0.2)]);
            let (roughness, gap) = (value(0.0, 0.4), [value(-0.5, 6.0), value(2.0, 9.0)]);
            let (step, at) = (value(-8.0, 8.0), [value(0.0, 200.0), value(0.0, 100.0)]);
            let behind_slope = value(-0.03, 0.03);
            let noise: Vec<f32> = (0..SIZE.0 * SIZE.1).map(|_| value(-1.0, 1.0)).collect();
            let front = |x: usize, y: usize| {
                let stepped = if (x as f32) < at[0] { 0.0 } else { step };
                start
                    + slope[0] * x as f32
                    + slope[1] * y as f32
                    + roughness * noise[y * SIZE.0 + x]
                    + stepped
            };
            let is_hole =
                |x: usize, y: usize| x.abs_diff(at[0] as usize) < 3 && y.abs_diff(at[1] as usize) < 2;
            let behind = |gap: f32| move |x: usize, y: usize| start + gap + behind_slope * (x + y) as f32;
            let layers = [
                layer(|x, y| (f32::from(!is_hole(x, y)), front(x, y))),
                layer(|x, y| {
                    (if x % 50 < 4 { 0.4 } else { 1.0 }, behind(gap[0])(x, y).max(front(x, y) - 0.3))
                }),
                layer(|x, y| (1.0, front(x, y) + gap[1])),
            ];
            let bins = bins(&layers);
            let shown = Shown::new(&layers, &bins);
            left_out += (1..3).filter(|&number| share(&layers, number) < 0.9).count();
            let all = picture(&layers, &bins, &Shown::all(&layers));
            assert!(picture(&layers, &bins, &shown) == all, "stack {number}");
        }
        assert!(left_out > 30, "most of few layers is left out: {left_out}");
    }

    #[test]
    fn behind_a_surface_without_holes_nothing_is_shown() {
        let behind = || layer(|_, _| (1.0, 6.0));
        for (slope, bump) in [(0.0, 0.0), (0.05, 0.0), (0.0, 0.3)] {
            let front =
                layer(|x, y| (1.0, -8.0 + slope * (x + y) as f32 + bump * ((x / 7 + y / 5) % 2) as f32));
            assert_eq!(share(&[front, behind()], 1), 0.0, "slope {slope}, bumps of {bump} px");
        }
    }

    #[test]
    fn what_some_ray_may_see_through_a_hole_is_shown_and_what_is_far_from_it_is_not() {
        let (x0, y0, difference) = (60, 36, 14);
        let front = layer(|x, y| (f32::from((x, y) != (x0, y0)), -8.0));
        let layers = [front, layer(|_, _| (1.0, 6.0))];
        let shown = Shown::new(&layers, &bins(&layers));
        let is_shown = |x: usize, y: usize| shown.columns(1, y).iter().any(|columns| columns.contains(&x));
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                let away = x.abs_diff(x0).max(y.abs_diff(y0));
                assert!(is_shown(x, y) || away > difference, "{x}, {y}");
                assert!(!is_shown(x, y) || away <= difference + 3 * BLOCK, "{x}, {y}");
            }
        }
    }

    #[test]
    fn what_is_not_behind_opaque_fragments_of_narrow_bins_is_shown() {
        let all = |front: Layer, behind_px: f32| share(&[front, layer(|_, _| (1.0, behind_px))], 1);
        let front = |alpha: f32, coc_px: f32| layer(move |_, _| (alpha, coc_px));
        assert_eq!(all(front(1.0, 2.0), 6.0), 0.0, "behind it");
        assert_eq!(all(front(1.0, 6.0), 2.0), 1.0, "in front of the first peel");
        assert_eq!(all(front(0.9, 2.0), 6.0), 1.0, "behind a translucent one");
        let wide = layer(|x, y| (1.0, -90.0 + 0.2 * (x + y) as f32));
        assert_eq!(all(wide, 6.0), 1.0, "bins of 3 px");
    }

    #[test]
    fn a_layer_is_shown_where_it_has_fragments() {
        let front = layer(|x, _| (f32::from(x < 40), 2.0));
        let layers = [front, layer(|x, _| (f32::from((64..80).contains(&x)), 6.0))];
        let shown = Shown::new(&layers, &bins(&layers));
        for y in 0..SIZE.1 {
            assert_eq!(shown.columns(1, y), std::slice::from_ref(&(64..80)));
            assert_eq!(shown.around(1, y), std::slice::from_ref(&(56..88)));
        }
    }
}
