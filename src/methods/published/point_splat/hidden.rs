//! The visible image, and the image of what it hides near its edges (section 3.2).
//!
//! Depths are compared as CoC radii: the paper's normalised scale, taken as a depth buffer's, is
//! `(c − c_near) / (c_far − c_near)`, so its thresholds become pixels of CoC radius once and for all.

use crate::image::Plane;
use crate::methods::shared::Peel;
use crate::methods::shared::planes_from_rows;
use crate::scene::OPAQUE_ALPHA;
use glam::Vec2;

/// The neighbours Ω of eq. 4 in a unit CoC: at least half a radius apart, as Poisson-disc samples are, with the symmetries
/// of the pixel grid, four within and eight around them.
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

/// Share of the neighbourhood that reduced points scan for depth changes: so far do they overlap the others (section 5).
const REDUCED_REACH: f32 = 0.95;

/// Coverage below this is no knowledge: it could not be divided by.
const MIN_COVERAGE: f32 = 1e-6;

/// What a camera sees in one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fragment<const N: usize> {
    /// Content, premultiplied by weight.
    pub content: [f32; N],
    /// How much of the pixel is known.
    pub weight: f32,
    /// Signed CoC radius of what shows most.
    pub coc_px: f32,
}

/// What is over one another at `x, y` among all fragments at or behind CoC radius `from_px`; `None` for nothing.
pub(super) fn seen<const N: usize>(
    peels: &[Peel],
    (x, y): (usize, usize),
    from_px: f32,
) -> Option<Fragment<N>> {
    let mut seen = Fragment { content: [0.0; N], weight: 0.0, coc_px: 0.0 };
    let (mut transmitted, mut most) = (1.0, 0.0);
    for Peel { covered, coc_px } in peels {
        let (coverage, coc_px) = (covered.coverage.get(x, y), coc_px.get(x, y));
        if coverage <= 0.0 || coc_px < from_px {
            continue;
        }
        for (sum, plane) in seen.content.iter_mut().zip(&covered.content) {
            *sum += transmitted * plane.get(x, y);
        }
        seen.weight += transmitted * coverage;
        if transmitted * coverage > most {
            (most, seen.coc_px) = (transmitted * coverage, coc_px);
        }
        transmitted *= if coverage >= OPAQUE_ALPHA { 0.0 } else { 1.0 - coverage };
        if transmitted <= 0.0 {
            break;
        }
    }
    (seen.weight > MIN_COVERAGE).then_some(seen)
}

impl<const N: usize> Fragment<N> {
    /// The fragment at full weight: what of it is not known is as what is.
    pub(super) fn whole(self) -> Self {
        if self.weight >= OPAQUE_ALPHA {
            return Self { weight: 1.0, ..self };
        }
        Self { content: self.content.map(|value| value / self.weight), weight: 1.0, ..self }
    }
}

/// Signed CoC radius of what is visible.
pub(super) fn visible_coc_px(peels: &[Peel], size: (usize, usize)) -> Plane {
    let [coc_px] = planes_from_rows(
        size,
        &|_| {},
        || (),
        |(), y, [row]: &mut [_; 1]| {
            for (x, coc_px) in row.iter_mut().enumerate() {
                *coc_px = seen::<0>(peels, (x, y), f32::NEG_INFINITY).map_or(0.0, |seen| seen.coc_px);
            }
        },
    );
    coc_px
}

/// Whether light that a pixel hides may show past it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edge {
    /// No depth change is near: the pixel's own surface closes.
    None,
    /// Just within reach of a depth change: reduced points overlap the others.
    Overlap,
    /// Near a depth change.
    Near,
}

/// The tests of section 3.2 in pixels of CoC radius.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hiding {
    /// A hidden fragment is at least this far behind the visible one, ε.
    pub epsilon_px: f32,
    /// Least depth change around a pixel with a hidden fragment.
    pub edge_px: f32,
}

impl Hiding {
    /// The tests of `epsilon` and `edge` on the normalised scale of a scene with this range.
    pub(super) fn new(epsilon: f32, edge: f32, [near_px, far_px]: [f32; 2]) -> Self {
        let range_px = (far_px - near_px).max(0.0);
        Self { epsilon_px: epsilon * range_px, edge_px: edge * range_px }
    }

    /// CoC radius from which a fragment behind a visible one at `visible_px` is hidden by it, not a part of it.
    pub(super) fn hidden_from_px(&self, visible_px: f32) -> f32 {
        // A threshold of nothing must not make the visible fragment hide itself.
        (visible_px + self.epsilon_px).max(visible_px.next_up())
    }

