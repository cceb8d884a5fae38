//! Bright points as exact discs: with few views a point a thousand times brighter than its surroundings would show as dots.
//!
//! [`super::lights`] finds them and removes them from their surfaces; [`draw`] adds them back in the shape that [`super::bokeh`]
//! computes. Each row of a disc is clipped by the spans of nearer bins, seen from each part of the highlight ([`super::hidden`]): the ray
//! from picture point `p` to `q` on the highlight passes CoC depth `c_k` at `s = p (1 − f) + q f`, `f = c_k / c_q`. This is affine in `p`,
//! so a span is projected to a span.

use super::bins::Bins;
use super::bokeh::{Bokeh, Shape};
use super::hidden::{Affine, Hidden};
use super::keys::Extent;
use super::softening::Softening;
use super::spans::{self, Span, Spans};
use crate::image::Image;
use crate::lens::Field;
use crate::methods::contract::Plan;
use crate::scene::Layer;
use glam::Vec2;
use rayon::prelude::*;
use std::ops::Range;

/// Fragments nearer than a highlight by less than the first belong to its own surface, and those nearer by more than the second to
/// others, in picture pixels and as a share of the highlight's CoC radius: whichever is more.
const OWN_SURFACE: [(f32, f32); 2] = [(0.25, 0.03), (0.75, 0.06)];

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
    /// Share that is hidden from all of the lens, 0 … 1: see [`share_that_covers`].
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

/// The scene that occludes highlights.
#[derive(Debug)]
pub(super) struct Occluders<'a> {
    /// Width of the picture.
    width: usize,
    /// The spans of all layers, by [`Extent::Occluder`].
    spans: Spans,
    /// The bins of the spans.
    bins: &'a Bins,
    /// The layers.
    layers: &'a [Layer],
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
    let discs: Vec<Disc<'_>> = highlights.par_iter().map(|highlight| Disc::new(highlight, bokeh)).collect();
    let [red, green, blue, _] = &mut image.planes;
    red.values_mut()
        .par_chunks_mut(width * STRIP)
        .zip(green.values_mut().par_chunks_mut(width * STRIP))
        .zip(blue.values_mut().par_chunks_mut(width * STRIP))
        .enumerate()
        .for_each(|(strip, ((red, green), blue))| {
            let rows = strip * STRIP..(strip * STRIP + STRIP).min(height);
            let mut hidden = (Hidden::default(), Vec::new());
            for disc in discs.iter().filter(|disc| disc.touches(rows.start, rows.end)) {
                for y in rows.clone() {
                    let start = (y - rows.start) * width;
                    let row =
                        [&mut *red, &mut *green, &mut *blue].map(|plane| &mut plane[start..start + width]);
                    disc.draw_row(y, row, occluders, &mut hidden);
                }
            }
        });
}

/// A highlight with its shape.
struct Disc<'a> {
    highlight: &'a Highlight,
    bokeh: &'a Bokeh<'a>,
    /// The shape of each set of colours that share one.
    shapes: Vec<Shape>,
    /// The shape of a part of the light, alike.
    part_shapes: Vec<Shape>,
}

/// Memory for a row of a disc: what is hidden of one part, and how far each part is visible in each column.
type Scratch = (Hidden, Vec<f32>);

impl<'a> Disc<'a> {
    /// Width of a part of a light, in picture pixels.
    const PART_PX: f32 = 1.0;

    fn new(highlight: &'a Highlight, bokeh: &'a Bokeh<'a>) -> Self {
        let shapes = |softening| bokeh.shapes(highlight.coc_px, &softening);
        Self {
            highlight,
            bokeh,
            shapes: shapes(highlight.emitter.softening()),
            part_shapes: shapes(Softening::square(Self::PART_PX)),
        }
    }

    fn touches(&self, first_row: usize, end_row: usize) -> bool {
        let reach = self.shapes.iter().fold(0.0, |reach: f32, shape| reach.max(shape.reach_px()));
        let y = self.highlight.position.y;
        y + reach >= first_row as f32 && y - reach <= (end_row - 1) as f32
    }

