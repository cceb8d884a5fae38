//! The surfaces behind the last fragment of a pixel, estimated from what is around it.
//!
//! From each pixel one looks around in eight directions for the first fragment behind the pixel's last one ([`Surroundings`]). The nearer
//! a fragment in the picture, the more it counts, and those that are much farther away than the nearest do not. The surface in the middle
//! of the order by depth is continued: a post that goes on above and below a bar stays a post behind the bar. It is opaque where the
//! nearer half is clear, and fades where it is not; behind it, a second plate continues what lies farther.
//!
//! A plate's colour is the mean of its surface's fragments. Lights, which are brighter than the others around, are dimmed.
//!
//! The estimate fades where the pixel shows the background ([`Background`]): nothing is behind its fragments there.
//!
//! Neighbouring pixels are estimated at once, in vectors. Cost: the pixels that rays pass to something behind them. Memory: the
//! estimated fragments.

use super::around::{Around, COUNTS_TO, Surface, sort};
use super::smooth::{Guess, Row};
use super::surface::CELL_PX;
use super::surroundings::{FADE_PX, LANES, Surroundings};
use super::unmixing::Unmixed;
use super::vector::Vector;
use super::ways::{WAYS, Ways};
use super::{Background, Layer};
use crate::stack::LIGHT_ALPHA;
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Number of surfaces that are estimated behind one another.
pub(super) const PLATES: usize = 2;

/// A fragment brighter than this multiple of the median of its surface around a pixel is a light.
pub(super) const LIGHT: f32 = 2.0;

/// What the estimate is made from.
pub(super) struct Behind<'a> {
    layers: &'a [Layer],
    /// The first of the layers.
    nearest: &'a Layer,
    unmixed: Option<&'a Unmixed>,
    background: Option<&'a Background>,
    surroundings: Surroundings,
}

impl<'a> Behind<'a> {
    /// What is behind `layers`, of which `nearest` is the first.
    pub(super) fn new(
        layers: &'a [Layer],
        nearest: &'a Layer,
        unmixed: Option<&'a Unmixed>,
        background: Option<&'a Background>,
    ) -> Self {
        Self { layers, nearest, unmixed, background, surroundings: Surroundings::new(nearest) }
    }

    /// The estimated fragments of `rows`, by plate, with the instructions of `arch`; `last_px` is memory for it.
    ///
    /// Pixels above one another look at much the same fragments, and follow one another, so that these are still in the cache.
    pub(super) fn rows(&self, rows: Range<usize>, last_px: &mut Vec<f32>, arch: Arch) -> Vec<[Row; PLATES]> {
        let width = self.nearest.width().next_multiple_of(LANES);
        last_px.clear();
        last_px.resize(rows.len() * width, f32::INFINITY);
        for (y, last_px) in rows.clone().zip(last_px.chunks_mut(width.max(1))) {
            self.last_cocs(y, last_px);
        }
        let mut estimated: Vec<_> = rows.clone().map(|_| [const { Row::new() }; PLATES]).collect();
        for x in (0..width).step_by(LANES) {
            for ((y, last_px), rows) in rows.clone().zip(last_px.chunks(width)).zip(&mut estimated) {
                let last_px = last_px[x..].first_chunk().expect("rows have whole groups");
                arch.dispatch(Estimate { behind: self, from: (x, y), last_px, rows });
            }
        }
        estimated
    }

    /// Writes the CoC radii of the last fragments of row `y` that hide something; `∞` where nothing is hidden.
    fn last_cocs(&self, y: usize, last_px: &mut [f32]) {
        for layer in self.layers {
            let fragments = layer.coc_px.row(y).iter().zip(layer.alpha.row(y));
            for (last_px, (&coc_px, &alpha)) in last_px.iter_mut().zip(fragments) {
                *last_px = if alpha > LIGHT_ALPHA { coc_px } else { *last_px };
            }
        }
        if let Some(background) = self.background {
            for (last_px, &share) in last_px.iter_mut().zip(background.share().row(y)) {
                *last_px = if share < 1.0 { *last_px } else { f32::INFINITY };
            }
        }
    }

    /// The unpremultiplied colour of the first layer's fragment at a place.
    fn color(&self, (x, y): (usize, usize)) -> [f32; 3] {
        let unmixed = self.unmixed.and_then(|unmixed| unmixed.get(x, y));
        unmixed.unwrap_or_else(|| self.nearest.unpremultiplied_at(x, y))
    }
}

