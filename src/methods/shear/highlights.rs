//! Bright points as exact discs: a few views would show a point a thousand times brighter than its surroundings as dots.
//!
//! [`extract`] takes the excess of a bright, blurred fragment over its surroundings out of its surface; [`draw`] adds it
//! back in the shape that [`super::bokeh`] gives it. Each row of a disc is clipped by the runs of nearer bins, seen from the highlight: the ray of picture point `p` and highlight `q` passes CoC depth `c_k` at
//! `s = p (1 − f) + q f`, `f = c_k / c_q`, which is affine in `p`: a run stays a run.

use super::bins::Bins;
use super::bokeh::{Bokeh, Shape};
use super::runs::{Run, Runs};
use crate::image::Image;
use crate::methods::contract::Plan;
use crate::scene::{EffectKind, Layer};
use glam::Vec2;
use rayon::prelude::*;

/// A fragment with a smaller CoC radius is no disc, in picture pixels.
const MIN_COC_PX: f32 = 1.0;

/// Half the side of the square whose unflagged fragments give a highlight its surroundings, in samples.
const SURROUNDINGS: usize = 4;

/// Rows that one task draws.
const STRIP: usize = 16;

/// The excess light of one fragment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Highlight {
    /// Where it is, in picture pixels; pixel centres are at whole numbers.
    pub(super) place: Vec2,
    /// Its CoC radius in picture pixels.
    pub(super) coc_px: f32,
    /// Light over that of its surroundings, summed over the fragment's area in picture pixels.
    pub(super) energy: [f32; 3],
}

/// Takes what is brighter than the plan's threshold out of `layers`, `supersample` samples a picture pixel along each
/// axis.
pub(super) fn extract(layers: &mut [Layer], plan: &Plan, supersample: usize) -> Vec<Highlight> {
    layers.iter_mut().flat_map(|layer| extract_from(layer, plan, supersample)).collect()
}

fn extract_from(layer: &mut Layer, plan: &Plan, supersample: usize) -> Vec<Highlight> {
    let threshold = plan.strength(EffectKind::Highlights).unwrap_or(f32::INFINITY);
    let view = &*layer;
    let found: Vec<(usize, usize, [f32; 3])> = (0..view.height())
        .into_par_iter()
        .flat_map_iter(|y| flagged(view, y, threshold).into_iter().map(move |x| (x, y)))
        .map(|(x, y)| (x, y, surroundings(view, x, y, threshold)))
        .collect();
    let (scale, samples) = (1.0 / supersample as f32, (supersample * supersample) as f32);
    found
        .into_iter()
        .map(|(x, y, base)| {
            let color = layer.color_at(x, y);
            layer.color.iter_mut().zip(base).for_each(|(plane, value)| plane.set(x, y, value));
            Highlight {
                place: (Vec2::new(x as f32, y as f32) + 0.5) * scale - 0.5,
                coc_px: layer.coc_px.get(x, y),
                energy: std::array::from_fn(|k| (color[k] - base[k]) / samples),
            }
        })
        .collect()
}

fn brightness(color: [f32; 3]) -> f32 {
    color[0].max(color[1]).max(color[2])
}

/// Columns of row `y` that hold a highlight.
fn flagged(layer: &Layer, y: usize, threshold: f32) -> Vec<usize> {
    let [red, green, blue] = layer.color.each_ref().map(|plane| plane.row(y));
    let (alpha, coc) = (layer.alpha.row(y), layer.coc_px.row(y));
    let bright = |x: &usize| brightness([red[*x], green[*x], blue[*x]]) > threshold;
    (0..red.len()).filter(bright).filter(|&x| alpha[x] > 0.0 && coc[x].abs() > MIN_COC_PX).collect()
}

/// Mean colour of the fragments around `x, y` that are no brighter than `threshold`, never more than the fragment's own;
/// where there are none, the fragment's own colour at the threshold.
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
    // Premultiplied colours over their alpha, at the fragment's own alpha.
    let scale = layer.alpha.get(x, y) / alpha_sum;
    std::array::from_fn(|k| {
        if alpha_sum > 0.0 { (sum[k] * scale).min(own[k]) } else { own[k] * threshold / brightness(own) }
    })
}

/// What [`draw`] reads beside the highlights.
#[derive(Debug)]
pub(super) struct Occluders<'a> {
    /// Width of the picture.
    pub(super) width: usize,
    /// The runs of all layers.
    pub(super) runs: &'a Runs,
    /// Their bins.
    pub(super) bins: &'a Bins,
    /// The layers themselves.
    pub(super) layers: &'a [Layer],
}

/// Adds the discs of `highlights`, each in the shape of `bokeh`, to `image`.
pub(super) fn draw(
    image: &mut Image,
    highlights: &[Highlight],
    bokeh: &Bokeh<'_>,
    occluders: &Occluders<'_>,
) {
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
            let mut seen = Vec::new();
            for disc in discs.iter().filter(|disc| disc.touches(rows.start, rows.end)) {
                for y in rows.clone() {
                    let start = (y - rows.start) * width;
                    let row =
                        [&mut *red, &mut *green, &mut *blue].map(|plane| &mut plane[start..start + width]);
                    disc.draw_row(y, row, occluders, &mut seen);
                }
            }
        });
}

