//! The parameters of `scatter`.

crate::declare_parameters! {
    /// Parameters of `scatter`.
    pub(super) ScatterParameters {
        /// Sprites whose coverage adds up to this hide what is behind them.
        saturation: f32 = 1.0, Number(0.1, 10.0);
    }
}
