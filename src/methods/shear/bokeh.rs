//! The shape of a blurred point of light: the aperture's, of radius `|c|`, its edge softened by the squares of the pixel and of the
//! fragment.
//!
//! A point of light `e` brings `e / (A c²)` to each pixel that is fully within its shape, `A` the aperture's area at radius 1;
//! softening keeps the area. As a rule the shape is the aperture's outline, exact along rows. With spherical aberration or an image the
//! light of a place is that of the ring through it ([`Radial`]), times what the aperture lets through there; where that changes within
//! a pixel, it is asked for at [`GRID`] × [`GRID`] places. Either way what does not pass the lens barrel is missing, and the rest is over
//! what the barrel leaves: as a picture is the mean over the rays that pass.

use crate::lens::{BarrelShares, Field, Landing, Optics, Outline, Radial};
use glam::Vec2;
use std::f32::consts::FRAC_1_SQRT_2;

/// Rows in which a pixel at an edge is measured.
const EDGE_ROWS: usize = 16;

/// Places along each side of a pixel where light is asked for that is not even over it.
const GRID: usize = 6;

/// Least CoC radius of a shape, in picture pixels: what is sharper is a dot of about a pixel all the same.
const MIN_COC_PX: f32 = 0.7;

/// The shapes of blurred points.
#[derive(Debug)]
pub(super) struct Bokeh<'a> {
    optics: &'a Optics,
    field: Field,
    shares: BarrelShares,
    outline: Outline,
    /// Width of the fragment, see [`crate::scene::Plan::fragment_px`].
    fragment_px: f32,
    /// Rows across the softening of an edge: their offsets, and the share of it that each stands for.
    edge_rows: [(f32, f32); EDGE_ROWS],
    /// Offsets along an axis that stand for equal shares of what the squares of pixel and fragment spread.
    grid: [f32; GRID],
    /// Half the width of the ring that is taken about each of these.
    half_px: f32,
    /// Half the width of a ring that stands for both squares as a whole.
    whole_half_px: f32,
}

/// The shape of one point, in a set of colours.
#[derive(Debug)]
pub(super) struct Shape {
    /// Channels.
    pub(super) colors: &'static [usize],
    /// By how much their CoC radius differs from the lens's, in picture pixels.
    pub(super) axial_px: f32,
    /// Their CoC radius in picture pixels.
    pub(super) coc_px: f32,
    /// Where the rays land, if the lens has faults.
    radial: Option<Radial>,
}

impl<'a> Bokeh<'a> {
    /// The shapes that a lens of `optics` gives fragments `fragment_px` wide.
    pub(super) fn new(optics: &'a Optics, field: Field, fragment_px: f32) -> Self {
        let height = (1.0 + fragment_px) / EDGE_ROWS as f32;
        let edge_rows = std::array::from_fn(|i| {
            let top = i as f32 * height - 0.5 * (1.0 + fragment_px);
            (top + 0.5 * height, soft_step(top + height, fragment_px) - soft_step(top, fragment_px))
        });
        let (shares, outline) = (BarrelShares::new(optics), optics.aperture.outline());
        let grid = std::array::from_fn(|i| quantile((i as f32 + 0.5) / GRID as f32, fragment_px));
        let spread = grid.iter().map(|offset| offset * offset).sum::<f32>() / GRID as f32;
        // A box of this half width has the rest of the variance.
        let half_px = (0.25 * (1.0 + fragment_px * fragment_px) - 3.0 * spread).max(0.0).sqrt();
        let whole_half_px = 0.5 * 1f32.hypot(fragment_px);
        Self { optics, field, shares, outline, fragment_px, edge_rows, grid, half_px, whole_half_px }
    }

