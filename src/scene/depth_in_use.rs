//! The depths that a lens sees, and how much it blurs them: whether a setting is in another unit than the stack shows here.
//!
//! Cost: one read of alpha and depth.

use crate::lens::ThinLens;
use crate::parallel;
use crate::stack::depth::{BACKGROUND, DepthScale};
use crate::stack::{Shading, Stack};
use pulp::{Arch, NullaryFnOnce};

/// The largest half float, which stands for background where depth was converted.
const HALF_MAX: f32 = 65504.0;
/// Share of the frame's width from which on a CoC radius counts as wide.
const WIDE: f32 = 0.25;
/// Values that are processed at once.
const LANES: usize = 16;

/// The depths of a stack's fragments, and the blur that a lens makes of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DepthInUse {
    /// Planar depth of the nearest and of the farthest surface, or of what it reflects, in depth units; the first is above the second where
    /// there is none.
    pub(crate) range: [f32; 2],
    /// Smallest and largest CoC radius of surfaces and background, without sign, in picture pixels. The smallest is 0 where focus lies
    /// between surfaces.
    pub(crate) coc_px: [f32; 2],
    /// Number of fragments.
    pub(crate) fragments: u64,
    /// Number of those whose CoC radius is above a quarter of the frame's width.
    pub(crate) wide: u64,
    /// Width of the frame in picture pixels.
    pub(crate) width_px: f32,
}

/// The depths of some fragments.
#[derive(Debug, Clone, Copy)]
struct Seen {
    range: [f32; 2],
    fragments: u64,
    /// Fragments of finite depth.
    surfaces: u64,
    wide: u64,
}

impl DepthInUse {
    /// Those of `stack` with `lens`; `scale` has its depth units.
    pub(crate) fn of(stack: &Stack, lens: &ThinLens, scale: &DepthScale) -> Self {
        let width_px = stack.frame.display.width as f32 / stack.supersample as f32;
        let [x0, y0] = stack.frame.data_origin_from_centre();
        let limit_px = WIDE * width_px;
        // The CoC radius grows with depth, from where it is negative.
        let wide = [lens.depth_planar(-limit_px), lens.depth_planar(limit_px)]
            .map(|depth| depth.unwrap_or(f32::INFINITY));
        let arch = Arch::new();
        let is_wide_at_infinity = lens.coc_infinity_px > limit_px;
        let of_row = |number: usize, y: usize| {
            let peel = &stack.peels[number];
            let mut depths = peel.depth.row(y).to_vec();
            scale.planar_row(&mut depths, y0 + y as f32, x0);
            let farthest = reflected(&stack.shading, number, (y, &depths));
            let seen = arch.dispatch(SeeRow { alpha: peel.alpha.row(y), depth: &depths, wide });
            Seen { range: [seen.range[0], seen.range[1].max(farthest)], ..seen }
        };
        let of_peel = |peel: usize| {
            let rows = parallel::map(stack.height(), &|y| of_row(peel, y));
            rows.into_iter().fold(Seen::NOTHING, Seen::joined)
        };
        let seen = (0..stack.peels.len()).map(of_peel).fold(Seen::NOTHING, Seen::joined);
        let background = seen.fragments - seen.surfaces;
        let wide = seen.wide + if is_wide_at_infinity { background } else { 0 };
        let coc_px = seen.coc_px(lens);
        Self { range: seen.range, coc_px, fragments: seen.fragments, wide, width_px }
    }

    /// Those of two parts of a frame together: ends and counts do not depend on the order.
    pub(crate) fn joined(self, other: Self) -> Self {
        let joined = |[a, b]: [f32; 2], [c, d]: [f32; 2]| [a.min(c), b.max(d)];
        Self {
            range: joined(self.range, other.range),
            coc_px: joined(self.coc_px, other.coc_px),
            fragments: self.fragments + other.fragments,
            wide: self.wide + other.wide,
            width_px: self.width_px,
        }
    }
}

