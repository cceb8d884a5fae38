//! Parameters of `point-splat`.

crate::declare_parameters! {
    /// Parameters of `point-splat`.
    pub(super) PointSplatParameters {
        /// Whether surfaces hidden by the visible image are splatted too (section 3.2).
        hidden: bool = true, Flag;
        /// Minimum distance of a hidden fragment behind the visible pixel, as a share of the depth buffer's range
        /// (section 3.2).
        epsilon: f32 = 0.05, Number(0.0, 1.0);
        /// Minimum depth change around a pixel that has a hidden fragment, on the same scale (eq. 4).
        edge: f32 = 0.01, Number(0.0, 1.0);
        /// Maximum CoC difference of pixels in the same layer, as a share of the pixel's CoC (eq. 6).
        delta: f32 = 0.4, Number(0.01, 10.0);
        /// Intensity of a sprite from its centre to its edge, at even distances (section 3.3).
        intensity: Vec<f32> = vec![1.0], Numbers(0.0, 1000.0);
        /// Whether blurred pixels away from edges are splatted at a quarter of the resolution (section 5).
        accelerated: bool = true, Flag;
    }
}
