//! Bright points as exact discs: with few views a point a thousand times brighter than its surroundings would show as dots.
//!
//! [`super::lights`] finds them and removes them from their surfaces; [`draw`] adds them back in the shape that [`super::bokeh`]
//! computes. Each row of a disc is clipped by what is nearer ([`super::occluders`]), seen from each part of the highlight.

use super::bins::Bins;
use super::bokeh::{Bokeh, Shape};
use super::hidden::Hidden;
use super::occluders::{Candidate, DiscRow, Occluders};
use super::softening::Softening;
use crate::image::{Image, Plane};
use crate::lens::Field;
use crate::methods::contract::Plan;
use crate::parallel;
use crate::scene::Layer;
use glam::Vec2;
use std::ops::Range;

/// Rows that one task draws.
const STRIP: usize = 16;

/// A light that is drawn as an exact disc.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Highlight {
    /// Position in picture pixels; pixel centres are at whole numbers.
    pub(super) position: Vec2,
    /// Signed CoC radius in picture pixels.
    pub(super) coc_px: f32,
    /// Excess over the colour of the surroundings, integrated over the light's area in picture pixels.
    pub(super) energy: [f32; 3],
    /// What the light comes from.
    pub(super) emitter: Emitter,
    /// Its parts, each of which has its own view of what is in front.
    pub(super) parts: Vec<Part>,
}

/// A part of a light, at most a pixel wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Part {
    /// Position in picture pixels.
    pub(super) position: Vec2,
    /// Share of the light's energy.
    pub(super) share: f32,
    /// Share that is hidden from all of the lens, 0 … 1: see [`super::occluders::share_that_covers`].
    pub(super) hidden: f32,
}

/// What a light comes from, in picture pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Emitter {
    /// One fragment.
    Square { width_px: f32 },
    /// A light.
    Disc { radius_px: f32 },
}

impl Emitter {
    fn softening(self) -> Softening {
        match self {
            Self::Square { width_px } => Softening::square(width_px),
            Self::Disc { radius_px } => Softening::disc(radius_px),
        }
    }
}

/// Adds the discs of `highlights` to `image`, each in the shape of the lens of `plan` and occluded by nearer fragments of `layers`,
/// whose CoC radii `bins` cover.
pub(super) fn draw(
    image: &mut Image,
    highlights: &[Highlight],
    (plan, field): (&Plan, Field),
    (layers, bins): (&[Layer], &Bins),
) {
    if !highlights.is_empty() {
        draw_all(image, highlights, &Bokeh::new(&plan.optics, field), &Occluders::new(layers, bins));
    }
}

/// Adds the discs of `highlights` to `image`, each in the shape of `bokeh` and occluded by nearer fragments.
fn draw_all(image: &mut Image, highlights: &[Highlight], bokeh: &Bokeh<'_>, occluders: &Occluders<'_>) {
    let (width, height) = (image.width(), image.height());
    let discs: Vec<Disc<'_>> =
        parallel::map(highlights.len(), &|number| Disc::new(&highlights[number], bokeh));
    let [red, green, blue, _] = image.planes.each_mut().map(Plane::values_mut);
    parallel::for_each_row_of([red, green, blue], width * STRIP, &|strip, [red, green, blue]| {
        let rows = strip * STRIP..(strip * STRIP + STRIP).min(height);
        let mut scratch = Scratch::default();
        for disc in discs.iter().filter(|disc| disc.touches(rows.start, rows.end)) {
            for y in rows.clone() {
                let start = (y - rows.start) * width;
                let row = [&mut *red, &mut *green, &mut *blue].map(|plane| &mut plane[start..start + width]);
                disc.draw_row(y, row, occluders, &mut scratch);
            }
        }
    });
}

/// A highlight with its shape.
struct Disc<'a> {
    highlight: &'a Highlight,
    bokeh: &'a Bokeh<'a>,
    /// Corners of the rectangle that holds the light's parts, in picture pixels.
    corners: [Vec2; 2],
    /// The shape of each set of colours that share one.
    shapes: Vec<Shape>,
    /// The shape of a part of the light, alike.
    part_shapes: Vec<Shape>,
}