/// The estimate for [`LANES`] pixels from a place on, to be compiled for each instruction set.
struct Estimate<'a> {
    behind: &'a Behind<'a>,
    from: (usize, usize),
    /// CoC radii of the last fragments of the pixels.
    last_px: &'a [f32; LANES],
    /// The estimated fragments, by plate, which get those of these pixels.
    rows: &'a mut [Row; PLATES],
}

impl WithSimd for Estimate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { behind, from: (x, y), last_px, rows } = self;
        let farthest_px = behind.surroundings.farthest_in_reach((x, y), last_px, CELL_PX);
        let mut hidden = [1.0; LANES];
        if let Some(background) = behind.background {
            for (hidden, &share) in hidden.iter_mut().zip(&background.share().row(y)[x..]) {
                *hidden = 1.0 - share;
            }
        }
        for first in (0..LANES).step_by(S::F32_LANES) {
            let [last_px, farthest_px, hidden] =
                [last_px, &farthest_px, &hidden].map(|values| Vector::load(simd, &values[first..]));
            if farthest_px.most() > f32::NEG_INFINITY {
                let pixels = Pixels { simd, behind, from: (x + first, y), last_px, farthest_px, hidden };
                pixels.estimate(rows);
            }
        }
    }
}

/// Neighbouring pixels of a row.
struct Pixels<'a, S: Simd> {
    simd: S,
    behind: &'a Behind<'a>,
    from: (usize, usize),
    /// CoC radii of their last fragments.
    last_px: Vector<S>,
    /// The largest CoC radii of fragments in reach; `−∞` without any.
    farthest_px: Vector<S>,
    /// The shares of the pixels that do not show the background.
    hidden: Vector<S>,
}

/// Estimated fragments of neighbouring pixels; 0 where there is none.
struct Guesses<S: Simd> {
    color: [Vector<S>; 3],
    coc_px: Vector<S>,
    distance_px: Vector<S>,
}