    /// Whether what the pixel `x, y` hides may show: it is not behind focus, and a depth change is near.
    pub(super) fn edge(&self, visible_px: &Plane, x: usize, y: usize) -> Edge {
        // No change at all is none, however small a change is asked for.
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

/// Mean depth change around `x, y`, `L(p)` (eq. 4), in pixels of CoC radius, scanned over `reach` of its CoC.
fn depth_change_px(visible_px: &Plane, x: usize, y: usize, reach: f32) -> f32 {
    let centre_px = visible_px.get(x, y);
    let place = |at: usize, offset: f32, size: usize| {
        (at as f32 + (reach * centre_px * offset).round()).clamp(0.0, (size - 1) as f32) as usize
    };
    let change = |neighbour: &Vec2| {
        let x = place(x, neighbour.x, visible_px.width());
        let y = place(y, neighbour.y, visible_px.height());
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
        // Columns below 20 at −10, the others at 2. The neighbours of a pixel at −10 are at columns ±3.5, ±3.7 and ±8.9.
        let step = Plane::from_fn(40, 40, |x, _| if x < 20 { -10.0 } else { 2.0 });
        assert_eq!(depth_change_px(&step, 5, 20, 1.0), 0.0, "none reaches it");
        assert_eq!(depth_change_px(&step, 14, 20, 1.0), 2.0, "8.9 columns on: two of twelve see 12 px more");
        assert_eq!(depth_change_px(&step, 19, 20, 1.0), 6.0, "six of twelve");
        assert_eq!(depth_change_px(&step, 11, 20, 1.0), 2.0, "9 columns on is past the edge");
        assert_eq!(depth_change_px(&step, 11, 20, 0.95), 0.0, "but not to a reduced point");
    }

    #[test]
    fn an_even_slope_is_no_depth_change() {
        let slope = Plane::from_fn(64, 64, |x, y| -8.0 + 0.25 * x as f32 - 0.125 * y as f32);
        assert!(depth_change_px(&slope, 20, 30, 1.0).abs() < 1e-5, "as much before as behind");
    }

    #[test]
    fn the_hidden_fragment_is_the_first_that_is_far_enough_behind() {
        // A range of 20 px: ε = 0.05 is 1 px.
        let hiding = Hiding::new(0.05, 0.01, [-10.0, 10.0]);
        let peels = [peel(1.0, 1.0, -8.0), peel(2.0, 1.0, -7.5), peel(3.0, 1.0, -7.0), peel(4.0, 1.0, 5.0)];
        let hidden = seen::<3>(&peels, (0, 0), hiding.hidden_from_px(-8.0)).unwrap();
        assert_eq!(hidden, Fragment { content: [3.0; 3], weight: 1.0, coc_px: -7.0 }, "1 px behind passes");
        assert_eq!(
            seen::<3>(&peels[..2], (0, 0), hiding.hidden_from_px(-8.0)),
            None,
            "half a pixel does not"
        );
    }

    #[test]
    fn nothing_hides_itself_however_small_the_threshold() {
        let hiding = Hiding::new(0.0, 0.0, [-8.0, 5.0]);
        let peels = [peel(1.0, 1.0, -8.0), peel(4.0, 1.0, 5.0)];
        let hidden = seen::<3>(&peels, (0, 0), hiding.hidden_from_px(-8.0)).unwrap();
        assert_eq!(hidden.coc_px, 5.0, "what is behind, not the visible fragment");
    }

    #[test]
    fn nothing_is_hidden_behind_focus_nor_far_from_a_depth_change() {
        let hiding = Hiding::new(0.05, 0.01, [-10.0, 14.0]);
        let step = |near_px| Plane::from_fn(40, 40, move |x, _| if x < 20 { near_px } else { 14.0 });
        assert_eq!(hiding.edge(&step(-10.0), 17, 20), Edge::Near, "in front of focus, at the edge");
        assert_eq!(hiding.edge(&step(-10.0), 11, 20), Edge::Overlap, "just at the reach of its CoC");
        assert_eq!(hiding.edge(&step(-10.0), 8, 20), Edge::None, "past it");
        assert_eq!(hiding.edge(&step(10.0), 17, 20), Edge::None, "behind focus");
    }

    #[test]
    fn a_camera_sees_a_veil_and_what_is_behind_it_at_the_depth_that_shows_most() {
        let peels = [peel(1.0, 0.25, -4.0), peel(3.0, 0.5, 2.0)];
        let seen = seen::<3>(&peels, (0, 0), f32::NEG_INFINITY).unwrap();
        // 0.25 · 1 + 0.75 · 0.5 · 3 of coverage 0.25 + 0.375.
        assert_eq!(seen, Fragment { content: [1.375; 3], weight: 0.625, coc_px: 2.0 }, "over one another");
        assert_eq!(seen.whole().content, [2.2; 3], "of what is known");
    }
}