/// Memory for a row of a disc.
#[derive(Default)]
struct Scratch<'a> {
    /// What may hide a part of the light.
    candidates: Vec<Candidate<'a>>,
    /// What is hidden of one part.
    hidden: Hidden,
    /// For each part, how far it is visible in each column.
    visible: Vec<f32>,
}

impl<'a> Disc<'a> {
    /// Width of a part of a light, in picture pixels.
    const PART_PX: f32 = 1.0;

    fn new(highlight: &'a Highlight, bokeh: &'a Bokeh<'a>) -> Self {
        let shapes = |softening| bokeh.shapes(highlight.coc_px, &softening);
        let positions = || highlight.parts.iter().map(|part| part.position);
        Self {
            highlight,
            bokeh,
            corners: [
                positions().fold(Vec2::INFINITY, Vec2::min),
                positions().fold(Vec2::NEG_INFINITY, Vec2::max),
            ],
            shapes: shapes(highlight.emitter.softening()),
            part_shapes: shapes(Softening::square(Self::PART_PX)),
        }
    }

    fn touches(&self, first_row: usize, end_row: usize) -> bool {
        let reach = self.shapes.iter().fold(0.0, |reach: f32, shape| reach.max(shape.reach_px()));
        let y = self.highlight.position.y;
        y + reach >= first_row as f32 && y - reach <= (end_row - 1) as f32
    }

