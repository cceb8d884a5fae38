//! The parameters of `gather`.

crate::declare_parameters! {
    /// Parameters of `gather`.
    pub(super) GatherParameters {
        /// Samples per pixel where `views` is not set.
        samples: usize = 1024, Count(1, 65536);
    }
}
