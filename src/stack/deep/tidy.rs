//! The samples of a pixel, sorted and without overlaps, as "Interpreting OpenEXR Deep Pixels" (openexr.com) defines them.
//!
//! A volume is homogeneous: of a share `x` of its length, `1 − (1 − α)^x` of the light behind it is taken away, and colour in
//! proportion to that. Where volumes overlap, or surfaces lie at one distance, they are mixed evenly: their optical depths
//! `u = −ln (1 − α)` add up, and so do their colours before they hide themselves, `c · u / α`. Of several opaque ones the colour is the mean.
//!
//! A sample that overlaps no other comes out as it went in, bit for bit. Cost: `n log n` of the samples of a pixel.

use super::sample::Sample;
use std::cmp::Ordering;

/// So many volumes at one place have their sums added up again where one ends; of more, its part is subtracted.
const SUMMED_AGAIN: usize = 64;

/// What is needed to put a pixel's samples in order, for one pixel after another.
#[derive(Debug, Default)]
pub(in crate::stack) struct Tidier {
    /// The distances at which a sample begins or ends.
    bounds: Vec<f32>,
    /// The volumes at the current distance.
    open: Vec<Sample>,
    /// The samples in order.
    tidy: Vec<Sample>,
}

/// Samples that are mixed evenly.
#[derive(Debug, Clone, Copy, Default)]
struct Mix {
    /// Sum of the optical depths of those that are not opaque.
    depth: f64,
    /// Sum of their colours before they hide themselves.
    color: [f64; 3],
    /// Number of the opaque ones.
    opaque: f64,
    /// Sum of their colours.
    opaque_color: [f64; 3],
}

impl Mix {
    /// Adds `share` of the optical depth and the colour of a sample; a negative one takes it away.
    fn add(&mut self, sample: &Sample, share: f64) {
        let alpha = f64::from(sample.alpha);
        let add = |sum: &mut [f64; 3], factor: f64| {
            sum.iter_mut().zip(sample.color).for_each(|(sum, value)| *sum += factor * f64::from(value));
        };
        if alpha >= 1.0 {
            self.opaque += share.signum();
            add(&mut self.opaque_color, share.signum());
            return;
        }
        let depth = -(-alpha).ln_1p();
        self.depth += share * depth;
        add(&mut self.color, share * if alpha > 0.0 { depth / alpha } else { 1.0 });
    }

    /// Colour and alpha of a length of 1 of the mix, or of `length`.
    fn mixed(&self, length: f64) -> ([f32; 3], f32) {
        if self.opaque > 0.5 {
            return (self.opaque_color.map(|sum| (sum / self.opaque) as f32), 1.0);
        }
        let depth = (self.depth * length).max(0.0);
        let alpha = -(-depth).exp_m1();
        let shown = if depth > 0.0 { alpha / depth } else { 1.0 };
        (self.color.map(|sum| (sum * length * shown) as f32), alpha as f32)
    }
}

impl Tidier {
    /// Sorts `samples` nearest first, splits volumes where another sample begins or ends, and merges what lies at one place.
    pub(in crate::stack) fn tidy<'a>(&'a mut self, samples: &'a mut [Sample]) -> &'a [Sample] {
        let are_in_order = |samples: &[Sample]| samples.windows(2).all(|pair| are_apart(&pair[0], &pair[1]));
        if are_in_order(samples) {
            return samples;
        }
        samples.sort_unstable_by(by_place);
        if are_in_order(samples) {
            return samples;
        }
        self.sweep(samples);
        &self.tidy
    }

    /// Goes through the sorted `samples` from bound to bound.
    fn sweep(&mut self, samples: &[Sample]) {
        self.bounds.clear();
        self.bounds.extend(samples.iter().flat_map(|sample| [sample.front, end(sample)]));
        self.bounds.sort_unstable_by(f32::total_cmp);
        self.bounds.dedup();
        self.open.clear();
        self.tidy.clear();
        let mut mix = Mix::default();
        let mut rest = samples;
        for i in 0..self.bounds.len() {
            let at = self.bounds[i];
            close(&mut self.open, &mut mix, at);
            let count = rest.iter().take_while(|sample| sample.front <= at).count();
            let (starting, later) = rest.split_at(count);
            rest = later;
            self.tidy.extend(merged_surfaces(starting, at));
            for volume in starting.iter().filter(|sample| sample.is_volume()) {
                mix.add(volume, 1.0 / length(volume));
                self.open.push(*volume);
            }
            if let Some(&next) = self.bounds.get(i + 1) {
                self.tidy.extend(merged_volumes(&self.open, &mix, at, next));
            }
        }
    }
}

