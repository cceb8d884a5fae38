//! Disocclusion fill: estimated surfaces behind the last fragment, for stacks of one or two layers.
//!
//! A lens ray that passes all known fragments should hit something plausible: the surfaces from the neighbourhood, continued behind what
//! hides them. From each pixel one looks around in eight directions for the first fragment behind the pixel's last one ([`Surroundings`]).
//! The nearer a fragment in the picture, the more it counts, and those that are much farther away than the nearest do not. The surface in
//! the middle of the order by depth is continued: a post that goes on above and below a bar stays a post behind the bar. It is opaque
//! where the nearer half is clear, and fades where it is not; behind it, a second plate continues what lies farther.
//!
//! A plate's colour is the mean of its surface's fragments, smoothed more the farther they are away ([`Smooth`]). None is that of a mixture
//! ([`unmixed_colors`]), and lights, which are brighter than the others around, are dimmed.
//!
//! The estimate fades where the pixel shows the background ([`Background`]): nothing is behind its fragments there.

use super::smooth::{Guess, Row, Smooth};
use super::surface::{CELL_PX, CELL_SHARE};
use super::surroundings::{FADE_PX, Seen, Surroundings, Way};
use super::unmixing::{replace_blurred, unmixed_colors};
use super::{Background, Layer, Scene};
use crate::image::Plane;
use crate::stack::LIGHT_ALPHA;
use rayon::prelude::*;

/// Number of surfaces that are estimated behind one another.
const PLATES: usize = 2;

/// Shares of what is around a pixel, of surfaces not behind a plate: transparent up to the first, opaque from the second on.
const CLEAR: [f32; 2] = [0.5, 0.9];

/// A fragment brighter than this multiple of the median of its surface around a pixel is a light.
const LIGHT: f32 = 2.0;

/// A fragment does not count from this multiple of the distance of the nearest on.
const COUNTS_TO: f32 = 3.0;

impl Scene {
    /// The scene at one sample per pixel, with estimated surfaces as its last layers.
    #[must_use]
    pub fn filled(self) -> Self {
        let has_mixed_edges = self.supersample == 1;
        let mut scene = self.merged();
        let colors = match &mut scene.layers[..] {
            [] => return scene,
            [picture] if has_mixed_edges => {
                // Peels, and the samples of a pixel, hold each surface's own colours; one picture with depth has mixtures of two at every
                // edge.
                let colors = unmixed_colors(picture, &scene.antialiasing);
                replace_blurred(picture, &colors);
                colors
            }
            [nearest, ..] => nearest.unpremultiplied(),
        };
        let estimated = estimated_layers(&scene.layers, &colors, scene.background.as_deref());
        scene.layers.extend(estimated);
        scene
    }
}

/// The estimated surfaces behind `layers`, nearest first, without those that are nowhere. `colors` are those of the first layer,
/// unpremultiplied.
fn estimated_layers(layers: &[Layer], colors: &[[f32; 3]], background: Option<&Background>) -> Vec<Layer> {
    let Some(nearest) = layers.first() else { return Vec::new() };
    let (width, height) = (nearest.width(), nearest.height());
    let behind = Behind { layers, colors, background, surroundings: Surroundings::new(nearest) };
    let plates: Vec<[Row; PLATES]> = (0..height).into_par_iter().map(|y| behind.row(y, width)).collect();
    let plates = (0..PLATES).map(|plate| plates.iter().map(|rows| rows[plate].as_slice()).collect());
    plates
        .filter(|rows: &Vec<&[_]>| rows.iter().any(|row| !row.is_empty()))
        .map(|rows| layer(&rows, width))
        .collect()
}

/// The layer of estimated fragments, `rows` of `width` pixels, with their colours smoothed.
fn layer(rows: &[&[(usize, Guess)]], width: usize) -> Layer {
    let smooth = Smooth::new(rows, width);
    let plane = || Plane::zeros(width, rows.len());
    let mut layer = Layer { color: [plane(), plane(), plane()], alpha: plane(), coc_px: plane() };
    let Layer { color: [red, green, blue], alpha, coc_px } = &mut layer;
    let [red, green, blue, alpha, coc_px] =
        [red, green, blue, alpha, coc_px].map(|plane| plane.values_mut().par_chunks_mut(width.max(1)));
    let planes = red.zip(green).zip(blue).zip(alpha).zip(coc_px).zip(rows);
    planes.enumerate().for_each(|(y, (((((red, green), blue), alpha), coc_px), row))| {
        for (x, guess) in *row {
            let color = smooth.color((*x, y), guess).map(|value| guess.alpha * value);
            [red[*x], green[*x], blue[*x], alpha[*x], coc_px[*x]] =
                [color[0], color[1], color[2], guess.alpha, guess.coc_px];
        }
    });
    layer
}

