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
//! Cost: the pixels that rays pass to something behind them. Memory: the estimated fragments.

use super::smooth::{Guess, Row};
use super::surface::{CELL_PX, CELL_SHARE};
use super::surroundings::{FADE_PX, LANES, Surroundings};
use super::unmixing::Unmixed;
use super::ways::{WAYS, Ways};
use super::{Background, Layer};
use crate::stack::LIGHT_ALPHA;

/// Number of surfaces that are estimated behind one another.
pub(super) const PLATES: usize = 2;

/// Shares of what is around a pixel, of surfaces not behind a plate: transparent up to the first, opaque from the second on.
const CLEAR: [f32; 2] = [0.5, 0.9];

/// A fragment brighter than this multiple of the median of its surface around a pixel is a light.
pub(super) const LIGHT: f32 = 2.0;

/// A fragment does not count from this multiple of the distance of the nearest on.
const COUNTS_TO: f32 = 3.0;

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

    /// The estimated fragments of row `y`, by plate; `last_px` is memory for it.
    pub(super) fn row(&self, y: usize, last_px: &mut Vec<f32>) -> [Row; PLATES] {
        last_px.clear();
        last_px.resize(self.nearest.width().next_multiple_of(LANES), f32::INFINITY);
        self.last_cocs(y, last_px);
        let mut rows = [const { Row::new() }; PLATES];
        for (group, last_px) in last_px.as_chunks::<LANES>().0.iter().enumerate() {
            let from = (group * LANES, y);
            let farthest_px = self.surroundings.farthest_in_reach(from, last_px, CELL_PX);
            let is_in_reach = |lane: usize| farthest_px[lane] > f32::NEG_INFINITY;
            if !(0..LANES).any(is_in_reach) {
                continue;
            }
            let of_lane = |lane, value, other| if is_in_reach(lane) { value } else { other };
            let limit_px = std::array::from_fn(|lane| of_lane(lane, last_px[lane] + CELL_PX, f32::INFINITY));
            let distance_px = std::array::from_fn(|lane| {
                of_lane(lane, farthest_px[lane] - last_px[lane] + FADE_PX[1], 0.0)
            });
            let seen = self.surroundings.first_seen(from, limit_px, distance_px);
            for lane in (0..LANES).filter(|&lane| is_in_reach(lane)) {
                let Some(ways) = seen.ways(lane) else { continue };
                let x = from.0 + lane;
                let plates = self.plates((x, y), ways, last_px[lane], farthest_px[lane]);
                for (row, guess) in rows.iter_mut().zip(plates) {
                    if guess.alpha > 0.0 {
                        row.push((x, guess));
                    }
                }
            }
        }
        rows
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

    /// The estimated fragments at a place, nearest first, behind the last fragment of CoC radius `last_px`: the `ways` have come to what is
    /// first seen behind it. The largest CoC radius of fragments in reach is `farthest_px`.
    fn plates(
        &self,
        (x, y): (usize, usize),
        mut ways: Ways,
        last_px: f32,
        farthest_px: f32,
    ) -> [Guess; PLATES] {
        let mut plates = [Guess::default(); PLATES];
        let hidden = self.background.map_or(1.0, |background| 1.0 - background.share().get(x, y));
        let mut limit_px = last_px + CELL_PX;
        for (i, plate) in plates.iter_mut().enumerate() {
            // Without a fragment in reach behind the limit, the estimate is transparent.
            if farthest_px <= limit_px {
                break;
            }
            let Some(around) = self.look(&mut ways, limit_px) else { break };
            let Some(middle_px) = around.middle_px() else { break };
            let surface = Surface { coc_px: middle_px, cell_px: cell_px(middle_px - last_px) };
            let clear = if i + 1 < PLATES { surface.clear(&around) } else { 1.0 };
            let separate = ((middle_px - last_px) / CELL_PX - 1.0).min(1.0);
            let alpha = hidden * clear * separate * around.within_reach(last_px);
            if alpha > 0.0 {
                self.surroundings.follow(&mut ways, limit_px.max(surface.coc_px - surface.cell_px));
                *plate = Guess { alpha, ..self.mean(&surface, &ways, around.nearest_px) };
            }
            limit_px = surface.coc_px + surface.cell_px;
        }
        plates
    }

    /// What is seen behind `limit_px`; `None` if all ways end without a fragment.
    fn look(&self, ways: &mut Ways, limit_px: f32) -> Option<Around> {
        self.surroundings.follow(ways, limit_px);
        let nearest_px = ways.distances_px().into_iter().fold(f32::INFINITY, f32::min);
        if nearest_px.is_infinite() {
            return None;
        }
        ways.extend(COUNTS_TO * nearest_px);
        self.surroundings.follow(ways, limit_px);
        Some(Around::new(ways, nearest_px))
    }

    /// The unpremultiplied colour of the first layer's fragment at a place.
    fn color(&self, (x, y): (usize, usize)) -> [f32; 3] {
        let unmixed = self.unmixed.and_then(|unmixed| unmixed.get(x, y));
        unmixed.unwrap_or_else(|| self.nearest.unpremultiplied_at(x, y))
    }

    /// The mean of the fragments of `surface` that the ways have come to, where the nearest of all is at `nearest_px`.
    fn mean(&self, surface: &Surface, ways: &Ways, nearest_px: f32) -> Guess {
        let around = Around::new(ways, nearest_px);
        let weights: [f32; WAYS] =
            std::array::from_fn(|way| surface.share(around.coc_px[way]) * around.weights[way]);
        let counting = || (0..WAYS).filter(|&way| weights[way] > 0.0);
        let (mut colors, mut brightness, mut count) = ([[0.0; 3]; WAYS], [f32::INFINITY; WAYS], 0);
        for way in counting() {
            colors[way] = self.color(ways.place(way));
            brightness[count] = luminance(colors[way]);
            count += 1;
        }
        brightness.sort_unstable_by(f32::total_cmp);
        let most = LIGHT * brightness[count.saturating_sub(1) / 2];
        let (mut guess, mut total) = (Guess { distance_px: f32::INFINITY, ..Guess::default() }, 0.0);
        for way in counting() {
            let own = colors[way];
            // A light counts less the brighter it is, and not as more than the limit.
            let dimmed = (most / luminance(own).max(most).max(f32::MIN_POSITIVE)).min(1.0);
            let weight = weights[way] * dimmed.max(f32::EPSILON);
            guess.color.iter_mut().zip(own).for_each(|(sum, value)| *sum += weight * dimmed * value);
            guess.coc_px += weight * around.coc_px[way];
            guess.distance_px = guess.distance_px.min(around.distance_px[way]);
            total += weight;
        }
        if total <= 0.0 {
            return Guess::default();
        }
        Guess { color: guess.color.map(|sum| sum / total), coc_px: guess.coc_px / total, ..guess }
    }
}