/// Nearest first. Samples at one place have an order too, so that sums over them have one.
fn by_place(a: &Sample, b: &Sample) -> Ordering {
    let values = |s: &Sample| [s.front, s.back, s.alpha, s.color[0], s.color[1], s.color[2]];
    let each = values(a).into_iter().zip(values(b)).map(|(a, b)| a.total_cmp(&b));
    each.fold(Ordering::Equal, Ordering::then)
}

/// Where a sample ends.
fn end(sample: &Sample) -> f32 {
    if sample.is_volume() { sample.back } else { sample.front }
}

fn length(volume: &Sample) -> f64 {
    f64::from(volume.back) - f64::from(volume.front)
}

/// Whether the second of two sorted samples neither overlaps the first nor lies where that lies.
fn are_apart(first: &Sample, second: &Sample) -> bool {
    let both_surfaces = !first.is_volume() && !second.is_volume();
    end(first) <= second.front && !(both_surfaces && first.front == second.front)
}

/// Takes the volumes that end at `at` out of the mix.
fn close(open: &mut Vec<Sample>, mix: &mut Mix, at: f32) {
    let before = open.len();
    open.retain(|volume| {
        let stays = volume.back > at;
        if !stays && before > SUMMED_AGAIN {
            mix.add(volume, -1.0 / length(volume));
        }
        stays
    });
    if open.len() < before && (before <= SUMMED_AGAIN || open.is_empty()) {
        *mix = Mix::default();
        open.iter().for_each(|volume| mix.add(volume, 1.0 / length(volume)));
    }
}

/// The surfaces among `starting` as one; `None` where there is none.
fn merged_surfaces(starting: &[Sample], at: f32) -> Option<Sample> {
    let mut surfaces = starting.iter().filter(|sample| !sample.is_volume());
    let first = *surfaces.next()?;
    let mut mix = Mix::default();
    mix.add(&first, 1.0);
    let mut alone = true;
    for surface in surfaces {
        mix.add(surface, 1.0);
        alone = false;
    }
    let (color, alpha) = mix.mixed(1.0);
    Some(if alone { first } else { Sample { front: at, back: at, color, alpha } })
}

