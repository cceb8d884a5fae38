//! The aperture's shape, in the plane of the lens samples `u` (see [`super::View`]).
//!
//! Picture point `p` sees a fragment at `q` with CoC radius `c` through `u = (q − p) / c`: behind focus its blur is
//! the shape of `u` rotated by 180°, in front of focus it is the shape itself. In the picture (y downwards) the lens as
//! seen from the camera, x to the right and y up, is `u = (−x, y)`, so a blurred point behind focus shows the aperture
//! upright. As in Cycles, an aperture of rotation 0 has a side, not a corner, to the right, rotation is applied before the squeeze,
//! and the corners lie on the disc of the f-number: `tests/cycles.rs` compares them.
//!
//! The outline is a disc, or a regular polygon whose corners lie on the unit circle. Curved blades have arcs as sides, all of one
//! curvature, from corner to corner, up to the curvature of the circle itself. An anamorphic lens shows the outline narrower
//! than high. So do pixels that are wider than high, counted in pixels. The larger of both extents is 1, the CoC radius.

use crate::error::Error;
use crate::settings::Values;
use glam::Vec2;
use std::f32::consts::{PI, TAU};

/// The shape of the aperture, within the unit circle.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Aperture {
    /// Number of sides, at least 3; 0 for a disc.
    blades: u32,
    /// Rotation of the polygon in radians, anticlockwise as seen in a blurred point behind focus.
    rotation: f32,
    /// Curvature of the sides in units of the circle's: 0 for straight ones, 1 for a disc.
    curvature: f32,
    /// Height over width, in pixels.
    squeeze: f32,
}

/// The radius of an aperture that is `squeeze` times as high as wide, in the units in which its height is 1 if pixels are square, as the
/// larger of its extents in pixels whose width divided by their height is `pixel_aspect`.
pub fn aperture_radius(squeeze: f32, pixel_aspect: f32) -> f32 {
    pixel_aspect.max(squeeze.recip())
}

/// One side of a polygon with its midpoint to the right: the line `x = apothem`, or an arc of the circle about `(centre, 0)`.
#[derive(Debug, Clone, Copy)]
struct Side {
    /// Half of the angle that the side subtends at the aperture's centre.
    half_angle: f32,
    /// Radius of its arc; infinite for a straight side.
    radius: f32,
    /// `x` of the centre of its arc; 0 for a straight side.
    centre: f32,
    /// Distance of its midpoint from the aperture's centre.
    apothem: f32,
}

impl Side {
    fn new(blades: u32, curvature: f32) -> Self {
        let half_angle = PI / blades as f32;
        let (half_length, straight) = half_angle.sin_cos();
        if curvature <= 0.0 {
            return Self { half_angle, radius: f32::INFINITY, centre: 0.0, apothem: straight };
        }
        let radius = 1.0 / curvature;
        let centre = straight - (radius * radius - half_length * half_length).max(0.0).sqrt();
        Self { half_angle, radius, centre, apothem: centre + radius }
    }

    fn is_straight(&self) -> bool {
        self.radius.is_infinite()
    }

    /// Half of the angle that an arc subtends at its own centre.
    fn half_arc(&self) -> f32 {
        (self.half_angle.sin() / self.radius).clamp(-1.0, 1.0).asin()
    }

    /// Area between the aperture's centre and the part of an arc from its midpoint to the angle `arc` at the arc's centre.
    fn area_to(&self, arc: f32) -> f32 {
        0.5 * self.radius * (self.radius * arc + self.centre * arc.sin())
    }

    /// Area of the sector between the aperture's centre and the side.
    fn area(&self) -> f32 {
        if self.is_straight() {
            self.half_angle.sin() * self.apothem
        } else {
            2.0 * self.area_to(self.half_arc())
        }
    }

    /// The point of the side at the share `share`, −1 … 1, of the area of half the sector, counted from the midpoint.
    fn point(&self, share: f32) -> Vec2 {
        if self.is_straight() {
            return Vec2::new(self.apothem, share * self.half_angle.sin());
        }
        let half_arc = self.half_arc();
        let target_area = share * self.area_to(half_arc);
        // Newton's method; four steps suffice because the area is nearly proportional to the arc.
        let arc = (0..4).fold(share * half_arc, |arc, _| {
            let slope = 0.5 * self.radius * (self.radius + self.centre * arc.cos());
            arc - (self.area_to(arc) - target_area) / slope
        });
        Vec2::new(self.centre + self.radius * arc.cos(), self.radius * arc.sin())
    }

