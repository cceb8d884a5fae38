//! The laws of the blur, and what a method may say about them.
//!
//! `tests/laws.rs` holds every method to every law by measuring one figure in several cases. A method that breaks a law by
//! design declares a [`Deviation`] beside its registration: its figures must then lie within what it declares, and one of
//! them outside what the law allows, so that no declaration outlives its reason.

/// A law, named by what it says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Law {
    /// A constant picture stays constant.
    Constancy,
    /// An isolated emitter keeps its energy.
    Energy,
    /// An isolated emitter stays where it is.
    Place,
    /// An isolated emitter spreads as the aperture does.
    Spread,
    /// A focused, opaque front hides a blurred back.
    Occlusion,
    /// A blurred front lets the back show through its middle.
    SeeThrough,
    /// A focused back shows at full sharpness through a blurred front.
    Sharpness,
    /// Light through half a veil is halved.
    Veil,
    /// An object before nothing leaves a picture with its own coverage.
    Transparency,
    /// A mirrored or turned scene gives the mirrored or turned picture.
    Symmetry,
    /// A small change of focus makes a small change of picture.
    Continuity,
    /// A slanted surface has no cracks.
    NoCracks,
    /// A surface steep across the corners of its samples has no cracks either.
    NoCracksAcrossCorners,
    /// With many samples the picture is the reference's.
    Convergence,
    /// A supersampled stack gives the picture that its samples stand for.
    Supersampling,
}

impl Law {
    /// What is measured of it.
    pub fn figure(&self) -> &'static str {
        match self {
            Self::Constancy => "largest difference of a constant picture",
            Self::Energy => "energy of a lone point of light, after over before",
            Self::Place => "how far a lone point of light moves, in pixels",
            Self::Spread => "variance of a lone point's blur, over the aperture's",
            Self::Occlusion => "largest difference of what is in focus before a blurred back",
            Self::SeeThrough => {
                "share of the back that shows through a blurred bar, 0.5 where nothing is missing"
            }
            Self::Sharpness => "largest difference of what is in focus behind a blurred front",
            Self::Veil => "largest difference behind half a veil",
            Self::Transparency => "coverage of an object before nothing, after over before",
            Self::Symmetry => "dB between the picture of a mirrored scene and the mirrored picture",
            Self::Continuity => "dB between two pictures whose focus differs by 0.02 px",
            Self::NoCracks | Self::NoCracksAcrossCorners => {
                "largest share of a bright wall that shows through a slanted surface"
            }
            Self::Convergence => "dB from the reference",
            Self::Supersampling => "dB from the reference, for four samples a pixel",
        }
    }
}

/// A law that a method breaks by design.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Deviation {
    /// Which.
    pub law: Law,
    /// Least and greatest figure ([`Law::figure`]) that the method reaches over all cases of the law's test.
    pub within: [f32; 2],
    /// Why, as the method's source has it.
    pub reason: &'static str,
}
