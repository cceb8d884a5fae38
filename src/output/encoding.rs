//! How a picture is stored: what determines its file beside the picture.

use super::exr::{Codec, ExrOptions};
use crate::stack::Precision;

/// How a picture is stored in its file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Encoding {
    /// Numeric type of an EXR's `R G B A`; that of the input if `None`.
    pub precision: Option<Precision>,
    /// Compression of an EXR.
    pub codec: Codec,
    /// Exposure of a PNG in stops.
    pub exposure_stops: f32,
}

impl Encoding {
    /// The options of an EXR, for an input of the numeric type `input`.
    pub fn exr_options(&self, input: Precision) -> ExrOptions {
        ExrOptions { precision: self.precision.unwrap_or(input), codec: self.codec }
    }
}
