//! Translucent scenes on a GPU: a ray remembers its last hit in each layer, in memory of fixed size.

use crate::error::Error;
use crate::scene::{Layer, MAX_TRANSLUCENT_LAYERS, OPAQUE_ALPHA};
use std::borrow::Borrow;

/// Whether some fragment of `layers` is translucent.
///
/// # Errors
/// [`crate::error::ErrorKind::Device`] if one is, and there are more layers than a ray remembers.
pub(in crate::methods) fn has_translucent<L: Borrow<Layer>>(layers: &[L]) -> Result<bool, Error> {
    let found = layers.iter().any(|layer| is_translucent(layer.borrow()));
    if found && layers.len() > MAX_TRANSLUCENT_LAYERS {
        return Err(Error::device("the layers of a translucent scene are too many for the GPU")
            .with("found", format!("{} layers", layers.len()))
            .with("expected", format!("{MAX_TRANSLUCENT_LAYERS} layers at most, or opaque fragments only"))
            .help("use `device = cpu`"));
    }
    Ok(found)
}

/// Whether some fragment of `layer` is translucent.
fn is_translucent(layer: &Layer) -> bool {
    layer.alpha.values().iter().fold(false, |any, &alpha| any | ((alpha > 0.0) & (alpha < OPAQUE_ALPHA)))
}
