//! A picture of all directions: longitude across, latitude down.
//!
//! Directions are those of OpenEXR's `latlong` maps: +y at the top, −z at the left edge, +x at a quarter of the width, +z at its centre and −x at
//! three quarters, `u = atan2(x, −z) / 2π`, `v = acos(y) / π`.
//!
//! Texel `i, j` of `W × H` has its centre at `u = (i + ½) / W`, `v = (j + ½) / H`, as in Blender. OpenEXR's own functions put the first
//! and the last texel on the ends of the range, and Mitsuba does so down the picture: at most half a texel is between the two.

use crate::parallel;
use crate::settings::Surroundings;
use glam::Vec3;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Radiance by direction.
#[derive(Debug, Clone, PartialEq)]
pub struct RadianceMap {
    width: usize,
    height: usize,
    texels: Arc<[[f32; 3]]>,
}

impl RadianceMap {
    /// The map of a picture, which has at least one texel.
    pub fn new(picture: &Surroundings) -> Self {
        let Surroundings { width, height, texels } = picture.clone();
        Self { width, height, texels }
    }

    /// The map of `width` × `height` texels with the values of `texel`.
    pub fn from_fn(width: usize, height: usize, texel: impl Fn(usize, usize) -> [f32; 3] + Sync) -> Self {
        let mut texels = vec![[0.0; 3]; width * height];
        parallel::for_each_row(&mut texels, width, &|y, row| {
            row.iter_mut().enumerate().for_each(|(x, value)| *value = texel(x, y));
        });
        Self { width, height, texels: texels.into() }
    }

    /// Width in texels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in texels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Radiance from `direction`, which need not have length 1: bilinear, around the picture's sides and as far as the first and the last row.
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        let u = direction.x.atan2(-direction.z) / TAU;
        let v = direction.x.hypot(direction.z).atan2(direction.y) / PI;
        let x = (u - u.floor()) * self.width as f32 - 0.5;
        let y = (v * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (x.floor(), y.floor());
        // A column left of the first is the last.
        let column = if left < 0.0 { self.width - 1 } else { (left as usize).min(self.width - 1) };
        let next = if column + 1 == self.width { 0 } else { column + 1 };
        let row = top as usize;
        let below = (row + 1).min(self.height - 1);
        let mix =
            |a: [f32; 3], b: [f32; 3], share: f32| std::array::from_fn(|k| a[k] + share * (b[k] - a[k]));
        let at = |row: usize| mix(self.texel(column, row), self.texel(next, row), x - left);
        mix(at(row), at(below), y - top)
    }

    fn texel(&self, x: usize, y: usize) -> [f32; 3] {
        self.texels[y * self.width + x]
    }

    /// The map with `width` × `height` texels, no more than it has: each the mean over the solid angle that it covers.
    pub(super) fn reduced(&self, width: usize, height: usize) -> Self {
        let columns: Vec<_> = (0..width).map(|x| covered(x, width, self.width)).collect();
        let rows: Vec<_> = (0..height).map(|y| covered(y, height, self.height)).collect();
        Self::from_fn(width, height, |x, y| {
            let (mut sum, mut whole) = ([0.0f32; 3], 0.0);
            for &(row, [top, bottom]) in &rows[y] {
                let height = |edge: f64| (edge / self.height as f64 * std::f64::consts::PI).cos();
                let zone = height(top) - height(bottom);
                for &(column, [left, right]) in &columns[x] {
                    let weight = (zone * (right - left)) as f32;
                    let texel = self.texel(column, row);
                    sum.iter_mut().zip(texel).for_each(|(sum, value)| *sum += weight * value);
                    whole += weight;
                }
            }
            sum.map(|sum| sum / whole)
        })
    }
}

/// Direction of the centre of texel `x, y` of a map of this size.
pub(super) fn direction([x, y]: [usize; 2], [width, height]: [usize; 2]) -> Vec3 {
    let longitude = (x as f32 + 0.5) / width as f32 * TAU;
    let (radius, height) = ((y as f32 + 0.5) / height as f32 * PI).sin_cos();
    Vec3::new(radius * longitude.sin(), height, -radius * longitude.cos())
}

