//! The shape of a blurred light: the aperture's shape of radius `|c|`, its edge softened by the square of the pixel and by the shape
//! of what emits the light ([`Softening`]).
//!
//! A point of energy `e` adds `e / (A c²)` to each pixel that lies fully within its shape, where `A` is the aperture's area at
//! radius 1. Softening keeps the area. Usually the shape is the aperture's outline, exact along rows. With spherical aberration
//! or an aperture image the light at a point of the shape is that of the ring through it ([`Radial`]) times the aperture's
//! transmittance there; where it varies within a pixel, it is sampled at [`GRID`] × [`GRID`] points. In both cases rays that
//! the lens barrel blocks are excluded, and the rest is divided by the share of rays that passes, because a pixel is the mean
//! over the rays that pass.

use super::softening::{GRID, Softening, SofteningRow, soft_step};
use crate::lens::{BarrelShares, Field, Landing, Optics, Outline, Radial};
use glam::Vec2;

/// Smallest CoC radius of a shape, in picture pixels. A sharper point also covers about a pixel.
const MIN_COC_PX: f32 = 0.7;

/// The shapes of blurred points.
#[derive(Debug)]
pub(super) struct Bokeh<'a> {
    optics: &'a Optics,
    field: Field,
    shares: BarrelShares,
    outline: Outline,
}

/// The shape of one point, in a set of colours.
#[derive(Debug)]
pub(super) struct Shape {
    /// Indices of the channels.
    pub(super) colors: &'static [usize],
    /// Difference of their CoC radius from the lens's by axial colour, in picture pixels.
    pub(super) axial_px: f32,
    /// Signed CoC radius of these channels in picture pixels.
    pub(super) coc_px: f32,
    /// Where rays land, for a lens with spherical aberration or an aperture image.
    radial: Option<Radial>,
    softening: Softening,
}

impl Shape {
    /// Radius in pixels that holds the shape and its softened edge.
    pub(super) fn reach_px(&self) -> f32 {
        self.radial.as_ref().map_or(self.coc_px.abs(), Radial::reach_px) + self.softening.reach_px
    }
}

impl<'a> Bokeh<'a> {
    /// The shapes of lights through a lens of `optics`.
    pub(super) fn new(optics: &'a Optics, field: Field) -> Self {
        Self { optics, field, shares: BarrelShares::new(optics), outline: optics.aperture.outline() }
    }

