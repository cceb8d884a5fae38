//! The parameters of `accumulate`.

crate::declare_parameters! {
    /// Parameters of `accumulate`.
    pub(super) AccumulateParameters {
        /// Lens rays per pixel where `views` does not set them.
        rays: usize = 1024, Count(1, 65536);
    }
}
