//! The parameters of `scatter`.

crate::declare_parameters! {
    /// Parameters of `scatter`.
    pub(super) ScatterParameters {
        /// Summed coverage of sprites at which they hide everything behind them.
        saturation: f32 = 1.0, Number(0.1, 10.0);
    }
}
