//! Bright points as exact discs: with few views a point a thousand times brighter than its surroundings would show as dots.
//!
//! [`extract`] removes the excess of a bright, blurred fragment over its surroundings from its surface; [`draw`] adds it back
//! in the shape that [`super::bokeh`] computes. Each row of a disc is clipped by the spans of nearer bins, seen from the
//! highlight: the ray from picture point `p` to highlight `q` passes CoC depth `c_k` at `s = p (1 − f) + q f`, `f = c_k / c_q`.
//! This is affine in `p`, so a span is projected to a span.

use super::bins::Bins;
use super::bokeh::{Bokeh, Shape};
use super::keys::Extent;
use super::spans::{self, Span, Spans};
use crate::image::Image;
use crate::lens::Field;
use crate::methods::contract::Plan;
use crate::scene::{Antialiasing, EffectKind, Layer, Scene, share_of_disc};
use glam::Vec2;
use rayon::prelude::*;
use std::ops::Range;

/// Fragments nearer than a highlight by less than the first belong to its own surface, and those nearer by more than the second to
/// others, in picture pixels and as a share of the highlight's CoC radius: whichever is more.
const OWN_SURFACE: [(f32, f32); 2] = [(0.25, 0.03), (0.75, 0.06)];

/// How much brighter than the threshold a fragment is whose whole excess goes into a disc: a quarter of a stop.
const FULL_DISC_FROM: f32 = 1.19;

/// Half the side of the square around a highlight whose fragments below the threshold are its surroundings, in samples.
const SURROUNDINGS: usize = 4;

/// Rows that one task draws.
const STRIP: usize = 16;

/// The excess energy of one fragment over its surroundings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Highlight {
    /// Position in picture pixels; pixel centres are at whole numbers.
    pub(super) position: Vec2,
    /// Signed CoC radius in picture pixels.
    pub(super) coc_px: f32,
    /// Excess over the colour of the surroundings, integrated over the fragment's area in picture pixels.
    pub(super) energy: [f32; 3],
    /// How far its colour is an average over the pixel: see [`crate::scene::Antialiasing`].
    pub(super) antialiased: f32,
}

/// Removes the excess of fragments brighter than the plan's threshold from the layers of `scene`.
pub(super) fn extract(scene: &mut Scene, plan: &Plan) -> Vec<Highlight> {
    let Scene { layers, supersample, antialiasing, .. } = scene;
    layers.iter_mut().flat_map(|layer| extract_from(layer, plan, (*supersample, antialiasing))).collect()
}

fn extract_from(
    layer: &mut Layer,
    plan: &Plan,
    (supersample, antialiasing): (usize, &Antialiasing),
) -> Vec<Highlight> {
    let threshold = plan.strength(EffectKind::Highlights).unwrap_or(f32::INFINITY);
    let original = &*layer;
    let found: Vec<(usize, usize, [f32; 3])> = (0..original.height())
        .into_par_iter()
        .flat_map_iter(|y| flagged(original, y, threshold).into_iter().map(move |x| (x, y)))
        .map(|(x, y)| (x, y, surroundings(original, x, y, threshold)))
        .collect();
    let (scale, samples) = (1.0 / supersample as f32, (supersample * supersample) as f32);
    found
        .into_iter()
        .map(|(x, y, base)| {
            let (color, coc_px) = (layer.color_at(x, y), layer.coc_px.get(x, y));
            let share = share_of_disc(coc_px) * share_of_light(brightness(color) / threshold);
            let excess: [f32; 3] = std::array::from_fn(|k| share * (color[k] - base[k]));
            let planes = layer.color.iter_mut().zip(color.iter().zip(excess));
            planes.for_each(|(plane, (value, excess))| plane.set(x, y, value - excess));
            Highlight {
                position: (Vec2::new(x as f32, y as f32) + 0.5) * scale - 0.5,
                coc_px,
                energy: excess.map(|value| value / samples),
                antialiased: antialiasing.at(x / supersample, y / supersample),
            }
        })
        .collect()
}

/// Share of the excess of a fragment `times` as bright as the threshold that goes into a disc.
fn share_of_light(times: f32) -> f32 {
    ((times - 1.0) / (FULL_DISC_FROM - 1.0)).clamp(0.0, 1.0)
}

fn brightness(color: [f32; 3]) -> f32 {
    color[0].max(color[1]).max(color[2])
}

/// Columns of row `y` that hold a highlight.
fn flagged(layer: &Layer, y: usize, threshold: f32) -> Vec<usize> {
    let [red, green, blue] = layer.color.each_ref().map(|plane| plane.row(y));
    // Most rows hold none, which one comparison a value tells.
    let any = |row: &[f32]| row.iter().fold(false, |any, &value| any | (value > threshold));
    if ![red, green, blue].into_iter().any(any) {
        return Vec::new();
    }
    let (alpha, coc) = (layer.alpha.row(y), layer.coc_px.row(y));
    let bright = |x: &usize| brightness([red[*x], green[*x], blue[*x]]) > threshold;
    (0..red.len()).filter(bright).filter(|&x| alpha[x] > 0.0 && share_of_disc(coc[x]) > 0.0).collect()
}

