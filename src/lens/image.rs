//! An aperture given as a picture: the transmittance at each point of the lens.
//!
//! The picture's inscribed circle is the aperture; pixels outside it are not used. The picture is upright, as a blurred point behind
//! focus shows it.

use crate::error::Error;
use crate::settings::Mask;
use glam::Vec2;
use std::f32::consts::TAU;

/// Number of directions of the tables of light, which lens samples are placed by.
const ANGLES: usize = 512;

/// Number of rings of equal area of these tables.
const RINGS: usize = 256;

/// The transmittance at each point of an aperture, 0 … 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ApertureImage {
    /// Width and height in pixels.
    size: [usize; 2],
    /// Rotation in radians, anticlockwise as seen in a blurred point behind focus.
    turn: f32,
    /// Summed-area table over pixel corners: one row and one column more than the picture has.
    sums: Vec<f64>,
    /// Cumulative share of the light by direction.
    angles: Vec<f32>,
    /// For each direction, the cumulative share of its light by ring.
    rings: Vec<Vec<f32>>,
    /// Mean over the circle.
    mean: f32,
}

impl ApertureImage {
    /// The aperture of `mask`, rotated anticlockwise by `rotation_deg`. The brightest pixel has transmittance 1.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a mask that is black within its circle.
    pub fn new(mask: &Mask, rotation_deg: f32) -> Result<Self, Error> {
        let max = mask.values.iter().copied().fold(0.0, f32::max);
        let mut image = Self {
            size: [mask.width, mask.height],
            turn: rotation_deg.to_radians(),
            sums: sums(mask, 1.0 / max.max(f32::MIN_POSITIVE)),
            angles: Vec::new(),
            rings: Vec::new(),
            mean: 0.0,
        };
        image.count_light();
        if image.mean > 0.0 {
            return Ok(image);
        }
        Err(Error::settings("the aperture image lets no light through")
            .with("found", format!("{} is black within its inscribed circle", mask.name))
            .help("make the opening white, in the centre of the picture"))
    }

    /// Tabulates the light by direction and ring.
    fn count_light(&mut self) {
        let side = 1.0 / RINGS as f32;
        let mut total = 0.0;
        for i in 0..ANGLES {
            let direction = Vec2::from_angle(self.turn + (i as f32 + 0.5) * TAU / ANGLES as f32);
            let mut sum = 0.0;
            let ring = |k: usize| {
                sum += self.around(((k as f32 + 0.5) * side).sqrt() * direction, 2.0 * side);
                sum
            };
            let mut light: Vec<f32> = (0..RINGS).map(ring).collect();
            light.iter_mut().for_each(|within| *within /= sum.max(f32::MIN_POSITIVE));
            self.rings.push(light);
            total += sum;
            self.angles.push(total);
        }
        self.angles.iter_mut().for_each(|before| *before /= total.max(f32::MIN_POSITIVE));
        self.mean = total / (ANGLES * RINGS) as f32;
    }

    /// Mean transmittance over the aperture's circle.
    pub fn mean(&self) -> f32 {
        self.mean
    }

    /// Mean transmittance over the part within the picture of a square of `side` about `point`, both in aperture radii; x to the right and
    /// y up as in a blurred point behind focus.
    pub(crate) fn around(&self, point: Vec2, side: f32) -> f32 {
        let [width, height] = self.size.map(|pixels| pixels as f32);
        let radius = 0.5 * width.min(height);
        let upright = Vec2::from_angle(-self.turn).rotate(point);
        let centre = 0.5 * Vec2::new(width, height) + radius * Vec2::new(upright.x, -upright.y);
        let half = 0.5 * (side * radius).max(1.0);
        let [left, right] = [-half, half].map(|to| (centre.x + to).clamp(0.0, width));
        let [top, bottom] = [-half, half].map(|to| (centre.y + to).clamp(0.0, height));
        let area = (right - left) * (bottom - top);
        let light =
            self.sum(right, bottom) - self.sum(left, bottom) - self.sum(right, top) + self.sum(left, top);
        if area > 0.0 { (light / f64::from(area)) as f32 } else { 0.0 }
    }

    /// Sum of the transmittance left of `x` and above `y`, which are in pixels.
    fn sum(&self, x: f32, y: f32) -> f64 {
        let [width, height] = self.size;
        let (x, y) = (x.clamp(0.0, width as f32), y.clamp(0.0, height as f32));
        let (column, row) = ((x as usize).min(width - 1), (y as usize).min(height - 1));
        let (right, down) = (f64::from(x - column as f32), f64::from(y - row as f32));
        let at = |column: usize, row: usize| self.sums[row * (width + 1) + column];
        let across = |row: usize| at(column, row) * (1.0 - right) + at(column + 1, row) * right;
        across(row) * (1.0 - down) + across(row + 1) * down
    }