    /// The shapes of a point of CoC radius `coc_px`, one for each set of colours that share it.
    pub(super) fn shapes(&self, coc_px: f32) -> Vec<Shape> {
        let sets: &[&[usize]] =
            if self.optics.has_axial_color() { &[&[0], &[1], &[2]] } else { &[&[0, 1, 2]] };
        let shape = |colors: &&'static [usize]| {
            let axial_px = self.optics.axial_px[colors[0]];
            let coc_px = (coc_px + axial_px).abs().max(MIN_COC_PX).copysign(coc_px + axial_px);
            Shape { colors, axial_px, coc_px, radial: self.radial(coc_px) }
        };
        sets.iter().map(shape).collect()
    }

    /// Where the rays of a point of CoC radius `coc_px` land; none where the aperture's outline says it.
    fn radial(&self, coc_px: f32) -> Option<Radial> {
        let needed = self.optics.image.is_some() || self.optics.spherical_px != 0.0;
        let [first, third] = self.optics.spherical_terms();
        needed.then(|| Radial::new(coc_px + first, third))
    }

    /// Radius within which `shape` and its edge lie.
    pub(super) fn reach_px(&self, shape: &Shape) -> f32 {
        // Half the diagonals of pixel and fragment past the edge.
        let edge = FRAC_1_SQRT_2 * (1.0 + self.fragment_px);
        shape.radial.as_ref().map_or(shape.coc_px.abs(), Radial::reach_px) + edge
    }

    /// The share of the light of a point at `place` that its `shape` brings to `pixel`, both with pixel centres at whole numbers.
    pub(super) fn share(&self, shape: &Shape, place: Vec2, pixel: Vec2) -> f32 {
        let (offset, height) = (place - pixel, self.field.height(pixel + 0.5));
        let share = match &shape.radial {
            None => self.covered(offset, shape.coc_px, height) / (shape.coc_px * shape.coc_px),
            Some(radial) => self.landed(radial, offset, height),
        };
        let left = if self.optics.cats_eye > 0.0 { self.shares.at(height) } else { 1.0 };
        if left > 0.0 { share / (left * self.optics.area()) } else { 0.0 }
    }

    /// Share of a pixel at the place `height` of the field that the aperture's shape of radius `coc_px` covers, `offset` from the pixel
    /// to the point, seen through the squares of the pixel and of the fragment.
    fn covered(&self, offset: Vec2, coc_px: f32, height: Vec2) -> f32 {
        let depth = self.optics.aperture.depth_inside(offset, coc_px); // q − p = c·u
        let depth = depth.min(coc_px.abs() * self.within_barrel(offset / coc_px, height));
        if depth.abs() >= FRAC_1_SQRT_2 * (1.0 + self.fragment_px) {
            return f32::from(u8::from(depth > 0.0));
        }
        // Exact along x, row by row along y.
        let row = |&(shift, share): &(f32, f32)| {
            let outline = self.outline.row(offset.y + shift, coc_px);
            outline.and_then(|row| self.past_barrel(row, offset.y + shift, coc_px, height)).map_or(
                0.0,
                |[left, right]| {
                    let step = |edge: f32| soft_step(edge - offset.x, self.fragment_px);
                    share * (step(right) - step(left))
                },
            )
        };
        self.edge_rows.iter().map(row).sum()
    }

    /// How far within the barrel the lens point `lens` lies, seen from the place `height` of the field.
    fn within_barrel(&self, lens: Vec2, height: Vec2) -> f32 {
        if self.optics.cats_eye > 0.0 { self.optics.within_barrel(lens, height) } else { f32::INFINITY }
    }

    /// What of `row`, at `y` from the middle of a shape of radius `coc_px`, passes the barrel seen from the place `height` of the field.
    fn past_barrel(&self, row: [f32; 2], y: f32, coc_px: f32, height: Vec2) -> Option<[f32; 2]> {
        if self.optics.cats_eye <= 0.0 {
            return Some(row);
        }
        let middle = coc_px * self.optics.cats_eye * height;
        let half_squared = coc_px * coc_px - (y - middle.y).powi(2);
        if half_squared <= 0.0 {
            return None;
        }
        let half = half_squared.sqrt();
        let [left, right] = [row[0].max(middle.x - half), row[1].min(middle.x + half)];
        (left < right).then_some([left, right])
    }

    /// The density of the light that lands on a pixel at the place `height` of the field, `offset` from the pixel to the point, over that
    /// on the lens.
    fn landed(&self, radial: &Radial, offset: Vec2, height: Vec2) -> f32 {
        let reach = FRAC_1_SQRT_2 * (1.0 + self.fragment_px);
        if let Some(light) = self.even_light(radial, offset, height, reach) {
            return light;
        }
        let columns = self.grid.iter().flat_map(|&x| self.grid.iter().map(move |&y| Vec2::new(x, y)));
        let sum: f32 = columns.map(|shift| self.light(radial, offset + shift, height, self.half_px)).sum();
        sum / (GRID * GRID) as f32
    }

    /// The light `offset` from a point, if neither rays nor what is open to them end `reach` around: but for an image, it is then even.
    fn even_light(&self, radial: &Radial, offset: Vec2, height: Vec2, reach: f32) -> Option<f32> {
        let distance = offset.length();
        let (inner, outer) = (distance - reach, distance + reach);
        if radial.ends_between(inner, outer) {
            return None;
        }
        // Ends that lie askew come nearer within the pixel.
        let wide = |landing: Landing| {
            let margin = 2.0 * reach * landing.per_px;
            [landing.lens[0] - margin, landing.lens[1] + margin]
        };
        let open = self.optics.open_along(offset / distance.max(f32::MIN_POSITIVE), height);
        let holds_no_end = |[from, to]: [f32; 2]| open.iter().all(|end| *end <= from || *end >= to);
        radial
            .between(inner, outer)
            .all(|landing| holds_no_end(wide(landing)))
            .then(|| self.light(radial, offset, height, self.whole_half_px))
    }

    /// The light `offset` from a point, of the ring of half width `half_px` through there.
    fn light(&self, radial: &Radial, offset: Vec2, height: Vec2, half_px: f32) -> f32 {
        let distance = offset.length();
        let (inner, outer) = ((distance - half_px).max(0.0), distance + half_px);
        let direction = offset / distance.max(f32::MIN_POSITIVE);
        let open = self.optics.open_along(direction, height);
        let light = |landing: Landing| {
            let middle = 0.5 * (landing.lens[0] + landing.lens[1]);
            let let_through = self.optics.light_around(middle * direction, 2.0 * half_px * landing.per_px);
            landing.share_within(open) * let_through
        };
        radial.between(inner, outer).map(light).sum::<f32>() / (outer * outer - inner * inner)
    }
}