/// A highlight about to be drawn.
struct Disc<'a> {
    highlight: &'a Highlight,
    bokeh: &'a Bokeh<'a>,
    /// Its shape, in each set of colours that share one.
    shapes: Vec<Shape>,
}

impl<'a> Disc<'a> {
    fn new(highlight: &'a Highlight, bokeh: &'a Bokeh<'a>) -> Self {
        Self { highlight, bokeh, shapes: bokeh.shapes(highlight.coc_px) }
    }

    fn touches(&self, first_row: usize, end_row: usize) -> bool {
        let reach = self.shapes.iter().fold(0.0, |reach: f32, shape| reach.max(self.bokeh.reach_px(shape)));
        let y = self.highlight.place.y;
        y + reach >= first_row as f32 && y - reach <= (end_row - 1) as f32
    }

    fn draw_row(&self, y: usize, mut row: [&mut [f32]; 3], occluders: &Occluders<'_>, seen: &mut Vec<f32>) {
        for shape in &self.shapes {
            self.draw_shape(shape, y, &mut row, occluders, seen);
        }
    }

    fn draw_shape(
        &self,
        shape: &Shape,
        y: usize,
        row: &mut [&mut [f32]; 3],
        occluders: &Occluders<'_>,
        seen: &mut Vec<f32>,
    ) {
        let place = self.highlight.place;
        let (dy, reach) = (y as f32 - place.y, self.bokeh.reach_px(shape));
        let half_width_squared = reach * reach - dy * dy;
        if half_width_squared <= 0.0 {
            return;
        }
        let half_width = half_width_squared.sqrt();
        let first = (place.x - half_width).ceil().max(0.0) as usize;
        let end = (place.x + half_width).floor() as i64 + 1;
        let end = end.clamp(0, row[0].len() as i64) as usize;
        if first >= end {
            return;
        }
        seen.clear();
        seen.resize(end - first, 1.0);
        self.hide(shape, y, first, seen, occluders);
        for (x, &seen) in (first..end).zip(seen.iter()) {
            let share = seen * self.bokeh.share(shape, place, Vec2::new(x as f32, y as f32));
            if share > 0.0 {
                for &channel in shape.colors {
                    row[channel][x] += self.highlight.energy[channel] * share;
                }
            }
        }
    }

    /// Takes from `seen`, columns from `first` of row `y`, what nearer fragments hide.
    fn hide(&self, shape: &Shape, y: usize, first: usize, seen: &mut [f32], occluders: &Occluders<'_>) {
        let Highlight { place, coc_px, .. } = *self.highlight;
        let height = occluders.runs.rows.len();
        // Nearer by less than this is the highlight's own layer.
        let own = f32::max(0.75, 0.06 * coc_px.abs());
        for (bin, &bin_coc) in occluders.bins.centers_px().iter().enumerate() {
            if bin_coc >= coc_px - own {
                break;
            }
            // Where the rays of these colours focus elsewhere, all CoC radii are others by as much.
            let f = (bin_coc + shape.axial_px) / shape.coc_px;
            let row = ((y as f32) * (1.0 - f) + place.y * f + 0.5).floor();
            let row = row.clamp(0.0, height as f32 - 1.0) as usize;
            let map = Affine { offset: -place.x * f / (1.0 - f), scale: 1.0 / (1.0 - f) };
            for run in occluders.runs.rows[row].of_bin(bin) {
                let alpha = (!run.opaque).then(|| occluders.layers[run.layer as usize].alpha.row(row));
                hide_behind(run, occluders.columns_of(run), map, (first, &mut *seen), alpha);
            }
        }
    }
}

/// `p = offset + scale · s`: where a column of an occluder's row lies in the picture, seen from the highlight.
#[derive(Clone, Copy)]
struct Affine {
    offset: f32,
    scale: f32,
}

impl Occluders<'_> {
    /// From where to where `run` reaches, in columns: for ever, where it ends at the picture's border.
    fn columns_of(&self, run: &Run) -> [f32; 2] {
        let start = if run.start == 0 { f32::NEG_INFINITY } else { run.start as f32 - 0.5 };
        let end = if run.end as usize == self.width { f32::INFINITY } else { run.end as f32 - 0.5 };
        [start, end]
    }
}

