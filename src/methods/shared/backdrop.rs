//! The background behind a blurred picture, for methods that do not follow lens rays.
//!
//! Such a method blurs what the stack has, and knows how much of each pixel that covers. Of the rest, the part that is less than the
//! background's share is transparent, as for a ray: see [`Background`]. What remains is unknown, and left out of the mean.
//!
//! Behind a blurred edge the share is that of the rays that pass beside it: of the pixels around that are not hidden by the same
//! surface, those that show the background. A lone object is as transparent at its blurred edges as its coverage says, and a clear
//! pixel in a closed surface counts as one of its neighbours. Pixels of which no such ray shows the background are as in a closed
//! picture.

use crate::image::{Image, Plane};
use crate::lens::views;
use crate::methods::contract::Plan;
use crate::methods::shared::planes_from_rows;
use crate::parallel;
use crate::scene::{Background, Scene};
use glam::Vec2;

/// Lens points at which a pixel looks for the background beside what hides it.
const LENS_POINTS: usize = 64;

/// CoC radius in pixels by which a surface lies behind another if a ray that passes the nearer one beside its edge hits it for certain.
const BEHIND_PX: f32 = 1.0;

/// Share of the background behind each pixel of the picture, 0 … 1.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Backdrop {
    share: Plane,
}

impl Backdrop {
    /// The backdrop of `scene`; `None` where the background is not visible, or the plan leaves it out.
    pub(in crate::methods) fn new(scene: &Scene, plan: &Plan) -> Option<Self> {
        let background = plan.background(scene)?;
        let lens: Vec<Vec2> =
            views(LENS_POINTS, plan.optics.aperture).into_iter().map(|view| view.lens).collect();
        let beside = Beside { rows_before: rows_before(background.share()), background: &background, lens };
        let size = (background.share().width(), background.share().height());
        let [share] = planes_from_rows(size, &|_| {}, &|| (), &|(), y, [row]: &mut [_; 1]| {
            row.iter_mut().enumerate().for_each(|(x, share)| *share = beside.share(x, y));
        });
        Some(Self { share })
    }
}

/// Number of rows of `share` above each row that show the background somewhere; and, last, of all.
fn rows_before(share: &Plane) -> Vec<usize> {
    let shows = |y: usize| usize::from(share.row(y).iter().any(|&share| share > 0.0));
    let counts = (0..share.height()).scan(0, |count, y| {
        *count += shows(y);
        Some(*count)
    });
    [0].into_iter().chain(counts).collect()
}

/// The background beside what hides it.
struct Beside<'a> {
    background: &'a Background,
    /// See [`rows_before`].
    rows_before: Vec<usize>,
    lens: Vec<Vec2>,
}

impl Beside<'_> {
    /// Share of the background behind pixel `x, y`.
    fn share(&self, x: usize, y: usize) -> f32 {
        let own = self.background.share().get(x, y);
        let coc_px = self.background.last_coc_px().get(x, y);
        if own >= 1.0 || !self.may_show(y, coc_px) {
            return own;
        }
        let pixel = Vec2::new(x as f32, y as f32);
        let (seen, passed) = self.lens.iter().fold((0.0, 0.0), |(seen, passed), lens| {
            let [share, hit] = self.past(pixel + coc_px * lens, coc_px);
            (seen + share, passed + share + (1.0 - share) * hit)
        });
        if seen > 0.0 { own.max(seen / passed) } else { own }
    }

    /// Whether a row within `coc_px` of row `y` shows the background.
    fn may_show(&self, y: usize, coc_px: f32) -> bool {
        let height = self.background.share().height();
        let reach = (coc_px.abs().ceil() as usize).min(height);
        self.rows_before[(y + reach + 1).min(height)] > self.rows_before[y.saturating_sub(reach)]
    }

    /// What is past a surface of CoC radius `coc_px` at `position`: share of the background, and how certainly a surface farther away.
    fn past(&self, position: Vec2, coc_px: f32) -> [f32; 2] {
        let (share, last_coc_px) = (self.background.share(), self.background.last_coc_px());
        let at = |value: f32, size: usize| (value.round().max(0.0) as usize).min(size - 1);
        let (x, y) = (at(position.x, share.width()), at(position.y, share.height()));
        [share.get(x, y), ((last_coc_px.get(x, y) - coc_px) / BEHIND_PX).clamp(0.0, 1.0)]
    }
}

