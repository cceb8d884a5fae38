//! The working copy of a scene: planes that later passes may change, laid out for reading 16 pixels at any place.

use crate::image::Plane;
use crate::scene::Layer;
use rayon::prelude::*;
use std::borrow::Cow;

/// Lanes of a word: pixels that the painter handles at once.
pub(super) const LANES: usize = 16;

/// A plane whose rows may be read [`LANES`] at a time from any column of the picture, up to a word past either end.
#[derive(Debug, Clone)]
pub(super) struct PaddedPlane {
    width: usize,
    stride: usize,
    values: Vec<f32>,
}

impl PaddedPlane {
    /// A copy of `plane`; the padding is 0.
    pub(super) fn copy_of(plane: &Plane) -> Self {
        let width = plane.width();
        let stride = LANES + width.next_multiple_of(LANES) + LANES;
        let mut values = vec![0.0; stride * plane.height()];
        values.par_chunks_mut(stride).enumerate().for_each(|(y, padded)| {
            padded[LANES..LANES + width].copy_from_slice(plane.row(y));
        });
        Self { width, stride, values }
    }

    /// Row `y` without its padding.
    pub(super) fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.stride + LANES..][..self.width]
    }

    /// Row `y` with its padding: column `x` is at `x + LANES`.
    pub(super) fn padded_row(&self, y: usize) -> &[f32] {
        &self.values[y * self.stride..][..self.stride]
    }

    /// Every row without its padding, to write.
    pub(super) fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        let width = self.width;
        self.values.par_chunks_mut(self.stride).map(move |row| &mut row[LANES..LANES + width])
    }

    /// Sets column `x` of row `y`.
    pub(super) fn set(&mut self, x: usize, y: usize, value: f32) {
        self.values[y * self.stride + LANES + x] = value;
    }

    /// The plane cut into upright strips of `strip` columns: `strips[i][y]` is row `y` of strip `i`.
    pub(super) fn strips_mut(&mut self, strip: usize) -> Vec<Vec<&mut [f32]>> {
        let (width, height) = (self.width, self.values.len() / self.stride);
        let mut strips: Vec<Vec<&mut [f32]>> =
            (0..width.div_ceil(strip)).map(|_| Vec::with_capacity(height)).collect();
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
    pub(super) color: [PaddedPlane; 3],
    /// Coverage; 0 where there is no fragment.
    pub(super) alpha: Cow<'a, Plane>,
    /// Signed CoC radius in picture pixels.
    pub(super) coc_px: Cow<'a, Plane>,
}

impl<'a> Surface<'a> {
    /// A working copy of `layer`.
    pub(super) fn of(layer: &'a Layer) -> Self {
        Self {
            color: layer.color.each_ref().map(PaddedPlane::copy_of),
            alpha: Cow::Borrowed(&layer.alpha),
            coc_px: Cow::Borrowed(&layer.coc_px),
        }
    }

    /// A surface that is not in the scene.
    pub(super) fn made(color: &[Plane; 3], alpha: Plane, coc_px: Plane) -> Self {
        Self {
            color: color.each_ref().map(PaddedPlane::copy_of),
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