/// The texels of `from` that texel `at` of `to` covers, and from where to where of each.
fn covered(at: usize, to: usize, from: usize) -> Vec<(usize, [f64; 2])> {
    let edge = |at: usize| at as f64 * from as f64 / to as f64;
    let (start, end) = (edge(at), edge(at + 1));
    let last = (end.ceil() as usize).min(from);
    (start as usize..last)
        .map(|texel| (texel, [start.max(texel as f64), end.min((texel + 1) as f64)]))
        .filter(|(_, [start, end])| end > start)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sides_of_the_map_are_the_axes_of_openexr() {
        // One texel of 64 × 32 is bright: the one whose corner lies at the axis. Its centre is half a texel off, where it shows in full.
        let bright = |x: usize, y: usize| {
            RadianceMap::from_fn(64, 32, move |i, j| [f32::from(u8::from((i, j) == (x, y))); 3])
        };
        for (x, y, axis) in [
            (0, 16, Vec3::NEG_Z),
            (63, 16, Vec3::NEG_Z),
            (16, 16, Vec3::X),
            (32, 15, Vec3::Z),
            (48, 15, Vec3::NEG_X),
        ] {
            let map = bright(x, y);
            assert!(
                (map.radiance(direction([x, y], [64, 32]))[0] - 1.0).abs() < 1e-4,
                "{x}, {y}: its centre"
            );
            // The axis lies at a corner of four texels.
            assert!((map.radiance(axis)[0] - 0.25).abs() < 1e-4, "{x}, {y}: {axis}");
            assert_eq!(map.radiance(-axis)[0], 0.0, "{x}, {y}: the other way");
        }
        assert!(bright(5, 0).radiance(direction([5, 0], [64, 32]))[0] > 0.999, "the top row");
        let top = RadianceMap::from_fn(64, 32, |_, j| [f32::from(u8::from(j == 0)); 3]);
        assert_eq!(
            [top.radiance(Vec3::Y)[0], top.radiance(Vec3::NEG_Y)[0]],
            [1.0, 0.0],
            "up is at the top, to the pole"
        );
    }

    #[test]
    fn the_direction_of_a_texel_is_found_again() {
        let map = RadianceMap::from_fn(30, 14, |x, y| [x as f32, y as f32, 1.0]);
        for (x, y) in [(0, 0), (29, 13), (7, 5), (15, 7), (22, 2)] {
            let [column, row, _] = map.radiance(3.0 * direction([x, y], [30, 14]));
            assert!(
                (column - x as f32).abs() < 1e-3 && (row - y as f32).abs() < 1e-3,
                "{x}, {y}: {column}, {row}"
            );
        }
    }

    #[test]
    fn a_smaller_map_has_the_same_light() {
        let light = |map: &RadianceMap| {
            let rows = (0..map.height()).map(|y| {
                let edge = |y: usize| (y as f32 / map.height() as f32 * PI).cos();
                let row: f32 = (0..map.width()).map(|x| map.texel(x, y)[0]).sum();
                row * (edge(y) - edge(y + 1)) / map.width() as f32
            });
            rows.sum::<f32>() / 2.0
        };
        let map = RadianceMap::from_fn(90, 46, |x, y| [((x * 7 + y * 13) % 11) as f32; 3]);
        let reduced = map.reduced(33, 17);
        assert_eq!((reduced.width(), reduced.height()), (33, 17));
        // Within the rounding of the sums.
        assert!((light(&reduced) / light(&map) - 1.0).abs() < 1e-5, "{} of {}", light(&reduced), light(&map));
        let same = map.reduced(90, 46);
        let off = same.texels.iter().zip(&*map.texels).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0, f32::max);
        assert!(off < 1e-5, "one of its own size is the same, but for rounding: {off}");
    }
}
