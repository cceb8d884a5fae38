//! The parameters of `accumulate`.

crate::declare_parameters! {
    /// Parameters of `accumulate`.
    pub(super) AccumulateParameters {
        /// Lens rays a pixel when `--views` does not say.
        rays: usize = 1024, Count(1, 65536);
    }
}
