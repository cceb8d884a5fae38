//! Detection of a stack's depth convention, with the reason.

use super::attributes;
use super::depth::BACKGROUND;
use super::writer::Writer;
use crate::finding::Finding;
use crate::settings::DepthConvention;
use exr::meta::attribute::{AttributeValue, Text};

/// Share of depths on the other side of 1 from which it is uncertain whether they are reciprocals.
const UNCERTAIN: f64 = 0.1;

/// Everything that indicates the depth convention of a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evidence<'a> {
    /// The convention requested by the user.
    pub(super) chosen: Option<DepthConvention>,
    /// The header attribute `thinlens.depth_convention`.
    pub(super) header: Option<DepthConvention>,
    /// All attributes.
    pub(super) attributes: &'a [(Text, AttributeValue)],
    /// Full name of the first peel's depth channel.
    pub(super) depth_channel: &'a str,
    /// Depths of the first peel.
    pub(super) depths: &'a [f32],
}

/// A convention, and whether it is a guess.
#[derive(Debug, Clone, Copy)]
pub(super) struct Conclusion {
    /// How depth is written.
    pub(super) convention: DepthConvention,
    /// Whether nothing in the file indicates it.
    pub(super) guessed: bool,
}

/// The requested convention, else that of the header, else that of the program that wrote the file.
pub(super) fn conclude(evidence: Evidence<'_>) -> (Conclusion, Finding) {
    let channel = Some(evidence.depth_channel).filter(|name| !name.is_empty());
    let of_channel = channel.map(|name| format!(" in {name}")).unwrap_or_default();
    let known = |convention, reason: String| {
        let text = format!("{}{of_channel}: {reason}", described(convention));
        (Conclusion { convention, guessed: false }, Finding::note("depth", text))
    };
    if let Some(convention) = evidence.chosen {
        return known(convention, "as requested".to_owned());
    }
    if let Some(convention) = evidence.header {
        return known(convention, "thinlens.depth_convention in the header".to_owned());
    }
    if let Some(writer) =
        attributes::text(evidence.attributes, "generatedBy").filter(|by| by.starts_with("Mitsuba"))
    {
        return known(DepthConvention::Ray, format!("written by {writer}"));
    }
    let ending = evidence.depth_channel.rsplit('.').next().unwrap_or_default();
    if ending == "T" {
        return known(
            DepthConvention::Ray,
            format!("the channel is called {} (Mitsuba)", evidence.depth_channel),
        );
    }
    if Writer::Blender.wrote(evidence.attributes) {
        return known(DepthConvention::Planar, "written by Blender".to_owned());
    }
    if Writer::Nuke.wrote(evidence.attributes)
        && let Some(below) = share_below_one(evidence.depths)
    {
        return of_nuke(below, &of_channel);
    }
    let text =
        format!("{}{of_channel}: assumed, the file does not specify it", described(DepthConvention::Planar));
    (Conclusion { convention: DepthConvention::Planar, guessed: true }, Finding::note("depth", text))
}

/// What depth is in a file of Nuke, of which the share `below` is less than 1: its own renderer writes 1 / distance, and what it only passes
/// through is as it was.
fn of_nuke(below: f64, of_channel: &str) -> (Conclusion, Finding) {
    let percent = 100.0 * below;
    let is_inverse = below > 0.5;
    let convention = if is_inverse { DepthConvention::Inverse } else { DepthConvention::Planar };
    let other = if is_inverse { "planar" } else { "inverse" };
    let text = format!(
        "{}{of_channel}: written by Nuke, whose 3D renderer writes 1 / distance; {percent:.0} % of the values are below 1; \
         `convention = {other}` reads them otherwise",
        described(convention)
    );
    let is_uncertain = (UNCERTAIN..1.0 - UNCERTAIN).contains(&below);
    let finding = if is_uncertain { Finding::warning("depth", text) } else { Finding::note("depth", text) };
    (Conclusion { convention, guessed: !is_inverse }, finding)
}