/// Depth of the farthest surface that row `y` of peel `number` reflects, whose surfaces have these planar depths: at most that, as it lies
/// along the ray.
fn reflected(shading: &[Option<Shading>], number: usize, (y, depths): (usize, &[f32])) -> f32 {
    let Some(shading) = shading.get(number).and_then(Option::as_ref) else { return f32::NEG_INFINITY };
    let of = |(x, depth): (usize, &f32)| {
        let behind = depth + shading.reflected_distance.get(x, y);
        (behind < BACKGROUND && shading.reflects(x, y)).then_some(behind)
    };
    depths.iter().enumerate().filter_map(of).fold(f32::NEG_INFINITY, f32::max)
}

/// Looks at one row.
struct SeeRow<'a> {
    alpha: &'a [f32],
    depth: &'a [f32],
    /// Depths below the first and above the second count as wide.
    wide: [f32; 2],
}

impl NullaryFnOnce for SeeRow<'_> {
    type Output = Seen;

    #[inline(always)]
    fn call(self) -> Seen {
        let Self { alpha, depth, wide } = self;
        let ([mut low, mut high], mut counts) = (Seen::NOTHING.range.map(|end| [end; LANES]), [0_u32; 3]);
        for (alpha, depth) in alpha.chunks(LANES).zip(depth.chunks(LANES)) {
            let ends = low.iter_mut().zip(&mut high);
            for ((low, high), (&alpha, &depth)) in ends.zip(alpha.iter().zip(depth)) {
                let present = alpha > 0.0;
                let surface = present & (depth < f32::INFINITY) & (depth != HALF_MAX);
                *low = if surface & (depth < *low) { depth } else { *low };
                *high = if surface & (depth > *high) { depth } else { *high };
                counts[0] += u32::from(present);
                counts[1] += u32::from(surface);
                counts[2] += u32::from(surface & ((depth < wide[0]) | (depth > wide[1])));
            }
        }
        let low = low.into_iter().fold(f32::INFINITY, f32::min);
        let high = high.into_iter().fold(f32::NEG_INFINITY, f32::max);
        let [fragments, surfaces, wide] = counts.map(u64::from);
        Seen { range: [low, high], fragments, surfaces, wide }
    }
}

impl Seen {
    const NOTHING: Self =
        Self { range: [f32::INFINITY, f32::NEG_INFINITY], fragments: 0, surfaces: 0, wide: 0 };

    fn joined(self, other: Self) -> Self {
        Self {
            range: [self.range[0].min(other.range[0]), self.range[1].max(other.range[1])],
            fragments: self.fragments + other.fragments,
            surfaces: self.surfaces + other.surfaces,
            wide: self.wide + other.wide,
        }
    }

    /// See [`DepthInUse::coc_px`].
    fn coc_px(&self, lens: &ThinLens) -> [f32; 2] {
        let [near, far] = self.range;
        let mut coc_px = [f32::INFINITY, f32::NEG_INFINITY];
        let mut add = |value: f32| coc_px = [coc_px[0].min(value), coc_px[1].max(value)];
        if near <= far {
            [near, far].into_iter().for_each(|depth| add(lens.coc_radius_px(depth).abs()));
            if (near..=far).contains(&lens.focus_distance) {
                add(0.0);
            }
        }
        if self.fragments > self.surfaces {
            add(lens.coc_infinity_px);
        }
        coc_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_count_by_depth_and_empty_samples_do_not() {
        let alpha = [1.0, 0.5, 0.0, 1.0, 1.0];
        let depth = [3.0, 12.0, 1.0, f32::INFINITY, HALF_MAX];
        let seen = SeeRow { alpha: &alpha, depth: &depth, wide: [4.0, 11.0] }.call();
        assert_eq!((seen.range, seen.fragments, seen.surfaces, seen.wide), ([3.0, 12.0], 4, 2, 2));
    }

    #[test]
    fn the_least_blur_is_none_where_focus_lies_between_surfaces() {
        let blur = |range: [f32; 2], focus: f32| {
            let lens = ThinLens { coc_infinity_px: 10.0, focus_distance: focus, opening_px: 10.0 };
            Seen { range, fragments: 5, surfaces: 5, wide: 0 }.coc_px(&lens)
        };
        assert_eq!(blur([2.0, 8.0], 4.0), [0.0, 10.0]);
        assert_eq!(blur([4.0, 8.0], 2.0), [5.0, 7.5]);
    }
}