/// Takes what `run`, which reaches over `columns`, hides from the columns `seen` (the first column, and what is seen of each),
/// with fractional ends; `alpha` is the coverage of the run's row if it lets light through.
fn hide_behind(
    run: &Run,
    columns: [f32; 2],
    map: Affine,
    (first, seen): (usize, &mut [f32]),
    alpha: Option<&[f32]>,
) {
    let ends = columns.map(|s| map.offset + map.scale * s);
    let (from, to) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    let last = first + seen.len() - 1;
    if to < first as f32 - 0.5 || from > last as f32 + 0.5 {
        return;
    }
    let begin = (from + 0.5).floor().max(first as f32) as usize;
    let end = (to + 0.5).floor().min(last as f32) as usize;
    for x in begin..=end {
        let covered = (to.min(x as f32 + 0.5) - from.max(x as f32 - 0.5)).clamp(0.0, 1.0);
        let opacity = alpha.map_or(1.0, |row| {
            let source = (x as f32 - map.offset) / map.scale;
            row[(source.round() as usize).clamp(run.start as usize, run.end as usize - 1)]
        });
        let seen = &mut seen[x - first];
        *seen = (*seen - covered * opacity).max(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::lens::{Aperture, Field, Optics};
    use crate::methods::shear::runs;

    const SIZE: usize = 64;

    /// The disc of one highlight of energy 1 at the middle, behind a wall of CoC radius −10 where `wall` says so.
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
        let zeros = || Plane::zeros(SIZE, SIZE);
        let alpha = Plane::from_fn(SIZE, SIZE, |x, _| wall(x));
        let near = Plane::filled(SIZE, SIZE, wall_px);
        let layers = [Layer { color: [zeros(), zeros(), zeros()], alpha, coc_px: near }];
        let bins = Bins::new([-10.0, 25.0], 0.5);
        let runs = runs::find(&layers, &bins);
        let highlight = Highlight { place: Vec2::splat(32.0), coc_px, energy: [1.0; 3] };
        let mut image = Image::transparent(SIZE, SIZE);
        draw(
            &mut image,
            &[highlight],
            &Bokeh::new(optics, Field::from_picture_size(SIZE, SIZE), size_px),
            &Occluders { width: SIZE, runs: &runs, bins: &bins, layers: &layers },
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
    fn a_disc_holds_its_energy_at_every_radius_shape_and_softness() {
        let blades = |n, turn| Aperture::new(n, turn).unwrap();
        let curved = blades(6, 0.0).curved(0.7).unwrap();
        for aperture in
            [Aperture::DISC, blades(5, 10.0), blades(6, 0.0), curved, curved.squeezed(2.0).unwrap()]
        {
            for coc in [-25.0, -7.9, -1.2, 1.0, 3.3, 8.1, 19.0] {
                for size in [0.0, 0.5, 1.0] {
                    let sum = energy(&drawn(coc, size, &Optics::from_aperture(aperture), |_| 0.0));
                    // Rows 2/16 px high, midpoint rule: the smallest disc, all edge, is off by less than their square.
                    assert!((sum - 1.0).abs() < 5e-3, "{aperture:?}, c = {coc}, fragment {size}: {sum}");
                }
            }
        }
    }

    #[test]
    fn a_wall_before_the_right_half_of_the_view_hides_half_of_the_disc() {
        // A wall from column 32 on, its edge at 31.5. A ray from p to q passes c = −10 at p (1 − f) + q f, f = −10 / 20: it
        // meets the edge from p = (31.5 + 16) / 1.5 = 31 ⅔ on, which leaves column 32 a sixth of its width.
        let free = drawn(20.0, 1.0, &disc(), |_| 0.0);
        let hidden = drawn(20.0, 1.0, &disc(), |x| f32::from(u8::from(x >= 32)));
        for x in 0..SIZE {
            let share = [1.0, 1.0 / 6.0, 0.0][(x + 1).saturating_sub(32).min(2)];
            let off = (hidden.pixel(x, 32)[0] - share * free.pixel(x, 32)[0]).abs();
            assert!(off < 1e-6, "column {x}: off by {off}");
        }
    }

    #[test]
    fn colours_that_focus_elsewhere_are_hidden_as_if_everything_lay_elsewhere() {
        // A CoC that is 5 px larger for all colours, behind a wall in whose bin the difference falls.
        let right = |x: usize| f32::from(u8::from(x >= 32));
        let astray = Optics { axial_px: [5.0; 3], ..disc() };
        let found = drawn_behind(-10.0, 15.0, 1.0, &astray, right);
        let expected = drawn_behind(-5.0, 20.0, 1.0, &disc(), right);
        for x in 0..SIZE {
            let off = (found.pixel(x, 32)[1] - expected.pixel(x, 32)[1]).abs();
            assert!(off < 1e-6, "column {x}: off by {off}");
        }
    }

    #[test]
    fn a_veil_dims_the_disc_by_its_coverage() {
        let (free, veiled) = (drawn(12.0, 0.0, &disc(), |_| 0.0), drawn(12.0, 0.0, &disc(), |_| 0.25));
        assert!((energy(&veiled) / energy(&free) - 0.75).abs() < 1e-4, "three quarters pass");
    }

    #[test]
    fn a_highlight_before_the_wall_is_not_hidden_by_it() {
        let sum = energy(&drawn(-14.0, 1.0, &disc(), |_| 1.0));
        assert!((sum - 1.0).abs() < 1e-2, "all of it: {sum}");
    }
}
