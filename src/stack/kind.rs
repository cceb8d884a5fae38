//! The kind of a stack, where it is announced, and what was found of it where it is not.

use super::antialiasing::Antialiasing;
use super::silhouettes::antialiasing;
use super::{Peel, StackKind};
use crate::error::Error;
use crate::finding::Finding;
use crate::settings::DepthConvention;

/// What determines the kind of a stack.
#[derive(Debug, Clone, Copy)]
pub(super) struct Announced {
    /// The kind that the user or the header sets.
    pub(super) kind: Option<StackKind>,
    /// Samples per picture pixel along each axis.
    pub(super) supersample: usize,
}

impl Announced {
    /// Whether one peel would be one picture with depth.
    pub(super) fn is_beauty(self) -> bool {
        self.supersample == 1 && self.kind.is_none_or(|kind| kind == StackKind::BeautyDepth)
    }
}

/// The kind of all of `peels`, if there is one, with how far their colours are averages over the pixel.
///
/// # Errors
/// A kind that contradicts the number of samples per pixel or of peels.
pub(super) fn conclude(
    peels: &[Peel],
    convention: DepthConvention,
    announced: Announced,
) -> Result<(Option<StackKind>, Antialiasing, Finding), Error> {
    check(announced, peels.len())?;
    let note = |text: String| Finding::note("kind", text);
    let everywhere =
        |kind: StackKind, text: String| (Some(kind), Antialiasing::from(kind), Finding::note("kind", text));
    let samples = announced.supersample;
    Ok(match announced.kind {
        _ if samples > 1 => everywhere(
            StackKind::Supersampled,
            format!("supersampled peels: {samples}×{samples} samples per picture pixel, as specified"),
        ),
        Some(kind) => everywhere(kind, format!("{} everywhere, as specified", kind.name())),
        None if peels.len() <= 1 => everywhere(
            StackKind::BeautyDepth,
            "one picture with depth: surfaces behind it are unknown, so the background behind blurred foregrounds is \
             estimated; its colours count as averages over the pixel: set `kind` if they are point samples"
                .to_owned(),
        ),
        None => {
            let found = antialiasing(peels, convention);
            let text = described(&found);
            (None, found, note(text))
        }
    })
}

fn described(found: &Antialiasing) -> String {
    let reason = match found.everywhere() {
        Some(share) if share <= 0.0 => "silhouettes are hard",
        Some(share) if share >= 1.0 => "silhouettes have rims",
        _ => "silhouettes are hard in places and have rims in others",
    };
    format!("{}: {reason}; `kind` overrules it", found.in_words())
}

/// Refuses a kind that contradicts the rest of the stack.
fn check(Announced { kind, supersample }: Announced, peels: usize) -> Result<(), Error> {
    match kind {
        Some(StackKind::Supersampled) if supersample == 1 => {
            Err(Error::settings("a supersampled stack has more than one sample a pixel")
                .with("found", "`kind = supersampled`, 1 sample a pixel")
                .help("set the samples a pixel along each axis, `supersample`, or another `kind`"))
        }
        Some(kind) if kind != StackKind::Supersampled && supersample > 1 => Err(Error::settings(format!(
            "a stack with {supersample}×{supersample} samples a pixel is supersampled"
        ))
        .with("found", format!("`kind = {}`, `supersample = {supersample}`", kind.name()))
        .help("set `kind = supersampled`, or `supersample = 1`")),
        Some(StackKind::BeautyDepth) if peels > 1 => {
            Err(Error::settings("`kind = beauty` is one picture with depth, without peels behind it")
                .with("found", format!("{peels} peels"))
                .help("give one picture, or set `kind` to what the peels are: `point` or `coverage`"))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    fn peel(width: usize, alpha: f32, depth: f32) -> Peel {
        let plane = |value| Plane::filled(width, 1, value);
        Peel { color: std::array::from_fn(|_| plane(alpha)), alpha: plane(alpha), depth: plane(depth) }
    }

    fn concluded(
        peels: &[Peel],
        kind: Option<StackKind>,
        supersample: usize,
    ) -> Result<Antialiasing, String> {
        conclude(peels, DepthConvention::Planar, Announced { kind, supersample })
            .map(|(_, antialiasing, _)| antialiasing)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn one_peel_is_anti_aliased_unless_it_is_announced_as_point_samples() {
        let one = [peel(4, 1.0, 3.0)];
        assert_eq!(concluded(&one, None, 1), Ok(Antialiasing::AVERAGES));
        assert_eq!(concluded(&one, Some(StackKind::PointSampled), 1), Ok(Antialiasing::POINT_SAMPLES));
    }

    #[test]
    fn an_announced_kind_overrules_what_the_peels_show() {
        let opaque = [peel(4, 1.0, 3.0), peel(4, 1.0, 5.0)];
        assert_eq!(concluded(&opaque, None, 1), Ok(Antialiasing::POINT_SAMPLES));
        assert_eq!(concluded(&opaque, Some(StackKind::Coverage), 1), Ok(Antialiasing::AVERAGES));
        assert_eq!(concluded(&opaque, Some(StackKind::Supersampled), 2), Ok(Antialiasing::AVERAGES));
    }

    #[test]
    fn contradictions_are_refused_with_the_way_out() {
        let two = [peel(4, 1.0, 3.0), peel(4, 1.0, 5.0)];
        let refused = |kind, supersample| concluded(&two, Some(kind), supersample).unwrap_err();
        assert!(refused(StackKind::Supersampled, 1).contains("`supersample`"));
        assert!(refused(StackKind::Coverage, 2).contains("`kind = supersampled`"));
        assert!(refused(StackKind::BeautyDepth, 1).contains("2 peels"));
    }
}
