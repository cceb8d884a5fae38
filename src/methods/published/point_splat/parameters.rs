//! The parameters of `point-splat`.

crate::declare_parameters! {
    /// Parameters of `point-splat`.
    pub(super) PointSplatParameters {
        /// Whether what the visible image hides is splatted too (section 3.2).
        hidden: bool = true, Flag;
        /// Least distance behind the visible pixel, as a share of the depth buffer's range, of a hidden fragment (section 3.2).
        epsilon: f32 = 0.05, Number(0.0, 1.0);
        /// Least depth change around a pixel that has a hidden fragment, on the same scale (eq. 4).
        edge: f32 = 0.01, Number(0.0, 1.0);
        /// Share of a pixel's CoC within which another belongs to the same layer (eq. 6).
        delta: f32 = 0.4, Number(0.01, 10.0);
        /// Intensity of a sprite from its centre to its rim, at even distances (section 3.3).
        intensity: Vec<f32> = vec![1.0], Numbers(0.0, 1000.0);
        /// Whether what is blurred and not near an edge is splatted at a quarter of the resolution (section 5).
        accelerated: bool = true, Flag;
    }
}
