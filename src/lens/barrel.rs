//! The lens barrel: the share of the aperture's light that passes it, and the falloff of brightness.

use super::{Aperture, Field, Optics};
use glam::Vec2;
use std::f32::consts::PI;

/// Share of the aperture's light that passes the barrel, tabulated by direction and distance from the axis.
#[derive(Debug, Clone)]
pub(crate) struct BarrelShares {
    cats_eye: f32,
    /// By direction, then by offset of the barrel, 0 … 2 aperture radii. `None` for a disc, which has a closed form.
    table: Option<Vec<[f32; Self::STEPS + 1]>>,
}

impl BarrelShares {
    const DIRECTIONS: usize = 32;
    const STEPS: usize = 32;

    /// The shares for the lens of `optics`.
    pub(crate) fn new(optics: &Optics) -> Self {
        let light = Light::from_optics(optics).filter(|_| optics.cats_eye > 0.0);
        let direction = |i: usize| Vec2::from_angle(i as f32 * 2.0 * PI / Self::DIRECTIONS as f32);
        let table = light.map(|light| {
            let along = |i: usize| {
                std::array::from_fn(|k| light.share(k as f32 * 2.0 / Self::STEPS as f32 * direction(i)))
            };
            (0..Self::DIRECTIONS).map(along).collect()
        });
        Self { cats_eye: optics.cats_eye, table }
    }

    /// The share at position `height` of the field: 1 on the axis.
    pub(crate) fn at(&self, height: Vec2) -> f32 {
        let barrel = self.cats_eye * height;
        let offset = barrel.length();
        let Some(table) = &self.table else { return disc_overlap(offset) };
        let (step, along) = split(offset * 0.5 * Self::STEPS as f32, Self::STEPS);
        let turn = (barrel.to_angle() / (2.0 * PI)).rem_euclid(1.0) * Self::DIRECTIONS as f32;
        let (direction, between) = split(turn, Self::DIRECTIONS);
        let share_in = |direction: usize| {
            let row = &table[direction % Self::DIRECTIONS];
            row[step] + along * (row[step + 1] - row[step])
        };
        share_in(direction) + between * (share_in(direction + 1) - share_in(direction))
    }
}

impl Optics {
    /// Share of the aperture's light that passes the barrel at position `height` of the field, without a table: see [`BarrelShares`].
    pub fn barrel_share(&self, height: Vec2) -> f32 {
        let barrel = self.cats_eye * height;
        Light::from_optics(self).map_or_else(|| disc_overlap(barrel.length()), |light| light.share(barrel))
    }

    /// Relative brightness at `place` of the lens's `field`, without a table: see [`Falloff`].
    pub fn brightness(&self, field: &Field, place: Vec2) -> f32 {
        brightness(self.barrel_share(field.height(place)), field.cosine(place), self.vignetting)
    }
}

/// Points that represent equal shares of an aperture's light.
struct Light {
    points: Vec<Vec2>,
    /// Number of points within the barrel on the axis.
    whole: f32,
}

impl Light {
    /// Number of points.
    const POINTS: usize = 4096;

    /// Half the width of the barrel's soft edge, over which a point's weight falls from 1 to 0, so that counts are smooth.
    const EDGE: f32 = 0.04;

    /// The points of the aperture of `optics`; `None` for a disc, which has a closed form.
    fn from_optics(optics: &Optics) -> Option<Self> {
        if optics.image.is_none() && optics.aperture == Aperture::DISC {
            return None;
        }
        let points = (0..Self::POINTS).map(|i| optics.lens_point(sunflower(i, Self::POINTS))).collect();
        let light = Self { points, whole: 1.0 };
        let whole = light.share(Vec2::ZERO);
        Some(Self { whole, ..light })
    }

    /// Share of the light within a barrel whose offset is `barrel`.
    fn share(&self, barrel: Vec2) -> f32 {
        let inside =
            |point: &Vec2| ((1.0 - (*point - barrel).length()) / (2.0 * Self::EDGE) + 0.5).clamp(0.0, 1.0);
        self.points.iter().map(inside).sum::<f32>() / self.whole
    }
}