impl<S: Simd> Pixels<'_, S> {
    #[inline(always)]
    fn all(&self, value: f32) -> Vector<S> {
        Vector::all(self.simd, value)
    }

    /// Appends the fragments behind the last ones, nearest first, to `rows`.
    #[inline(always)]
    fn estimate(&self, rows: &mut [Row; PLATES]) {
        let (simd, surroundings, last_px) = (self.simd, &self.behind.surroundings, self.last_px);
        let [zero, cell_px, infinity] = [0.0, CELL_PX, f32::INFINITY].map(|value| self.all(value));
        let size = (self.behind.nearest.width(), self.behind.nearest.height());
        let mut ways = Ways::new(simd, self.from, size);
        ways.extend((self.farthest_px - last_px + self.all(FADE_PX[1])).larger(zero));
        // Nothing more is looked for from where it becomes `∞`.
        let mut limit_px = last_px + cell_px;
        for (plate, row) in rows.iter_mut().enumerate() {
            // Without a fragment in reach behind the limit, the estimate is transparent.
            limit_px = limit_px.is_below(self.farthest_px).select(limit_px, infinity);
            ways.follow(surroundings, limit_px);
            let nearest_px = ways.nearest_px();
            ways.extend(self.all(COUNTS_TO) * nearest_px);
            ways.follow(surroundings, limit_px);
            let around = Around::new(simd, &ways, nearest_px);
            let middle_px = around.middle_px();
            limit_px = middle_px.is_below(infinity).select(limit_px, infinity);
            if limit_px.least() == f32::INFINITY {
                return;
            }
            let surface = Surface::new(simd, middle_px, last_px);
            let clear = if plate + 1 < PLATES { surface.clear(&around) } else { self.all(1.0) };
            let separate = ((middle_px - last_px) / cell_px - self.all(1.0)).smaller(self.all(1.0));
            let alpha = self.hidden * clear * separate * around.within_reach(last_px);
            let alpha = limit_px.is_below(infinity).select(alpha.larger(zero), zero);
            let nearer_px = (surface.coc_px - surface.cell_px).larger(limit_px);
            ways.follow(surroundings, alpha.is_above(zero).select(nearer_px, infinity));
            let guesses = self.mean(&surface, &ways, (nearest_px, alpha));
            guesses.push(self.from.0, alpha, row);
            limit_px = limit_px.is_below(infinity).select(surface.coc_px + surface.cell_px, infinity);
        }
    }

    /// The means of the fragments of `surface` that the ways have come to, where `alpha` is not 0 and the nearest of all are at `nearest_px`.
    #[inline(always)]
    fn mean(
        &self,
        surface: &Surface<S>,
        ways: &Ways<S>,
        (nearest_px, alpha): (Vector<S>, Vector<S>),
    ) -> Guesses<S> {
        let [zero, one, infinity] = [0.0, 1.0, f32::INFINITY].map(|value| self.all(value));
        let around = Around::new(self.simd, ways, nearest_px);
        let (mut weights, mut colors) = ([zero; WAYS], [[zero; 3]; WAYS]);
        let (mut luminances, mut count) = ([infinity; WAYS], zero);
        for way in 0..WAYS {
            let weight = surface.share(around.coc_px[way]) * around.weights[way];
            weights[way] = alpha.is_above(zero).select(weight, zero);
            let counts = weights[way].is_above(zero);
            colors[way] = self.colors(ways.places(way), weights[way]);
            luminances[way] = counts.select(luminance(colors[way]).larger(zero), infinity);
            count = count + counts.select(one, zero);
        }
        let most = lights_from(self.simd, luminances, count);
        let (mut color, mut coc_px, mut distance_px, mut total) = ([zero; 3], zero, infinity, zero);
        for way in 0..WAYS {
            let counts = weights[way].is_above(zero);
            // A light counts less the brighter it is, and not as more than the limit.
            let brightest = luminances[way].larger(most).larger(self.all(f32::MIN_POSITIVE));
            let dimmed = (most / brightest).smaller(one);
            let weight = weights[way] * dimmed.larger(self.all(f32::EPSILON));
            for (sum, value) in color.iter_mut().zip(colors[way]) {
                *sum = counts.select(*sum + weight * dimmed * value, *sum);
            }
            coc_px = counts.select(coc_px + weight * around.coc_px[way], coc_px);
            distance_px = counts.select(around.distance_px[way].smaller(distance_px), distance_px);
            total = counts.select(total + weight, total);
        }
        let is_any = total.is_above(zero);
        for sum in &mut color {
            *sum = is_any.select(*sum / total, zero);
        }
        Guesses {
            color,
            coc_px: is_any.select(coc_px / total, zero),
            distance_px: is_any.select(distance_px, zero),
        }
    }

    /// The colours at the places of the pixels whose weight is not 0.
    #[inline(always)]
    fn colors(&self, place: impl Fn(usize) -> (usize, usize), weights: Vector<S>) -> [Vector<S>; 3] {
        let (mut colors, mut weight_of) = ([[0.0; LANES]; 3], [0.0; LANES]);
        weights.store(&mut weight_of);
        for lane in (0..S::F32_LANES).filter(|&lane| weight_of[lane] > 0.0) {
            let color = self.behind.color(place(lane));
            colors.iter_mut().zip(color).for_each(|(channel, value)| channel[lane] = value);
        }
        colors.map(|channel| Vector::load(self.simd, &channel))
    }
}

/// The luminance from which a fragment is a light: [`LIGHT`] times the median of the `count` smallest of the `luminances`.
#[inline(always)]
fn lights_from<S: Simd>(simd: S, luminances: [Vector<S>; WAYS], count: Vector<S>) -> Vector<S> {
    let mut sorted = [luminances];
    sort(&mut sorted);
    let [luminances] = sorted;
    let mut median = luminances[0];
    for (i, luminance) in luminances.into_iter().enumerate() {
        // The lower one of two in the middle.
        median = Vector::all(simd, 2.0 * i as f32).is_below(count).select(luminance, median);
    }
    Vector::all(simd, LIGHT) * median
}

