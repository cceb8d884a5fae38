//! Disocclusion fill: estimated surfaces behind the last fragment, for stacks of one or two layers.
//!
//! A lens ray that passes all known fragments should hit something plausible: the surfaces from the neighbourhood, continued behind what
//! hides them ([`Behind`]). A plate is such a surface in all pixels. Its colour is smoothed more the farther its fragments are away
//! ([`Smooth`]). None is that of a mixture ([`Unmixed`]).

use super::plates::{Behind, PLATES};
use super::smooth::{Guess, Row, Smooth};
use super::unmixing::{Unmixed, replace_blurred};
use super::{Background, Layer, Scene};
use crate::image::Plane;
use crate::parallel;
use pulp::Arch;

/// Rows that are estimated together.
const STRIP: usize = 16;

impl Scene {
    /// The scene at one sample per pixel, with estimated surfaces as its last layers.
    #[must_use]
    pub fn filled(self) -> Self {
        // Peels, and the samples of a pixel, hold each surface's own colours; one picture with depth has mixtures of two at every edge.
        let is_picture = self.supersample == 1 && self.layers.len() == 1;
        let mut scene = self.merged();
        let Some(nearest) = scene.layers.first() else { return scene };
        let unmixed = if is_picture { Unmixed::new(nearest, &scene.antialiasing) } else { None };
        let estimated = estimated_layers(&scene.layers, unmixed.as_ref(), scene.background.as_deref());
        if is_picture {
            replace_blurred(&mut scene.layers[0], unmixed.as_ref());
        }
        scene.layers.extend(estimated);
        scene
    }
}

/// The estimated surfaces behind `layers`, nearest first, without those that are nowhere. Their colours are those of the first layer, of
/// whose edge pixels `unmixed` has them.
fn estimated_layers(
    layers: &[Layer],
    unmixed: Option<&Unmixed>,
    background: Option<&Background>,
) -> Vec<Layer> {
    let Some(nearest) = layers.first() else { return Vec::new() };
    let (width, height) = (nearest.width(), nearest.height());
    let behind = Behind::new(layers, nearest, unmixed, background);
    let arch = Arch::new();
    let strip = |last_px: &mut Vec<_>, strip: usize| {
        behind.rows(strip * STRIP..((strip + 1) * STRIP).min(height), last_px, arch)
    };
    let plates: Vec<Vec<[Row; PLATES]>> = parallel::map_with(height.div_ceil(STRIP), &Vec::new, &strip);
    let plates: Vec<[Row; PLATES]> = plates.into_iter().flatten().collect();
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
    let planes = [red, green, blue, alpha, coc_px].map(Plane::values_mut);
    parallel::for_each_row_of(planes, width, &|y, [red, green, blue, alpha, coc_px]| {
        for (x, guess) in rows[y] {
            let color = smooth.color((*x, y), guess).map(|value| guess.alpha * value);
            [red[*x], green[*x], blue[*x], alpha[*x], coc_px[*x]] =
                [color[0], color[1], color[2], guess.alpha, guess.coc_px];
        }
    });
    layer
}

#[cfg(test)]
mod tests {
    use super::super::plates::LIGHT;
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
        estimated_layers(&[layer], None, None)
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
    fn the_estimate_fades_as_far_as_a_pixel_shows_the_background() {
        // The stripe lets a twentieth of the light pass: half of what shows the background alone.
        let mut layer = picture(stripe);
        (0..64).for_each(|y| (28..36).for_each(|x| layer.alpha.set(x, y, 0.95)));
        let layers = [layer];
        let background = Background::behind(&layers, 1, 30.0);
        let share = background.as_ref().map_or(0.0, |background| background.share().get(30, 16));
        assert!((share - 0.5).abs() < 1e-4, "a share of {share}");
        let fill = estimated_layers(&layers, None, background.as_ref());
        for x in 28..36 {
            assert_eq!(fill[0].alpha.get(x, 16), 1.0 - share, "column {x}");
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
