//! The program that wrote a file, from the attributes of its header.

use super::attributes::text;
use exr::meta::attribute::{AttributeValue, Text};

/// A program that writes OpenEXR files in a way of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Writer {
    Blender,
    Nuke,
    Unreal,
    /// Programs that render USD scenes: husk, Karma, usdrecord.
    Usd,
    VRay,
}

/// Attributes whose text names the program.
const PROGRAM: [&str; 5] = ["generatedBy", "software", "Software", "writer", "creator"];

impl Writer {
    /// How the names of its attributes begin, and the words that name it in those of [`PROGRAM`]; both in small letters.
    fn marks(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Blender => (&["blendermultichannel"], &["blender"]),
            Self::Nuke => (&["nuke/"], &["nuke"]),
            Self::Unreal => (&["unreal/"], &["unreal"]),
            Self::Usd => {
                (&["usd/", "usd:", "husk", "karma", "hydra"], &["usd", "husk", "karma", "hydra", "houdini"])
            }
            Self::VRay => (&["vrayinfo/", "cameratransform"], &["v-ray", "vray"]),
        }
    }

    /// Whether it wrote the file with these attributes.
    pub(super) fn wrote(self, attributes: &[(Text, AttributeValue)]) -> bool {
        let (prefixes, words) = self.marks();
        let is_marked = |(name, _): &(Text, AttributeValue)| {
            let name = name.to_string().to_ascii_lowercase();
            prefixes.iter().any(|prefix| name.starts_with(prefix))
        };
        let names_it = |name: &&str| {
            let program = text(attributes, name).unwrap_or_default().to_ascii_lowercase();
            words.iter().any(|word| program.contains(word))
        };
        attributes.iter().any(is_marked) || PROGRAM.iter().any(names_it)
    }
}