impl<S: Simd> Guesses<S> {
    /// Appends those of `alpha` above 0 to `row`; the first is in column `first`.
    #[inline(always)]
    fn push(&self, first: usize, alpha: Vector<S>, row: &mut Row) {
        let [red, green, blue] = self.color;
        let values = [red, green, blue, self.coc_px, self.distance_px, alpha].map(|quantity| {
            let mut values = [0.0; LANES];
            quantity.store(&mut values);
            values
        });
        for lane in 0..S::F32_LANES {
            let [red, green, blue, coc_px, distance_px, alpha] = values.map(|values| values[lane]);
            if alpha > 0.0 {
                row.push((first + lane, Guess { color: [red, green, blue], coc_px, alpha, distance_px }));
            }
        }
    }
}

/// Sum of the channels.
#[inline(always)]
fn luminance<S: Simd>([red, green, blue]: [Vector<S>; 3]) -> Vector<S> {
    red + green + blue
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// Slats of many depths with gaps, lights, translucent and empty samples, before a slope.
    fn layer(width: usize, height: usize) -> Layer {
        let noise = |x: usize, y: usize| (x * 7919 + y * 104_729 + x * y * 31) % 1009;
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(width, height, value);
        let coc = |x: usize, y: usize| match (x / 5 + y / 9) % 4 {
            0 => -12.0 + (x / 20) as f32,
            1 => -3.0 + 0.01 * noise(x, y) as f32,
            _ => 4.0 + 0.1 * x as f32,
        };
        let light = |x: usize, y: usize| if noise(y, x) < 20 { 400.0 } else { 0.0 };
        Layer {
            color: std::array::from_fn(|k| plane(&|x, y| (noise(x + k, y) % 97) as f32 / 97.0 + light(x, y))),
            alpha: plane(&|x, y| [1.0, 1.0, 0.95, 0.6, 0.0][noise(x, y + 3) % 5]),
            coc_px: plane(&coc),
        }
    }

    /// By plate, the estimated fragments of all rows: columns, and bits of all values.
    fn estimated(layers: &[Layer], arch: Arch) -> Vec<Vec<(usize, [u32; 6])>> {
        let background = Background::behind(layers, 1, 30.0);
        let behind = Behind::new(layers, &layers[0], None, background.as_ref());
        let rows = behind.rows(0..layers[0].height(), &mut Vec::new(), arch);
        let values = |(x, guess): &(usize, Guess)| {
            let [red, green, blue] = guess.color;
            (*x, [red, green, blue, guess.coc_px, guess.alpha, guess.distance_px].map(f32::to_bits))
        };
        rows.iter().flatten().map(|row| row.iter().map(values).collect()).collect()
    }

    #[test]
    fn every_instruction_set_estimates_the_same_bits() {
        // Pictures narrower than a vector, and with a rest.
        for (width, height) in [(1, 1), (7, 40), (16, 30), (53, 40), (130, 70)] {
            let layers = [layer(width, height)];
            let scalar = estimated(&layers, Arch::Scalar);
            let count = scalar.iter().map(Vec::len).sum::<usize>();
            assert_eq!(count > 0, width > 1, "{count} fragments in {width} columns");
            #[cfg(target_arch = "x86_64")]
            if let Some(v3) = pulp::x86::V3::try_new() {
                assert_eq!(estimated(&layers, Arch::V3(v3)), scalar, "AVX2 and scalar, {width} columns");
            }
            assert_eq!(estimated(&layers, Arch::new()), scalar, "this machine's and scalar, {width} columns");
        }
    }

    /// [`lights_from`] for these luminances, of which some count.
    struct Lights(Vec<f32>);

    impl WithSimd for Lights {
        type Output = f32;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f32 {
            let counting = self.0.len();
            let of_way = |way: usize| Vector::all(simd, self.0.get(way).copied().unwrap_or(f32::INFINITY));
            lights_from(simd, std::array::from_fn(of_way), Vector::all(simd, counting as f32)).most()
        }
    }

    #[test]
    fn a_light_is_brighter_than_twice_the_lower_median() {
        let medians: [(&[f32], f32); 4] = [
            (&[3.0], 3.0),
            (&[500.0, 1.0], 1.0),
            (&[4.0, 2.0, 9.0], 4.0),
            (&[8.0, 1.0, 7.0, 2.0, 6.0, 3.0, 5.0, 4.0], 4.0),
        ];
        for (luminances, median) in medians {
            for arch in [Arch::Scalar, Arch::new()] {
                assert_eq!(arch.dispatch(Lights(luminances.to_vec())), LIGHT * median, "{luminances:?}");
            }
        }
    }
}