    fn draw_row(&self, y: usize, row: [&mut [f32]; 3], occluders: &Occluders<'_>, scratch: &mut Scratch) {
        let position = self.highlight.position;
        for (shape, part_shape) in self.shapes.iter().zip(&self.part_shapes) {
            let columns = self.columns(shape, y, row[0].len());
            if columns.is_empty() {
                continue;
            }
            self.see(shape, (y, columns.clone()), occluders, scratch);
            let (count, first) = (columns.len(), columns.start);
            for x in columns {
                let pixel = Vec2::new(x as f32, y as f32);
                let visible = |part: usize| scratch.1[part * count + x - first];
                let share =
                    self.bokeh.share(shape, position, pixel) * self.visible(part_shape, pixel, &visible);
                if share > 0.0 {
                    for &channel in shape.colors {
                        row[channel][x] += self.highlight.energy[channel] * share;
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

    /// Writes how far each part of the light is visible in `columns` of row `y` of the picture.
    fn see(
        &self,
        shape: &Shape,
        (y, columns): (usize, Range<usize>),
        occluders: &Occluders<'_>,
        (hidden, visible): &mut Scratch,
    ) {
        visible.clear();
        for part in &self.highlight.parts {
            hidden.clear(columns.clone(), part.hidden);
            self.occlude(shape, (part.position, y), hidden, occluders);
            visible.extend(hidden.visible());
        }
    }

    /// Adds to `hidden` what nearer fragments hide of row `y` from a part of the light at `position`.
    fn occlude(
        &self,
        shape: &Shape,
        (position, y): (Vec2, usize),
        hidden: &mut Hidden,
        occluders: &Occluders<'_>,
    ) {
        let coc_px = self.highlight.coc_px;
        let height = occluders.spans.height();
        for (bin, &bin_coc) in occluders.bins.centers_px().iter().enumerate() {
            let share = share_that_hides(coc_px, bin_coc);
            if share <= 0.0 {
                break;
            }
            // Axial colour changes all CoC radii of these colours by the same amount.
            let f = (bin_coc + shape.axial_px) / shape.coc_px;
            let row = ((y as f32) * (1.0 - f) + position.y * f + 0.5).floor();
            let row = row.clamp(0.0, height as f32 - 1.0) as usize;
            let map = Affine { offset: -position.x * f / (1.0 - f), scale: 1.0 / (1.0 - f) };
            for span in occluders.spans.of_block(row, bin) {
                let alpha = (!span.opaque).then(|| occluders.layers[span.layer as usize].alpha.row(row));
                hidden.add(span, (occluders.columns_of(span), map), (share, alpha));
            }
        }
    }
}

/// Share of a fragment with the CoC radius `occluder_px` that hides a highlight with `coc_px`: what is not of its own surface.
pub(super) fn share_that_hides(coc_px: f32, occluder_px: f32) -> f32 {
    let [own_px, other_px] = OWN_SURFACE.map(|(least_px, share)| f32::max(least_px, share * coc_px.abs()));
    ((coc_px - occluder_px - own_px) / (other_px - own_px)).clamp(0.0, 1.0)
}

/// Share of a fragment with the CoC radius `occluder_px` that hides all of the light behind it at the same place with `coc_px`: a ray passes it
/// at nearly the place of the light, if it is little nearer.
pub(super) fn share_that_covers(coc_px: f32, occluder_px: f32) -> f32 {
    /// Difference in CoC radius from which on it covers nothing, relative to the one from which on [`share_that_hides`] is all.
    const NONE_FROM: f32 = 1.25;
    let other_px = f32::max(OWN_SURFACE[1].0, OWN_SURFACE[1].1 * coc_px.abs());
    ((NONE_FROM * other_px - (coc_px - occluder_px)) / ((NONE_FROM - 1.0) * other_px)).clamp(0.0, 1.0)
}

impl<'a> Occluders<'a> {
    /// The occluders in `layers`, whose CoC radii `bins` cover.
    fn new(layers: &'a [Layer], bins: &'a Bins) -> Self {
        let width = layers.first().map_or(0, Layer::width);
        Self { width, spans: spans::find(layers, bins, Extent::Occluder), bins, layers }
    }

    /// The columns that `span` covers; a span that ends at the picture's border is unbounded there.
    fn columns_of(&self, span: &Span) -> [f32; 2] {
        let start = if span.start == 0 { f32::NEG_INFINITY } else { span.start as f32 - 0.5 };
        let end = if span.end as usize == self.width { f32::INFINITY } else { span.end as f32 - 0.5 };
        [start, end]
    }
}

#[cfg(test)]
mod tests {
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
