//! Reciprocal distance, as the 3D renderer of a compositor writes it.
//!
//! Nuke's own renderer writes 1 / z; pictures of other renderers that Nuke only saved again keep their distances, in the same channel.
//! So the values decide where the header names Nuke: reciprocals of distances are mostly below 1, distances mostly above.

use super::convention::Conclusion;
use crate::error::Error;
use crate::finding::Finding;
use crate::settings::DepthConvention;
use exr::meta::attribute::{AttributeValue, Text};

/// Start of the names of Nuke's attributes.
const NUKE: &str = "nuke/";
/// Share of values on the other side of 1 from which on the conclusion is a warning.
const DOUBTED: f64 = 0.25;

/// Whether the header `attributes` is of a file that Nuke saved.
pub(super) fn is_by_compositor(attributes: &[(Text, AttributeValue)]) -> bool {
    attributes.iter().any(|(name, _)| name.to_string().starts_with(NUKE))
}

/// What the values of a file by Nuke mean; `below_one` is the share of its depths below 1, `None` where only a part of them is read.
///
/// # Errors
/// A part, which may differ from the whole.
pub(super) fn conclude(below_one: Option<f64>) -> Result<(Conclusion, Finding), Error> {
    let below_one = below_one.ok_or_else(|| {
        Error::settings("Nuke saved the file, and a part of it does not tell whether depth is 1 / distance")
            .help("set `convention = inverse` or `convention = planar`, or allow more memory with `memory`")
    })?;
    let is_inverse = below_one >= 0.5;
    let (convention, kind) = match is_inverse {
        true => (DepthConvention::Inverse, "inverse depth, 1 / distance"),
        false => (DepthConvention::Planar, "planar depth"),
    };
    let text = format!(
        "{kind}: Nuke saved the file, whose own renderer writes 1 / distance, and {:.1} % of the values are below 1; `convention` \
         overrules it",
        100.0 * below_one
    );
    let doubted = below_one.min(1.0 - below_one) >= DOUBTED;
    let finding = if doubted { Finding::warning("depth", text) } else { Finding::note("depth", text) };
    Ok((Conclusion { convention, guessed: false }, finding))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_mostly_below_one_are_reciprocals() {
        let concluded =
            |share| conclude(Some(share)).map(|(found, text)| (found.convention, text.warning)).unwrap();
        assert_eq!(concluded(0.97), (DepthConvention::Inverse, false));
        assert_eq!(concluded(0.0), (DepthConvention::Planar, false));
        assert_eq!(concluded(0.6), (DepthConvention::Inverse, true));
        assert!(conclude(None).is_err());
    }

    #[test]
    fn nuke_is_known_by_its_attributes() {
        let attribute = |name: &str| [(Text::new_or_panic(name), AttributeValue::Text(Text::from("15.0v4")))];
        assert!(is_by_compositor(&attribute("nuke/version")));
        assert!(!is_by_compositor(&attribute("software")));
    }
}
