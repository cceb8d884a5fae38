//! From the sorted samples of a pixel to fragments, each at one distance, and no more than a stack has peels.
//!
//! A blur grows with `1/z`, whatever the lens: the radius of the circle of confusion is `c_inf (1 − z_f / z)`. A thick volume becomes
//! slices of equal steps in `1/z`, the more the more of the pixel's light it shows. Where a pixel has too many fragments,
//! neighbours are merged so that the largest error of any merged group is as small as it can be: the sum of its squared distances in
//! `1/z` from their mean, each weighted with the light that it shows. Background is not merged with anything.

use super::sample::{Fragment, Sample};

/// Largest step of a slice in `1/z`, as a share of the `1/z` of the volume's front, times the share of the pixel's light that it shows.
const SLICE_STEP: f64 = 0.05;
/// Nearest front of a volume, as a share of the distance of its back: a camera within a volume sees it from itself on.
pub(super) const NEAREST_FRONT: f32 = 0.01;
/// Share of its alpha by which a fragment hides what is behind it, when it is weighed: lens rays pass beside what is opaque.
const HIDING_SHARE: f64 = 0.9;
/// Halvings of the range in which the largest error of a group is searched for.
const HALVINGS: usize = 30;
/// Places of Gauss's quadrature of three points in 0 … 1, with their weights.
const QUADRATURE: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Appends the fragments of a pixel's `samples`, which are sorted and do not overlap, nearest first: at most `most`. Returns whether there
/// were more.
pub(in crate::stack) fn reduce(samples: &[Sample], most: usize, fragments: &mut Vec<Fragment>) -> bool {
    let first = fragments.len();
    if samples.len() <= most && !samples.iter().any(Sample::is_volume) {
        fragments.extend(samples.iter().map(|s| Fragment {
            distance: s.front,
            color: s.color,
            alpha: s.alpha,
        }));
        return false;
    }
    let mut passing = 1.0;
    for sample in samples {
        let shown = passing * weight(sample.alpha, sample.color);
        slice(sample, slice_count(sample, shown).min(most), fragments);
        passing *= 1.0 - f64::from(sample.alpha);
    }
    let is_reduced = fragments.len() - first > most;
    if is_reduced {
        let merged = merged(&fragments[first..], most);
        fragments.truncate(first);
        fragments.extend(merged);
    }
    is_reduced
}

/// How much of a pixel's light a fragment shows or takes away, if nothing is before it.
fn weight(alpha: f32, color: [f32; 3]) -> f64 {
    let light = color.into_iter().fold(0.0, f32::max).min(1.0);
    f64::from(alpha.max(light))
}

/// The number of slices of a sample that shows this share of the pixel's light.
fn slice_count(sample: &Sample, shown: f64) -> usize {
    if !sample.is_volume() || sample.alpha >= 1.0 {
        return 1;
    }
    let range = 1.0 - f64::from(nearest_front(sample) / sample.back);
    ((range * shown / SLICE_STEP).ceil() as usize).max(1)
}

fn nearest_front(sample: &Sample) -> f32 {
    sample.front.max(sample.back * NEAREST_FRONT)
}

/// Appends `count` slices of a sample, equal in `1/z`.
fn slice(sample: &Sample, count: usize, fragments: &mut Vec<Fragment>) {
    let Sample { front, color, alpha, .. } = *sample;
    if !sample.is_volume() || alpha >= 1.0 {
        fragments.push(Fragment { distance: front, color, alpha });
        return;
    }
    let [near, far] = [f64::from(nearest_front(sample)), f64::from(sample.back)];
    let bound = |i: usize| match i {
        0 => near,
        _ if i == count => far,
        _ => (near.recip() + (far.recip() - near.recip()) * i as f64 / count as f64).recip(),
    };
    let depth = -f64::from(-alpha).ln_1p();
    for i in 0..count {
        let (start, end) = (bound(i), bound(i + 1));
        let share = (end - start) / (far - near);
        let part = -(-depth * share).exp_m1();
        let shown = if alpha > 0.0 { part / f64::from(alpha) } else { share };
        let distance = mean_distance(start, end, depth * share) as f32;
        let (color, alpha) = if count == 1 {
            (color, alpha)
        } else {
            (color.map(|value| (f64::from(value) * shown) as f32), part as f32)
        };
        fragments.push(Fragment { distance, color, alpha });
    }
}

/// The distance whose `1/z` is the mean of that of the light of a homogeneous volume of this optical depth.
fn mean_distance(start: f64, end: f64, depth: f64) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (at, weight) in QUADRATURE {
        let weight = weight * (-depth * at).exp();
        sum += weight / (start + at * (end - start));
        weights += weight;
    }
    (weights / sum).clamp(start, end)
}

