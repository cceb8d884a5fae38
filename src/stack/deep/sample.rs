//! One deep sample, and what becomes of it.

/// A sample of one pixel: a surface, or a volume between two distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::stack) struct Sample {
    /// Where it begins: a number that grows with the distance ([`crate::stack::depth`]), `+∞` for background.
    pub(in crate::stack) front: f32,
    /// Where it ends; that of `front` for a surface.
    pub(in crate::stack) back: f32,
    /// Red, green, blue: premultiplied.
    pub(in crate::stack) color: [f32; 3],
    /// Share of the light behind it that it takes away.
    pub(in crate::stack) alpha: f32,
}

impl Sample {
    /// Whether it ends behind where it begins, and both are known.
    pub(in crate::stack) fn is_volume(&self) -> bool {
        self.back > self.front && self.back < f32::INFINITY
    }

    /// Whether it is neither light nor in the way of any.
    pub(in crate::stack) fn is_empty(&self) -> bool {
        self.alpha <= 0.0 && self.color == [0.0; 3]
    }
}

/// What a pixel shows at one distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::stack) struct Fragment {
    /// Its distance, as that of [`Sample::front`].
    pub(in crate::stack) distance: f32,
    /// Red, green, blue: premultiplied.
    pub(in crate::stack) color: [f32; 3],
    /// Share of the light behind it that it takes away.
    pub(in crate::stack) alpha: f32,
}
