//! The visible image, and the image of surfaces hidden near its edges (section 3.2).
//!
//! Depths are compared as CoC radii. The paper's normalised scale, taken to be a depth buffer's, is `(c − c_near) /
//! (c_far − c_near)`, so its thresholds are constants in pixels of CoC radius.

use crate::image::Plane;
use crate::methods::shared::{Peel, known, planes_from_rows, presence};
use crate::scene::OPAQUE_ALPHA;
use glam::Vec2;

/// The neighbours Ω of eq. 4 in a unit CoC: at least half a radius apart, as Poisson-disc samples are, with the
/// symmetries of the pixel grid, four inner and eight outer ones.
const NEIGHBOURS: [Vec2; 12] = [
    Vec2::new(0.35, 0.35),
    Vec2::new(-0.35, 0.35),
    Vec2::new(-0.35, -0.35),
    Vec2::new(0.35, -0.35),
    Vec2::new(0.89, 0.37),
    Vec2::new(0.37, 0.89),
    Vec2::new(-0.37, 0.89),
    Vec2::new(-0.89, 0.37),
    Vec2::new(-0.89, -0.37),
    Vec2::new(-0.37, -0.89),
    Vec2::new(0.37, -0.89),
    Vec2::new(0.89, -0.37),
];

/// Share of the neighbourhood that reduced points scan for depth changes. The rest is where they overlap the others
/// (section 5).
const REDUCED_REACH: f32 = 0.95;

/// The channel of alpha, in pictures that have it.
const ALPHA: usize = 3;

/// A pixel of a camera's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fragment<const N: usize> {
    /// Red, green, blue and, where there are four channels, alpha; premultiplied by alpha.
    pub content: [f32; N],
    /// To what part the pixel is a surface.
    pub weight: f32,
    /// Signed CoC radius of the fragment with the largest weight.
    pub coc_px: f32,
}

/// Composites all fragments at `x, y` whose CoC radius is at least `from_px`; `None` if there are none.
pub(super) fn composite<const N: usize>(
    peels: &[Peel],
    (x, y): (usize, usize),
    from_px: f32,
) -> Option<Fragment<N>> {
    let mut composite = Fragment { content: [0.0; N], weight: 0.0, coc_px: 0.0 };
    let (mut transmittance, mut max_weight) = (1.0, 0.0);
    for Peel { covered, coc_px } in peels {
        let (coverage, coc_px) = (covered.coverage.get(x, y), coc_px.get(x, y));
        if coverage <= 0.0 || coc_px < from_px {
            continue;
        }
        for (sum, plane) in composite.content.iter_mut().zip(&covered.content) {
            *sum += transmittance * plane.get(x, y);
        }
        composite.weight += transmittance * coverage;
        if transmittance * coverage > max_weight {
            (max_weight, composite.coc_px) = (transmittance * coverage, coc_px);
        }
        transmittance *= if coverage >= OPAQUE_ALPHA { 0.0 } else { 1.0 - coverage };
        if transmittance <= 0.0 {
            break;
        }
    }
    if let Some(alpha) = composite.content.get_mut(ALPHA) {
        *alpha = composite.weight;
    }
    (composite.weight > 0.0).then_some(composite)
}

impl<const N: usize> Fragment<N> {
    /// The fragment of a pixel whose share of the background is `share`: its content divided by what is known of the pixel.
    pub(super) fn normalised(self, share: f32) -> Self {
        let known = known(self.weight, share);
        let divisor = if known >= OPAQUE_ALPHA { 1.0 } else { known };
        let mut content = self.content.map(|value| value / divisor);
        let alpha = self.weight / known;
        if let Some(of_content) = content.get_mut(ALPHA) {
            *of_content = alpha;
        }
        Self { content, weight: presence(alpha), ..self }
    }
}

