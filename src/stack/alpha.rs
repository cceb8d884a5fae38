//! Straight alpha: colour that is not multiplied by alpha.
//!
//! Renderers write premultiplied colour, some compositors and painting programs straight colour. The difference shows where alpha changes
//! on one surface: premultiplied colour changes in proportion, straight colour does not.
//!
//! Cost of the doubt: one read of alpha, and of the colours of neighbours whose alphas differ.

use super::Peel;
use crate::finding::Finding;
use crate::image::Plane;
use crate::parallel;
use pulp::Arch;

/// Least difference of the alphas of two neighbours that says something.
const ALPHA_STEP: f32 = 0.1;
/// Least alpha of both: below it, colour is noise.
const LEAST_ALPHA: f32 = 0.02;
/// Straight colour fits this many times better than premultiplied colour before it is doubted.
const CLEARLY: f64 = 3.0;
/// One pair of so many at least has a colour that exceeds alpha.
const BRIGHT_OF: u64 = 8;
/// Pairs of neighbours below which nothing is doubted.
const FEWEST_PAIRS: u64 = 12;

/// How badly the two readings of alpha fit pairs of neighbours.
#[derive(Debug, Clone, Copy, Default)]
struct Fit {
    /// Number of pairs.
    pairs: u64,
    /// Those of them whose colour exceeds alpha at either.
    bright: u64,
    /// Sum of the differences of colour, as straight alpha has it.
    straight: f64,
    /// Sum of the differences of colour over alpha, on the same scale.
    premultiplied: f64,
}

impl Fit {
    fn joined(self, other: Self) -> Self {
        Self {
            pairs: self.pairs + other.pairs,
            bright: self.bright + other.bright,
            straight: self.straight + other.straight,
            premultiplied: self.premultiplied + other.premultiplied,
        }
    }
}

/// Multiplies straight `color` by `alpha`, in place.
pub(super) fn premultiply(color: &mut [Plane; 3], alpha: &Plane) {
    for plane in color {
        parallel::for_each_block(plane.values_mut(), &|block, values| {
            values.iter_mut().zip(&alpha.values()[block]).for_each(|(value, alpha)| *value *= alpha);
        });
    }
}

/// A warning where the colours of `peels` change with alpha as only those of straight alpha do.
pub(super) fn doubt(peels: &[Peel]) -> Option<Finding> {
    let fit = peels.iter().map(fit_of).fold(Fit::default(), Fit::joined);
    let is_straight = fit.pairs >= FEWEST_PAIRS
        && BRIGHT_OF * fit.bright >= fit.pairs
        && CLEARLY * fit.straight < fit.premultiplied;
    let text = format!(
        "colour looks straight, not multiplied by alpha: it stays the same across {} edges at which alpha changes, and is \
         brighter than alpha there; it is read as premultiplied: set `alpha = straight`, or `alpha = premultiplied` if it is right",
        fit.pairs
    );
    is_straight.then(|| Finding::warning("alpha", text))
}

/// How the two readings fit the neighbours of one peel, summed in the order of rows.
fn fit_of(peel: &Peel) -> Fit {
    let (width, height, arch) = (peel.alpha.width(), peel.alpha.height(), Arch::new());
    // Pairs count only where one of them is neither empty nor opaque.
    let is_between = |y: usize| {
        let between = |alpha: &f32| (LEAST_ALPHA..=1.0 - ALPHA_STEP).contains(alpha);
        arch.dispatch(|| peel.alpha.row(y).iter().fold(false, |any, alpha| any | between(alpha)))
    };
    let of_row = |y: usize| {
        let mut fit = Fit::default();
        if !is_between(y) && (y == 0 || !is_between(y - 1)) {
            return fit;
        }
        let row = peel.alpha.row(y);
        for x in 1..width {
            add(&mut fit, peel, [(x - 1, y), (x, y)], [row[x - 1], row[x]]);
        }
        if y > 0 {
            let above = peel.alpha.row(y - 1);
            for x in 0..width {
                add(&mut fit, peel, [(x, y - 1), (x, y)], [above[x], row[x]]);
            }
        }
        fit
    };
    parallel::map(height, &of_row).into_iter().fold(Fit::default(), Fit::joined)
}

/// Adds a pair of neighbours to `fit`, if their alphas differ.
#[inline]
fn add(fit: &mut Fit, peel: &Peel, places: [(usize, usize); 2], alphas: [f32; 2]) {
    let [a, b] = alphas;
    if (a - b).abs() < ALPHA_STEP || a.min(b) < LEAST_ALPHA {
        return;
    }
    let most = a.max(b);
    let colors = places.map(|(x, y)| peel.color.each_ref().map(|plane| plane.get(x, y)));
    let brightness = |color: [f32; 3]| color.into_iter().fold(0.0, f32::max);
    if colors.iter().all(|color| brightness(*color) <= 0.0) {
        return;
    }
    fit.pairs += 1;
    fit.bright += u64::from(colors.iter().zip(alphas).any(|(color, alpha)| brightness(*color) > alpha));
    // Colours that are far apart are of two surfaces: a pair counts at most as much as its brightness.
    let scale = colors.into_iter().map(brightness).fold(0.0, f32::max);
    let (mut straight, mut premultiplied) = (0.0_f32, 0.0_f32);
    for channel in 0..3 {
        let [of_a, of_b] = colors.map(|color| color[channel]);
        straight = straight.max((of_a - of_b).abs());
        premultiplied = premultiplied.max((of_a * b - of_b * a).abs() / most);
    }
    fit.straight += f64::from((straight / scale).min(1.0));
    fit.premultiplied += f64::from((premultiplied / scale).min(1.0));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc of one colour with a soft rim, straight or premultiplied.
    fn disc(color: f32, is_straight: bool) -> Peel {
        let alpha = Plane::from_fn(32, 32, |x, y| {
            let distance = ((x as f32 - 15.5).powi(2) + (y as f32 - 15.5).powi(2)).sqrt();
            (0.25 * (12.0 - distance)).clamp(0.0, 1.0)
        });
        let shown = |alpha: f32| if is_straight && alpha > 0.0 { color } else { color * alpha };
        let plane = Plane::from_fn(32, 32, |x, y| shown(alpha.get(x, y)));
        Peel { color: std::array::from_fn(|_| plane.clone()), alpha, depth: Plane::filled(32, 32, 3.0) }
    }

    #[test]
    fn straight_colour_times_alpha_is_premultiplied_colour() {
        let mut straight = disc(0.8, true);
        premultiply(&mut straight.color, &straight.alpha);
        assert_eq!(straight, disc(0.8, false));
    }

    #[test]
    fn colour_that_does_not_change_with_alpha_is_doubted() {
        assert!(doubt(&[disc(0.8, true)]).is_some_and(|finding| finding.warning));
        assert!(doubt(&[disc(0.8, false)]).is_none());
        assert!(doubt(&[disc(20.0, false)]).is_none(), "a bright light exceeds alpha, in proportion to it");
    }
}
