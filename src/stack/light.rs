//! Light without alpha: what shines and hides nothing, as flames, glows, shafts and additive passes are written.
//!
//! Its fragments get [`LIGHT_ALPHA`], so that a method sees them as it sees all others: their colour is premultiplied, adds to what is
//! behind, and what is before them hides it. A light has the depth that its file gives it. Where that is background, it has the depth of what
//! it lies on, the nearest fragment behind it in its pixel; where there is nothing behind, it stays as far as the background.

use super::Peel;
use super::depth::foreground;
use crate::finding::Finding;
use crate::parallel;
use crate::settings::DepthConvention;
use pulp::{Arch, NullaryFnOnce};

/// The alpha of light that hides nothing: half of the last place of 1, so that `1 − LIGHT_ALPHA` is 1 in the arithmetic of `f32` and what is
/// behind such a fragment keeps its bits. A colour divided by it stays finite.
pub const LIGHT_ALPHA: f32 = 1.0 / (1 << 25) as f32;

/// What was found in a row, or in all rows.
#[derive(Debug, Clone, Copy, Default)]
struct Found {
    /// Fragments of colour without alpha.
    lights: usize,
    /// Those of them that took the depth of what they lie on.
    placed: usize,
    /// Those of them that have a depth of their own.
    own: usize,
}

impl Found {
    fn plus(self, other: Self) -> Self {
        Self {
            lights: self.lights + other.lights,
            placed: self.placed + other.placed,
            own: self.own + other.own,
        }
    }
}

/// Makes fragments of the colours that have no alpha. Says how many there are, and whether any has a depth of its own: its pixel may have to
/// be sorted then.
pub(super) fn complete(peels: &mut [Peel], convention: DepthConvention) -> (Option<Finding>, bool) {
    let mut found = Found::default();
    // The deepest first, so that a light that lies on another has the depth of both.
    for i in (0..peels.len()).rev() {
        let (nearer, behind) = peels.split_at_mut(i + 1);
        if let Some(peel) = nearer.last_mut() {
            found = found.plus(complete_peel(peel, behind, convention));
        }
    }
    let Found { lights, placed, own } = found;
    if lights == 0 {
        return (None, false);
    }
    let depth = format!(
        "{placed} of them without depth have that of what they lie on, {} are as far as the background",
        lights - placed - own
    );
    let text =
        format!("{lights} fragments have colour and no alpha: light, which adds and hides nothing; {depth}");
    let hides_nothing = |peel: &Peel| peel.alpha.values().iter().all(|&alpha| alpha <= LIGHT_ALPHA);
    let finding = if peels.iter().all(hides_nothing) {
        let text = format!("{text}; alpha is 0 everywhere: if it is only missing, use `alpha = opaque`");
        Finding::warning("light", text)
    } else {
        Finding::note("light", text)
    };
    (Some(finding), own > 0)
}

/// Completes one peel, with the peels behind it.
fn complete_peel(peel: &mut Peel, behind: &[Peel], convention: DepthConvention) -> Found {
    let (width, foreground, arch) = (peel.alpha.width().max(1), foreground(convention), Arch::new());
    let Peel { color: [red, green, blue], alpha, depth } = peel;
    let color = [&*red, &*green, &*blue];
    let below = |x: usize, y: usize| {
        behind.iter().find(|peel| peel.alpha.get(x, y) > 0.0).map(|peel| peel.depth.get(x, y))
    };
    let complete_row = |y: usize, (alpha, depth): (&mut [f32], &mut [f32])| {
        let (mut found, rows) = (Found::default(), color.map(|plane| plane.row(y)));
        // Most rows have no light: loops without branches say so.
        if !arch.dispatch(HasLight { color: rows, alpha }) {
            return found;
        }
        for (x, (alpha, depth)) in alpha.iter_mut().zip(depth).enumerate() {
            if *alpha > 0.0 || rows.iter().all(|row| row[x] == 0.0) {
                continue;
            }
            *alpha = LIGHT_ALPHA;
            found.lights += 1;
            if foreground.contains(depth) {
                found.own += 1;
            } else if let Some(below) = below(x, y) {
                *depth = below;
                found.placed += 1;
            }
        }
        found
    };
    let rows = alpha.values_mut().chunks_mut(width).zip(depth.values_mut().chunks_mut(width));
    parallel::map_each(rows, &complete_row).into_iter().fold(Found::default(), Found::plus)
}

