//! Sprites: the blur of a point as weights of pixels that sum to one (section 3.3, eq. 5).
//!
//! A sprite's weight is `k_n(C) / C²` times the share of the pixel within the aperture's shape times the intensity there.
//! Its rows are made when they are asked for, and kept by whoever works on a row: a table of all sprites would grow with
//! the square of the largest CoC.

use crate::lens::Aperture;
use glam::Vec2;
use rayon::prelude::*;

/// Radii of neighbouring sprites are apart by this share.
const STEP: f32 = 1.0 / 64.0;

/// Up to this radius a blur stays within its pixel.
const PIXEL_RADIUS: f32 = 0.5;

/// Radius from which `k_n` has reached its limit.
const LIMIT_RADIUS: f32 = 64.0;

/// Radius from which the intensity hardly changes within a pixel.
const SMOOTH_RADIUS: f32 = 6.0;

/// A pixel this deep inside the shape is covered whole, and one this far outside is not at all: half its diagonal, and the
/// soft rim of its parts.
const RIM: f32 = 0.7;

/// Least intensity as a share of the greatest: a profile whose light falls between all parts of a pixel still has a sum.
const MIN_INTENSITY: f32 = 1e-6;

/// A rim's pixel is looked at in this many parts along each axis.
const PARTS: usize = 4;

/// What a sprite blurs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Centre {
    /// One pixel.
    Pixel,
    /// Four pixels as one, about the corner where they meet: the mean of their sprites, so that together they leave no
    /// pattern, and no seam to pixels of their own.
    Corner,
}

impl Centre {
    /// Pixels from one point to the next.
    pub(super) fn spacing(self) -> usize {
        match self {
            Self::Pixel => 1,
            Self::Corner => 2,
        }
    }
}

/// Whether a point lies at the left or the right border of the picture, past which it is repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Border {
    /// Repeated to the left.
    pub left: bool,
    /// Repeated to the right.
    pub right: bool,
}

impl Border {
    /// Adds to the weights of a row those of the point's repetitions, `spacing` apart.
    fn repeat(self, weights: &mut [f32], spacing: usize) {
        if !self.left && !self.right {
            return;
        }
        let (once, count) = (weights.to_vec(), weights.len());
        let mut further = vec![0.0; count];
        if self.left {
            for i in (0..count.saturating_sub(spacing)).rev() {
                further[i] = further[i + spacing] + once[i + spacing];
                weights[i] += further[i];
            }
        }
        further.fill(0.0);
        if self.right {
            for i in spacing..count {
                further[i] = further[i - spacing] + once[i - spacing];
                weights[i] += further[i];
            }
        }
    }
}

/// Where a row of a sprite lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// What the sprite blurs.
    pub centre: Centre,
    /// Rows from the sprite's pixel, or the upper ones of four, down to the row.
    pub down: i32,
    /// Where its point lies in the picture.
    pub border: Border,
}

/// A sprite: one of the radii, and the sign of the CoC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sprite(pub u16);

impl Sprite {
    /// The sprite nearest to signed CoC radius `coc_px`.
    pub(super) fn of(coc_px: f32) -> Self {
        let step = (coc_px.abs() / PIXEL_RADIUS).max(1.0).ln() / STEP;
        Self(2 * step.round() as u16 + u16::from(coc_px < 0.0))
    }

    /// Its signed CoC radius.
    pub(super) fn coc_px(self) -> f32 {
        let radius = PIXEL_RADIUS * (f32::from(self.0 / 2) * STEP).exp();
        if self.0 % 2 == 1 { -radius } else { radius }
    }

    /// Most pixels that it reaches along an axis from the pixel of its centre.
    pub(super) fn reach(self) -> i32 {
        if self.0 / 2 == 0 { 0 } else { (self.coc_px().abs() + RIM).ceil() as i32 }
    }
}

/// All sprites of one aperture and one intensity profile.
#[derive(Debug)]
pub(super) struct Sprites {
    aperture: Aperture,
    intensity: Vec<f32>,
    /// Sum of a sprite's weights over its squared radius, which is `4 / k_n`.
    areas: Vec<f32>,
}

impl Sprites {
    /// The sprites of `aperture` whose intensity from centre to rim is `intensity`, at even distances.
    pub(super) fn new(aperture: Aperture, intensity: &[f32]) -> Self {
        let greatest = intensity.iter().fold(0.0, |most: f32, &value| most.max(value));
        let intensity =
            intensity.iter().map(|value| value.max(MIN_INTENSITY * greatest) / greatest).collect();
        let mut sprites = Self { aperture, intensity, areas: Vec::new() };
        let steps = Sprite::of(LIMIT_RADIUS).0 / 2;
        sprites.areas = (0..=steps).into_par_iter().map(|step| sprites.area(Sprite(2 * step))).collect();
        sprites
    }

