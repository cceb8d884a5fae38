//! The peels that fragments sorted by depth become, row after row.

use super::deep::Fragment;
use super::layers::Layer;
use super::{Peel, Window};
use crate::error::Error;
use crate::image::Plane;
use crate::parallel;
use crate::settings::DepthConvention;

/// Bytes of one sample of one peel.
const PEEL_BYTES: u64 = 20;

/// The fragments of one row of pixels, each pixel's nearest first.
#[derive(Debug, Default)]
pub(super) struct Row {
    /// For each pixel, the number of fragments up to and with its own.
    pub(super) ends: Vec<usize>,
    /// The fragments, pixel after pixel.
    pub(super) fragments: Vec<Fragment>,
}

/// Peels that grow in number with the pixel that has the most fragments.
#[derive(Debug)]
pub(super) struct Peels {
    peels: Vec<Peel>,
    window: Window,
    convention: DepthConvention,
    max_bytes: u64,
}

impl Row {
    /// The fragments of pixel `x`.
    fn pixel(&self, x: usize) -> &[Fragment] {
        let start = x.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.fragments[start..self.ends[x]]
    }

    fn most(&self) -> usize {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        self.ends.iter().zip(starts).map(|(end, start)| end - start).max().unwrap_or(0)
    }
}

impl Peels {
    /// No peels yet, of the pixels of `window`, with depth in `convention`, that may take `max_bytes`.
    pub(super) fn new(window: Window, convention: DepthConvention, max_bytes: u64) -> Self {
        Self { peels: Vec::new(), window, convention, max_bytes }
    }

    /// Bytes that the peels take.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes_of(self.peels.len())
    }

    fn bytes_of(&self, peels: usize) -> u64 {
        let pixels = (self.window.width as u64).saturating_mul(self.window.height as u64);
        pixels.saturating_mul(PEEL_BYTES).saturating_mul(peels as u64)
    }

    /// Puts `rows` at `top`, counted from the top of the window.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Limits`] for more peels than the limit allows.
    pub(super) fn put(&mut self, top: usize, rows: &[Row]) -> Result<(), Error> {
        let most = rows.iter().map(Row::most).max().unwrap_or(0);
        while self.peels.len() < most {
            if self.bytes_of(most) > self.max_bytes {
                return Err(self.too_large(most));
            }
            self.peels.push(self.empty());
        }
        let convention = self.convention;
        parallel::for_each(self.peels.iter_mut(), &|peel, planes| {
            for (y, row) in rows.iter().enumerate() {
                put_row(planes, peel, (top + y, row), convention);
            }
        });
        Ok(())
    }

    fn empty(&self) -> Peel {
        let Window { width, height, .. } = self.window;
        let zeros = || Plane::zeros(width, height);
        let depth = Plane::filled(width, height, f32::INFINITY);
        Peel { color: [zeros(), zeros(), zeros()], alpha: zeros(), depth }
    }

    fn too_large(&self, peels: usize) -> Error {
        let Window { width, height, .. } = self.window;
        Error::limits("the merged stack requires more memory than the limit")
            .with(
                "found",
                format!("{width}×{height} pixels, {peels} peels: {} MiB", self.bytes_of(peels) >> 20),
            )
            .with("limit", format!("{} MiB", self.max_bytes >> 20))
            .help("crop or scale the picture, or allow more memory")
    }

    /// The peels.
    pub(super) fn into_peels(self) -> Vec<Peel> {
        self.peels
    }

    /// The peels as layers, whose depth is called `depth_channel`.
    pub(super) fn into_layers(mut self, depth_channel: &str) -> Vec<Layer> {
        // A stack has a peel, if an empty one.
        if self.peels.is_empty() {
            self.peels.push(self.empty());
        }
        let window = self.window;
        let layer = |(i, Peel { color, alpha, depth }): (usize, Peel)| Layer {
            color,
            alpha,
            depth: Some(depth),
            window,
            prefix: i.to_string(),
            depth_channel: depth_channel.to_owned(),
            found: "samples merged by depth".to_owned(),
            shading: None,
        };
        self.peels.into_iter().enumerate().map(layer).collect()
    }
}

/// Puts the `peel`-th fragment of each pixel of a row into its planes.
fn put_row(planes: &mut Peel, peel: usize, (y, row): (usize, &Row), convention: DepthConvention) {
    let [red, green, blue] = planes.color.each_mut().map(|plane| plane.row_mut(y));
    let (alpha, depth) = (planes.alpha.row_mut(y), planes.depth.row_mut(y));
    for x in 0..row.ends.len() {
        if let Some(fragment) = row.pixel(x).get(peel) {
            [red[x], green[x], blue[x]] = fragment.color;
            alpha[x] = fragment.alpha;
            depth[x] = written(fragment.distance, convention);
        }
    }
}

/// A distance as `convention` writes it: the inverse of [`super::depth::FarDepth::of`].
fn written(distance: f32, convention: DepthConvention) -> f32 {
    match convention {
        DepthConvention::Inverse => distance.recip(),
        DepthConvention::Normalised => distance - super::depth::NORMALISED_OFFSET,
        DepthConvention::Planar | DepthConvention::Ray => distance,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::depth::FarDepth;

    fn fragment(distance: f32) -> Fragment {
        Fragment { distance, color: [0.1, 0.2, 0.3], alpha: 0.5 }
    }

    #[test]
    fn there_are_as_many_peels_as_the_fullest_pixel_needs() {
        let window = Window { x: -3, y: 7, width: 2, height: 2 };
        let mut peels = Peels::new(window, DepthConvention::Planar, 1 << 20);
        peels.put(0, &[Row { ends: vec![1, 1], fragments: vec![fragment(4.0)] }]).unwrap();
        let three = [2.0, 3.0, 5.0].map(fragment).to_vec();
        peels.put(1, &[Row { ends: vec![0, 3], fragments: three }]).unwrap();
        let layers = peels.into_layers("Z");
        let depths: Vec<&[f32]> = layers.iter().map(|layer| layer.depth.as_ref().unwrap().values()).collect();
        let none = f32::INFINITY;
        assert_eq!(depths, [[4.0, none, none, 2.0], [none, none, none, 3.0], [none, none, none, 5.0]]);
        assert_eq!(layers[1].alpha.values(), [0.0, 0.0, 0.0, 0.5]);
    }

    #[test]
    fn more_peels_than_the_limit_are_refused_before_they_are_allocated() {
        let window = Window { x: 0, y: 0, width: 1 << 28, height: 1 << 28 };
        let mut peels = Peels::new(window, DepthConvention::Planar, 1 << 30);
        let one = Row { ends: vec![1], fragments: vec![fragment(4.0)] };
        assert!(peels.put(0, &[one]).unwrap_err().to_string().contains("1024 MiB"));
    }

    #[test]
    fn a_distance_is_written_as_it_was_read() {
        for convention in [DepthConvention::Planar, DepthConvention::Inverse, DepthConvention::Normalised] {
            let value = written(FarDepth::new(convention).of(0.25), convention);
            assert!((value - 0.25).abs() < 1e-6, "{convention:?}: {value}");
        }
    }
}