    /// Distance of the side from the aperture's centre in the direction `angle`, counted from its midpoint.
    fn distance(&self, angle: f32) -> f32 {
        if self.is_straight() {
            return self.apothem / angle.cos();
        }
        let across = self.centre * angle.sin();
        self.centre * angle.cos() + (self.radius * self.radius - across * across).sqrt()
    }

    /// Distance of `point` from the side scaled by `scale`, positive inside, and the unit normal there.
    fn depth(&self, point: Vec2, scale: f32) -> (f32, Vec2) {
        if self.is_straight() {
            return (scale * self.apothem - point.x, Vec2::X);
        }
        let from_centre = point - Vec2::new(scale * self.centre, 0.0);
        (scale * self.radius - from_centre.length(), from_centre.normalize_or(Vec2::X))
    }
}

impl Aperture {
    /// A disc.
    pub const DISC: Self = Self { blades: 0, rotation: 0.0, curvature: 0.0, squeeze: 1.0 };

    /// The aperture of `blades` straight blades, 0 for a disc.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for one or two blades, more than 100, or a rotation that is not finite.
    pub fn new(blades: u32, rotation_deg: f32) -> Result<Self, Error> {
        Values { blades: Some(blades), rotation_deg: Some(rotation_deg), ..Values::default() }.check()?;
        if blades == 0 {
            return Ok(Self::DISC);
        }
        Ok(Self { blades, rotation: rotation_deg.to_radians(), ..Self::DISC })
    }

    /// The same aperture with sides of `curvature`, 0 (straight) … 1 (that of the circle). A disc is unchanged.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a curvature out of range.
    pub fn curved(self, curvature: f32) -> Result<Self, Error> {
        Values { blade_curvature: Some(curvature), ..Values::default() }.check()?;
        Ok(Self { curvature: if self.blades == 0 { 0.0 } else { curvature }, ..self })
    }

    /// The same aperture, `squeeze` times as high as wide, with its height unchanged.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Settings`] for a squeeze out of range.
    pub fn squeezed(self, squeeze: f32) -> Result<Self, Error> {
        Values { squeeze: Some(squeeze), ..Values::default() }.check()?;
        Ok(Self { squeeze, ..self })
    }

    /// The same aperture as seen in pixels whose width divided by their height is `aspect`.
    #[must_use]
    pub fn in_pixels(self, aspect: f32) -> Self {
        Self { squeeze: self.squeeze * aspect, ..self }
    }

    /// The same aperture with straight sides unless `curved`, and as wide as high unless `squeezed`.
    #[must_use]
    pub fn simplified(self, curved: bool, squeezed: bool) -> Self {
        Self {
            curvature: if curved { self.curvature } else { 0.0 },
            squeeze: if squeezed { self.squeeze } else { 1.0 },
            ..self
        }
    }

    /// Height over width, in pixels.
    pub fn squeeze(&self) -> f32 {
        self.squeeze
    }

    /// Width and height relative to those of the outline as wide as high; the larger is 1.
    pub(crate) fn scale(&self) -> Vec2 {
        Vec2::new(self.squeeze.max(1.0).recip(), self.squeeze.min(1.0))
    }

    /// One side of the polygon; `None` for a disc.
    fn side(&self) -> Option<Side> {
        (self.blades > 0).then(|| Side::new(self.blades, self.curvature))
    }

    /// Area in units of the squared aperture radius: π, or `n/2 · sin(2π/n)` and the area between chords and arcs.
    pub fn area(&self) -> f32 {
        self.side().map_or(PI, |side| self.blades as f32 * side.area()) * self.scale().element_product()
    }

