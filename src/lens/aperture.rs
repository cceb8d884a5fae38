//! The aperture's shape, in the plane of the lens samples `u` (see [`super::View`]).
//!
//! A fragment at `q` with CoC radius `c` is seen by picture point `p` through `u = (q − p) / c`: behind focus its blur is
//! the shape of `u` turned by 180°, in front of focus it is the shape itself. In the picture (y downwards) the lens as
//! the camera sees it, x to the right and y up, is `u = (−x, y)`, so a blurred point behind focus shows the aperture
//! upright. As in Cycles, an aperture of rotation 0 has a side, not a corner, to the right.

use crate::error::Error;
use glam::Vec2;
use std::f32::consts::{PI, TAU};

/// The shape of the aperture, inscribed in the unit circle.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Aperture {
    /// A disc.
    Disc,
    /// A regular polygon whose corners lie on the unit circle.
    Polygon {
        /// Number of sides, at least 3.
        blades: u32,
        /// Turn of the polygon in radians, anticlockwise as seen in a blurred point behind focus.
        rotation: f32,
    },
}

impl Aperture {
    /// The aperture of `blades` blades, 0 for a disc.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for one or two blades, more than 100, or a rotation that is not finite.
    pub fn new(blades: u32, rotation_deg: f32) -> Result<Self, Error> {
        if !rotation_deg.is_finite() {
            return Err(Error::settings("the aperture's rotation must be a number of degrees")
                .with("found", rotation_deg.to_string()));
        }
        match blades {
            0 => Ok(Self::Disc),
            3..=100 => Ok(Self::Polygon { blades, rotation: rotation_deg.to_radians() }),
            _ => Err(Error::settings("an aperture has 3 to 100 blades, or 0 for a disc")
                .with("found", format!("{blades} blades"))
                .help("set it with --blades, or blades in the preset's [aperture]")),
        }
    }

    /// Area in units of the squared aperture radius: π, or `n/2 · sin(2π/n)`.
    pub fn area(&self) -> f32 {
        match *self {
            Self::Disc => PI,
            Self::Polygon { blades, .. } => 0.5 * blades as f32 * (TAU / blades as f32).sin(),
        }
    }

    /// Mean of `x²` (and of `y²`) over the shape: 1/4, or `(2 + cos(2π/n)) / 12`.
    pub fn second_moment(&self) -> f32 {
        match *self {
            Self::Disc => 0.25,
            Self::Polygon { blades, .. } => (2.0 + (TAU / blades as f32).cos()) / 12.0,
        }
    }

    /// Carries a point of the unit disc into the shape so that equal areas stay equal: a uniform disc becomes a uniform
    /// polygon.
    ///
    /// Each wedge of the disc becomes the triangle over one side: radius to height above the centre, angle to position
    /// along the side.
    pub fn from_disc(&self, point: Vec2) -> Vec2 {
        let Self::Polygon { blades, .. } = *self else { return point };
        let wedge = TAU / blades as f32;
        let side = (self.angle_from_side(point) / wedge).round();
        let along = self.angle_from_side(point) / wedge - side; // −½ … ½ of the side
        let (half_side, apothem) = (0.5 * wedge).sin_cos();
        let upright = Vec2::new(apothem, 2.0 * half_side * along) * point.length();
        Vec2::from_angle(self.side_angle(side)).rotate(upright)
    }

    /// How deep `point` lies inside the shape scaled by `scale`, in the units of `point`; negative outside.
    ///
    /// A negative scale turns the shape by 180°.
    pub fn depth_inside(&self, point: Vec2, scale: f32) -> f32 {
        let Self::Polygon { blades, .. } = *self else { return scale.abs() - point.length() };
        let point = if scale < 0.0 { -point } else { point };
        let side = (self.angle_from_side(point) / (TAU / blades as f32)).round();
        scale.abs() * self.apothem() - Vec2::from_angle(self.side_angle(side)).dot(point)
    }

