//! How far what a surface reflects moves in the picture, as the lens moves.
//!
//! In the camera's axes (x right, y up, z towards the viewer) the pinhole is at the origin. The lens point `u` of the picture's axes (y
//! down) is `V = R (−u_x, u_y, 0)`: a ray from `V` through the point in focus lies `c·u` from its pixel, at the depth of CoC radius `c`.
//!
//! A fragment at `X`, of normal `n`, is seen along `d = X / |X|` and reflects along `r = d − 2 (d·n) n`, to a point at the distance `D`. Seen
//! from `V`, that is to first order the point that the pinhole sees at the place `p + M u` of the same surface:
//!
//! ```text
//!   A = ∂r/∂p + (I − r rᵀ) ∂X/∂p / D              3 × 2
//!   B = −(I − 2 n nᵀ) (I − d dᵀ) ∂V/∂u / |X|      3 × 2
//!   M = (AᵀA)⁻¹ AᵀB                               2 × 2, picture pixels
//! ```
//!
//! For a flat mirror `M = (c_v − c) I`, with the CoC radius `c_v` of the mirrored point: [`View::mirrored_coc_px`].

use crate::lens::ThinLens;
use crate::stack::Frame;
use crate::stack::depth::DepthScale;
use glam::{DMat2, DVec2, Mat2, Vec2, Vec3};

/// The camera and its lens.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    frame: Frame,
    lens: ThinLens,
    /// Distance of the sensor, in samples.
    focal_px: f32,
    /// Samples per picture pixel along each axis.
    supersample: f32,
    /// Radius of the lens along the picture's axes, in scene units.
    radius: Vec2,
}

/// A fragment of a surface that reflects.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Its place in the camera's axes.
    pub(super) at: Vec3,
    /// Its normal, of length 1.
    pub(super) normal: Vec3,
}

impl Point {
    /// The direction in which the pinhole sees it.
    pub(super) fn seen_along(&self) -> Vec3 {
        self.at.normalize_or_zero()
    }

    /// The direction in which it reflects the pinhole's ray.
    pub(super) fn reflects_along(&self) -> Vec3 {
        reflected(self.seen_along(), self.normal)
    }
}

/// How a surface changes from one sample to the next along an axis of the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slope {
    /// Change of the place.
    pub(super) at: Vec3,
    /// Change of the direction of reflection.
    pub(super) along: Vec3,
}

impl View {
    /// The camera of a stack with this `frame`, whose depths are `scale`d, and `lens`.
    pub(super) fn new(frame: Frame, supersample: usize, lens: ThinLens, scale: &DepthScale) -> Self {
        let supersample = supersample as f32;
        // A lens of this radius has the CoC law's radius at infinity.
        let radius = lens.coc_infinity_px * supersample * lens.focus_distance / scale.focal_px;
        let aspect = frame.usable_pixel_aspect();
        Self {
            frame,
            lens,
            focal_px: scale.focal_px,
            supersample,
            radius: Vec2::new(radius, radius / aspect),
        }
    }

    /// The point at planar depth `z` that the pinhole sees in sample `x, y`.
    pub(super) fn point(&self, x: usize, y: usize, z: f32) -> Vec3 {
        let [x0, _] = self.frame.data_origin_from_centre();
        let across = (x0 + x as f32) / self.focal_px;
        let down = self.frame.row_from_centre(y as f32) / self.focal_px;
        z * Vec3::new(across, -down, -1.0)
    }

    /// Turns the depths of row `y` into planar depth.
    pub(super) fn planar_row(&self, depth: &mut [f32], y: usize, scale: &DepthScale) {
        let [x0, _] = self.frame.data_origin_from_centre();
        scale.planar_row(depth, self.frame.row_from_centre(y as f32), x0);
    }

    /// Samples per picture pixel along each axis.
    pub(super) fn supersample(&self) -> f32 {
        self.supersample
    }

    /// CoC radius in picture pixels of what a flat mirror at `point` shows at the distance `distance` from it.
    pub(super) fn mirrored_coc_px(&self, point: &Point, distance: f32) -> f32 {
        let z = -point.at.z;
        self.lens.coc_radius_px(z + distance * z / point.at.length())
    }

    /// The matrix `M` of the module's head in picture pixels, for a fragment that reflects what lies at the `inverse_distance`, and that
    /// changes by `slopes` from one sample to the next. `None` where the surface focuses the view to a point: `A` has no inverse.
    pub(super) fn movement(&self, point: &Point, inverse_distance: f32, slopes: [Slope; 2]) -> Option<Mat2> {
        let (seen, normal) = (point.seen_along(), point.normal);
        let along = reflected(seen, normal);
        let across = |v: Vec3, axis: Vec3| v - axis.dot(v) * axis;
        let a = slopes.map(|slope| slope.along + inverse_distance * across(slope.at, along));
        let lens_points = [Vec3::new(-self.radius.x, 0.0, 0.0), Vec3::new(0.0, self.radius.y, 0.0)];
        let b = lens_points.map(|lens| -reflected(across(lens, seen), normal) / point.at.length());
        let dot = |a: Vec3, b: Vec3| a.as_dvec3().dot(b.as_dvec3());
        let squares = DMat2::from_cols(
            DVec2::new(dot(a[0], a[0]), dot(a[1], a[0])),
            DVec2::new(dot(a[0], a[1]), dot(a[1], a[1])),
        );
        let products = DMat2::from_cols(
            DVec2::new(dot(a[0], b[0]), dot(a[1], b[0])),
            DVec2::new(dot(a[0], b[1]), dot(a[1], b[1])),
        );
        let movement = (squares.inverse() * products).as_mat2() * self.supersample.recip();
        movement.is_finite().then_some(movement)
    }
}

/// `v` mirrored in the plane of this `normal`.
fn reflected(v: Vec3, normal: Vec3) -> Vec3 {
    v - 2.0 * v.dot(normal) * normal
}

/// The largest factor by which `matrix` stretches a vector.
pub(super) fn largest_stretch(matrix: Mat2) -> f32 {
    let [a, c, b, d] = matrix.to_cols_array();
    let (sum, difference) = ((a + d).hypot(b - c), (a - d).hypot(b + c));
    0.5 * (sum + difference)
}
