//! The parameters of `peel-rays`.

crate::declare_parameters! {
    /// Parameters of `peel-rays`.
    pub(super) PeelRaysParameters {
        /// Lens rays a pixel when `--views` does not say.
        rays: usize = 256, Count(1, 65536);
        /// Steps of the linear search along a ray.
        linear_steps: usize = 100, Count(1, 4096);
        /// Steps of the binary search that follows.
        binary_steps: usize = 5, Count(0, 32);
    }
}