    /// Area in squared radii of a sprite as its pixels have it, weighted by intensity.
    fn area(&self, sprite: Sprite) -> f32 {
        let (coc_px, reach) = (sprite.coc_px(), sprite.reach());
        let pixels =
            (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| Vec2::new(x as f32, y as f32)));
        let sum: f64 = pixels.map(|offset| f64::from(self.coverage(offset, coc_px))).sum();
        (sum / f64::from(coc_px * coc_px)) as f32
    }

    /// Weights of the pixels `place.down` rows below a sprite's pixel, from `-reach_px` to `reach_px` columns off it: written
    /// to `weights`, while the first one's column is returned.
    pub(super) fn row(&self, sprite: Sprite, place: &Place, reach_px: i32, weights: &mut Vec<f32>) -> i32 {
        let reach = sprite.reach().min(reach_px);
        weights.clear();
        weights.resize(2 * reach as usize + 2, 0.0);
        match place.centre {
            Centre::Pixel => self.add_row(sprite, place.down, reach, 1.0, weights),
            Centre::Corner => {
                for down in [place.down, place.down - 1] {
                    self.add_row(sprite, down, reach, 0.25, weights);
                }
                // The right pixels' sprites are the left ones', a column on.
                for column in (1..weights.len()).rev() {
                    weights[column] += weights[column - 1];
                }
            }
        }
        place.border.repeat(weights, place.centre.spacing());
        -reach
    }

    /// Adds `share` of a sprite's weights `down` rows below its pixel, from `-reach` to `reach` columns off it.
    fn add_row(&self, sprite: Sprite, down: i32, reach: i32, share: f32, weights: &mut [f32]) {
        let coc_px = sprite.coc_px();
        let area = self.areas.get(usize::from(sprite.0 / 2)).or(self.areas.last()).copied().unwrap_or(1.0);
        let scale = share / (area * coc_px * coc_px);
        let chord = ((coc_px.abs() + RIM).powi(2) - (down * down) as f32).max(0.0).sqrt().ceil() as i32;
        let chord = chord.min(reach);
        for dx in -chord..=chord {
            weights[(dx + reach) as usize] +=
                scale * self.coverage(Vec2::new(dx as f32, down as f32), coc_px);
        }
    }

    /// How much of the pixel at `offset` from the centre a sprite of radius `coc_px` covers, times its intensity there.
    fn coverage(&self, offset: Vec2, coc_px: f32) -> f32 {
        // Light goes from the fragment at q to the picture point p through u = (q − p) / c.
        let point = -offset;
        let radius = coc_px.abs();
        if radius <= PIXEL_RADIUS {
            return if offset == Vec2::ZERO { 1.0 } else { 0.0 };
        }
        let depth = self.aperture.depth_inside(point, coc_px);
        if depth < -RIM {
            return 0.0;
        }
        if depth > RIM && (radius > SMOOTH_RADIUS || self.intensity.len() == 1) {
            return self.intensity_at(depth, radius);
        }
        let place = |part: usize| (part as f32 + 0.5) / PARTS as f32 - 0.5;
        let part = |i: usize| {
            let point = point + Vec2::new(place(i % PARTS), place(i / PARTS));
            let depth = self.aperture.depth_inside(point, coc_px);
            (PARTS as f32 * depth + 0.5).clamp(0.0, 1.0) * self.intensity_at(depth, radius)
        };
        (0..PARTS * PARTS).map(part).sum::<f32>() / (PARTS * PARTS) as f32
    }

    /// Intensity `depth` pixels inside the shape of radius `radius`: on lines of its own form from centre to rim.
    fn intensity_at(&self, depth: f32, radius: f32) -> f32 {
        let last = self.intensity.len() - 1;
        if last == 0 {
            return self.intensity[0];
        }
        let place = (1.0 - depth / (radius * self.aperture.apothem())).clamp(0.0, 1.0) * last as f32;
        let below = (place as usize).min(last - 1);
        let share = place - below as f32;
        (1.0 - share) * self.intensity[below] + share * self.intensity[below + 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INNER: Border = Border { left: false, right: false };

    fn sprites(blades: u32, intensity: &[f32]) -> Sprites {
        Sprites::new(Aperture::new(blades, 20.0).unwrap(), intensity)
    }

    /// Sum and first moments of all weights of a sprite.
    fn moments(sprites: &Sprites, sprite: Sprite, centre: Centre) -> [f64; 3] {
        let (mut sums, mut weights) = ([0.0; 3], Vec::new());
        let middle = if centre == Centre::Corner { 0.5 } else { 0.0 };
        for down in -sprite.reach()..=sprite.reach() + 1 {
            let first = sprites.row(sprite, &Place { centre, down, border: INNER }, 1000, &mut weights);
            for (i, &weight) in weights.iter().enumerate() {
                let (x, y) = ((first + i as i32) as f32 - middle, down as f32 - middle);
                let terms = [1.0, x, y].map(|term| f64::from(term) * f64::from(weight));
                sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
            }
        }
        sums
    }

    #[test]
    fn every_sprite_sums_to_one_about_its_centre() {
        for (blades, intensity) in
            [(0, &[1.0][..]), (0, &[0.0, 1.0]), (0, &[1.0, 0.3, 0.0]), (3, &[1.0]), (6, &[0.2, 1.0])]
        {
            let sprites = sprites(blades, intensity);
            for coc_px in [0.1, 0.5, -0.7, 1.0, -2.3, 5.0, -17.2, 90.0] {
                for centre in [Centre::Pixel, Centre::Corner] {
                    let [sum, x, y] = moments(&sprites, Sprite::of(coc_px), centre);
                    let case = format!("{blades} blades, {intensity:?}, c = {coc_px}, {centre:?}");
                    // Past the largest tabulated radius the sum of a rim's parts, 1/16 of a pixel each, is its limit's.
                    assert!((sum - 1.0).abs() < 1e-3, "{case}: sum {sum}");
                    // A triangle that covers its neighbours unevenly is rounded to whole pixels.
                    let most = if blades == 3 { 0.1 } else { 1e-4 };
                    assert!(x.hypot(y) < most, "{case}: {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn the_scaling_of_a_uniform_disc_goes_to_four_over_pi() {
        // k_n is four over the area in squared radii.
        let sprites = sprites(0, &[1.0]);
        let scaling = 4.0 / sprites.areas.last().unwrap();
        assert!((scaling - 4.0 / std::f32::consts::PI).abs() < 1e-3, "{scaling}");
    }

    #[test]
    fn a_blur_within_its_pixel_is_the_pixel() {
        for coc_px in [0.0, -0.3, 0.5] {
            let (sprites, mut weights) = (sprites(0, &[0.0, 1.0]), Vec::new());
            let place = Place { centre: Centre::Pixel, down: 0, border: INNER };
            let first = sprites.row(Sprite::of(coc_px), &place, 9, &mut weights);
            assert_eq!((first, &weights[..]), (0, &[1.0, 0.0][..]), "c = {coc_px}");
            assert_eq!(Sprite::of(coc_px).reach(), 0, "and reaches no other");
        }
    }

    #[test]
    fn the_intensity_is_linear_from_the_centre_to_the_rim() {
        let sprites = sprites(0, &[1.0, 0.5, 2.0]);
        // Of the greatest, 2: at the centre, a quarter of the way, halfway, at the rim.
        for (depth, expected) in [(8.0, 0.5), (6.0, 0.375), (4.0, 0.25), (0.0, 1.0)] {
            assert!((sprites.intensity_at(depth, 8.0) - expected).abs() < 1e-6, "{depth} px inside");
        }
    }

    #[test]
    fn a_triangle_points_the_other_way_in_front_of_focus() {
        let (sprites, mut weights) = (Sprites::new(Aperture::new(3, 0.0).unwrap(), &[1.0]), Vec::new());
        let place = Place { centre: Centre::Pixel, down: 0, border: INNER };
        let mut ends = |coc_px| {
            let first = sprites.row(Sprite::of(coc_px), &place, 99, &mut weights);
            let lit = weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0);
            let columns: Vec<i32> = lit.map(|(i, _)| first + i as i32).collect();
            [columns[0], columns[columns.len() - 1]]
        };
        // Behind focus its corner is to the left, 10 px off, and its side 5 px off to the right.
        assert_eq!(ends(10.0), [-10, 5], "behind focus");
        assert_eq!(ends(-10.0), [-5, 10], "in front of it");
    }

    #[test]
    fn a_point_at_the_border_stands_for_its_repetitions_past_it() {
        let row = |left, right, spacing| {
            let mut weights = vec![1.0, 2.0, 4.0, 8.0];
            Border { left, right }.repeat(&mut weights, spacing);
            weights
        };
        assert_eq!(row(true, false, 1), [15.0, 14.0, 12.0, 8.0], "of points to the left, one after another");
        assert_eq!(row(false, true, 1), [1.0, 3.0, 7.0, 15.0], "to the right");
        assert_eq!(row(true, true, 1), [15.0; 4], "to both sides");
        assert_eq!(row(true, false, 2), [5.0, 10.0, 4.0, 8.0], "every other pixel");
    }
}