    /// Maps a point of the unit disc by the distribution of light: a uniform disc becomes the picture; for an even picture the map is the
    /// identity.
    pub(crate) fn lit_point(&self, point: Vec2) -> Vec2 {
        let share = ((point.to_angle() - self.turn) / TAU).rem_euclid(1.0);
        let (angle, along) = quantile(&self.angles, share);
        let (ring, across) = quantile(&self.rings[angle], point.length_squared().min(1.0));
        let radius = ((ring as f32 + across) / RINGS as f32).sqrt();
        radius * Vec2::from_angle(self.turn + (angle as f32 + along) * TAU / ANGLES as f32)
    }
}

/// Summed-area table of `mask` times `scale`, over pixel corners.
fn sums(mask: &Mask, scale: f32) -> Vec<f64> {
    let stride = mask.width + 1;
    let mut sums = vec![0.0; stride * (mask.height + 1)];
    for (y, row) in mask.values.chunks(mask.width).enumerate() {
        let mut sum = 0.0;
        for (x, value) in row.iter().enumerate() {
            sum += f64::from(value.max(0.0) * scale);
            sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + sum;
        }
    }
    sums
}

/// The step of cumulative `shares` in which `share` is reached, and the position within the step, 0 … 1.
fn quantile(shares: &[f32], share: f32) -> (usize, f32) {
    let step = shares.partition_point(|up_to| *up_to <= share).min(shares.len() - 1);
    let before = if step == 0 { 0.0 } else { shares[step - 1] };
    let width = shares[step] - before;
    (step, if width > 0.0 { ((share - before) / width).clamp(0.0, 1.0) } else { 0.5 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(value: impl Fn(f32, f32) -> f32) -> ApertureImage {
        let (width, height) = (200, 160);
        let at = |i: usize| value((i % width) as f32 - 99.5, 79.5 - (i / width) as f32);
        let values = (0..width * height).map(at).collect();
        ApertureImage::new(&Mask { name: "test".to_owned(), width, height, values }, 0.0).unwrap()
    }

    #[test]
    fn an_even_picture_is_the_disc() {
        let white = image(|_, _| 0.3);
        assert!((white.mean() - 1.0).abs() < 1e-5, "the brightest pixel has transmittance 1");
        for point in [Vec2::new(0.3, -0.4), Vec2::new(-0.9, 0.1), Vec2::ZERO, Vec2::new(0.0, -1.0)] {
            assert!((white.lit_point(point) - point).length() < 2e-3, "{point}: {}", white.lit_point(point));
        }
    }

    #[test]
    fn points_are_distributed_in_proportion_to_the_light() {
        // Light only to the right of a quarter of the radius, twice as much in the upper half.
        let picture = image(|x, y| if x < 20.0 { 0.0 } else { 0.5 + 0.5 * f32::from(u8::from(y > 0.0)) });
        let golden = |i: usize| Vec2::from_angle(i as f32 * 2.399_963) * ((i as f32 + 0.5) / 10_000.0).sqrt();
        let points: Vec<Vec2> = (0..10_000).map(|i| picture.lit_point(golden(i))).collect();
        assert!(points.iter().all(|point| point.x > 0.25 - 0.02), "none in the dark");
        let above = points.iter().filter(|point| point.y > 0.0).count() as f32 / 1e4;
        assert!((above - 2.0 / 3.0).abs() < 5e-3, "{above}");
        // The segment beyond a quarter: acos t − t √(1 − t²) of π, with a mean transmittance of three quarters.
        let t = 0.25f32;
        let share = 0.75 * (t.acos() - t * (1.0 - t * t).sqrt()) / std::f32::consts::PI;
        assert!((picture.mean() - share).abs() < 5e-3, "{}, expected {share}", picture.mean());
    }

    #[test]
    fn the_mean_around_a_point_is_that_of_the_pixels_there() {
        let halves = image(|x, _| f32::from(u8::from(x > 0.0)));
        for (x, expected) in [(-0.5, 0.0), (0.5, 1.0), (0.0, 0.5), (0.05, 0.75)] {
            let found = halves.around(Vec2::new(x, 0.2), 0.2);
            assert!((found - expected).abs() < 1e-5, "{x}: {found}");
        }
    }

    #[test]
    fn a_picture_without_light_is_refused() {
        let mask = Mask { name: "dark.png".to_owned(), width: 4, height: 4, values: vec![0.0; 16] };
        let error = ApertureImage::new(&mask, 0.0).unwrap_err().to_string();
        assert!(error.contains("dark.png") && error.contains("no light"), "{error}");
    }

    #[test]
    fn a_rotated_picture_is_rotated_anticlockwise() {
        let right = Mask {
            name: "right".to_owned(),
            width: 60,
            height: 60,
            values: (0..3600).map(|i| f32::from(u8::from(i % 60 >= 45))).collect(),
        };
        let up = ApertureImage::new(&right, 90.0).unwrap();
        assert!(up.around(Vec2::new(0.0, 0.75), 0.1) > 0.99, "the right side is now above");
        assert!(up.lit_point(Vec2::new(0.1, 0.2)).y > 0.45, "points too");
    }
}
