//! The parameters of `shear`.

crate::declare_parameters! {
    /// Parameters of `shear`.
    pub(super) ShearParameters {
        /// Lens samples per pixel where no other number is requested.
        views: usize = 64, Count(1, 65536);
        /// Radius of the prefilter as a multiple of half the gap between lens samples; 0 switches it off.
        prefilter: f32 = 1.4, Number(0.0, 16.0);
        /// Weight of the resolve filter's four neighbours on point-sampled, in-focus pixels; 0 switches it off.
        resolve: f32 = 0.08, Number(0.0, 0.2);
        /// Brightness, 1 or more, above which a fragment is drawn as an exact disc; 0 switches highlights off.
        highlight_threshold: f32 = 1.0, Number(0.0, 65504.0);
        /// Whether missing surfaces may be filled in from their surroundings.
        fill: bool = true, Flag;
    }
}