/// The open volumes between two bounds as one; `None` where there is none.
fn merged_volumes(open: &[Sample], mix: &Mix, front: f32, back: f32) -> Option<Sample> {
    match open {
        [] => None,
        [only] if only.front == front && only.back == back => Some(*only),
        _ => {
            let (color, alpha) = mix.mixed(f64::from(back) - f64::from(front));
            Some(Sample { front, back, color, alpha })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(front: f32, back: f32, color: f32, alpha: f32) -> Sample {
        Sample { front, back, color: [color; 3], alpha }
    }

    fn surface(at: f32, color: f32, alpha: f32) -> Sample {
        volume(at, at, color, alpha)
    }

    fn tidied(samples: &[Sample]) -> Vec<Sample> {
        Tidier::default().tidy(&mut samples.to_vec()).to_vec()
    }

    /// Colour and alpha of samples in order, one over the other.
    fn flattened(samples: &[Sample]) -> [f64; 2] {
        let mut passing = 1.0;
        let mut color = 0.0;
        for sample in samples {
            color += passing * f64::from(sample.color[0]);
            passing *= 1.0 - f64::from(sample.alpha);
        }
        [color, 1.0 - passing]
    }

    fn assert_near(found: [f64; 2], expected: [f64; 2], what: &str) {
        let error = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(error < 1e-6, "{what}: {found:?}, expected {expected:?}");
    }

    #[test]
    fn samples_that_do_not_overlap_are_sorted_and_otherwise_untouched() {
        let [fog, card, sky] =
            [volume(1.0, 2.0, 0.3, 0.4), surface(2.0, 0.1, 0.7), surface(f32::INFINITY, 0.2, 1.0)];
        assert_eq!(
            tidied(&[sky, card, fog]),
            [fog, card, sky],
            "a surface at the end of a volume lies behind it"
        );
        let touching = volume(2.0, 3.0, 0.1, 0.1);
        assert_eq!(tidied(&[touching, card, fog]), [fog, card, touching], "and before one that begins there");
    }

    #[test]
    fn a_volume_around_a_surface_is_split_by_its_transmittance() {
        // A quarter of the length lets the fourth root of the light pass.
        let found = tidied(&[volume(2.0, 6.0, 0.5, 0.5), surface(3.0, 0.0, 0.25)]);
        assert_eq!(found.len(), 3);
        let root = 0.5_f32.powf(0.25);
        assert!(
            (found[0].alpha - (1.0 - root)).abs() < 1e-6
                && (found[2].alpha - (1.0 - root.powi(3))).abs() < 1e-6
        );
        assert!((found[0].color[0] - found[0].alpha).abs() < 1e-6, "colour in proportion to alpha");
        assert_near(flattened(&[found[0], found[2]]), [0.5, 0.5], "the parts are the whole");
        assert_eq!(found[1], surface(3.0, 0.0, 0.25));
    }

    #[test]
    fn two_volumes_at_one_place_keep_their_transmittance_and_their_light() {
        // Solved by hand: u = ln 2 and ln 4, so that 1/8 of the light passes; colours 0.5 · ln 2 / 0.5 + 0.3 · ln 4 / 0.75.
        let both = tidied(&[volume(1.0, 3.0, 0.5, 0.5), volume(1.0, 3.0, 0.3, 0.75)]);
        let ln2 = std::f64::consts::LN_2;
        let color = (ln2 + 0.4 * 2.0 * ln2) * 0.875 / (3.0 * ln2);
        assert_near(flattened(&both), [color, 0.875], "two volumes");
        assert_eq!((both.len(), both[0].front, both[0].back), (1, 1.0, 3.0));
    }

    #[test]
    fn volumes_of_one_kind_are_the_same_however_they_overlap() {
        // Every part of 1 … 4 emits and hides as much as every other, so that only the optical depth of each counts.
        let fog = |front: f32, back: f32, density: f32| {
            let alpha = 1.0 - (-density * (back - front)).exp();
            volume(front, back, 0.25 * alpha, alpha)
        };
        let found = tidied(&[fog(1.0, 3.0, 0.5), fog(2.0, 4.0, 0.25), fog(1.5, 3.5, 1.0)]);
        let passing = f64::exp(-(2.0 * 0.5 + 2.0 * 0.25 + 2.0));
        assert_near(flattened(&found), [0.25 * (1.0 - passing), 1.0 - passing], "one colour");
        assert_eq!(found.len(), 5, "from bound to bound");
        assert!(found.windows(2).all(|pair| pair[0].back == pair[1].front));
    }

    #[test]
    fn light_without_alpha_is_divided_by_length() {
        let found = tidied(&[volume(1.0, 5.0, 2.0, 0.0), surface(2.0, 0.0, 0.5)]);
        assert_eq!([found[0].color[0], found[2].color[0]], [0.5, 1.5]);
        assert_eq!([found[0].alpha, found[2].alpha], [0.0, 0.0]);
    }

    #[test]
    fn opaque_samples_at_one_place_have_their_mean() {
        assert_eq!(tidied(&[surface(2.0, 0.2, 1.0), surface(2.0, 0.6, 1.0)]), [surface(2.0, 0.4, 1.0)]);
        assert_eq!(tidied(&[surface(2.0, 0.2, 1.0), surface(2.0, 9.0, 0.5)]), [surface(2.0, 0.2, 1.0)]);
        let split = tidied(&[volume(1.0, 3.0, 0.7, 1.0), surface(2.0, 0.1, 0.5)]);
        assert_eq!(split[0], volume(1.0, 2.0, 0.7, 1.0), "an opaque volume is opaque in every part");
    }

    #[test]
    fn the_order_in_which_samples_are_written_does_not_matter() {
        let all = [
            volume(1.0, 4.0, 0.1, 0.3),
            surface(2.0, 0.2, 0.5),
            surface(2.0, 0.4, 0.25),
            volume(2.0, 3.0, 0.0, 0.6),
            volume(0.5, 2.5, 1.5, 0.0),
        ];
        let expected = tidied(&all);
        for turn in 1..all.len() {
            let mut turned = all;
            turned.rotate_left(turn);
            assert_eq!(tidied(&turned), expected, "{turn}");
            turned.reverse();
            assert_eq!(tidied(&turned), expected, "{turn}, reversed");
        }
    }

    #[test]
    fn many_volumes_at_one_place_add_up_as_few_do() {
        // Thin layers of one fog, more than are added up again, and one thick volume around them.
        let thin = |i: usize| volume(1.0 + 0.01 * i as f32, 3.0 + 0.01 * i as f32, 0.001, 0.002);
        let mut all: Vec<Sample> = (0..200).map(thin).collect();
        all.push(volume(0.5, 10.0, 0.0, 0.5));
        let found = flattened(&tidied(&all));
        let passing = 0.5 * 0.998_f64.powi(200);
        assert!((found[1] - (1.0 - passing)).abs() < 1e-6, "{found:?}, {passing}");
    }
}