    fn draw_row<'s>(
        &self,
        y: usize,
        row: [&mut [f32]; 3],
        occluders: &'s Occluders<'_>,
        scratch: &mut Scratch<'s>,
    ) {
        let Highlight { position, coc_px, energy, .. } = *self.highlight;
        for (shape, part_shape) in self.shapes.iter().zip(&self.part_shapes) {
            let columns = self.columns(shape, y, row[0].len());
            if columns.is_empty() {
                continue;
            }
            let (count, first) = (columns.len(), columns.start);
            let (disc_px, axial_px) = (shape.coc_px, shape.axial_px);
            let disc_row = DiscRow { y, columns: columns.clone(), coc_px, disc_px, axial_px };
            let same = self.see(&disc_row, occluders, scratch);
            for x in columns {
                let pixel = Vec2::new(x as f32, y as f32);
                let of_part = |part: usize| scratch.visible[part * count + x - first];
                let visible = same.unwrap_or_else(|| self.visible(part_shape, pixel, &of_part));
                let share = self.bokeh.share(shape, position, pixel) * visible;
                if share > 0.0 {
                    for &channel in shape.colors {
                        row[channel][x] += energy[channel] * share;
                    }
                }
            }
        }
    }

    /// The columns of row `y` of a picture of this width that `shape` reaches.
    fn columns(&self, shape: &Shape, y: usize, width: usize) -> Range<usize> {
        let position = self.highlight.position;
        let (dy, reach) = (y as f32 - position.y, shape.reach_px());
        let half_width_squared = reach * reach - dy * dy;
        if half_width_squared <= 0.0 {
            return 0..0;
        }
        let half_width = half_width_squared.sqrt();
        let first = (position.x - half_width).ceil().max(0.0) as usize;
        let end = (position.x + half_width).floor() as i64 + 1;
        first..end.clamp(0, width as i64) as usize
    }

    /// How far the light is visible at `pixel`, where each of its parts is `visible(part)`: their mean by the energy that reaches the pixel.
    fn visible(&self, part_shape: &Shape, pixel: Vec2, visible: &impl Fn(usize) -> f32) -> f32 {
        let parts = &self.highlight.parts;
        let first = visible(0);
        if (1..parts.len()).all(|part| visible(part) == first) {
            return first;
        }
        /// Weight of a part that the pixel does not see, so that a mean is defined where it sees none.
        const UNSEEN: f32 = 1e-6;
        let (sum, weight) = parts.iter().enumerate().fold((0.0, 0.0), |(sum, weights), (index, part)| {
            let weight = part.share * (self.bokeh.share(part_shape, part.position, pixel) + UNSEEN);
            (sum + weight * visible(index), weights + weight)
        });
        sum / weight
    }

    /// Writes to `scratch` how far each part of the light is visible in the columns of `disc_row`. Returns how far if that is the same for
    /// all of them.
    fn see<'s>(
        &self,
        disc_row: &DiscRow,
        occluders: &'s Occluders<'_>,
        scratch: &mut Scratch<'s>,
    ) -> Option<f32> {
        let (parts, Scratch { candidates, hidden, visible }) = (&self.highlight.parts, scratch);
        occluders.search(disc_row, self.corners, candidates);
        let same = parts.iter().all(|part| part.hidden == parts[0].hidden);
        if candidates.is_empty() && same {
            return Some(1.0 - parts[0].hidden);
        }
        visible.clear();
        for part in parts {
            hidden.clear(disc_row.columns.clone(), part.hidden);
            occluders.hide(candidates, (part.position, disc_row.y), hidden);
            visible.extend(hidden.visible());
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::occluders::share_that_hides;
    use super::*;
    use crate::image::Plane;
    use crate::lens::{Aperture, Field, Optics};

    const SIZE: usize = 64;

    /// The disc of one highlight of energy 1 at the centre, behind a wall of CoC radius −10 and of coverage `wall(x)` in column
    /// `x`.
    fn drawn(coc_px: f32, size_px: f32, optics: &Optics, wall: impl Fn(usize) -> f32) -> Image {
        drawn_behind(-10.0, coc_px, size_px, optics, wall)
    }

    /// The same behind a wall of CoC radius `wall_px`.
    fn drawn_behind(
        wall_px: f32,
        coc_px: f32,
        size_px: f32,
        optics: &Optics,
        wall: impl Fn(usize) -> f32,
    ) -> Image {
        drawn_behind_wall(Plane::filled(SIZE, SIZE, wall_px), coc_px, size_px, optics, wall)
    }

    /// The same behind a wall of these CoC radii.
    fn drawn_behind_wall(
        wall_px: Plane,
        coc_px: f32,
        size_px: f32,
        optics: &Optics,
        wall: impl Fn(usize) -> f32,
    ) -> Image {
        let zeros = || Plane::zeros(SIZE, SIZE);
        let alpha = Plane::from_fn(SIZE, SIZE, |x, _| wall(x));
        let layers = [Layer { color: [zeros(), zeros(), zeros()], alpha, coc_px: wall_px }];
        let bins = Bins::new([-10.0, 25.0], 0.5);
        let emitter = Emitter::Square { width_px: size_px };
        let part = Part { position: Vec2::splat(32.0), share: 1.0, hidden: 0.0 };
        let highlight =
            Highlight { position: part.position, coc_px, energy: [1.0; 3], emitter, parts: vec![part] };
        let mut image = Image::transparent(SIZE, SIZE);
        let bokeh = Bokeh::new(optics, Field::from_picture_size(SIZE, SIZE));
        draw_all(&mut image, &[highlight], &bokeh, &Occluders::new(&layers, &bins));
        image
    }

    fn disc() -> Optics {
        Optics::from_aperture(Aperture::DISC)
    }

    fn energy(image: &Image) -> f32 {
        image.planes[1].values().iter().sum()
    }

    #[test]
    fn a_disc_keeps_its_energy_at_every_radius_shape_and_softness() {
        let blades = |n, rotation_deg| Aperture::new(n, rotation_deg).unwrap();
        let curved = blades(6, 0.0).curved(0.7).unwrap();
        for aperture in
            [Aperture::DISC, blades(5, 10.0), blades(6, 0.0), curved, curved.squeezed(2.0).unwrap()]
        {
            for coc in [-25.0, -7.9, -1.2, 1.0, 3.3, 8.1, 19.0] {
                for size in [0.0, 0.5, 1.0] {
                    let sum = energy(&drawn(coc, size, &Optics::from_aperture(aperture), |_| 0.0));
                    // Midpoint rule over rows 2/16 px high: the smallest disc, which is all edge, is off by less than their
                    // square.
                    assert!((sum - 1.0).abs() < 5e-3, "{aperture:?}, c = {coc}, fragment {size}: {sum}");
                }
            }
        }
    }

    #[test]
    fn a_wall_in_front_of_the_right_half_of_the_picture_hides_half_of_the_disc() {
        // The wall begins at column 32, so its edge lies at 31.5. A ray from p to q passes c = −10 at p (1 − f) + q f, f = −10
        // / 20. It passes the edge at p = (31.5 + 16) / 1.5 = 31 ⅔, so a sixth of the width of column 32 is visible.
        let free = drawn(20.0, 1.0, &disc(), |_| 0.0);
        let hidden = drawn(20.0, 1.0, &disc(), |x| f32::from(u8::from(x >= 32)));
        for x in 0..SIZE {
            let share = [1.0, 1.0 / 6.0, 0.0][(x + 1).saturating_sub(32).min(2)];
            let off = (hidden.pixel(x, 32)[0] - share * free.pixel(x, 32)[0]).abs();
            assert!(off < 1e-5, "column {x}: off by {off}");
        }
    }

    #[test]
    fn axial_colour_moves_highlight_and_occluder_by_the_same_coc() {
        // Axial colour of 5 px gives the picture of a highlight and a wall whose CoC radii are 5 px larger.
        let right = |x: usize| f32::from(u8::from(x >= 32));
        let with_axial_color = Optics { axial_px: [5.0; 3], ..disc() };
        let found = drawn_behind(-10.0, 15.0, 1.0, &with_axial_color, right);
        let expected = drawn_behind(-5.0, 20.0, 1.0, &disc(), right);
        for x in 0..SIZE {
            let off = (found.pixel(x, 32)[1] - expected.pixel(x, 32)[1]).abs();
            assert!(off < 1e-5, "column {x}: off by {off}");
        }
    }

    #[test]
    fn a_translucent_layer_attenuates_the_disc_by_its_coverage() {
        let (free, attenuated) = (drawn(12.0, 0.0, &disc(), |_| 0.0), drawn(12.0, 0.0, &disc(), |_| 0.25));
        assert!((energy(&attenuated) / energy(&free) - 0.75).abs() < 1e-4, "transmittance of three quarters");
    }

    #[test]
    fn a_wall_hides_more_of_a_disc_the_nearer_it_is_and_none_of_it_at_the_same_depth() {
        let behind = |gap_px: f32| energy(&drawn_behind(8.0 - gap_px, 8.0, 1.0, &disc(), |_| 1.0));
        let energies: Vec<f32> = (0..=40).map(|i| behind(0.05 * i as f32)).collect();
        assert!((energies[0] - 1.0).abs() < 5e-3 && energies[40] == 0.0, "{energies:?}");
        // Bins are 0.37 px wide there, so that the wall moves by that much at once: three quarters of the way from all to nothing.
        assert!(energies.windows(2).all(|pair| (0.0..0.8).contains(&(pair[0] - pair[1]))), "{energies:?}");
        assert_eq!([0.25, 0.5, 0.75].map(|gap_px| share_that_hides(8.0, 8.0 - gap_px)), [0.0, 0.5, 1.0]);
        assert_eq!([1.5, 2.25, 3.0].map(|gap_px| share_that_hides(-50.0, -50.0 - gap_px)), [0.0, 0.5, 1.0]);
    }

    #[test]
    fn a_rough_wall_hides_what_its_fragments_hide_whatever_their_number_of_bins() {
        // Fragments of c = 1.4 and 1.6, which hide 0.7 and 0.3 of a highlight of c = 2, and lie three bins apart.
        let relief = Plane::from_fn(SIZE, SIZE, |x, y| if (x + y) % 2 == 0 { 1.4 } else { 1.6 });
        let sum = energy(&drawn_behind_wall(relief, 2.0, 1.0, &disc(), |_| 1.0));
        assert!((0.3..0.7).contains(&sum), "{sum} of the disc is visible");
    }

    #[test]
    fn a_highlight_in_front_of_the_wall_is_not_occluded() {
        let sum = energy(&drawn(-14.0, 1.0, &disc(), |_| 1.0));
        assert!((sum - 1.0).abs() < 1e-2, "sum {sum}");
    }
}