/// Signed CoC radius of the visible surface in every pixel.
pub(super) fn visible_coc_px(peels: &[Peel], size: (usize, usize)) -> Plane {
    let [coc_px] = planes_from_rows(size, &|_| {}, &|| (), &|(), y, [row]: &mut [_; 1]| {
        for (x, coc_px) in row.iter_mut().enumerate() {
            *coc_px =
                composite::<0>(peels, (x, y), f32::NEG_INFINITY).map_or(0.0, |composite| composite.coc_px);
        }
    });
    coc_px
}

/// Whether surfaces hidden by a pixel may show beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edge {
    /// No depth change is near.
    None,
    /// A depth change at the limit of the CoC: reduced points overlap the others.
    Overlap,
    /// A depth change is near.
    Near,
}

/// The tests of section 3.2, in pixels of CoC radius.
#[derive(Debug, Clone, Copy)]
pub(super) struct OcclusionTests {
    /// Minimum distance of a hidden fragment behind the visible one, ε.
    pub epsilon_px: f32,
    /// Minimum depth change around a pixel with a hidden fragment.
    pub edge_px: f32,
}

impl OcclusionTests {
    /// The tests for `epsilon` and `edge` on the normalised scale of a scene with this CoC range.
    pub(super) fn new(epsilon: f32, edge: f32, [near_px, far_px]: [f32; 2]) -> Self {
        let range_px = (far_px - near_px).max(0.0);
        Self { epsilon_px: epsilon * range_px, edge_px: edge * range_px }
    }

    /// Minimum CoC radius of fragments that are hidden by a visible one at `visible_px` and not part of its surface.
    pub(super) fn hidden_from_px(&self, visible_px: f32) -> f32 {
        // With a threshold of zero the visible fragment must not count as hidden.
        (visible_px + self.epsilon_px).max(visible_px.next_up())
    }

    /// Classifies pixel `x, y`: surfaces show beside it if it is not behind focus and a depth change is near.
    pub(super) fn edge(&self, visible_px: &Plane, x: usize, y: usize) -> Edge {
        // A change of zero does not count, even with a threshold of zero.
        let changes = |reach| {
            let change_px = depth_change_px(visible_px, x, y, reach);
            change_px > 0.0 && change_px >= self.edge_px
        };
        if visible_px.get(x, y) > 0.0 || !changes(1.0) {
            Edge::None
        } else if changes(REDUCED_REACH) {
            Edge::Near
        } else {
            Edge::Overlap
        }
    }
}