/// A fragment with what its error is measured by.
#[derive(Debug, Clone, Copy)]
struct Weighed {
    fragment: Fragment,
    /// `1/z`.
    place: f64,
    /// The light that it shows.
    weight: f64,
}

/// Consecutive fragments that become one.
#[derive(Debug, Clone, Copy, Default)]
struct Group {
    weight: f64,
    /// Weighted mean of the places.
    mean: f64,
    /// Weighted sum of the squared distances from the mean.
    error: f64,
}

impl Group {
    fn with(self, next: &Weighed) -> Self {
        let weight = self.weight + next.weight;
        let step = next.place - self.mean;
        let share = if weight > 0.0 { next.weight / weight } else { 0.0 };
        Self { weight, mean: self.mean + share * step, error: self.error + self.weight * share * step * step }
    }

    fn of(first: &Weighed) -> Self {
        Self { weight: first.weight, mean: first.place, error: 0.0 }
    }
}

/// `fragments`, merged to `most`.
fn merged(fragments: &[Fragment], most: usize) -> Vec<Fragment> {
    let is_background = |fragment: &&Fragment| fragment.distance == f32::INFINITY;
    let background = fragments.last().filter(is_background);
    let surfaces = &fragments[..fragments.len() - usize::from(background.is_some())];
    let most = most.saturating_sub(usize::from(background.is_some())).max(1);
    let mut passing = 1.0;
    let weighed = surfaces.iter().map(|fragment| {
        let weight = passing * weight(fragment.alpha, fragment.color);
        passing *= 1.0 - HIDING_SHARE * f64::from(fragment.alpha);
        Weighed { fragment: *fragment, place: f64::from(fragment.distance).recip(), weight }
    });
    let weighed: Vec<Weighed> = weighed.collect();
    let limit = smallest_error(&weighed, most);
    let mut found = Vec::with_capacity(most + 1);
    let mut rest = weighed.as_slice();
    for count in grouped(&weighed, limit) {
        let (own, others) = rest.split_at(count);
        found.push(composited(own));
        rest = others;
    }
    found.extend(background);
    found
}

/// The smallest error of a group with which there are at most `most` groups.
fn smallest_error(weighed: &[Weighed], most: usize) -> f64 {
    let all = weighed.iter().skip(1).fold(weighed.first().map(Group::of).unwrap_or_default(), Group::with);
    // Fragments beyond `most` at one place, or that show nothing.
    if grouped(weighed, 0.0).count() <= most {
        return 0.0;
    }
    let (mut low, mut high) = (all.error * 1e-15, all.error);
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if grouped(weighed, middle).count() <= most {
            high = middle;
        } else {
            low = middle;
        }
    }
    high
}

/// The lengths of the groups: each as long as its error allows.
fn grouped(weighed: &[Weighed], limit: f64) -> impl Iterator<Item = usize> {
    let mut rest = weighed;
    std::iter::from_fn(move || {
        let (first, others) = rest.split_first()?;
        let mut group = Group::of(first);
        let fits = |next: &&Weighed| {
            group = group.with(next);
            group.error <= limit
        };
        let count = 1 + others.iter().take_while(fits).count();
        rest = &rest[count..];
        Some(count)
    })
}

