//! The parameters of `pyramid-disocclusion`.

crate::declare_parameters! {
    /// Parameters of `pyramid-disocclusion`.
    pub(super) PyramidDisocclusionParameters {
        /// Blur radius of the first sub-image in pixels; the radius doubles with each further one.
        first_radius_px: f32 = 1.7, Number(0.5, 16.0);
    }
}
