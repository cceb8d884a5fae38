//! The blur of a point behind a lens with spherical aberration: where its rays land, and how densely.
//!
//! A ray through the lens at distance `ρ` from its centre lands at distance `R(ρ) = a·ρ + b·ρ³` from the point, on the other side where
//! that is negative. Rays are evenly spread over the lens, so the share of them between two distances is the difference of `ρ²`. Where `R`
//! has an extremum, rays concentrate into a bright ring. The range of `ρ` is split at the extremum and at the zero of `R`, so that `R` is
//! monotonic on each interval and can be inverted there.

/// Steps of `ρ` along an interval, between which `R` is interpolated linearly.
const STEPS: usize = 64;

/// The distance at which rays land, by their distance from the lens's centre.
#[derive(Debug, Clone)]
pub(crate) struct Radial {
    intervals: Vec<Interval>,
}

/// An interval of `ρ` on which `R` is monotonic and has one sign.
#[derive(Debug, Clone)]
struct Interval {
    /// Smallest and largest `ρ`.
    from: f32,
    to: f32,
    /// `|R|` at equal steps from `from` to `to`, or from `to` to `from` where it falls, so that the values rise.
    distances_px: [f32; STEPS + 1],
    falls: bool,
    /// Whether the rays land on the other side of the point.
    crossed: bool,
}

/// Rays of one interval of `ρ` that land within a ring about the point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Landing {
    /// Where they pass the lens, on the line through its centre parallel to the line from the point to where they land: the two ends, in
    /// aperture radii. Negative for rays that land on the other side.
    pub lens: [f32; 2],
    /// Change of this position with the distance from the point, per pixel.
    pub per_px: f32,
}

impl Landing {
    /// Share of these rays among all rays of the disc, counting only those within `open`.
    pub(crate) fn share_within(&self, open: [f32; 2]) -> f32 {
        let [from, to] = self.lens.map(|distance| distance.clamp(open[0], open[1].max(open[0])));
        (to * to - from * from).abs()
    }
}

impl Radial {
    /// For a lens whose rays land `first·ρ + third·ρ³` pixels from the point.
    pub(crate) fn new(first: f32, third: f32) -> Self {
        let within = |square: f32| (square > 0.0 && square < 1.0).then(|| square.sqrt());
        // The extremum, then the zero, whose square is three times as large.
        let cuts = [-first / (3.0 * third), -first / third].into_iter().filter_map(within);
        let ends: Vec<f32> = std::iter::once(0.0).chain(cuts).chain([1.0]).collect();
        let radius = |rho: f32| (first + third * rho * rho) * rho;
        Self { intervals: ends.windows(2).map(|ends| Interval::new(ends[0], ends[1], radius)).collect() }
    }

    /// Largest distance from the point at which rays land, in pixels.
    pub(crate) fn reach_px(&self) -> f32 {
        self.intervals.iter().fold(0.0, |reach, interval| reach.max(interval.distances_px[STEPS]))
    }

    /// Whether the image of an interval of `ρ` begins or ends between `inner` and `outer` pixels from the point.
    pub(crate) fn ends_between(&self, inner: f32, outer: f32) -> bool {
        let within = |end: f32| end > 0.0 && end >= inner && end <= outer;
        self.intervals
            .iter()
            .any(|interval| within(interval.distances_px[0]) || within(interval.distances_px[STEPS]))
    }

    /// The rays that land from `inner` to `outer` pixels from the point.
    pub(crate) fn between(&self, inner: f32, outer: f32) -> impl Iterator<Item = Landing> {
        self.intervals.iter().filter_map(move |interval| interval.between(inner, outer))
    }
}

impl Interval {
    fn new(from: f32, to: f32, radius: impl Fn(f32) -> f32) -> Self {
        let falls = radius(from).abs() > radius(to).abs();
        let crossed = radius(0.5 * (from + to)) < 0.0;
        let interval = Self { from, to, distances_px: [0.0; STEPS + 1], falls, crossed };
        let distances_px = std::array::from_fn(|i| radius(interval.lens_distance(i as f32)).abs());
        Self { distances_px, ..interval }
    }

    /// `ρ` at the fractional step `step`.
    fn lens_distance(&self, step: f32) -> f32 {
        let share = step / STEPS as f32;
        let share = if self.falls { 1.0 - share } else { share };
        self.from + share * (self.to - self.from)
    }