/// Mean colour of the fragments around `x, y` that are no brighter than `threshold`, at most the fragment's own colour. Without
/// such fragments, the fragment's own colour scaled to the threshold.
fn surroundings(layer: &Layer, x: usize, y: usize, threshold: f32) -> [f32; 3] {
    let own = layer.color_at(x, y);
    let (mut sum, mut alpha_sum) = ([0.0; 3], 0.0);
    for ny in y.saturating_sub(SURROUNDINGS)..=(y + SURROUNDINGS).min(layer.height() - 1) {
        for nx in x.saturating_sub(SURROUNDINGS)..=(x + SURROUNDINGS).min(layer.width() - 1) {
            let (near, alpha) = (layer.color_at(nx, ny), layer.alpha.get(nx, ny));
            if alpha > 0.0 && brightness(near) <= threshold {
                sum.iter_mut().zip(near).for_each(|(sum, value)| *sum += value);
                alpha_sum += alpha;
            }
        }
    }
    // The mean of premultiplied colours, unpremultiplied and premultiplied again by the fragment's own alpha.
    let scale = layer.alpha.get(x, y) / alpha_sum;
    std::array::from_fn(|k| {
        if alpha_sum > 0.0 { (sum[k] * scale).min(own[k]) } else { own[k] * threshold / brightness(own) }
    })
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
/// whose CoC radii `bins` cover. A highlight that is an average in part is drawn as a fragment of either width, by that part.
pub(super) fn draw(
    image: &mut Image,
    highlights: &[Highlight],
    (plan, field): (&Plan, Field),
    (layers, bins): (&[Layer], &Bins),
) {
    /// Width of the square that a point sample represents, in picture pixels.
    const POINT_SAMPLE_PX: f32 = 1.0;
    if highlights.is_empty() {
        return;
    }
    let occluders = &Occluders::new(layers, bins);
    let parts = [
        (POINT_SAMPLE_PX, parts(highlights, |highlight| 1.0 - highlight.antialiased)),
        (plan.averages_px, parts(highlights, |highlight| highlight.antialiased)),
    ];
    for (fragment_px, highlights) in parts.iter().filter(|(_, highlights)| !highlights.is_empty()) {
        draw_alike(image, highlights, &Bokeh::new(&plan.optics, field, *fragment_px), occluders);
    }
}

/// The `highlights` with the part `share` of their energy, without those that have none.
fn parts(highlights: &[Highlight], share: impl Fn(&Highlight) -> f32) -> Vec<Highlight> {
    let part = |highlight: &Highlight| {
        let share = share(highlight);
        let energy = highlight.energy.map(|energy| energy * share);
        (share > 0.0).then(|| Highlight { energy, ..highlight.clone() })
    };
    highlights.iter().filter_map(part).collect()
}

/// Adds the discs of `highlights` to `image`, each in the shape of `bokeh` and occluded by nearer fragments.
fn draw_alike(image: &mut Image, highlights: &[Highlight], bokeh: &Bokeh<'_>, occluders: &Occluders<'_>) {
    let (width, height) = (image.width(), image.height());
    let discs: Vec<Disc<'_>> = highlights.iter().map(|highlight| Disc::new(highlight, bokeh)).collect();
    let [red, green, blue, _] = &mut image.planes;
    red.values_mut()
        .par_chunks_mut(width * STRIP)
        .zip(green.values_mut().par_chunks_mut(width * STRIP))
        .zip(blue.values_mut().par_chunks_mut(width * STRIP))
        .enumerate()
        .for_each(|(strip, ((red, green), blue))| {
            let rows = strip * STRIP..(strip * STRIP + STRIP).min(height);
            let mut hidden = Hidden::default();
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
}

impl<'a> Disc<'a> {
    fn new(highlight: &'a Highlight, bokeh: &'a Bokeh<'a>) -> Self {
        Self { highlight, bokeh, shapes: bokeh.shapes(highlight.coc_px) }
    }

    fn touches(&self, first_row: usize, end_row: usize) -> bool {
        let reach = self.shapes.iter().fold(0.0, |reach: f32, shape| reach.max(self.bokeh.reach_px(shape)));
        let y = self.highlight.position.y;
        y + reach >= first_row as f32 && y - reach <= (end_row - 1) as f32
    }

    fn draw_row(&self, y: usize, mut row: [&mut [f32]; 3], occluders: &Occluders<'_>, hidden: &mut Hidden) {
        for shape in &self.shapes {
            self.draw_shape(shape, y, &mut row, occluders, hidden);
        }
    }

    fn draw_shape(
        &self,
        shape: &Shape,
        y: usize,
        row: &mut [&mut [f32]; 3],
        occluders: &Occluders<'_>,
        hidden: &mut Hidden,
    ) {
        let position = self.highlight.position;
        let (dy, reach) = (y as f32 - position.y, self.bokeh.reach_px(shape));
        let half_width_squared = reach * reach - dy * dy;
        if half_width_squared <= 0.0 {
            return;
        }
        let half_width = half_width_squared.sqrt();
        let first = (position.x - half_width).ceil().max(0.0) as usize;
        let end = (position.x + half_width).floor() as i64 + 1;
        let end = end.clamp(0, row[0].len() as i64) as usize;
        if first >= end {
            return;
        }
        hidden.clear(first..end);
        self.occlude(shape, y, hidden, occluders);
        for (x, visible) in hidden.visible() {
            let share = visible * self.bokeh.share(shape, position, Vec2::new(x as f32, y as f32));
            if share > 0.0 {
                for &channel in shape.colors {
                    row[channel][x] += self.highlight.energy[channel] * share;
                }
            }
        }
    }

    /// Adds to `hidden` what nearer fragments hide of row `y`.
    fn occlude(&self, shape: &Shape, y: usize, hidden: &mut Hidden, occluders: &Occluders<'_>) {
        let Highlight { position, coc_px, .. } = *self.highlight;
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
fn share_that_hides(coc_px: f32, occluder_px: f32) -> f32 {
    let [own_px, other_px] = OWN_SURFACE.map(|(least_px, share)| f32::max(least_px, share * coc_px.abs()));
    ((coc_px - occluder_px - own_px) / (other_px - own_px)).clamp(0.0, 1.0)
}

/// `p = offset + scale · s`: the projection of column `s` of an occluder's row to column `p` of the picture, seen from the
/// highlight.
#[derive(Clone, Copy)]
struct Affine {
    offset: f32,
    scale: f32,
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

/// How far nearer fragments hide some columns of a row of a disc.
///
/// A surface is in several bins, which overlap where its fragments reach to their neighbours and adjoin where they do not. It hides what its
/// bins hide together, but no more than the one that hides most, so that the number of bins does not matter.
#[derive(Debug, Default)]
struct Hidden {
    /// The first column.
    first: usize,
    /// Number of columns.
    count: usize,
    /// The layers that hide any of them.
    layers: Vec<u16>,
    /// For each of these layers and each column, the sum over its bins of the share of the column that they cover times how far they hide.
    sums: Vec<f32>,
    /// The same for the most that one of its bins hides where it covers.
    most: Vec<f32>,
}

impl Hidden {
    /// Starts with nothing hidden of `columns`.
    fn clear(&mut self, columns: Range<usize>) {
        (self.first, self.count) = (columns.start, columns.len());
        self.layers.clear();
        self.sums.clear();
        self.most.clear();
    }

    /// Where the columns of layer `layer` begin in the sums.
    fn start_of(&mut self, layer: u16) -> usize {
        let known = self.layers.iter().position(|&known| known == layer);
        let index = known.unwrap_or_else(|| {
            self.layers.push(layer);
            for values in [&mut self.sums, &mut self.most] {
                values.resize(self.layers.len() * self.count, 0.0);
            }
            self.layers.len() - 1
        });
        index * self.count
    }

    /// Adds `span`, which covers `columns` of its row, mapped to the disc's row by `map`, with fractional coverage at its ends; it hides the
    /// share `share`, and `alpha` is the coverage of its row if it is translucent.
    fn add(
        &mut self,
        span: &Span,
        (columns, map): ([f32; 2], Affine),
        (share, alpha): (f32, Option<&[f32]>),
    ) {
        let ends = columns.map(|s| map.offset + map.scale * s);
        let (from, to) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let last = self.first + self.count - 1;
        if to < self.first as f32 - 0.5 || from > last as f32 + 0.5 {
            return;
        }
        let begin = (from + 0.5).floor().max(self.first as f32) as usize;
        let end = (to + 0.5).floor().min(last as f32) as usize;
        let start = self.start_of(span.layer);
        for x in begin..=end {
            let covered = (to.min(x as f32 + 0.5) - from.max(x as f32 - 0.5)).clamp(0.0, 1.0);
            let opacity = alpha.map_or(1.0, |row| {
                let source = (x as f32 - map.offset) / map.scale;
                row[(source.round() as usize).clamp(span.start as usize, span.end as usize - 1)]
            });
            let index = start + x - self.first;
            let hides = if covered > 0.0 { share * opacity } else { 0.0 };
            self.sums[index] += covered * hides;
            self.most[index] = self.most[index].max(hides);
        }
    }

    /// The columns, and how far each is visible.
    fn visible(&self) -> impl Iterator<Item = (usize, f32)> {
        (0..self.count).map(|column| {
            let layers = (column..self.sums.len()).step_by(self.count);
            let visible = layers.fold(1.0, |left: f32, index| left - self.sums[index].min(self.most[index]));
            (self.first + column, visible.max(0.0))
        })
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
        let highlight = Highlight { position: Vec2::splat(32.0), coc_px, energy: [1.0; 3], antialiased: 0.0 };
        let mut image = Image::transparent(SIZE, SIZE);
        draw_alike(
            &mut image,
            &[highlight],
            &Bokeh::new(optics, Field::from_picture_size(SIZE, SIZE), size_px),
            &Occluders::new(&layers, &bins),
        );
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
