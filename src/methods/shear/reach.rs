//! The bins that views can move to single pixels. Most bins lie elsewhere in the picture, and for a few pixels most of the time
//! would be spent on looking for their spans.

use super::bins::Bins;
use super::canvas::{BinsInReach, Canvas};
use super::spans::Spans;

/// Rows of the picture that share an entry.
const ROWS: usize = 8;

/// Where each bin has spans: in blocks of [`ROWS`] rows and a 64th of the picture's width.
#[derive(Debug)]
pub(super) struct Reach {
    /// One bit for each 64th of the width, by bin and, within a bin, by block of rows.
    columns: Vec<u64>,
    /// Number of blocks of rows of a bin.
    blocks: usize,
    /// Width and height of the picture.
    size: (usize, usize),
}

impl Reach {
    /// The reach of `spans` in `bins`, in a picture of `size`.
    pub(super) fn from_spans(spans: &Spans, bins: &Bins, size: (usize, usize)) -> Self {
        let blocks = size.1.div_ceil(ROWS);
        let mut reach = Self { columns: vec![0; bins.count() * blocks], blocks, size };
        for y in 0..spans.height() {
            for bin in 0..bins.count() {
                let bits = spans
                    .of_block(y, bin)
                    .iter()
                    .fold(0, |bits, span| bits | reach.bits(span.start as usize, span.end as usize - 1));
                reach.columns[bin * blocks + y / ROWS] |= bits;
            }
        }
        reach
    }

    /// The bins of `canvas` that some view can move to one of `columns` of output row `y`.
    pub(super) fn bins(&self, canvas: &Canvas<'_>, y: usize, columns: &[usize]) -> BinsInReach {
        BinsInReach::new(canvas.bins, |bin, coc_px| {
            let reach = (coc_px.abs() + canvas.aberration_px).ceil() as usize + 1;
            let around = |at: usize, length: usize| [at.saturating_sub(reach), (at + reach).min(length - 1)];
            let [top, bottom] = around(y, self.size.1);
            let blocks = &self.columns[bin * self.blocks..][top / ROWS..=bottom / ROWS];
            let occurs = blocks.iter().fold(0, |bits, block| bits | block);
            let within = |&x: &usize| {
                let [left, right] = around(x, self.size.0);
                occurs & self.bits(left, right) != 0
            };
            occurs != 0 && columns.iter().any(within)
        })
    }

    /// The bits of columns `first ..= last`.
    fn bits(&self, first: usize, last: usize) -> u64 {
        let bit = |x: usize| x * 64 / self.size.0;
        (u64::MAX << bit(first)) & (u64::MAX >> (63 - bit(last)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::methods::contract::LostRays;
    use crate::methods::shear::keys::Extent;
    use crate::methods::shear::shown::Shown;
    use crate::methods::shear::spans;
    use crate::scene::Layer;

    #[test]
    fn a_bin_is_in_reach_within_its_coc_radius() {
        let (width, height) = (100, 50);
        // A background in focus, and one fragment of radius 10 at 60, 20.
        let at_fragment = |x, y| (x, y) == (60, 20);
        let layer = |coc: f32, alpha: &dyn Fn(usize, usize) -> bool| Layer {
            color: std::array::from_fn(|_| Plane::zeros(width, height)),
            alpha: Plane::from_fn(width, height, |x, y| f32::from(u8::from(alpha(x, y)))),
            coc_px: Plane::filled(width, height, coc),
        };
        let layers = [layer(0.0, &|_, _| true), layer(10.0, &at_fragment)];
        let bins = Bins::new([0.0, 10.0], 0.5);
        let spans = spans::find(&layers, &bins, Extent::HalfWay, &Shown::all(&layers));
        let reach = Reach::from_spans(&spans, &bins, (width, height));
        let canvas = Canvas {
            layers: &layers,
            spans: &spans,
            bins: &bins,
            mirrors: None,
            barrel: None,
            aberration_px: 0.0,
            background: None,
            lost_rays: LostRays::LeftOut,
        };
        let in_reach = |canvas: &Canvas<'_>, y: usize, columns: &[usize]| {
            let found = reach.bins(canvas, y, columns);
            let bins: Vec<usize> = (0..bins.count()).filter(|&bin| found.has(bin)).collect();
            bins
        };
        let (sharp, blurred) = (bins.index(0.0) as usize, bins.index(10.0) as usize);
        assert_eq!(in_reach(&canvas, 20, &[52]), [sharp, blurred], "within its radius");
        assert_eq!(in_reach(&canvas, 29, &[60]), [sharp, blurred], "within its radius below it");
        assert_eq!(in_reach(&canvas, 20, &[5, 66]), [sharp, blurred], "for one column of several");
        assert_eq!(in_reach(&canvas, 20, &[30]), [sharp], "outside its radius beside it");
        assert_eq!(in_reach(&canvas, 45, &[60]), [sharp], "nor below it");
        let aberrated = Canvas { aberration_px: 16.0, ..canvas };
        assert_eq!(in_reach(&aberrated, 45, &[60]), [sharp, blurred], "unless aberrations move it there");
    }
}
