//! The working copy of a scene: planes that later passes may change, laid out for reading 16 pixels at any place.

use crate::image::Plane;
use crate::scene::Layer;
use rayon::prelude::*;
use std::borrow::Cow;

/// Lanes of a word: pixels that the painter handles at once.
pub(super) const LANES: usize = 16;

/// `N` planes whose rows may be read [`LANES`] at a time from any column of the picture, up to a word past either end.
///
/// Row by row, and within a row channel by channel, so that the channels of a stretch of pixels lie near one another.
#[derive(Debug, Clone)]
pub(super) struct Padded<const N: usize> {
    width: usize,
    stride: usize,
    values: Vec<f32>,
}

impl<const N: usize> Padded<N> {
    /// A copy of `planes`; the padding is 0.
    pub(super) fn copy_of(planes: [&Plane; N]) -> Self {
        let (width, height) = (planes[0].width(), planes[0].height());
        let stride = LANES + width.next_multiple_of(LANES) + LANES;
        let mut values = vec![0.0; N * stride * height];
        values.par_chunks_mut(N * stride).enumerate().for_each(|(y, row)| {
            for (padded, plane) in row.chunks_mut(stride).zip(planes) {
                padded[LANES..LANES + width].copy_from_slice(plane.row(y));
            }
        });
        Self { width, stride, values }
    }

    /// Values from one channel of a row to the next.
    pub(super) fn stride(&self) -> usize {
        self.stride
    }

    /// Row `y` of all channels with padding: column `x` of channel `k` is at `k · stride + LANES + x`.
    #[inline(always)]
    pub(super) fn padded_row(&self, y: usize) -> &[f32] {
        &self.values[N * self.stride * y..][..N * self.stride]
    }

    /// Row `y` of channel `k` without padding.
    pub(super) fn row(&self, k: usize, y: usize) -> &[f32] {
        &self.padded_row(y)[k * self.stride + LANES..][..self.width]
    }

    /// The values of column `x` of row `y`.
    pub(super) fn pixel(&self, x: usize, y: usize) -> [f32; N] {
        let row = self.padded_row(y);
        std::array::from_fn(|k| row[k * self.stride + LANES + x])
    }

    /// Sets column `x` of row `y`.
    pub(super) fn set_pixel(&mut self, x: usize, y: usize, pixel: [f32; N]) {
        for (k, value) in pixel.into_iter().enumerate() {
            self.values[(N * y + k) * self.stride + LANES + x] = value;
        }
    }

    /// All channels of every row without padding, to write.
    pub(super) fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = [&mut [f32]; N]> {
        let (width, stride) = (self.width, self.stride);
        self.values.par_chunks_mut(N * stride).map(move |row| {
            let mut channels = row.chunks_mut(stride).map(|channel| &mut channel[LANES..LANES + width]);
            std::array::from_fn(|_| channels.next().unwrap_or_default())
        })
    }

    /// The planes cut into upright strips of `strip` columns: `strips[i][N·y + k]` is row `y` of channel `k` of strip `i`.
    pub(super) fn strips_mut(&mut self, strip: usize) -> Vec<Vec<&mut [f32]>> {
        let (width, rows) = (self.width, self.values.len() / self.stride);
        let mut strips: Vec<Vec<&mut [f32]>> =
            (0..width.div_ceil(strip)).map(|_| Vec::with_capacity(rows)).collect();
        for row in self.values.chunks_mut(self.stride) {
            for (i, piece) in row[LANES..LANES + width].chunks_mut(strip).enumerate() {
                strips[i].push(piece);
            }
        }
        strips
    }
}

/// One layer as the passes work on it.
#[derive(Debug, Clone)]
pub(super) struct Surface<'a> {
    /// Red, green, blue: a copy, since highlights are taken out of it and the prefilter smooths it.
    pub(super) color: Padded<3>,
    /// Coverage; 0 where there is no fragment.
    pub(super) alpha: Cow<'a, Plane>,
    /// Signed CoC radius in picture pixels.
    pub(super) coc_px: Cow<'a, Plane>,
}

impl<'a> Surface<'a> {
    /// A working copy of `layer`.
    pub(super) fn of(layer: &'a Layer) -> Self {
        Self {
            color: Padded::copy_of(layer.color.each_ref()),
            alpha: Cow::Borrowed(&layer.alpha),
            coc_px: Cow::Borrowed(&layer.coc_px),
        }
    }

    /// A surface that is not in the scene.
    pub(super) fn made(color: &[Plane; 3], alpha: Plane, coc_px: Plane) -> Self {
        Self {
            color: Padded::copy_of(color.each_ref()),
            alpha: Cow::Owned(alpha),
            coc_px: Cow::Owned(coc_px),
        }
    }

    /// Width in samples.
    pub(super) fn width(&self) -> usize {
        self.alpha.width()
    }

    /// Height in samples.
    pub(super) fn height(&self) -> usize {
        self.alpha.height()
    }
}
