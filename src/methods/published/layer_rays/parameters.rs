//! The parameters of `layer-rays`.

crate::declare_parameters! {
    /// Parameters of `layer-rays`.
    pub(super) LayerRaysParameters {
        /// Lens rays a pixel when `--views` does not say.
        rays: usize = 32, Count(1, 65536);
        /// Growth of the CoC radius from layer to layer, δ, in pixels (eq. 4).
        delta_px: f32 = 3.0, Number(0.1, 1000.0);
        /// Share of its depth by which a layer reaches into its neighbours (section 4.2).
        overlap: f32 = 0.1, Number(0.0, 0.5);
        /// Steps of the false-position search in a layer (section 4.3).
        iterations: usize = 3, Count(1, 64);
        /// Whether rays are thickened to cones (section 4.4).
        cones: bool = true, Flag;
        /// Whether lens samples differ from pixel to pixel (section 4.5).
        jitter: bool = true, Flag;
        /// Whether rays that are stopped outside the frame are discarded (section 4.3); else the border's samples go on for ever.
        discard: bool = true, Flag;
    }
}