/// Mean depth change `L(p)` around `x, y` (eq. 4), in pixels of CoC radius, scanned over the share `reach` of the
/// pixel's CoC.
fn depth_change_px(visible_px: &Plane, x: usize, y: usize, reach: f32) -> f32 {
    let centre_px = visible_px.get(x, y);
    let neighbour_index = |at: usize, offset: f32, size: usize| {
        (at as f32 + (reach * centre_px * offset).round()).clamp(0.0, (size - 1) as f32) as usize
    };
    let change = |neighbour: &Vec2| {
        let x = neighbour_index(x, neighbour.x, visible_px.width());
        let y = neighbour_index(y, neighbour.y, visible_px.height());
        visible_px.get(x, y) - centre_px
    };
    NEIGHBOURS.iter().map(change).sum::<f32>() / NEIGHBOURS.len() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::shared::CoveragePlanes;

    fn peel(value: f32, coverage: f32, coc_px: f32) -> Peel {
        let plane = |value| Plane::filled(1, 1, value);
        let covered = CoveragePlanes { content: vec![plane(value * coverage); 3], coverage: plane(coverage) };
        Peel { covered, coc_px: plane(coc_px) }
    }

    #[test]
    fn the_depth_change_at_a_step_is_the_share_of_neighbours_past_it() {
        // Columns below 20 are at −10, the others at 2. The neighbours of a pixel at −10 are at columns ±3.5, ±3.7
        // and ±8.9.
        let step = Plane::from_fn(40, 40, |x, _| if x < 20 { -10.0 } else { 2.0 });
        assert_eq!(depth_change_px(&step, 5, 20, 1.0), 0.0, "no neighbour reaches it");
        assert_eq!(depth_change_px(&step, 14, 20, 1.0), 2.0, "8.9 columns on: two of twelve see 12 px more");
        assert_eq!(depth_change_px(&step, 19, 20, 1.0), 6.0, "six of twelve");
        assert_eq!(depth_change_px(&step, 11, 20, 1.0), 2.0, "9 columns on is past the edge");
        assert_eq!(depth_change_px(&step, 11, 20, 0.95), 0.0, "but not to a reduced point");
    }

    #[test]
    fn a_constant_slope_has_no_depth_change() {
        let slope = Plane::from_fn(64, 64, |x, y| -8.0 + 0.25 * x as f32 - 0.125 * y as f32);
        assert!(depth_change_px(&slope, 20, 30, 1.0).abs() < 1e-5, "changes cancel");
    }

    #[test]
    fn the_hidden_fragment_is_the_first_one_behind_epsilon() {
        // With a range of 20 px, ε = 0.05 is 1 px.
        let tests = OcclusionTests::new(0.05, 0.01, [-10.0, 10.0]);
        let peels = [peel(1.0, 1.0, -8.0), peel(2.0, 1.0, -7.5), peel(3.0, 1.0, -7.0), peel(4.0, 1.0, 5.0)];
        let hidden = composite::<3>(&peels, (0, 0), tests.hidden_from_px(-8.0)).unwrap();
        assert_eq!(hidden, Fragment { content: [3.0; 3], weight: 1.0, coc_px: -7.0 }, "1 px behind passes");
        assert_eq!(
            composite::<3>(&peels[..2], (0, 0), tests.hidden_from_px(-8.0)),
            None,
            "half a pixel does not"
        );
    }

    #[test]
    fn no_fragment_hides_itself_at_a_threshold_of_zero() {
        let tests = OcclusionTests::new(0.0, 0.0, [-8.0, 5.0]);
        let peels = [peel(1.0, 1.0, -8.0), peel(4.0, 1.0, 5.0)];
        let hidden = composite::<3>(&peels, (0, 0), tests.hidden_from_px(-8.0)).unwrap();
        assert_eq!(hidden.coc_px, 5.0, "the fragment behind, not the visible one");
    }

    #[test]
    fn only_pixels_in_front_of_focus_near_a_depth_change_hide_surfaces() {
        let tests = OcclusionTests::new(0.05, 0.01, [-10.0, 14.0]);
        let step = |near_px| Plane::from_fn(40, 40, move |x, _| if x < 20 { near_px } else { 14.0 });
        assert_eq!(tests.edge(&step(-10.0), 17, 20), Edge::Near, "in front of focus, at the edge");
        assert_eq!(tests.edge(&step(-10.0), 11, 20), Edge::Overlap, "at the limit of its CoC");
        assert_eq!(tests.edge(&step(-10.0), 8, 20), Edge::None, "past it");
        assert_eq!(tests.edge(&step(10.0), 17, 20), Edge::None, "behind focus");
    }

    #[test]
    fn translucent_fragments_composite_at_the_depth_of_the_largest_weight() {
        let peels = [peel(1.0, 0.25, -4.0), peel(3.0, 0.5, 2.0)];
        let composite = composite::<3>(&peels, (0, 0), f32::NEG_INFINITY).unwrap();
        // 0.25 · 1 + 0.75 · 0.5 · 3 of coverage 0.25 + 0.375.
        assert_eq!(composite, Fragment { content: [1.375; 3], weight: 0.625, coc_px: 2.0 }, "composited");
        assert_eq!(composite.normalised(0.0).content, [2.2; 3], "divided by the weight");
        let open = composite.normalised(1.0);
        assert_eq!((open.content, open.weight), ([1.375; 3], 1.0), "before the background");
    }
}
