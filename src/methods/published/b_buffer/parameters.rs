//! The parameters of `b-buffer`.

crate::declare_parameters! {
    /// Parameters of `b-buffer`.
    pub(super) BBufferParameters {
        /// A contribution is culled as part of the same surface where its CoC radius differs from that of the last opaque
        /// contribution by less than this, in pixels, or by less than half of that radius.
        same_surface_px: f32 = 0.5, Number(0.0, 64.0);
        /// Largest CoC radius, in pixels, that counts as in focus.
        in_focus_px: f32 = 0.5, Number(0.1, 8.0);
    }
}
