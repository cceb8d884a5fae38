//! The laws of the blur, and what a method may say about them.
//!
//! `tests/laws.rs` holds every method to every law by measuring one figure in several cases. A method that breaks a law by
//! design declares a [`Deviation`] beside its registration: its figures must then lie within what it declares, and one of
//! them outside what the law allows, so that no declaration outlives its reason.

/// A law, named by what it says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// A constant picture stays constant. Figure: largest difference.
    Constancy,
    /// An isolated emitter keeps its energy. Figure: energy after, over energy before.
    Energy,
    /// An isolated emitter stays where it is. Figure: distance of its centroid in pixels.
    Place,
    /// An isolated emitter spreads as the aperture does. Figure: variance over the aperture's, `c²·m`.
    Spread,
    /// A focused, opaque front hides a blurred back. Figure: largest difference.
    Occlusion,
    /// A blurred front lets the back show through its middle. Figure: the share that shows, one half where nothing is missing.
    SeeThrough,
    /// A focused back shows at full sharpness through a blurred front. Figure: largest difference.
    Sharpness,
    /// Light through half a veil is halved. Figure: largest difference.
    Veil,
    /// An object before nothing leaves a picture with its own coverage. Figure: coverage after, over coverage before.
    Transparency,
    /// A mirrored or turned scene gives the mirrored or turned picture. Figure: dB between the two.
    Symmetry,
    /// A small change of focus makes a small change of picture. Figure: dB between the two.
    Continuity,
    /// A slanted surface has no cracks. Figure: largest share of a bright wall that shows through it.
    NoCracks,
    /// A surface steep across the corners of its samples has no cracks either. Figure: as for [`Law::NoCracks`].
    NoCracksAcrossCorners,
    /// With many samples the picture is the reference's. Figure: dB between the two.
    Convergence,
    /// A supersampled stack gives the picture that its samples stand for. Figure: dB from the reference.
    Supersampling,
}

/// A law that a method breaks by design.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Deviation {
    /// Which.
    pub law: Law,
    /// Least and greatest figure that the method reaches over all cases of the law's test.
    pub within: [f32; 2],
    /// Why, as the method's source has it.
    pub reason: &'static str,
}
