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

/// All of them.
const WRITERS: [Writer; 5] = [Writer::Blender, Writer::Nuke, Writer::Unreal, Writer::Usd, Writer::VRay];

/// Attributes whose text names the program.
const PROGRAM: [&str; 5] = ["generatedBy", "software", "Software", "writer", "creator"];

/// Whether an attribute of this name says which program wrote the file.
pub(super) fn identifies(name: &Text) -> bool {
    let name = name.to_string();
    let is_program = PROGRAM.contains(&name.as_str());
    is_program || WRITERS.iter().any(|writer| writer.marks_with(&name))
}

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

    /// Whether `name` is that of one of its attributes.
    fn marks_with(self, name: &str) -> bool {
        let name = name.to_ascii_lowercase();
        self.marks().0.iter().any(|prefix| name.starts_with(prefix))
    }

    /// Whether it wrote the file with these attributes.
    pub(super) fn wrote(self, attributes: &[(Text, AttributeValue)]) -> bool {
        let (_, words) = self.marks();
        let is_marked = |(name, _): &(Text, AttributeValue)| self.marks_with(&name.to_string());
        let names_it = |name: &&str| {
            let program = text(attributes, name).unwrap_or_default().to_ascii_lowercase();
            words.iter().any(|word| program.contains(word))
        };
        attributes.iter().any(is_marked) || PROGRAM.iter().any(names_it)
    }
}