    fn between(&self, inner: f32, outer: f32) -> Option<Landing> {
        let (inner, outer) = (inner.max(self.distances_px[0]), outer.min(self.distances_px[STEPS]));
        if inner >= outer {
            return None;
        }
        let [a, b] = [inner, outer].map(|distance| self.lens_distance(self.step_of(distance)));
        let [min, max] = [a.min(b), a.max(b)];
        let lens = if self.crossed { [-max, -min] } else { [min, max] };
        Some(Landing { lens, per_px: (max - min) / (outer - inner) })
    }

    /// The fractional step at which rays land `distance` pixels away; `distance` is within the interval's range.
    fn step_of(&self, distance: f32) -> f32 {
        let after = self.distances_px.partition_point(|known| *known <= distance).clamp(1, STEPS);
        let (low, high) = (self.distances_px[after - 1], self.distances_px[after]);
        let along = if high > low { ((distance - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 };
        (after - 1) as f32 + along
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of the light in a ring one pixel wide at `distance`, divided by the ring's area over π.
    fn density(radial: &Radial, distance: f32) -> f32 {
        let (inner, outer) = (distance - 0.5, distance + 0.5);
        radial.between(inner, outer).map(|landing| landing.share_within([-1.0, 1.0])).sum::<f32>()
            / (outer * outer - inner * inner)
    }

    #[test]
    fn without_aberration_light_is_even_up_to_the_edge() {
        for size in [20.0f32, -20.0] {
            let radial = Radial::new(size, 0.0);
            assert_eq!(radial.reach_px(), 20.0);
            for distance in [1.0, 7.0, 18.0] {
                assert!((density(&radial, distance) * 400.0 - 1.0).abs() < 1e-3, "at {distance}");
            }
            let landing = radial.between(9.5, 10.5).next().unwrap();
            let middle = 0.5 * (landing.lens[0] + landing.lens[1]);
            assert!((middle * size - 10.0).abs() < 1e-3, "halfway, with the sign of {size}");
            assert_eq!(landing.share_within([-0.2, 0.2]), 0.0, "all rays pass farther out");
            assert!((landing.per_px - 0.05).abs() < 1e-4);
        }
    }

    #[test]
    fn the_shares_of_all_rings_sum_to_one() {
        for (first, third) in
            [(20.0, 5.0), (20.0, -5.0), (20.0, -12.0), (20.0, -40.0), (-3.0, 8.0), (0.0, 4.0)]
        {
            let radial = Radial::new(first, third);
            let all: f32 = (0..40)
                .flat_map(|ring| radial.between(ring as f32, (ring + 1) as f32))
                .map(|landing| landing.share_within([-1.0, 1.0]))
                .sum();
            assert!((all - 1.0).abs() < 1e-4, "{first}, {third}: {all}");
        }
    }

    #[test]
    fn light_is_as_dense_as_the_slope_of_the_map_says() {
        // dρ² / dR² = 1 / ((a + bρ²)(a + 3bρ²)), R = aρ + bρ³: the edge is brighter than the centre in the first case, darker in the second.
        for (first, third) in [(20.0f32, -4.0f32), (20.0, 6.0)] {
            let radial = Radial::new(first, third);
            for rho in [0.3f32, 0.6, 0.9] {
                let square = rho * rho;
                let expected = 1.0 / ((first + third * square) * (first + 3.0 * third * square));
                let found = density(&radial, (first + third * square) * rho);
                assert!((found / expected - 1.0).abs() < 0.02, "{third}, ρ = {rho}: {found}, {expected}");
            }
        }
    }

    #[test]
    fn rays_that_land_on_the_other_side_have_negative_lens_positions() {
        // R = 10ρ − 30ρ³ passes 0 at ρ = 0.577 and reaches −20 at the edge.
        let radial = Radial::new(10.0, -30.0);
        assert_eq!(radial.reach_px(), 20.0);
        let landings: Vec<Landing> = radial.between(1.0, 2.0).collect();
        assert_eq!(landings.len(), 3, "rising, falling, crossed: {landings:?}");
        assert_eq!(landings.iter().filter(|landing| landing.lens[1] < 0.0).count(), 1);
    }
}
