//! The parameters of `opaque-blur`.

crate::declare_parameters! {
    /// Parameters of `opaque-blur`.
    pub(super) OpaqueBlurParameters {
        /// Blur radius of the first sub-image in pixels; the radius doubles with each further one (eq. 1).
        first_radius_px: f32 = 1.7, Number(0.5, 16.0);
    }
}