/// Whether a row has colours without alpha.
struct HasLight<'a> {
    color: [&'a [f32]; 3],
    alpha: &'a [f32],
}

impl NullaryFnOnce for HasLight<'_> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let Self { color: [red, green, blue], alpha } = self;
        // Most rows of the first peel are covered.
        let covered = alpha.iter().fold(true, |covered, &alpha| covered & (alpha > 0.0));
        let colors = red.iter().zip(green).zip(blue);
        !covered
            && alpha.iter().zip(colors).fold(false, |found, (&alpha, ((&red, &green), &blue))| {
                let black = (red == 0.0) & (green == 0.0) & (blue == 0.0);
                found | !((alpha > 0.0) | black)
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// A peel of one row, `(colour, alpha, depth)` each.
    fn peel(row: &[(f32, f32, f32)]) -> Peel {
        let plane = |of: fn(&(f32, f32, f32)) -> f32| Plane::from_fn(row.len(), 1, |x, _| of(&row[x]));
        Peel {
            color: [plane(|of| of.0), plane(|_| 0.0), plane(|_| 0.0)],
            alpha: plane(|of| of.1),
            depth: plane(|of| of.2),
        }
    }

    #[test]
    fn light_hides_nothing_to_the_last_bit() {
        assert_eq!(1.0 - LIGHT_ALPHA, 1.0);
        assert!((65504.0 / LIGHT_ALPHA).is_finite());
    }

    #[test]
    fn a_light_has_its_own_depth_or_that_of_what_it_lies_on_or_the_backgrounds() {
        let mut peels = [
            peel(&[(1.0, 0.0, 5.0), (1.0, 0.0, 1e10), (1.0, 0.0, 1e10), (0.0, 0.0, 1e10), (0.5, 0.5, 2.0)]),
            peel(&[(1.0, 1.0, 9.0), (2.0, 0.0, 1e10), (0.0, 0.0, 1e10), (0.0, 0.0, 1e10), (1.0, 1.0, 9.0)]),
            peel(&[(0.0, 0.0, 1e10), (1.0, 1.0, 7.0), (0.0, 0.0, 1e10), (0.0, 0.0, 1e10), (0.0, 0.0, 1e10)]),
        ];
        let (finding, has_own) = complete(&mut peels, DepthConvention::Planar);
        assert_eq!(peels[0].depth.values(), [5.0, 7.0, 1e10, 1e10, 2.0]);
        assert_eq!(peels[1].depth.values(), [9.0, 7.0, 1e10, 1e10, 9.0]);
        assert_eq!(peels[0].alpha.values(), [LIGHT_ALPHA, LIGHT_ALPHA, LIGHT_ALPHA, 0.0, 0.5]);
        assert!(has_own);
        let text = finding.unwrap().text;
        assert!(
            text.starts_with("4 fragments") && text.contains("2 of them") && text.contains("1 are"),
            "{text}"
        );
    }

    #[test]
    fn alpha_that_is_nowhere_is_doubted_black_pixels_or_not() {
        let warned = |alpha: f32| {
            let mut peels = [peel(&[(1.0, 0.0, 5.0), (0.0, 0.0, 5.0), (0.0, alpha, 5.0)])];
            complete(&mut peels, DepthConvention::Planar).0.unwrap().warning
        };
        assert!(warned(0.0) && !warned(0.5));
    }

    #[test]
    fn a_stack_without_light_is_left_alone() {
        let mut peels = [peel(&[(0.0, 0.0, 1e10), (0.5, 0.5, 3.0), (0.0, 1.0, 3.0)])];
        let before = peels.clone();
        let (finding, has_own) = complete(&mut peels, DepthConvention::Planar);
        assert!(finding.is_none() && !has_own);
        assert_eq!(peels, before);
    }
}