/// Relative brightness at each place of a lens's field.
#[derive(Debug, Clone)]
pub(crate) struct Falloff {
    shares: BarrelShares,
    field: Field,
    power: f32,
}

impl Falloff {
    /// The falloff of the lens of `optics` in its `field`.
    pub(crate) fn new(optics: &Optics, field: Field) -> Self {
        Self { shares: BarrelShares::new(optics), field, power: optics.vignetting }
    }

    /// Relative brightness at `place`, in picture pixels from the picture's corner: 1 on the axis.
    pub(crate) fn at(&self, place: Vec2) -> f32 {
        brightness(self.shares.at(self.field.height(place)), self.field.cosine(place), self.power)
    }
}

/// Relative brightness where `share` of the aperture's light passes the barrel, at a field angle of this `cosine`.
fn brightness(share: f32, cosine: f32, power: f32) -> f32 {
    (share * cosine.powi(4)).powf(power)
}

/// The cell, of `count`, that contains `position`, and the position within it, 0 … 1.
fn split(position: f32, count: usize) -> (usize, f32) {
    let cell = (position as usize).min(count - 1);
    (cell, (position - cell as f32).min(1.0))
}

/// Share of a disc within another disc of the same size, their centres `offset` radii apart.
fn disc_overlap(offset: f32) -> f32 {
    let half = (0.5 * offset).min(1.0);
    2.0 * (half.acos() - half * (1.0 - half * half).sqrt()) / PI
}

/// Point `i` of `count` spread evenly over the unit disc.
fn sunflower(i: usize, count: usize) -> Vec2 {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    let angle = (i as f64 * GOLDEN_ANGLE).rem_euclid(std::f64::consts::TAU) as f32;
    Vec2::from_angle(angle) * ((i as f32 + 0.5) / count as f32).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_that_passes_the_barrel_is_that_of_counted_points() {
        let disc = Optics { cats_eye: 1.0, ..Optics::from_aperture(Aperture::DISC) };
        let polygon = Optics { aperture: Aperture::new(6, 10.0).unwrap(), ..disc.clone() };
        for height in [Vec2::ZERO, Vec2::new(0.5, 0.0), Vec2::new(-0.3, 0.8), Vec2::new(0.0, -1.1)] {
            for optics in [&disc, &polygon] {
                let count = 200_000;
                let within = |i: &usize| {
                    optics.within_barrel(optics.aperture.warp_disc(sunflower(*i, count)), height) > 0.0
                };
                let counted = (0..count).filter(within).count() as f32 / count as f32;
                for share in [BarrelShares::new(optics).at(height), optics.barrel_share(height)] {
                    assert!((share - counted).abs() < 5e-3, "{height}: {share}, counted {counted}");
                }
            }
        }
        let half = BarrelShares::new(&disc).at(Vec2::X);
        assert!((half - 0.391).abs() < 1e-3, "two unit discs a radius apart share 39.1 %: {half}");
    }

    #[test]
    fn brightness_falls_off_by_the_cosine_to_the_fourth_and_by_the_barrels_share() {
        let field = Field { focal_length_px: 50.0, ..Field::from_picture_size(80, 60) };
        let optics = Optics { vignetting: 1.0, ..Optics::from_aperture(Aperture::DISC) };
        // 50 px from the axis at a focal length of 50 px: cos⁴ 45° = 1/4.
        assert!((Falloff::new(&optics, field).at(Vec2::ZERO) - 0.25).abs() < 1e-6);
        let barrel = Optics { cats_eye: 1.0, ..optics.clone() };
        assert!((Falloff::new(&barrel, field).at(Vec2::ZERO) - 0.25 * 0.391).abs() < 1e-3);
        let half = Optics { vignetting: 0.5, ..optics };
        assert!((Falloff::new(&half, field).at(Vec2::ZERO) - 0.5).abs() < 1e-6);
        assert_eq!(Falloff::new(&barrel, field).at(field.axis_px), 1.0, "on the axis");
        let place = Vec2::new(11.0, 17.0);
        assert!(
            (Falloff::new(&barrel, field).at(place) - barrel.brightness(&field, place)).abs() < 1e-5,
            "the table and the single place agree"
        );
    }
}