    /// Mean of `x²` and of `y²` over the shape: 1/4 each, or `(2 + cos(2π/n)) / 12` for straight blades.
    pub fn second_moments(&self) -> Vec2 {
        let moment = self.side().map_or(0.25, |side| {
            // ∫ r⁴/4 over the angle is the integral of r² over the sector; half of it is that of x².
            let intervals = 64;
            let step = 2.0 * side.half_angle / intervals as f32;
            let weight = |i: u32| match i {
                0 => 1.0,
                i if i == intervals => 1.0,
                i if i % 2 == 1 => 4.0,
                _ => 2.0,
            };
            let fourth = |i: u32| side.distance(i as f32 * step - side.half_angle).powi(4);
            let simpson: f32 = (0..=intervals).map(|i| weight(i) * fourth(i)).sum::<f32>() * step / 3.0;
            simpson / 8.0 / side.area()
        });
        moment * self.scale() * self.scale()
    }

    /// Maps a point of the unit disc into the shape. The map preserves area: a uniform disc becomes a uniform polygon.
    ///
    /// Each wedge of the disc becomes the sector of one side: the radius is the share of the way to the side, the angle the position along
    /// the side.
    pub(crate) fn warp_disc(&self, point: Vec2) -> Vec2 {
        let unsqueezed = match self.side() {
            None => point,
            Some(side) => {
                let along = self.angle_from_side(point) / side.half_angle;
                let number = (0.5 * along).round();
                let upright = side.point(along - 2.0 * number) * point.length();
                Vec2::from_angle(self.side_angle(number)).rotate(upright)
            }
        };
        unsqueezed * self.scale()
    }

    /// Signed distance of `point` from the outline of the shape scaled by `scale`, in the units of `point`; negative outside. Exact without
    /// a squeeze, otherwise accurate near the outline.
    ///
    /// A negative scale rotates the shape by 180°.
    pub(crate) fn depth_inside(&self, point: Vec2, scale: f32) -> f32 {
        let turned = if scale < 0.0 { -point } else { point } / self.scale();
        let (depth, normal) = match self.side() {
            None => (scale.abs() - turned.length(), turned.normalize_or(Vec2::Y)),
            Some(side) => {
                let number = (0.5 * self.angle_from_side(turned) / side.half_angle).round();
                let angle = self.side_angle(number);
                let (depth, normal) = side.depth(Vec2::from_angle(-angle).rotate(turned), scale.abs());
                (depth, Vec2::from_angle(angle).rotate(normal))
            }
        };
        // From the space where the shape is as wide as high back to that of `point`: distances across shrink by the squeeze.
        depth / (normal / self.scale()).length()
    }

    /// A disc with the same squeeze.
    #[must_use]
    pub(super) fn without_blades(self) -> Self {
        Self { squeeze: self.squeeze, ..Self::DISC }
    }

    /// Distance of the outline from the centre along the unit vector `direction`.
    pub(super) fn distance(&self, direction: Vec2) -> f32 {
        let upright = direction / self.scale();
        let distance = self.side().map_or(1.0, |side| {
            let angle = self.angle_from_side(upright);
            side.distance(angle - 2.0 * side.half_angle * (0.5 * angle / side.half_angle).round())
        });
        distance / upright.length()
    }

    /// Smallest distance of the outline from the centre; for a disc, its radius.
    pub fn apothem(&self) -> f32 {
        self.side().map_or(1.0, |side| side.apothem) * self.scale().min_element()
    }

    /// Outward unit normals of straight sides that are not squeezed; none for a disc.
    pub(crate) fn side_normals(&self) -> Vec<Vec2> {
        (0..self.blades).map(|side| Vec2::from_angle(self.side_angle(side as f32))).collect()
    }

    /// The outline as bounds, prepared for [`Outline::row`].
    pub fn outline(&self) -> Outline {
        let side = self.side();
        let bounds = side.iter().flat_map(|side| {
            self.side_normals().into_iter().map(|normal| {
                if side.is_straight() {
                    Bound::Line { normal, distance: side.apothem }
                } else {
                    Bound::Circle { centre: normal * side.centre, radius: side.radius }
                }
            })
        });
        let disc = Bound::Circle { centre: Vec2::ZERO, radius: 1.0 };
        let bounds = if side.is_some() { bounds.collect() } else { vec![disc] };
        Outline { bounds, shape: self.scale() }
    }

    /// Angle of `point` from the normal of side 0, in `u` coordinates.
    fn angle_from_side(&self, point: Vec2) -> f32 {
        point.to_angle() - self.side_angle(0.0)
    }

