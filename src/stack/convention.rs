//! Detection of a stack's depth convention, with the reason.

use super::camera;
use crate::finding::Finding;
use crate::settings::DepthConvention;
use exr::meta::attribute::{AttributeValue, Text};

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
    let known = |convention, reason: String| {
        let text = format!("{}: {reason}", described(convention));
        (Conclusion { convention, guessed: false }, Finding::note("depth", text))
    };
    if let Some(convention) = evidence.chosen {
        return known(convention, "as requested".to_owned());
    }
    if let Some(convention) = evidence.header {
        return known(convention, "thinlens.depth_convention in the header".to_owned());
    }
    if let Some(writer) =
        camera::text(evidence.attributes, "generatedBy").filter(|by| by.starts_with("Mitsuba"))
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
    if evidence.attributes.iter().any(|(name, _)| name.eq("BlenderMultiChannel")) {
        return known(DepthConvention::Planar, "written by Blender".to_owned());
    }
    let text = format!("{}: assumed, the file does not specify it", described(DepthConvention::Planar));
    (Conclusion { convention: DepthConvention::Planar, guessed: true }, Finding::note("depth", text))
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
        conclude(Evidence { chosen, header: None, attributes: &attributes, depth_channel }).0
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
    fn the_requested_convention_overrides_the_file() {
        let chosen = concluded(&[("generatedBy", "Mitsuba")], "depth.T", Some(DepthConvention::Inverse));
        assert_eq!(chosen.convention, DepthConvention::Inverse);
    }
}