/// The share of the depths that are below 1, of those that are distances or their reciprocals; `None` without any.
fn share_below_one(depths: &[f32]) -> Option<f64> {
    let known = depths.iter().filter(|depth| **depth > 0.0 && **depth < BACKGROUND);
    let (below, all) =
        known.fold((0u64, 0u64), |(below, all), depth| (below + u64::from(*depth < 1.0), all + 1));
    (all > 0).then(|| below as f64 / all as f64)
}

/// A warning if the smallest and largest depth contradict a guessed convention.
pub(super) fn doubt(conclusion: Conclusion, depth_range: Option<[f32; 2]>) -> Option<Finding> {
    let [nearest, farthest] = depth_range?;
    (conclusion.guessed && farthest <= 1.0).then(|| {
        let text = format!(
            "all depths are between {nearest} and {farthest}, as in normalised or inverse depth; assumed planar: \
             set `convention`"
        );
        Finding::warning("depth", text)
    })
}

fn described(convention: DepthConvention) -> &'static str {
    match convention {
        DepthConvention::Planar => "planar depth",
        DepthConvention::Ray => "depth along the ray",
        DepthConvention::Inverse => "inverse depth",
        DepthConvention::Normalised => "normalised depth",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn concluded(
        attributes: &[(&str, &str)],
        depth_channel: &str,
        chosen: Option<DepthConvention>,
    ) -> Conclusion {
        let text = |text: &str| Text::new_or_panic(text);
        let attributes: Vec<_> =
            attributes.iter().map(|(name, value)| (text(name), AttributeValue::Text(text(value)))).collect();
        conclude(Evidence { chosen, header: None, attributes: &attributes, depth_channel, depths: &[] }).0
    }

    #[test]
    fn mitsuba_writes_depth_along_the_ray_and_blender_planar_depth() {
        let mitsuba = concluded(&[("generatedBy", "Mitsuba version 3.9.1")], "peel0.depth", None);
        assert_eq!((mitsuba.convention, mitsuba.guessed), (DepthConvention::Ray, false));
        let blender =
            concluded(&[("BlenderMultiChannel", "Blender V2.55.1 and newer")], "Peel0.Depth.Z", None);
        assert_eq!((blender.convention, blender.guessed), (DepthConvention::Planar, false));
        assert_eq!(concluded(&[], "depth.T", None).convention, DepthConvention::Ray);
        assert!(concluded(&[], "Z", None).guessed);
    }

    #[test]
    fn depth_of_nukes_renderer_is_inverse_by_its_values_and_passes_through_otherwise() {
        let by_nuke = |depths: &[f32]| {
            let text = AttributeValue::Text(Text::new_or_panic("15.0v4"));
            let attributes = vec![(Text::new_or_panic("nuke/version"), text)];
            let evidence = Evidence {
                chosen: None,
                header: None,
                attributes: &attributes,
                depth_channel: "depth.Z",
                depths,
            };
            let (conclusion, finding) = conclude(evidence);
            (conclusion.convention, finding.warning)
        };
        // 1 / 12, 1 / 3 and 1 / 0.8 with background; distances of 12, 3 and 0.8.
        assert_eq!(by_nuke(&[0.083, 0.333, 0.0]), (DepthConvention::Inverse, false));
        assert_eq!(by_nuke(&[0.083, 0.333, 1.25, 0.0]), (DepthConvention::Inverse, true));
        assert_eq!(by_nuke(&[12.0, 3.0, 0.8, 1e10]), (DepthConvention::Planar, true));
        assert_eq!(by_nuke(&[12.0, 3.0, 5.0, 0.0]), (DepthConvention::Planar, false));
    }

    #[test]
    fn the_requested_convention_overrides_the_file() {
        let chosen = concluded(&[("generatedBy", "Mitsuba")], "depth.T", Some(DepthConvention::Inverse));
        assert_eq!(chosen.convention, DepthConvention::Inverse);
    }
}