/// Where the step through a box 1 wide and one `size_px` wide reaches `share`: the inverse of [`soft_step`].
fn quantile(share: f32, size_px: f32) -> f32 {
    let end = 0.5 * (1.0 + size_px);
    let halved = |[low, high]: [f32; 2], _| {
        let middle = 0.5 * (low + high);
        if soft_step(middle, size_px) < share { [middle, high] } else { [low, middle] }
    };
    (0..24).fold([-end, end], halved)[0]
}

/// A step at 0, seen through a box 1 wide and one `size_px` wide: the integral of the trapezoid that the two make.
fn soft_step(depth: f32, size_px: f32) -> f32 {
    let (flat, end) = (0.5 * (1.0 - size_px), 0.5 * (1.0 + size_px));
    let from_end = (end - depth.abs()).max(0.0);
    let sloped = depth.abs() > flat && size_px > 0.0;
    let outer = if sloped { from_end * from_end / (2.0 * size_px) } else { (0.5 - depth.abs()).max(0.0) };
    if depth > 0.0 { 1.0 - outer } else { outer }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Aperture;

    #[test]
    fn a_soft_step_rises_from_nothing_to_everything_through_a_half() {
        for size in [0.0, 0.25, 1.0] {
            assert_eq!(
                [soft_step(-2.0, size), soft_step(0.0, size), soft_step(2.0, size)],
                [0.0, 0.5, 1.0],
                "size {size}"
            );
            let steps: Vec<f32> = (-20..=20).map(|i| soft_step(i as f32 * 0.1, size)).collect();
            assert!(
                steps.windows(2).all(|pair| pair[1] >= pair[0] && pair[1] - pair[0] < 0.11),
                "size {size}: {steps:?}"
            );
        }
    }

    const SIZE: usize = 96;

    /// The sums of the light of a point of CoC radius `coc_px` at `place`, times 1, x and y from it, and its second moments.
    fn moments(optics: &Optics, coc_px: f32, place: Vec2) -> (f32, Vec2, Vec2) {
        let bokeh = Bokeh::new(optics, Field::from_picture_size(SIZE, SIZE), 1.0);
        let shape = &bokeh.shapes(coc_px)[0];
        let pixels = (0..SIZE * SIZE).map(|i| Vec2::new((i % SIZE) as f32, (i / SIZE) as f32));
        pixels.fold((0.0, Vec2::ZERO, Vec2::ZERO), |(sum, first, second), pixel| {
            let (share, offset) = (bokeh.share(shape, place, pixel), pixel - place);
            (sum + share, first + share * offset, second + share * offset * offset)
        })
    }

    #[test]
    fn rays_land_with_all_their_light_where_the_lens_sends_them() {
        let hexagon = Aperture::new(6, 10.0).unwrap();
        for (aperture, spherical_px) in
            [(Aperture::DISC, -5.0), (Aperture::DISC, 4.0), (hexagon, 3.0), (hexagon, -4.0)]
        {
            for coc in [-19.0f32, 12.0, 22.5] {
                let optics = Optics { spherical_px, ..Optics::from_aperture(aperture) };
                let (sum, _, second) = moments(&optics, coc, Vec2::splat(47.3));
                let name = format!("{aperture:?}, {spherical_px} px, c = {coc}");
                assert!((sum - 1.0).abs() < 0.02, "{name}: {sum}");
                let rays = optics.rays(1024);
                let land = |view: &crate::lens::View| {
                    let landed = coc * view.lens + view.shift;
                    landed * landed
                };
                // And the squares of pixel and fragment.
                let expected = rays.green().iter().map(land).sum::<Vec2>() / 1024.0 + 2.0 / 12.0;
                assert!(
                    (second / sum / expected - 1.0).abs().max_element() < 0.02,
                    "{name}: {second}, {expected}"
                );
            }
        }
    }

    #[test]
    fn an_image_of_a_shape_gives_the_shape() {
        let side = 256;
        let polygon = Aperture::new(5, 20.0).unwrap();
        // Behind focus, p = q − c·u: the picture of the aperture, x to the right and y down, is −u.
        let at = |i: usize| {
            let pixel = Vec2::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5);
            let seen = pixel / (0.5 * side as f32) - 1.0;
            (polygon.depth_inside(-seen, 1.0) * 0.5 * side as f32 + 0.5).clamp(0.0, 1.0)
        };
        let values = (0..side * side).map(at).collect();
        let mask = crate::settings::Mask { name: "polygon".to_owned(), width: side, height: side, values };
        let image = crate::lens::ApertureImage::new(&mask, 0.0).unwrap();
        let drawn =
            Optics { image: Some(std::sync::Arc::new(image)), ..Optics::from_aperture(Aperture::DISC) };
        let exact = Optics::from_aperture(polygon);
        assert!((drawn.area() / exact.area() - 1.0).abs() < 5e-3, "{} and {}", drawn.area(), exact.area());
        let field = Field::from_picture_size(SIZE, SIZE);
        let [drawn, exact] = [&drawn, &exact].map(|optics| Bokeh::new(optics, field, 0.0));
        for coc in [25.0, -18.0] {
            let (a, b) = (drawn.shapes(coc).remove(0), exact.shapes(coc).remove(0));
            let off = |x: usize, y: usize| {
                let (place, pixel) = (Vec2::splat(48.0), Vec2::new(x as f32, y as f32));
                (drawn.share(&a, place, pixel) - exact.share(&b, place, pixel)).abs()
            };
            let sum: f32 =
                (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))).map(|(x, y)| off(x, y)).sum();
            assert!(sum < 0.03, "c = {coc}: {sum} of all light lies elsewhere");
        }
    }

    #[test]
    fn in_the_corners_the_rim_leaves_a_cats_eye_and_its_light_per_pixel_is_that_of_a_mean_over_it() {
        let optics = Optics { cats_eye: 1.0, ..Optics::from_aperture(Aperture::DISC) };
        let bokeh = Bokeh::new(&optics, Field::from_picture_size(SIZE, SIZE), 0.0);
        let shape = &bokeh.shapes(12.0)[0];
        let place = Vec2::splat(20.0);
        let light = |x: f32, y: f32| bokeh.share(shape, place, Vec2::new(x, y));
        let even = 1.0 / (std::f32::consts::PI * 144.0);
        // Behind focus the barrel cuts off what lies outwards.
        assert_eq!(light(13.0, 13.0), 0.0, "outwards");
        assert!(light(27.0, 27.0) > even, "inwards");
        let left = bokeh.shares.at(bokeh.field.height(Vec2::splat(20.5)));
        assert!((light(20.0, 20.0) * left / even - 1.0).abs() < 1e-3);
    }

    #[test]
    fn colours_that_focus_elsewhere_have_shapes_of_other_sizes() {
        let optics = Optics { axial_px: [-2.0, 0.0, 1.0], ..Optics::from_aperture(Aperture::DISC) };
        let bokeh = Bokeh::new(&optics, Field::from_picture_size(SIZE, SIZE), 1.0);
        let sizes = |coc: f32| bokeh.shapes(coc).iter().map(|shape| shape.coc_px).collect::<Vec<_>>();
        assert_eq!(sizes(10.0), [8.0, 10.0, 11.0]);
        assert_eq!(sizes(-10.0), [-12.0, -10.0, -9.0]);
        assert_eq!(sizes(2.0)[0], MIN_COC_PX, "no smaller than a dot");
    }
}
