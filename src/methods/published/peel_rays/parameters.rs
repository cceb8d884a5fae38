//! Parameters of `peel-rays`.

crate::declare_parameters! {
    /// Parameters of `peel-rays`.
    pub(super) PeelRaysParameters {
        /// Lens rays per pixel if `views` is not set.
        rays: usize = 256, Count(1, 65536);
        /// Maximum number of steps of the linear search along a ray.
        linear_steps: usize = 100, Count(1, 4096);
        /// Steps of the binary search after the linear search.
        binary_steps: usize = 5, Count(0, 32);
    }
}
