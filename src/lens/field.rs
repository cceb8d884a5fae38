//! The field of a lens: positions in the picture relative to the lens's axis, and their field angles.

use glam::{Vec2, Vec3};

/// Where the axis of the lens meets the picture, and the lengths that turn pixels into shares of the field and into angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Where the axis meets the picture, in picture pixels right and down from its corner: pixel `x` has its centre at `x + ½`.
    pub axis_px: Vec2,
    /// Distance from the axis to the corners of the frame, in picture pixels.
    pub half_diagonal_px: f32,
    /// Distance from the camera's centre to the picture, in widths of a picture pixel.
    pub focal_length_px: f32,
    /// Width of a pixel divided by its height.
    pub pixel_aspect: f32,
}

impl Field {
    /// The field of a picture of `width` × `height` pixels with its axis at the centre and a focal length of the picture's width.
    pub fn from_picture_size(width: usize, height: usize) -> Self {
        let axis_px = 0.5 * Vec2::new(width as f32, height as f32);
        Self { axis_px, half_diagonal_px: axis_px.length(), focal_length_px: width as f32, pixel_aspect: 1.0 }
    }

    /// `place`, in pixels from the picture's corner, as an offset from the axis that has length 1 in the frame's corners.
    #[inline]
    pub(crate) fn height(&self, place: Vec2) -> Vec2 {
        (place - self.axis_px) / self.half_diagonal_px
    }

    /// A place at the same distance from the axis as the corners of the frame, in pixels from the picture's corner.
    pub(crate) fn corner_place(&self) -> Vec2 {
        self.axis_px + self.half_diagonal_px * Vec2::X
    }

    /// Direction, of length 1, in which the centre of the lens sees `place`, in pixels from the picture's corner: x right, y up, z to the viewer.
    pub(crate) fn direction(&self, place: Vec2) -> Vec3 {
        let from_axis = (place - self.axis_px) / Vec2::new(1.0, -self.pixel_aspect);
        from_axis.extend(-self.focal_length_px).normalize()
    }

    /// Cosine of the field angle at `place`.
    pub(crate) fn cosine(&self, place: Vec2) -> f32 {
        let from_axis = (place - self.axis_px) / Vec2::new(1.0, self.pixel_aspect);
        let tangent = from_axis.length() / self.focal_length_px;
        1.0 / tangent.hypot(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corners_of_a_frame_are_at_distance_one_from_its_axis() {
        let field = Field::from_picture_size(640, 360);
        assert_eq!(field.height(Vec2::new(320.0, 180.0)), Vec2::ZERO);
        assert!((field.height(Vec2::new(640.0, 0.0)).length() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn directions_have_x_to_the_right_and_y_upwards() {
        let field = Field { focal_length_px: 100.0, pixel_aspect: 2.0, ..Field::from_picture_size(640, 360) };
        assert_eq!(field.direction(Vec2::new(320.0, 180.0)), Vec3::NEG_Z);
        let seen = field.direction(Vec2::new(420.0, -20.0));
        assert!(
            (seen - Vec3::new(1.0, 1.0, -1.0).normalize()).length() < 1e-6,
            "200 rows up, half as high: {seen}"
        );
    }

    #[test]
    fn the_field_angle_is_45_degrees_at_one_focal_length_from_the_axis() {
        let field = Field { focal_length_px: 100.0, ..Field::from_picture_size(640, 360) };
        assert_eq!(field.cosine(Vec2::new(320.0, 180.0)), 1.0);
        assert!((field.cosine(Vec2::new(320.0, 280.0)) - 0.5f32.sqrt()).abs() < 1e-6);
        let wide = Field { pixel_aspect: 2.0, ..field };
        assert!(
            (wide.cosine(Vec2::new(320.0, 380.0)) - 0.5f32.sqrt()).abs() < 1e-6,
            "200 rows, half as high"
        );
    }
}
