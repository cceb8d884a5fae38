//! Which depth convention a stack is written in, and why that is believed.

use super::camera;
use super::kind::SceneStats;
use crate::finding::Finding;
use crate::settings::DepthConvention;
use exr::meta::attribute::{AttributeValue, Text};

/// What the file says about its depth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evidence<'a> {
    /// What the user says.
    pub(super) chosen: Option<DepthConvention>,
    /// `thinlens.depth_convention`.
    pub(super) header: Option<DepthConvention>,
    /// All attributes.
    pub(super) attributes: &'a [(Text, AttributeValue)],
    /// Full name of the first peel's depth channel.
    pub(super) depth_channel: &'a str,
}

/// A convention, and whether it is more than a guess.
#[derive(Debug, Clone, Copy)]
pub(super) struct Conclusion {
    /// How depth is written.
    pub(super) convention: DepthConvention,
    /// Nothing in the file speaks for it.
    pub(super) guessed: bool,
}

/// The convention by what was asked for, else by the header, else by who wrote the file.
pub(super) fn conclude(evidence: Evidence<'_>) -> (Conclusion, Finding) {
    let said = |convention, reason: String| {
        let text = format!("{}: {reason}", described(convention));
        (Conclusion { convention, guessed: false }, Finding::note("depth", text))
    };
    if let Some(convention) = evidence.chosen {
        return said(convention, "as asked for".to_owned());
    }
    if let Some(convention) = evidence.header {
        return said(convention, "thinlens.depth_convention in the header".to_owned());
    }
    if let Some(writer) =
        camera::text(evidence.attributes, "generatedBy").filter(|by| by.starts_with("Mitsuba"))
    {
        return said(DepthConvention::Ray, format!("written by {writer}"));
    }
    let ending = evidence.depth_channel.rsplit('.').next().unwrap_or_default();
    if ending == "T" {
        return said(
            DepthConvention::Ray,
            format!("the channel is called {} (Mitsuba)", evidence.depth_channel),
        );
    }
    if evidence.attributes.iter().any(|(name, _)| name.eq("BlenderMultiChannel")) {
        return said(DepthConvention::Planar, "written by Blender".to_owned());
    }
    let text = format!("{}: assumed, the file does not say", described(DepthConvention::Planar));
    (Conclusion { convention: DepthConvention::Planar, guessed: true }, Finding::note("depth", text))
}

/// A doubt about a guessed convention, from the values themselves.
pub(super) fn doubt(conclusion: Conclusion, stats: &SceneStats) -> Option<Finding> {
    let [nearest, farthest] = stats.depth_range?;
    (conclusion.guessed && farthest <= 1.0).then(|| {
        let text = format!(
            "all depths lie between {nearest} and {farthest}, which looks normalised or inverse; taken as planar: \
             say which with `convention`"
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
    fn the_convention_asked_for_beats_what_the_file_says() {
        let chosen = concluded(&[("generatedBy", "Mitsuba")], "depth.T", Some(DepthConvention::Inverse));
        assert_eq!(chosen.convention, DepthConvention::Inverse);
    }
}