/// The picture before the backdrop. `picture` is divided by `coverage`, the known part of each pixel; without a backdrop it is all.
pub(in crate::methods) fn before(picture: Image, coverage: &Plane, backdrop: Option<&Backdrop>) -> Image {
    let Some(Backdrop { share }) = backdrop else { return picture };
    let Image { mut planes } = picture;
    for plane in &mut planes {
        parallel::for_each_block(plane.values_mut(), &|block, values| {
            let behind = coverage.values()[block.clone()].iter().zip(&share.values()[block]);
            let values = values.iter_mut().zip(behind);
            values.for_each(|(value, (&coverage, &share))| *value *= covered_part(coverage, share));
        });
    }
    Image { planes }
}

/// The known part of a pixel, surfaces and background: surfaces cover it to `coverage`, and its share of the background is `share`. All of
/// it where there is nothing but light without alpha, which says nothing of the rest.
#[inline]
pub(in crate::methods) fn known(coverage: f32, share: f32) -> f32 {
    /// Coverage of a pixel in which nothing hides anything.
    const NOTHING: f32 = 1e-6;
    let known = coverage + (1.0 - coverage).clamp(0.0, share);
    if known > NOTHING { known } else { 1.0 }
}

/// Part of what is known of a pixel that is covered.
#[inline]
fn covered_part(coverage: f32, share: f32) -> f32 {
    if coverage > 0.0 { coverage / known(coverage, share) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Layer;
    use crate::settings::{Origin, ParameterValues, Settings, Values};
    use crate::stack::StackKind;

    /// The shares behind a scene of one layer with `fragment(x, y)` = alpha and CoC radius; the CoC radius at infinity is 5.
    fn shares(width: usize, height: usize, fragment: impl Fn(usize, usize) -> (f32, f32)) -> Option<Plane> {
        let alpha = Plane::from_fn(width, height, |x, y| fragment(x, y).0);
        let coc_px = Plane::from_fn(width, height, |x, y| fragment(x, y).1);
        let layer = Layer { color: std::array::from_fn(|_| alpha.clone()), alpha, coc_px };
        let scene = Scene::new(vec![layer], StackKind::PointSampled, 1, 5.0);
        let values = Values { method: Some("b-buffer".to_owned()), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        let plan = crate::methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
        Backdrop::new(&scene, &plan).map(|backdrop| backdrop.share)
    }

    #[test]
    fn a_closed_scene_has_no_backdrop() {
        assert_eq!(shares(9, 9, |x, _| (1.0, x as f32)), None);
    }

    #[test]
    fn the_background_continues_behind_a_lone_object_as_far_as_rays_pass_beside_it() {
        let share = shares(60, 40, |x, _| if x >= 20 { (1.0, -8.0) } else { (0.0, 0.0) }).unwrap();
        assert_eq!([0, 19, 20, 26].map(|x| share.get(x, 20)), [1.0; 4], "within 8 px of its edge");
        assert_eq!([29, 50].map(|x| share.get(x, 20)), [0.0; 2], "past that every ray is hidden");
    }

    #[test]
    fn beside_a_closed_surface_the_background_continues_behind_nothing() {
        // An object before a wall; nine clear pixels far from its edge.
        let clear = |x: usize, y: usize| x < 3 && y < 3;
        let fragment = |x, y| if clear(x, y) { (0.0, 0.0) } else { (1.0, if x >= 40 { -8.0 } else { 3.0 }) };
        let share = shares(60, 40, fragment).unwrap();
        assert_eq!([share.get(41, 20), share.get(30, 2), share.get(7, 7)], [0.0; 3]);
    }

    #[test]
    fn a_clear_pixel_in_a_wall_counts_as_one_of_the_pixels_that_a_ray_may_pass() {
        let fragment = |x: usize, y: usize| match (x, y) {
            (17, 20) => (0.0, 0.0),
            (20.., _) => (1.0, -8.0),
            _ => (1.0, 3.0),
        };
        let share = shares(60, 40, fragment).unwrap();
        let found = share.get(21, 20);
        assert!(found < 0.1, "{found}: about 80 pixels are beside the object");
    }

    #[test]
    fn what_is_neither_known_nor_background_is_left_out() {
        assert_eq!(covered_part(0.5, 1.0), 0.5, "as transparent as the coverage says");
        assert_eq!(covered_part(0.5, 0.0), 1.0, "closed");
        assert_eq!(covered_part(0.5, 0.1), 0.5 / 0.6, "a tenth is background, the rest unknown");
        assert_eq!([covered_part(0.0, 0.0), covered_part(1.0 + 1e-6, 1.0)], [0.0, 1.0]);
    }
}