/// The fragments that the ways from a pixel have come to, and how much each counts.
struct Around {
    /// `−∞` without a fragment.
    coc_px: [f32; WAYS],
    /// `∞` without a fragment.
    distance_px: [f32; WAYS],
    /// 0 for a fragment that does not count, or none.
    weights: [f32; WAYS],
    /// Distance of the nearest.
    nearest_px: f32,
}

impl Around {
    /// Fragments count less the farther away they are, and nothing from [`COUNTS_TO`] times `nearest_px` on: what an edge hides depends
    /// on what is near it.
    fn new(ways: &Ways, nearest_px: f32) -> Self {
        let inverse_square = |distance_px: f32| (distance_px * distance_px).recip();
        let distance_px = ways.distances_px();
        let none = inverse_square(COUNTS_TO * nearest_px);
        let weights = distance_px.map(|distance_px| (inverse_square(distance_px) - none).max(0.0));
        Self { coc_px: *ways.coc_px(), distance_px, weights, nearest_px }
    }

    /// The CoC radius up to which half of what is seen lies, by weight.
    fn middle_px(&self) -> Option<f32> {
        let mut order: [(f32, f32); WAYS] = std::array::from_fn(|way| {
            let counts = self.weights[way] > 0.0;
            (if counts { self.coc_px[way] } else { f32::INFINITY }, self.weights[way])
        });
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let half = 0.5 * order.iter().map(|(_, weight)| weight).sum::<f32>();
        let mut sum = 0.0;
        let found = order.iter().find(|(_, weight)| {
            sum += weight;
            sum >= half
        });
        found.map(|(coc_px, _)| *coc_px).filter(|coc_px| coc_px.is_finite())
    }

    /// How far rays that pass a fragment of CoC radius `coc_px` reach what is seen, 0 … 1: at a depth they are as far away as CoC radii
    /// differ.
    fn within_reach(&self, coc_px: f32) -> f32 {
        let counting = (0..WAYS).filter(|&way| self.weights[way] > 0.0);
        let missing = counting.map(|way| self.distance_px[way] - (self.coc_px[way] - coc_px));
        let [all, none] = FADE_PX;
        ((none - missing.fold(f32::INFINITY, f32::min)) / (none - all)).clamp(0.0, 1.0)
    }
}

/// A surface among those around a pixel.
struct Surface {
    coc_px: f32,
    /// Difference in CoC radius from which a fragment is of another surface.
    cell_px: f32,
}

impl Surface {
    /// How far a fragment of this CoC radius is one of the surface, 0 … 1.
    fn share(&self, coc_px: f32) -> f32 {
        (1.0 - (coc_px - self.coc_px).abs() / self.cell_px).max(0.0)
    }

    /// How far the surface is opaque, 0 … 1: by the share of what is around that does not lie behind it.
    fn clear(&self, around: &Around) -> f32 {
        let (mut nearer, mut total) = (0.0, 0.0);
        for (coc_px, weight) in around.coc_px.into_iter().zip(around.weights) {
            let behind = ((coc_px - self.coc_px) / self.cell_px - 1.0).clamp(0.0, 1.0);
            nearer += weight * (1.0 - behind);
            total += weight;
        }
        let t = ((nearer / total - CLEAR[0]) / (CLEAR[1] - CLEAR[0])).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
}

/// Difference in CoC radius from which fragments around a pixel are of two surfaces, `behind_px` behind the pixel's own.
fn cell_px(behind_px: f32) -> f32 {
    CELL_PX.max(CELL_SHARE * behind_px)
}

/// Sum of the channels; 0 for negative light.
fn luminance(color: [f32; 3]) -> f32 {
    color.iter().sum::<f32>().max(0.0)
}
