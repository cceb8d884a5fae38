//! Parameters of `layer-rays`.

crate::declare_parameters! {
    /// Parameters of `layer-rays`.
    pub(super) LayerRaysParameters {
        /// Lens rays per pixel if `views` is not set.
        rays: usize = 32, Count(1, 65536);
        /// CoC growth per layer, δ, as radius in pixels (eq. 4).
        delta_px: f32 = 3.0, Number(0.1, 1000.0);
        /// Share of a layer's depth by which it extends into its neighbours (section 4.2).
        overlap: f32 = 0.1, Number(0.0, 0.5);
        /// Iterations of the false-position search in a layer (section 4.3).
        iterations: usize = 3, Count(1, 64);
        /// Whether rays are widened to cones (section 4.4).
        cones: bool = true, Flag;
        /// Whether lens samples differ from pixel to pixel (section 4.5).
        jitter: bool = true, Flag;
        /// Whether rays that hit something outside the frame are discarded (section 4.3); if not, the border's
        /// samples are repeated.
        discard: bool = true, Flag;
    }
}