    /// Distance of a side from the centre; a disc's is its radius.
    pub fn apothem(&self) -> f32 {
        match *self {
            Self::Disc => 1.0,
            Self::Polygon { blades, .. } => (PI / blades as f32).cos(),
        }
    }

    /// Outward unit normals of the sides; none for a disc.
    pub fn side_normals(&self) -> Vec<Vec2> {
        match *self {
            Self::Disc => Vec::new(),
            Self::Polygon { blades, .. } => {
                (0..blades).map(|side| Vec2::from_angle(self.side_angle(side as f32))).collect()
            }
        }
    }

    /// Angle of `point` from the normal of side 0, in `u` coordinates.
    fn angle_from_side(&self, point: Vec2) -> f32 {
        point.to_angle() - self.side_angle(0.0)
    }

    /// Direction of the outward normal of side `side`, in `u` coordinates (x mirrored: see the module's head).
    fn side_angle(&self, side: f32) -> f32 {
        let Self::Polygon { blades, rotation } = *self else { return 0.0 };
        PI - rotation + side * TAU / blades as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::views;

    fn shapes() -> impl Iterator<Item = Aperture> {
        [(0, 0.0), (3, 0.0), (5, 17.0), (6, 0.0), (8, -40.0)]
            .into_iter()
            .map(|(n, deg)| Aperture::new(n, deg).unwrap())
    }

    #[test]
    fn the_area_matches_a_count_of_points_inside() {
        let n = 1000;
        for shape in shapes() {
            let grid = |i: usize| (i as f32 + 0.5) / n as f32 * 2.0 - 1.0;
            let inside = (0..n * n)
                .filter(|i| shape.depth_inside(Vec2::new(grid(i % n), grid(i / n)), 1.0) > 0.0)
                .count();
            let area = 4.0 * inside as f32 / (n * n) as f32;
            assert!(
                (area - shape.area()).abs() < 2e-3,
                "{shape:?}: {area} counted, {} claimed",
                shape.area()
            );
        }
    }

    #[test]
    fn views_fill_the_shape_evenly_about_its_centre() {
        for shape in shapes() {
            let samples = views(1024, shape);
            let mean = samples.iter().map(|v| v.lens).sum::<Vec2>() / 1024.0;
            let square = samples.iter().map(|v| v.lens * v.lens).sum::<Vec2>() / 1024.0;
            assert!(mean.length() < 2e-3, "{shape:?}: centroid {mean}");
            let moment = shape.second_moment();
            assert!((square - Vec2::splat(moment)).length() < 3e-3, "{shape:?}: {square}, expected {moment}");
            let outside = samples.iter().filter(|v| shape.depth_inside(v.lens, 1.0) < -1e-4).count();
            assert_eq!(outside, 0, "{shape:?}: samples outside the aperture");
        }
    }

    #[test]
    fn a_triangle_of_rotation_zero_has_its_side_to_the_right_behind_focus() {
        let shape = Aperture::new(3, 0.0).unwrap();
        // Behind focus a point q lights p = q − c·u, so the picture shows −u: a corner to the left, at u = (1, 0).
        assert!(shape.depth_inside(Vec2::new(0.99, 0.0), 1.0) > 0.0, "corner to the left in the picture");
        assert!(
            shape.depth_inside(Vec2::new(-0.51, 0.0), 1.0) < 0.0,
            "side to the right, at half the radius"
        );
        assert!(shape.depth_inside(Vec2::new(-0.99, 0.0), -1.0) > 0.0, "turned by 180° in front of focus");
    }

    #[test]
    fn rotation_turns_the_picture_anticlockwise() {
        let shape = Aperture::new(3, 90.0).unwrap();
        // The corner that pointed left now points down: in the picture (y down) at (0, 1), in u at (0, −1).
        assert!(shape.depth_inside(Vec2::new(0.0, -0.99), 1.0) > 0.0, "corner downwards");
        assert!(shape.depth_inside(Vec2::new(0.0, 0.99), 1.0) < 0.0, "side upwards");
    }
}