    /// Direction of the outward normal of side `side`, in `u` coordinates (x mirrored: see the module's head).
    fn side_angle(&self, side: f32) -> f32 {
        PI - self.rotation + side * TAU / self.blades as f32
    }
}

/// A half-plane or disc. The shape is the intersection of its bounds.
#[derive(Debug, Clone, Copy)]
enum Bound {
    Line { normal: Vec2, distance: f32 },
    Circle { centre: Vec2, radius: f32 },
}

/// The outline of an aperture as the intersection of its bounds.
#[derive(Debug, Clone)]
pub struct Outline {
    bounds: Vec<Bound>,
    /// Width and height relative to those of the bounds.
    shape: Vec2,
}

impl Outline {
    /// Left and right end of the shape scaled by `scale` in the row at `y` from its centre; `None` outside. A negative scale rotates it by
    /// 180°.
    pub fn row(&self, y: f32, scale: f32) -> Option<[f32; 2]> {
        let (turned_y, size) = (y * scale.signum() / self.shape.y, scale.abs());
        let [mut left, mut right] = [f32::NEG_INFINITY, f32::INFINITY];
        for bound in &self.bounds {
            match *bound {
                Bound::Circle { centre, radius } => {
                    let (centre, radius) = (size * centre, size * radius);
                    let square = radius * radius - (turned_y - centre.y).powi(2);
                    if square <= 0.0 {
                        return None;
                    }
                    (left, right) = (left.max(centre.x - square.sqrt()), right.min(centre.x + square.sqrt()));
                }
                Bound::Line { normal, distance } => {
                    // normal · (x, y) ≤ distance
                    let room = size * distance - normal.y * turned_y;
                    if normal.x.abs() < 1e-6 {
                        if room < 0.0 {
                            return None;
                        }
                    } else if normal.x > 0.0 {
                        right = right.min(room / normal.x);
                    } else {
                        left = left.max(room / normal.x);
                    }
                }
            }
        }
        let extent = if scale < 0.0 { [-right, -left] } else { [left, right] };
        (left < right).then(|| extent.map(|x| x * self.shape.x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::views;

    fn shapes() -> impl Iterator<Item = Aperture> {
        let outlines = [(0, 0.0), (3, 0.0), (5, 17.0), (6, 0.0), (8, -40.0)];
        outlines.into_iter().flat_map(|(blades, rotation_deg)| {
            let straight = Aperture::new(blades, rotation_deg).unwrap();
            let curved = straight.curved(0.6).unwrap();
            let wide = straight.in_pixels(0.6);
            [
                straight,
                curved,
                wide,
                straight.squeezed(2.0).unwrap(),
                curved.squeezed(1.4).unwrap().in_pixels(0.5),
            ]
        })
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
    fn views_are_evenly_spread_over_the_shape() {
        for shape in shapes() {
            let samples = views(1024, shape);
            let mean = samples.iter().map(|v| v.lens).sum::<Vec2>() / 1024.0;
            let square = samples.iter().map(|v| v.lens * v.lens).sum::<Vec2>() / 1024.0;
            assert!(mean.length() < 2e-3, "{shape:?}: centroid {mean}");
            let moments = shape.second_moments();
            assert!((square - moments).length() < 4e-3, "{shape:?}: {square}, expected {moments}");
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

    #[test]
    fn straight_blades_have_the_moments_and_area_of_a_polygon_and_round_ones_those_of_the_disc() {
        for blades in 3..=9 {
            let n = blades as f32;
            let straight = Aperture::new(blades, 30.0).unwrap();
            assert!((straight.area() - 0.5 * n * (TAU / n).sin()).abs() < 1e-5, "{blades} blades");
            let moment = (2.0 + (TAU / n).cos()) / 12.0;
            assert!((straight.second_moments() - Vec2::splat(moment)).length() < 1e-4, "{blades} blades");
            let round = straight.curved(1.0).unwrap();
            assert!((round.area() - PI).abs() < 1e-4, "{blades} blades: {}", round.area());
            assert!((round.second_moments() - Vec2::splat(0.25)).length() < 1e-4, "{blades} blades");
            for point in [Vec2::new(0.3, -0.4), Vec2::new(-0.9, 0.1), Vec2::new(1.2, 0.8)] {
                assert!((round.warp_disc(point) - point).length() < 1e-4, "{blades} blades: {point}");
                assert!((round.depth_inside(point, 1.0) - (1.0 - point.length())).abs() < 1e-4, "{point}");
            }
        }
    }

    #[test]
    fn curved_blades_lie_between_the_polygon_and_the_disc_and_share_its_corners() {
        let straight = Aperture::new(6, 10.0).unwrap();
        let [half, nearly_round] = [0.5, 0.9].map(|curvature| straight.curved(curvature).unwrap());
        assert!(straight.area() < half.area() && half.area() < nearly_round.area());
        assert!(nearly_round.area() < PI);
        let corner = Vec2::from_angle(straight.side_angle(0.5));
        for shape in [straight, half, nearly_round] {
            assert!(shape.depth_inside(corner, 1.0).abs() < 1e-5, "{shape:?}");
        }
    }

    #[test]
    fn the_ends_of_a_row_lie_on_the_outline() {
        for (shape, scale) in shapes().flat_map(|shape| [(shape, 9.0), (shape, -9.0)]) {
            let outline = shape.outline();
            for y in [-8.2, -3.0, 0.1, 4.4, 7.9] {
                let Some(ends) = outline.row(y, scale) else {
                    let outside =
                        (-40..=40).all(|x| shape.depth_inside(Vec2::new(0.4 * x as f32, y), scale) < 0.01);
                    assert!(outside, "{shape:?}, row {y}");
                    continue;
                };
                for x in ends {
                    let depth = shape.depth_inside(Vec2::new(x, y), scale);
                    assert!(depth.abs() < 1e-3, "{shape:?}, scale {scale}: {depth} deep at {x}, {y}");
                }
                let middle = Vec2::new(0.5 * (ends[0] + ends[1]), y);
                assert!(shape.depth_inside(middle, scale) > 0.0, "{shape:?}: between the ends");
            }
        }
    }

    #[test]
    fn the_point_at_the_outlines_distance_lies_on_it_in_every_direction() {
        for (shape, turn) in shapes().flat_map(|shape| [0.0, 0.7, 2.9, 4.4].map(|turn| (shape, turn))) {
            let direction = Vec2::from_angle(turn);
            let depth = shape.depth_inside(shape.distance(direction) * direction, 1.0);
            assert!(depth.abs() < 1e-4, "{shape:?}, towards {direction}: {depth}");
        }
    }

    #[test]
    fn a_squeezed_aperture_is_narrower_and_as_high() {
        let oval = Aperture::DISC.squeezed(2.0).unwrap();
        assert!(oval.depth_inside(Vec2::new(0.0, 0.99), 1.0) > 0.0, "as high as the disc");
        assert!((oval.depth_inside(Vec2::new(0.5, 0.0), 1.0)).abs() < 1e-6, "half as wide");
        assert!((oval.depth_inside(Vec2::new(0.51, 0.0), 1.0) + 0.01).abs() < 1e-3, "in its own units");
    }

    #[test]
    fn an_aperture_on_wide_pixels_is_as_round_as_on_square_ones_when_it_is_shown() {
        for (squeeze, aspect) in [(1.0, 2.0), (1.0, 0.5), (2.0, 2.0), (1.5, 0.9), (2.0, 0.25)] {
            let shape = Aperture::DISC.squeezed(squeeze).unwrap().in_pixels(aspect);
            let radius = aperture_radius(squeeze, aspect);
            // In widths of a pixel, a pixel is 1 / aspect high.
            let [across, down] =
                [shape.distance(Vec2::X), shape.distance(Vec2::Y) / aspect].map(|extent| radius * extent);
            assert!((down - 1.0).abs() < 1e-6 && (across * squeeze - 1.0).abs() < 1e-6, "{across}, {down}");
            assert!((shape.scale().max_element() - 1.0).abs() < 1e-6, "the unit circle holds it");
        }
    }

    #[test]
    fn impossible_curvatures_and_squeezes_are_refused() {
        assert!(Aperture::DISC.curved(1.1).is_err() && Aperture::DISC.curved(f32::NAN).is_err());
        assert!(Aperture::DISC.squeezed(0.0).is_err() && Aperture::DISC.squeezed(f32::INFINITY).is_err());
    }
}
