//! Parameters of `recursive-gaussian`.

crate::declare_parameters! {
    /// Parameters of `recursive-gaussian`.
    pub(super) RecursiveGaussianParameters {
        /// Whether layers are blurred in one cascade (eq. 13) or each on its own (eq. 11).
        cascaded: bool = true, Flag;
        /// Number of depth layers K; "auto" makes as many as the stack's CoC range needs.
        layers: Option<usize> = None, CountOrAuto(1, 512);
        /// CoC diameter of a layer over the standard deviation of its Gaussian (eq. 10).
        coc_per_sigma: f32 = 4.0, Number(1.0, 16.0);
        /// Boundary of two layers, from the nearer one's CoC radius, 0, to the farther one's, 1 (eq. 9).
        anchor: f32 = 0.5, Number(0.0, 1.0);
    }
}
