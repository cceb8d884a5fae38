//! The parameters of `b-buffer`.

crate::declare_parameters! {
    /// Parameters of `b-buffer`.
    pub(super) BBufferParameters {
        /// Contributions within this of the winner's CoC radius, in pixels, or within half of it, are culled as parts of the same surface.
        same_surface_px: f32 = 0.5, Number(0.0, 64.0);
        /// Largest CoC radius, in pixels, that still counts as in focus.
        in_focus_px: f32 = 0.5, Number(0.1, 8.0);
    }
}
