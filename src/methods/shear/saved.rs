//! The colours of the layers before the prefilter, so that they can be filtered again for another number of views.
//!
//! Only chunks of columns with fragments are kept: deeper peels are mostly empty, and allocating memory costs more than copying.

use crate::image::Plane;
use crate::parallel;
use crate::scene::Layer;

/// Columns of a chunk, which is kept if it has a fragment.
const CHUNK_COLUMNS: usize = 16;

/// The saved colours, row by row of each layer.
#[derive(Debug)]
pub(super) struct SavedColors {
    layers: Vec<Vec<SavedRow>>,
}

/// The chunks of a row that have fragments.
#[derive(Debug, Default)]
struct SavedRow {
    /// The first column of each chunk.
    starts: Vec<u32>,
    /// Red, then green, then blue of each chunk.
    values: Vec<f32>,
}

impl SavedColors {
    /// Saves the colours of `layers`.
    pub(super) fn from_layers(layers: &[Layer]) -> Self {
        let saved = |layer| parallel::map(Layer::height(layer), &|y| SavedRow::from_layer(layer, y));
        Self { layers: layers.iter().map(saved).collect() }
    }

    /// Writes the colours back into `layers`, from which they were saved.
    pub(super) fn restore(&self, layers: &mut [Layer]) {
        for (layer, rows) in layers.iter_mut().zip(&self.layers) {
            let width = layer.width();
            let color = layer.color.each_mut().map(Plane::values_mut);
            parallel::for_each_row_of(color, width, &|y, color| rows[y].restore(color));
        }
    }
}

impl SavedRow {
    fn from_layer(layer: &Layer, y: usize) -> Self {
        let alphas = layer.alpha.row(y).chunks(CHUNK_COLUMNS);
        let has_fragments = |alphas: &[f32]| alphas.iter().fold(false, |any, alpha| any | (*alpha > 0.0));
        let starts = alphas.enumerate().filter(|(_, alphas)| has_fragments(alphas));
        let starts: Vec<u32> = starts.map(|(index, _)| (index * CHUNK_COLUMNS) as u32).collect();
        let mut values = Vec::with_capacity(3 * CHUNK_COLUMNS * starts.len());
        for &start in &starts {
            for plane in &layer.color {
                values.extend_from_slice(chunk(plane.row(y), start));
            }
        }
        Self { starts, values }
    }

    fn restore(&self, mut row: [&mut [f32]; 3]) {
        let mut rest = self.values.as_slice();
        for &start in &self.starts {
            for channel in &mut row {
                let (start, width) = (start as usize, channel.len());
                let channel = &mut channel[start..(start + CHUNK_COLUMNS).min(width)];
                let (values, others) = rest.split_at(channel.len());
                channel.copy_from_slice(values);
                rest = others;
            }
        }
    }
}

/// The chunk of `row` that begins at column `start`.
fn chunk(row: &[f32], start: u32) -> &[f32] {
    let start = start as usize;
    &row[start..(start + CHUNK_COLUMNS).min(row.len())]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn restoring_brings_back_the_colours_of_all_fragments() {
        let (width, height) = (37, 3);
        let layer = || Layer {
            color: std::array::from_fn(|k| {
                Plane::from_fn(width, height, |x, y| (100 * k + 10 * y + x) as f32)
            }),
            alpha: Plane::from_fn(width, height, |x, y| f32::from(y != 1 && x > 17)),
            coc_px: Plane::zeros(width, height),
        };
        let mut layers = [layer(), layer()];
        let saved = SavedColors::from_layers(&layers);
        layers.iter_mut().flat_map(|layer| &mut layer.color).for_each(|plane| plane.values_mut().fill(-1.0));
        saved.restore(&mut layers);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let original = layer();
            if original.alpha.get(x, y) > 0.0 {
                assert_eq!(layers[1].color_at(x, y), original.color_at(x, y), "{x}, {y}");
            }
        }
        assert_eq!(layers[0].color_at(20, 1), [-1.0; 3], "a row without fragments is left alone");
    }
}
