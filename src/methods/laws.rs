//! The laws of the blur, and a method's declared deviations from them.
//!
//! `tests/laws.rs` and `tests/continuity` check every method against every law: they measure one figure in several cases. A method that breaks a law by
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
    /// A translucent plane lets the same light pass however it is tilted.
    TiltedPane,
    /// A translucent plane that goes on in the next peel counts once.
    SheetOfTwoPeels,
    /// The alpha of a soft object without a background is the mean over the lens.
    SoftDisc,
    /// A changed sample changes nothing beyond its blur.
    LocalChange,
    /// A steep opaque surface lets no light pass.
    SteepRamp,
    /// A rough opaque surface lets hardly any light pass.
    Relief,
    /// A lens that changes evenly changes the picture evenly.
    EvenSweep,
    /// A lens that changes changes the picture.
    FrozenFrames,
    /// The peak of a point of light falls as its disc grows.
    Peak,
    /// The picture becomes the input as the lens closes.
    NearFocus,
    /// The picture does not jump as the lens closes.
    StepNearFocus,
    /// Any number of peels is seen.
    ManyPeels,
    /// The order of a stack's peels does not matter.
    PeelOrder,
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
            Self::TiltedPane => {
                "error of the mean light through a tilted translucent plane, or of its mean alpha"
            }
            Self::SheetOfTwoPeels => {
                "error of the mean light through a translucent plane that goes on in the next peel"
            }
            Self::SoftDisc => "largest error of alpha in a soft disc with nothing behind it",
            Self::LocalChange => "largest change beyond the blur of a changed sample",
            Self::SteepRamp => "mean share of a white wall visible through a steep opaque plane",
            Self::Relief => "mean share of a white wall visible through a rough opaque surface",
            Self::EvenSweep => "largest change between two frames of a sweep, over the mean change",
            Self::FrozenFrames => "frames of 45 in a sweep that do not change",
            Self::Peak => "relative error of the peak of a point of light",
            Self::NearFocus => "largest difference from the input at a CoC radius of 0.02 px or less",
            Self::StepNearFocus => "largest change of a pixel between two CoC radii 0.01 px apart",
            Self::ManyPeels => "largest difference in an even picture that 300 peels hold",
            Self::PeelOrder => "largest difference between pictures of the same peels in another order",
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
