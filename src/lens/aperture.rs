//! The aperture's shape.

/// The shape of the aperture, inscribed in the unit circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Aperture {
    /// A disc.
    Disc,
    /// A regular polygon whose corners lie on the unit circle.
    Polygon {
        /// Number of sides.
        blades: u32,
        /// Direction of the first corner in radians.
        rotation: f32,
    },
}
