//! The parameters of `gather`.

crate::declare_parameters! {
    /// Parameters of `gather`.
    pub(super) GatherParameters {
        /// Samples a pixel when `--views` does not say.
        samples: usize = 1024, Count(1, 65536);
    }
}
