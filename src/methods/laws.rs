//! The laws of the blur, and a method's declared deviations from them.
//!
//! `tests/laws.rs` checks every method against every law: it measures one figure in several cases. A method that breaks a law by
//! design declares a [`Deviation`] in its [`MethodInfo`](super::MethodInfo). Its figures must then lie within the declared range,
//! and at least one of them outside what the law allows, so that a declaration without need fails the test.

/// A law of the blur.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Law {
    /// A constant picture stays constant.
    Constancy,
    /// An isolated emitter keeps its energy.
    Energy,
    /// An isolated emitter does not move.
    Place,
    /// The blur of an isolated emitter has the variance of the aperture's shape.
    Spread,
    /// A focused, opaque foreground occludes a blurred background.
    Occlusion,
    /// The background is visible through the middle of a blurred foreground.
    SeeThrough,
    /// A focused background is fully sharp behind a blurred foreground.
    Sharpness,
    /// A translucent layer of alpha 0.5 halves the light behind it.
    Veil,
    /// The picture of an object without a background has the coverage of the object.
    Transparency,
    /// A clear pixel in a closed picture changes nothing beyond the largest blur of it.
    Locality,
    /// A translucent element alone keeps its alpha and its colour.
    Element,
    /// A constant colour, divided by alpha, stays constant whatever the alpha.
    ConstantColor,
    /// The edge of an object without a background has the coverage of its blur.
    Edge,
    /// A mirrored or rotated scene gives the mirrored or rotated picture.
    Symmetry,
    /// A small change of focus changes the picture little.
    Continuity,
    /// A slanted surface has no cracks.
    NoCracks,
    /// A surface that is steep along the diagonal of its samples has no cracks.
    NoCracksAcrossCorners,
    /// With many samples the picture converges to the reference's.
    Convergence,
    /// A supersampled stack gives the picture of the scene that its samples represent.
    Supersampling,
}

impl Law {
    /// The figure that the law's test measures.
    pub fn figure(&self) -> &'static str {
        match self {
            Self::Constancy => "largest difference in a constant picture",
            Self::Energy => "energy of a lone point of light, after over before",
            Self::Place => "how far a lone point of light moves, in pixels",
            Self::Spread => "variance of a lone point's blur, over the aperture's",
            Self::Occlusion => "largest difference in a focused foreground before a blurred background",
            Self::SeeThrough => {
                "share of the background visible through a blurred bar, 0.5 where nothing is missing"
            }
            Self::Sharpness => "largest difference in a focused background behind a blurred foreground",
            Self::Veil => "largest difference behind a layer of alpha 0.5",
            Self::Transparency => "coverage of an object without a background, after over before",
            Self::Locality => "largest difference beyond the blur of pixels that become clear",
            Self::Element => "largest difference in a lone element of constant alpha and colour",
            Self::ConstantColor => "largest difference of a constant colour, times alpha",
            Self::Edge => "largest difference of the edge of a lone object from the integral of its disc",
            Self::Symmetry => "dB between the picture of a mirrored scene and the mirrored picture",
            Self::Continuity => "dB between two pictures whose focus differs by 0.02 px",
            Self::NoCracks | Self::NoCracksAcrossCorners => {
                "largest share of a bright wall visible through a slanted surface"
            }
            Self::Convergence => "dB from the reference",
            Self::Supersampling => "dB from the reference, for four samples a pixel",
        }
    }
}

/// A law that a method breaks by design.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Deviation {
    /// The law.
    pub law: Law,
    /// Minimum and maximum of the figure ([`Law::figure`]) over all cases of the law's test.
    pub within: [f32; 2],
    /// Reason, from the method's source.
    pub reason: &'static str,
}
