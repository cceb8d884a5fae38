//! The colours of the layers as they were before smoothing, so that they can be smoothed again for another number of views.
//!
//! Only stretches with fragments are kept: deeper peels are mostly empty, and fresh memory costs more than the copying.

use crate::scene::Layer;
use rayon::prelude::*;

/// Columns that are kept together.
const STRETCH: usize = 16;

/// What was there, row by row of each layer.
#[derive(Debug)]
pub(super) struct SavedColors {
    layers: Vec<Vec<SavedRow>>,
}

/// The stretches of a row that have fragments.
#[derive(Debug, Default)]
struct SavedRow {
    /// Their first columns.
    starts: Vec<u32>,
    /// Red, then green, then blue of each.
    values: Vec<f32>,
}

impl SavedColors {
    /// Those of `layers`.
    pub(super) fn of(layers: &[Layer]) -> Self {
        let saved =
            |layer| (0..Layer::height(layer)).into_par_iter().map(|y| SavedRow::of(layer, y)).collect();
        Self { layers: layers.iter().map(saved).collect() }
    }

    /// Puts them back into the `layers` that they come from.
    pub(super) fn restore(&self, layers: &mut [Layer]) {
        for (layer, rows) in layers.iter_mut().zip(&self.layers) {
            let width = layer.width();
            let [red, green, blue] =
                layer.color.each_mut().map(|plane| plane.values_mut().par_chunks_mut(width));
            rows.par_iter().zip(red).zip(green).zip(blue).for_each(|(((saved, red), green), blue)| {
                saved.restore([red, green, blue]);
            });
        }
    }
}

impl SavedRow {
    fn of(layer: &Layer, y: usize) -> Self {
        let alphas = layer.alpha.row(y).chunks(STRETCH);
        let has_fragments = |alphas: &[f32]| alphas.iter().fold(false, |any, alpha| any | (*alpha > 0.0));
        let starts = alphas.enumerate().filter(|(_, alphas)| has_fragments(alphas));
        let starts: Vec<u32> = starts.map(|(index, _)| (index * STRETCH) as u32).collect();
        let mut values = Vec::with_capacity(3 * STRETCH * starts.len());
        for &start in &starts {
            for plane in &layer.color {
                values.extend_from_slice(stretch(plane.row(y), start));
            }
        }
        Self { starts, values }
    }

    fn restore(&self, mut row: [&mut [f32]; 3]) {
        let mut rest = self.values.as_slice();
        for &start in &self.starts {
            for channel in &mut row {
                let (start, width) = (start as usize, channel.len());
                let channel = &mut channel[start..(start + STRETCH).min(width)];
                let (values, others) = rest.split_at(channel.len());
                channel.copy_from_slice(values);
                rest = others;
            }
        }
    }
}

/// The stretch of `row` that begins at column `start`.
fn stretch(row: &[f32], start: u32) -> &[f32] {
    let start = start as usize;
    &row[start..(start + STRETCH).min(row.len())]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn what_has_fragments_is_as_it_was() {
        let (width, height) = (37, 3);
        let layer = || Layer {
            color: std::array::from_fn(|k| {
                Plane::from_fn(width, height, |x, y| (100 * k + 10 * y + x) as f32)
            }),
            alpha: Plane::from_fn(width, height, |x, y| f32::from(y != 1 && x > 17)),
            coc_px: Plane::zeros(width, height),
        };
        let mut layers = [layer(), layer()];
        let saved = SavedColors::of(&layers);
        layers.iter_mut().flat_map(|layer| &mut layer.color).for_each(|plane| plane.values_mut().fill(-1.0));
        saved.restore(&mut layers);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let was = layer();
            if was.alpha.get(x, y) > 0.0 {
                assert_eq!(layers[1].color_at(x, y), was.color_at(x, y), "{x}, {y}");
            }
        }
        assert_eq!(layers[0].color_at(20, 1), [-1.0; 3], "a row without fragments is left alone");
    }
}