/// What the estimate is made from.
struct Behind<'a> {
    layers: &'a [Layer],
    colors: &'a [[f32; 3]],
    background: Option<&'a Background>,
    surroundings: Surroundings,
}

impl Behind<'_> {
    /// The estimated fragments of row `y`, by plate.
    fn row(&self, y: usize, width: usize) -> [Row; PLATES] {
        let mut rows = [const { Row::new() }; PLATES];
        for x in 0..width {
            for (row, guess) in rows.iter_mut().zip(self.plates((x, y))) {
                if guess.alpha > 0.0 {
                    row.push((x, guess));
                }
            }
        }
        rows
    }

    /// The estimated fragments behind the last fragment at a place, nearest first.
    fn plates(&self, place: (usize, usize)) -> [Guess; PLATES] {
        let mut plates = [Guess::default(); PLATES];
        let (x, y) = place;
        let hidden = self.background.map_or(1.0, |background| 1.0 - background.share().get(x, y));
        let Some(last_px) = last_coc(self.layers, x, y).filter(|_| hidden > 0.0) else { return plates };
        let Some(reach_px) = self.surroundings.reach_px(place, last_px, CELL_PX) else { return plates };
        let mut ways = Surroundings::ways(place, reach_px + FADE_PX[1]);
        let mut limit_px = last_px + CELL_PX;
        for (i, plate) in plates.iter_mut().enumerate() {
            let Some((seen, nearest_px)) = self.look(&mut ways, limit_px) else { break };
            let Some(middle_px) = middle(&seen) else { break };
            let surface = Surface { coc_px: middle_px, cell_px: cell_px(middle_px - last_px) };
            let clear = if i + 1 < PLATES { surface.clear(&seen) } else { 1.0 };
            *plate = self.mean(&surface, &mut ways.clone(), [limit_px, nearest_px]);
            let separate = ((middle_px - last_px) / CELL_PX - 1.0).min(1.0);
            plate.alpha = hidden * clear * separate * within_reach(&seen, last_px);
            limit_px = surface.coc_px + surface.cell_px;
        }
        plates
    }

    /// The first fragment on each way behind `limit_px` with its weight, and the distance of the nearest; `None` if all ways end without one.
    fn look(&self, ways: &mut [Way; 8], limit_px: f32) -> Option<([Option<Weighted>; 8], f32)> {
        let within = |ways: &mut [Way; 8]| ways.each_mut().map(|way| self.surroundings.follow(way, limit_px));
        let nearest_px =
            within(ways).iter().flatten().map(|seen| seen.distance_px).fold(f32::INFINITY, f32::min);
        if nearest_px.is_infinite() {
            return None;
        }
        ways.iter_mut().for_each(|way| way.extend(COUNTS_TO * nearest_px));
        Some((within(ways).map(|seen| Weighted::new(seen?, nearest_px)), nearest_px))
    }

    /// The mean of the fragments of `surface` that are met first on each way behind `limit_px`, where the nearest of all is at
    /// `nearest_px`.
    fn mean(&self, surface: &Surface, ways: &mut [Way; 8], [limit_px, nearest_px]: [f32; 2]) -> Guess {
        let limit_px = limit_px.max(surface.coc_px - surface.cell_px);
        let seen = ways.each_mut().map(|way| {
            let Weighted { seen, weight } =
                Weighted::new(self.surroundings.follow(way, limit_px)?, nearest_px)?;
            Some((surface.share(seen.coc_px) * weight, seen)).filter(|(weight, _)| *weight > 0.0)
        });
        let color = |seen: &Seen| self.colors[seen.place.1 * self.surroundings.width() + seen.place.0];
        let seen = || seen.iter().flatten();
        let mut brightness = [f32::INFINITY; 8];
        brightness.iter_mut().zip(seen()).for_each(|(value, (_, seen))| *value = luminance(color(seen)));
        brightness.sort_unstable_by(f32::total_cmp);
        let most = LIGHT * brightness[seen().count().saturating_sub(1) / 2];
        let (mut guess, mut total) = (Guess { distance_px: f32::INFINITY, ..Guess::default() }, 0.0);
        for (weight, seen) in seen() {
            let own = color(seen);
            // A light counts less the brighter it is, and not as more than the limit.
            let dimmed = (most / luminance(own).max(most).max(f32::MIN_POSITIVE)).min(1.0);
            let weight = weight * dimmed.max(f32::EPSILON);
            guess.color.iter_mut().zip(own).for_each(|(sum, value)| *sum += weight * dimmed * value);
            guess.coc_px += weight * seen.coc_px;
            guess.distance_px = guess.distance_px.min(seen.distance_px);
            total += weight;
        }
        if total <= 0.0 {
            return Guess::default();
        }
        Guess { color: guess.color.map(|sum| sum / total), coc_px: guess.coc_px / total, ..guess }
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
    fn clear(&self, seen: &[Option<Weighted>; 8]) -> f32 {
        let (mut nearer, mut total) = (0.0, 0.0);
        for Weighted { seen, weight } in seen.iter().flatten() {
            let behind = ((seen.coc_px - self.coc_px) / self.cell_px - 1.0).clamp(0.0, 1.0);
            nearer += weight * (1.0 - behind);
            total += weight;
        }
        let t = ((nearer / total - CLEAR[0]) / (CLEAR[1] - CLEAR[0])).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
}

/// A fragment beside a pixel, and how much it counts.
#[derive(Debug, Clone, Copy)]
struct Weighted {
    seen: Seen,
    weight: f32,
}

impl Weighted {
    /// Less the farther away it is, and nothing from [`COUNTS_TO`] times `nearest_px` on: what an edge hides depends on what is near it.
    fn new(seen: Seen, nearest_px: f32) -> Option<Self> {
        let inverse_square = |distance_px: f32| (distance_px * distance_px).recip();
        let weight = inverse_square(seen.distance_px) - inverse_square(COUNTS_TO * nearest_px);
        (weight > 0.0).then_some(Self { seen, weight })
    }
}

/// The CoC radius up to which half of what is seen lies, by weight.
fn middle(seen: &[Option<Weighted>; 8]) -> Option<f32> {
    let mut order = seen.map(|seen| seen.map_or((f32::INFINITY, 0.0), |one| (one.seen.coc_px, one.weight)));
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * order.iter().map(|(_, weight)| weight).sum::<f32>();
    let mut sum = 0.0;
    let found = order.iter().find(|(_, weight)| {
        sum += weight;
        sum >= half
    });
    found.map(|(coc_px, _)| *coc_px).filter(|coc_px| coc_px.is_finite())
}

/// Difference in CoC radius from which fragments around a pixel are of two surfaces, `behind_px` behind the pixel's own.
fn cell_px(behind_px: f32) -> f32 {
    CELL_PX.max(CELL_SHARE * behind_px)
}

/// How far rays that pass a fragment of CoC radius `coc_px` reach what is seen, 0 … 1: at a depth they are as far away as CoC radii differ.
fn within_reach(seen: &[Option<Weighted>; 8], coc_px: f32) -> f32 {
    let missing = seen.iter().flatten().map(|one| one.seen.distance_px - (one.seen.coc_px - coc_px));
    let [all, none] = FADE_PX;
    ((none - missing.fold(f32::INFINITY, f32::min)) / (none - all)).clamp(0.0, 1.0)
}

/// Sum of the channels; 0 for negative light.
fn luminance(color: [f32; 3]) -> f32 {
    color.iter().sum::<f32>().max(0.0)
}

/// CoC radius of the last fragment at `x, y` that hides something.
fn last_coc(layers: &[Layer], x: usize, y: usize) -> Option<f32> {
    layers.iter().rev().find(|layer| layer.alpha.get(x, y) > LIGHT_ALPHA).map(|layer| layer.coc_px.get(x, y))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A layer of 64 × 64 pixels: colour and CoC radius of each.
    fn picture(pixel: impl Fn(usize, usize) -> ([f32; 3], f32)) -> Layer {
        let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(64, 64, value);
        Layer {
            color: std::array::from_fn(|k| plane(&|x, y| pixel(x, y).0[k])),
            alpha: plane(&|_, _| 1.0),
            coc_px: plane(&|x, y| pixel(x, y).1),
        }
    }

    fn estimated(layer: Layer) -> Vec<Layer> {
        let colors = layer.unpremultiplied();
        estimated_layers(&[layer], &colors, None)
    }

    const RED: [f32; 3] = [1.0, 0.0, 0.0];
    const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
    const BLUE: [f32; 3] = [0.0, 0.0, 1.0];

    /// A near red stripe in front of a far green wall, which is unknown behind the stripe.
    fn stripe(x: usize, _: usize) -> ([f32; 3], f32) {
        if (28..36).contains(&x) { (RED, -20.0) } else { (GREEN, 6.0) }
    }

    #[test]
    fn a_near_stripe_is_filled_with_the_surface_around_it() {
        let fill = &estimated(picture(stripe))[0];
        for x in 28..36 {
            assert_eq!(fill.alpha.get(x, 16), 1.0, "column {x} is filled");
            assert!((fill.coc_px.get(x, 16) - 6.0).abs() < 1e-4, "column {x} lies on the wall");
            assert!(fill.color_at(x, 16)[0] < 1e-6, "column {x} has nothing of the stripe's red");
            assert!((fill.color_at(x, 16)[1] - 1.0).abs() < 1e-5, "column {x} is the wall's green");
        }
    }

    #[test]
    fn nothing_is_filled_behind_the_farthest_surface() {
        let fill = estimated(picture(stripe));
        assert_eq!(fill.len(), 1, "one wall");
        assert_eq!(fill[0].alpha.get(5, 16), 0.0, "no fill behind the wall");
    }

    #[test]
    fn nothing_is_filled_where_no_ray_can_reach() {
        // The stripe is little nearer than the wall: rays spread by less than the distance to the surroundings.
        let fill = estimated(picture(|x, _| (GREEN, if (8..56).contains(&x) { 0.0 } else { 3.0 })));
        assert_eq!(fill[0].alpha.get(32, 32), 0.0, "24 px from the wall, 3 px of blur");
        assert_eq!(fill[0].alpha.get(9, 32), 1.0, "2 px from it");
    }

    #[test]
    fn a_post_stays_whole_behind_a_bar_and_the_wall_goes_on_behind_the_post() {
        let is_post = |x: usize| (28..38).contains(&x);
        let scene = |x: usize, y: usize| match (x, y) {
            (_, 29..35) => (RED, -20.0),
            (x, _) if is_post(x) => (BLUE, 2.0),
            _ => (GREEN, 12.0),
        };
        let fill = estimated(picture(scene));
        assert_eq!(fill.len(), 2, "post and wall");
        for y in 29..35 {
            for x in 28..38 {
                assert!((fill[0].coc_px.get(x, y) - 2.0).abs() < 1e-4, "{x}, {y}: the post goes on");
                assert!(fill[0].alpha.get(x, y) > 0.5, "{x}, {y}: more than half");
            }
            for x in 31..35 {
                assert!(
                    fill[0].alpha.get(x, y) > 0.99 && fill[0].color_at(x, y)[1] < 0.01,
                    "{x}, {y}: whole"
                );
            }
            for x in (5..24).chain(42..60) {
                let shown = fill.iter().find(|layer| layer.alpha.get(x, y) > 0.1).unwrap();
                assert!((shown.coc_px.get(x, y) - 12.0).abs() < 1e-4, "{x}, {y}: the wall beside it");
            }
        }
        assert!((fill[1].coc_px.get(32, 32) - 12.0).abs() < 1e-4, "behind the post");
    }

    #[test]
    fn a_light_beside_an_edge_is_not_continued_behind_it() {
        let lit =
            |x: usize, y: usize| if (x, y) == (36, 16) { ([0.0, 500.0, 0.0], 6.0) } else { stripe(x, y) };
        let fill = &estimated(picture(lit))[0];
        let most = fill.color[1].values().iter().copied().fold(0.0, f32::max);
        assert!(most <= LIGHT * 1.0 + 1e-3, "{most}");
    }

    #[test]
    fn the_estimate_follows_depth_and_colour_by_degrees() {
        // The stripe moves towards the wall until it is one surface with it: alpha and colour change in small steps.
        let at = |coc_px: f32| {
            let scene = |x: usize, y: usize| {
                let (color, coc) = stripe(x, y);
                (color, if coc < 0.0 { coc_px } else { coc })
            };
            estimated(picture(scene)).first().map_or(0.0, |layer| layer.alpha.get(29, 16))
        };
        let alphas: Vec<f32> = (0..200).map(|i| at(2.0 + 0.02 * i as f32)).collect();
        assert!(alphas[0] == 1.0 && alphas[199] == 0.0);
        let steps = alphas.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.clone().fold(0.0, f32::max) < 0.05, "{:?}", steps.fold(0.0, f32::max));
    }
}