    /// The shapes of a light of CoC radius `coc_px`, one for each set of colours with the same shape.
    pub(super) fn shapes(&self, coc_px: f32, softening: &Softening) -> Vec<Shape> {
        let sets: &[&[usize]] =
            if self.optics.has_axial_color() { &[&[0], &[1], &[2]] } else { &[&[0, 1, 2]] };
        let shape = |colors: &&'static [usize]| {
            let axial_px = self.optics.axial_px[colors[0]];
            let coc_px = (coc_px + axial_px).abs().max(MIN_COC_PX).copysign(coc_px + axial_px);
            Shape { colors, axial_px, coc_px, radial: self.radial(coc_px), softening: softening.clone() }
        };
        sets.iter().map(shape).collect()
    }

    /// Where the rays of a point of CoC radius `coc_px` land; `None` if the aperture's outline is the shape.
    fn radial(&self, coc_px: f32) -> Option<Radial> {
        let needed = self.optics.image.is_some() || self.optics.spherical_px != 0.0;
        let [first, third] = self.optics.spherical_terms();
        needed.then(|| Radial::new(coc_px + first, third))
    }

    /// Share of the energy of a light at `position` that its `shape` adds to `pixel`; pixel centres are at whole numbers.
    pub(super) fn share(&self, shape: &Shape, position: Vec2, pixel: Vec2) -> f32 {
        let (offset, height) = (position - pixel, self.field.height(pixel + 0.5));
        let share = match &shape.radial {
            None => self.covered(shape, offset, height) / (shape.coc_px * shape.coc_px),
            Some(radial) => self.density(radial, &shape.softening, offset, height),
        };
        let passing = if self.optics.cats_eye > 0.0 { self.shares.at(height) } else { 1.0 };
        if passing > 0.0 { share / (passing * self.optics.area()) } else { 0.0 }
    }

    /// Share of a pixel that the aperture's outline in `shape` covers, softened. `offset` leads from the pixel to the light, `height` is
    /// the pixel's position in the field.
    fn covered(&self, shape: &Shape, offset: Vec2, height: Vec2) -> f32 {
        let Shape { coc_px, softening, .. } = shape;
        let coc_px = *coc_px;
        let depth = self.optics.aperture.depth_inside(offset, coc_px); // q − p = c·u
        let depth = depth.min(coc_px.abs() * self.within_barrel(offset / coc_px, height));
        if depth.abs() >= softening.reach_px {
            return f32::from(u8::from(depth > 0.0));
        }
        // Exact along x, midpoint rule along y.
        let row = |row: &SofteningRow| {
            let y = offset.y + row.offset_px;
            let outline = self.outline.row(y, coc_px);
            outline.and_then(|outline| self.past_barrel(outline, y, coc_px, height)).map_or(
                0.0,
                |[left, right]| {
                    let step = |edge: f32| soft_step(edge - offset.x, row.width_px);
                    row.weight * (step(right) - step(left))
                },
            )
        };
        softening.rows.iter().map(row).sum()
    }

    /// Distance of the lens point `lens` from the barrel's edge, positive inside, seen from position `height` of the field.
    fn within_barrel(&self, lens: Vec2, height: Vec2) -> f32 {
        if self.optics.cats_eye > 0.0 { self.optics.within_barrel(lens, height) } else { f32::INFINITY }
    }

    /// The part of `row`, at `y` from the centre of a shape of radius `coc_px`, that passes the barrel, seen from position
    /// `height` of the field.
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

    /// Density of the light on a pixel relative to that on the lens. `offset` leads from the pixel to the point, `height` is
    /// the pixel's position in the field.
    fn density(&self, radial: &Radial, softening: &Softening, offset: Vec2, height: Vec2) -> f32 {
        if let Some(light) = self.uniform_light(radial, softening, offset, height) {
            return light;
        }
        let Softening { grid, sample_half_px, .. } = softening;
        let shifts = grid.iter().flat_map(|&x| grid.iter().map(move |&y| Vec2::new(x, y)));
        let sum: f32 = shifts.map(|shift| self.light(radial, offset + shift, height, *sample_half_px)).sum();
        sum / (GRID * GRID) as f32
    }

    /// The light at `offset` from a light, if neither an end of the rays nor an edge of the opening lies within reach of `softening`:
    /// except for an aperture image, it is then uniform over the pixel. Otherwise `None`.
    fn uniform_light(
        &self,
        radial: &Radial,
        softening: &Softening,
        offset: Vec2,
        height: Vec2,
    ) -> Option<f32> {
        let (distance, reach) = (offset.length(), softening.reach_px);
        let (inner, outer) = (distance - reach, distance + reach);
        if radial.ends_between(inner, outer) {
            return None;
        }
        // A slanted edge may come nearer within the pixel.
        let wide = |landing: Landing| {
            let margin = 2.0 * reach * landing.per_px;
            [landing.lens[0] - margin, landing.lens[1] + margin]
        };
        let open = self.optics.open_along(offset / distance.max(f32::MIN_POSITIVE), height);
        let holds_no_end = |[from, to]: [f32; 2]| open.iter().all(|end| *end <= from || *end >= to);
        radial
            .between(inner, outer)
            .all(|landing| holds_no_end(wide(landing)))
            .then(|| self.light(radial, offset, height, softening.pixel_half_px))
    }

    /// The light at `offset` from a point: the mean over the ring of half width `half_px` through it.
    fn light(&self, radial: &Radial, offset: Vec2, height: Vec2, half_px: f32) -> f32 {
        let distance = offset.length();
        let (inner, outer) = ((distance - half_px).max(0.0), distance + half_px);
        let direction = offset / distance.max(f32::MIN_POSITIVE);
        let open = self.optics.open_along(direction, height);
        let light = |landing: Landing| {
            let middle = 0.5 * (landing.lens[0] + landing.lens[1]);
            let transmittance = self.optics.light_around(middle * direction, 2.0 * half_px * landing.per_px);
            landing.share_within(open) * transmittance
        };
        radial.between(inner, outer).map(light).sum::<f32>() / (outer * outer - inner * inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Aperture;

    const SIZE: usize = 96;

    /// The sum and the first and second moments of the light of a point of CoC radius `coc_px` at `position`, about that point.
    fn moments(optics: &Optics, coc_px: f32, position: Vec2) -> (f32, Vec2, Vec2) {
        let bokeh = Bokeh::new(optics, Field::from_picture_size(SIZE, SIZE));
        let shape = &bokeh.shapes(coc_px, &Softening::square(1.0))[0];
        let pixels = (0..SIZE * SIZE).map(|i| Vec2::new((i % SIZE) as f32, (i / SIZE) as f32));
        pixels.fold((0.0, Vec2::ZERO, Vec2::ZERO), |(sum, first, second), pixel| {
            let (share, offset) = (bokeh.share(shape, position, pixel), pixel - position);
            (sum + share, first + share * offset, second + share * offset * offset)
        })
    }

    #[test]
    fn a_shape_with_spherical_aberration_has_the_energy_and_variance_of_its_rays() {
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
                // The squares of pixel and fragment add a twelfth each.
                let expected = rays.green().iter().map(land).sum::<Vec2>() / 1024.0 + 2.0 / 12.0;
                assert!(
                    (second / sum / expected - 1.0).abs().max_element() < 0.02,
                    "{name}: {second}, {expected}"
                );
            }
        }
    }

    #[test]
    fn an_aperture_image_of_a_polygon_gives_the_shape_of_the_polygon() {
        let side = 256;
        let polygon = Aperture::new(5, 20.0).unwrap();
        // Behind focus p = q − c·u: the image of the aperture, x to the right and y down, is −u.
        let at = |i: usize| {
            let pixel = Vec2::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5);
            let image_point = pixel / (0.5 * side as f32) - 1.0;
            (polygon.depth_inside(-image_point, 1.0) * 0.5 * side as f32 + 0.5).clamp(0.0, 1.0)
        };
        let values = (0..side * side).map(at).collect();
        let mask = crate::settings::Mask { name: "polygon".to_owned(), width: side, height: side, values };
        let image = crate::lens::ApertureImage::new(&mask, 0.0).unwrap();
        let from_image =
            Optics { image: Some(std::sync::Arc::new(image)), ..Optics::from_aperture(Aperture::DISC) };
        let exact = Optics::from_aperture(polygon);
        assert!(
            (from_image.area() / exact.area() - 1.0).abs() < 5e-3,
            "{} and {}",
            from_image.area(),
            exact.area()
        );
        let field = Field::from_picture_size(SIZE, SIZE);
        let [from_image, exact] = [&from_image, &exact].map(|optics| Bokeh::new(optics, field));
        let point = Softening::square(0.0);
        for coc in [25.0, -18.0] {
            let (a, b) = (from_image.shapes(coc, &point).remove(0), exact.shapes(coc, &point).remove(0));
            let off = |x: usize, y: usize| {
                let (position, pixel) = (Vec2::splat(48.0), Vec2::new(x as f32, y as f32));
                (from_image.share(&a, position, pixel) - exact.share(&b, position, pixel)).abs()
            };
            let sum: f32 =
                (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))).map(|(x, y)| off(x, y)).sum();
            assert!(sum < 0.03, "c = {coc}: the sum of differences is {sum} of the energy");
        }
    }

    #[test]
    fn in_the_corners_the_barrel_cuts_the_disc_and_the_rest_gets_its_energy() {
        let optics = Optics { cats_eye: 1.0, ..Optics::from_aperture(Aperture::DISC) };
        let bokeh = Bokeh::new(&optics, Field::from_picture_size(SIZE, SIZE));
        let shape = &bokeh.shapes(12.0, &Softening::square(0.0))[0];
        let position = Vec2::splat(20.0);
        let light = |x: f32, y: f32| bokeh.share(shape, position, Vec2::new(x, y));
        let uniform = 1.0 / (std::f32::consts::PI * 144.0);
        // Behind focus the barrel blocks the outer side of the shape.
        assert_eq!(light(13.0, 13.0), 0.0, "outer side");
        assert!(light(27.0, 27.0) > uniform, "inner side");
        let passing = bokeh.shares.at(bokeh.field.height(Vec2::splat(20.5)));
        assert!((light(20.0, 20.0) * passing / uniform - 1.0).abs() < 1e-3);
    }

    #[test]
    fn axial_colour_gives_each_channel_a_shape_of_its_own_size() {
        let optics = Optics { axial_px: [-2.0, 0.0, 1.0], ..Optics::from_aperture(Aperture::DISC) };
        let bokeh = Bokeh::new(&optics, Field::from_picture_size(SIZE, SIZE));
        let softening = Softening::square(1.0);
        let sizes =
            |coc: f32| bokeh.shapes(coc, &softening).iter().map(|shape| shape.coc_px).collect::<Vec<_>>();
        assert_eq!(sizes(10.0), [8.0, 10.0, 11.0]);
        assert_eq!(sizes(-10.0), [-12.0, -10.0, -9.0]);
        assert_eq!(sizes(2.0)[0], MIN_COC_PX, "no smaller than a dot");
    }
}