/// Consecutive fragments, one over the other, at the mean of their `1/z`.
fn composited(own: &[Weighed]) -> Fragment {
    if let [only] = own {
        return only.fragment;
    }
    let (mut color, mut passing) = ([0.0; 3], 1.0);
    let mut group = Group::default();
    let mut plain = 0.0;
    for weighed in own {
        let Fragment { color: added, alpha, .. } = weighed.fragment;
        color.iter_mut().zip(added).for_each(|(sum, value)| *sum += passing * f64::from(value));
        passing *= 1.0 - f64::from(alpha);
        group = group.with(weighed);
        plain += weighed.place / own.len() as f64;
    }
    let place = if group.weight > 0.0 { group.mean } else { plain };
    Fragment {
        distance: place.recip() as f32,
        color: color.map(|value| value as f32),
        alpha: (1.0 - passing) as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(distance: f32, color: f32, alpha: f32) -> Sample {
        Sample { front: distance, back: distance, color: [color; 3], alpha }
    }

    fn reduced(samples: &[Sample], most: usize) -> Vec<Fragment> {
        let mut fragments = Vec::new();
        reduce(samples, most, &mut fragments);
        fragments
    }

    /// Colour and alpha of fragments, one over the other.
    fn flattened(fragments: &[Fragment]) -> [f64; 2] {
        let (mut color, mut passing) = (0.0, 1.0);
        for fragment in fragments {
            color += passing * f64::from(fragment.color[0]);
            passing *= 1.0 - f64::from(fragment.alpha);
        }
        [color, 1.0 - passing]
    }

    #[test]
    fn surfaces_that_fit_keep_their_values() {
        let samples = [surface(1.0, 0.1, 0.5), surface(2.0, 3.0, 0.0), surface(f32::INFINITY, 0.4, 1.0)];
        let kept = |s: &Sample| Fragment { distance: s.front, color: s.color, alpha: s.alpha };
        assert_eq!(reduced(&samples, 3), samples.each_ref().map(kept));
    }

    #[test]
    fn merged_fragments_show_and_hide_what_they_did() {
        let samples: Vec<Sample> =
            (0..100).map(|i| surface(2.0 + 0.1 * i as f32, 0.01 * i as f32, 0.03)).collect();
        let (all, few) = (reduced(&samples, 100), reduced(&samples, 16));
        assert_eq!((all.len(), few.len()), (100, 16));
        let [all, few] = [flattened(&all), flattened(&few)];
        assert!((all[0] - few[0]).abs() < 1e-6 && (all[1] - few[1]).abs() < 1e-6, "{all:?} {few:?}");
    }

    #[test]
    fn what_lies_close_is_merged_before_what_lies_apart() {
        // Two groups that a lens sees apart, a stray surface between them, and the sky.
        let near = (0..10).map(|i| surface(1.0 + 1e-3 * i as f32, 0.05, 0.05));
        let far = (0..10).map(|i| surface(50.0 + i as f32, 0.05, 0.05));
        let samples: Vec<Sample> = near
            .chain([surface(3.0, 0.2, 0.2)])
            .chain(far)
            .chain([surface(f32::INFINITY, 1.0, 1.0)])
            .collect();
        let found: Vec<f32> = reduced(&samples, 4).iter().map(|fragment| fragment.distance).collect();
        assert!((found[0] - 1.0045).abs() < 1e-3, "{found:?}");
        assert_eq!((found[1], found[3]), (3.0, f32::INFINITY));
        assert!((50.0..60.0).contains(&found[2]));
    }

    #[test]
    fn what_is_behind_an_opaque_fragment_stays() {
        let mut samples = vec![surface(1.0, 1.0, 1.0)];
        samples.extend((0..20).map(|i| surface(4.0 + 0.01 * i as f32, 0.1, 0.1)));
        let found = reduced(&samples, 2);
        assert_eq!(found[0], Fragment { distance: 1.0, color: [1.0; 3], alpha: 1.0 });
        let hidden: Vec<Fragment> = reduced(&samples[1..], 20);
        assert!((f64::from(found[1].alpha) - flattened(&hidden)[1]).abs() < 1e-6);
    }

    #[test]
    fn a_thick_volume_is_slices_of_the_same_light() {
        let fog = Sample { front: 2.0, back: 20.0, color: [0.4; 3], alpha: 0.8 };
        let found = reduced(&[fog], 16);
        assert_eq!(found.len(), 15, "0.9 of the way to infinity, times 0.8, by 0.05");
        let flat = flattened(&found);
        assert!((flat[0] - 0.4).abs() < 1e-6 && (flat[1] - 0.8).abs() < 1e-6, "{flat:?}");
        assert!(found.windows(2).all(|pair| pair[0].distance < pair[1].distance));
        assert!(found[0].distance > 2.0 && found[14].distance < 20.0);
    }

    #[test]
    fn a_thin_veil_is_one_fragment_at_the_mean_of_its_inverse_distance() {
        // Of hardly any optical depth: ln (b/a) / (b − a).
        let veil = Sample { front: 4.0, back: 5.0, color: [0.001; 3], alpha: 0.001 };
        let found = reduced(&[veil], 16);
        let place = (5.0_f64 / 4.0).ln();
        assert_eq!((found.len(), found[0].alpha, found[0].color), (1, 0.001, [0.001; 3]));
        assert!((f64::from(found[0].distance).recip() - place).abs() < 2e-5, "{found:?} {place}");
    }

    #[test]
    fn an_opaque_volume_is_its_front() {
        let block = Sample { front: 3.0, back: 9.0, color: [0.5; 3], alpha: 1.0 };
        assert_eq!(reduced(&[block], 16), [Fragment { distance: 3.0, color: [0.5; 3], alpha: 1.0 }]);
    }
}
