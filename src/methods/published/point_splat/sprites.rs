//! Sprites: the blur of a point as weights of pixels that sum to one (section 3.3, eq. 5).
//!
//! A sprite's weight is `k_n(C) / C²` times the share of the pixel within the aperture's shape times the intensity
//! there. Rows are computed on demand and kept by the caller that works on a row: a table of all sprites would grow
//! with the square of the largest CoC.

use crate::lens::Aperture;
use crate::parallel;
use glam::Vec2;

/// Logarithmic step between the radii of neighbouring sprites.
const RADIUS_STEP: f32 = 1.0 / 64.0;

/// Up to this radius, in pixels, a blur stays within its pixel.
const PIXEL_RADIUS_PX: f32 = 0.5;

/// Radius in pixels from which `k_n` has reached its limit.
const LIMIT_RADIUS_PX: f32 = 64.0;

/// Radius in pixels from which the intensity hardly changes within a pixel.
const SMOOTH_RADIUS_PX: f32 = 6.0;

/// A pixel this deep inside the shape is fully covered, and one this far outside is not covered: half a pixel's
/// diagonal, which includes the soft edge of its subsamples. In pixels.
const EDGE_MARGIN_PX: f32 = 0.7;

/// Minimum intensity as a share of the maximum. Without it, a profile whose light falls between all subsamples of a
/// pixel would have a sum of zero.
const MIN_INTENSITY: f32 = 1e-6;

/// Subsamples of an edge pixel along each axis.
const SUBSAMPLES: usize = 4;

/// The pixels that a sprite blurs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Centre {
    /// One pixel.
    Pixel,
    /// Four pixels as one, about their common corner. The sprite is the mean of their sprites, so that reduced points
    /// form no pattern, and no seam to pixels with their own points.
    Corner,
}

impl Centre {
    /// Distance of neighbouring points, in pixels.
    pub(super) fn spacing(self) -> usize {
        match self {
            Self::Pixel => 1,
            Self::Corner => 2,
        }
    }
}

/// Whether a point lies at the left or right border of the picture, past which it is repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Border {
    /// Repeated to the left.
    pub left: bool,
    /// Repeated to the right.
    pub right: bool,
}

impl Border {
    /// Adds to the weights of a row those of the point's repetitions, `spacing` pixels apart.
    fn repeat(self, weights: &mut [f32], spacing: usize) {
        if !self.left && !self.right {
            return;
        }
        let (single, count) = (weights.to_vec(), weights.len());
        let mut repeated = vec![0.0; count];
        if self.left {
            for i in (0..count.saturating_sub(spacing)).rev() {
                repeated[i] = repeated[i + spacing] + single[i + spacing];
                weights[i] += repeated[i];
            }
        }
        repeated.fill(0.0);
        if self.right {
            for i in spacing..count {
                repeated[i] = repeated[i - spacing] + single[i - spacing];
                weights[i] += repeated[i];
            }
        }
    }
}

/// Position of a row of a sprite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// The pixels that the sprite blurs.
    pub centre: Centre,
    /// Rows from the sprite's pixel, or from the upper ones of its four, down to the row.
    pub down: i32,
    /// Borders of the picture at which the point lies.
    pub border: Border,
}

/// A sprite: index of a radius, and sign of the CoC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sprite(pub u16);

impl Sprite {
    /// The sprite nearest to signed CoC radius `coc_px`.
    pub(super) fn from_coc_px(coc_px: f32) -> Self {
        let step = (coc_px.abs() / PIXEL_RADIUS_PX).max(1.0).ln() / RADIUS_STEP;
        Self(2 * step.round() as u16 + u16::from(coc_px < 0.0))
    }

    /// Its signed CoC radius.
    pub(super) fn coc_px(self) -> f32 {
        let radius = PIXEL_RADIUS_PX * (f32::from(self.0 / 2) * RADIUS_STEP).exp();
        if self.0 % 2 == 1 { -radius } else { radius }
    }

    /// Maximum reach along an axis from the centre pixel, in pixels.
    pub(super) fn reach(self) -> i32 {
        if self.0 / 2 == 0 { 0 } else { (self.coc_px().abs() + EDGE_MARGIN_PX).ceil() as i32 }
    }
}

/// All sprites of one aperture and one intensity profile.
#[derive(Debug)]
pub(super) struct Sprites {
    aperture: Aperture,
    intensity: Vec<f32>,
    /// Sum of a sprite's unscaled weights over its squared radius, which is `4 / k_n`.
    areas: Vec<f32>,
}

impl Sprites {
    /// The sprites of `aperture` with the intensity profile `intensity` from centre to edge, at even distances.
    pub(super) fn new(aperture: Aperture, intensity: &[f32]) -> Self {
        let max_intensity = intensity.iter().fold(0.0, |max: f32, &value| max.max(value));
        let intensity =
            intensity.iter().map(|value| value.max(MIN_INTENSITY * max_intensity) / max_intensity).collect();
        let mut sprites = Self { aperture, intensity, areas: Vec::new() };
        let steps = usize::from(Sprite::from_coc_px(LIMIT_RADIUS_PX).0 / 2) + 1;
        sprites.areas = parallel::map(steps, &|step| sprites.area(Sprite(2 * step as u16)));
        sprites
    }

    /// Area in squared radii of a sprite as sampled by its pixels, weighted by intensity.
    fn area(&self, sprite: Sprite) -> f32 {
        let (coc_px, reach) = (sprite.coc_px(), sprite.reach());
        let pixels =
            (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| Vec2::new(x as f32, y as f32)));
        let sum: f64 = pixels.map(|offset| f64::from(self.coverage(offset, coc_px))).sum();
        (sum / f64::from(coc_px * coc_px)) as f32
    }

    /// Writes the weights of the pixels `place.down` rows below a sprite's pixel, from `-reach_px` to `reach_px`
    /// columns from it, to `weights`, and returns the column of the first one.
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
                // The sprites of the right pixels are those of the left ones, shifted by a column.
                for column in (1..weights.len()).rev() {
                    weights[column] += weights[column - 1];
                }
            }
        }
        place.border.repeat(weights, place.centre.spacing());
        -reach
    }

    /// Adds `share` times a sprite's weights `down` rows below its pixel, from `-reach` to `reach` columns from it.
    fn add_row(&self, sprite: Sprite, down: i32, reach: i32, share: f32, weights: &mut [f32]) {
        let coc_px = sprite.coc_px();
        let area = self.areas.get(usize::from(sprite.0 / 2)).or(self.areas.last()).copied().unwrap_or(1.0);
        let scale = share / (area * coc_px * coc_px);
        let chord =
            ((coc_px.abs() + EDGE_MARGIN_PX).powi(2) - (down * down) as f32).max(0.0).sqrt().ceil() as i32;
        let chord = chord.min(reach);
        for dx in -chord..=chord {
            weights[(dx + reach) as usize] +=
                scale * self.coverage(Vec2::new(dx as f32, down as f32), coc_px);
        }
    }

    /// Covered share of the pixel at `offset` from the centre of a sprite of radius `coc_px`, times the intensity
    /// there.
    fn coverage(&self, offset: Vec2, coc_px: f32) -> f32 {
        // Light from the fragment at q reaches the picture point p through lens point u = (q − p) / c.
        let point = -offset;
        let radius = coc_px.abs();
        if radius <= PIXEL_RADIUS_PX {
            return if offset == Vec2::ZERO { 1.0 } else { 0.0 };
        }
        let depth = self.aperture.depth_inside(point, coc_px);
        if depth < -EDGE_MARGIN_PX {
            return 0.0;
        }
        if depth > EDGE_MARGIN_PX && (radius > SMOOTH_RADIUS_PX || self.intensity.len() == 1) {
            return self.intensity_at(depth, radius);
        }
        let place = |subsample: usize| (subsample as f32 + 0.5) / SUBSAMPLES as f32 - 0.5;
        let subsample = |i: usize| {
            let point = point + Vec2::new(place(i % SUBSAMPLES), place(i / SUBSAMPLES));
            let depth = self.aperture.depth_inside(point, coc_px);
            (SUBSAMPLES as f32 * depth + 0.5).clamp(0.0, 1.0) * self.intensity_at(depth, radius)
        };
        (0..SUBSAMPLES * SUBSAMPLES).map(subsample).sum::<f32>() / (SUBSAMPLES * SUBSAMPLES) as f32
    }

    /// Intensity `depth` pixels inside the shape of radius `radius`: constant on contours parallel to the shape's
    /// edge.
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
                    let [sum, x, y] = moments(&sprites, Sprite::from_coc_px(coc_px), centre);
                    let case = format!("{blades} blades, {intensity:?}, c = {coc_px}, {centre:?}");
                    // Past the largest tabulated radius the sum of an edge's subsamples, 1/16 of a pixel each, is its
                    // limit's.
                    assert!((sum - 1.0).abs() < 1e-3, "{case}: sum {sum}");
                    // A triangle that covers its neighbours unevenly is rounded to whole pixels.
                    let max_offset = if blades == 3 { 0.1 } else { 1e-4 };
                    assert!(x.hypot(y) < max_offset, "{case}: {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn the_scaling_of_a_uniform_disc_converges_to_four_over_pi() {
        // k_n is four over the area in squared radii.
        let sprites = sprites(0, &[1.0]);
        let scaling = 4.0 / sprites.areas.last().unwrap();
        assert!((scaling - 4.0 / std::f32::consts::PI).abs() < 1e-3, "{scaling}");
    }

    #[test]
    fn a_blur_within_its_pixel_keeps_the_pixel() {
        for coc_px in [0.0, -0.3, 0.5] {
            let (sprites, mut weights) = (sprites(0, &[0.0, 1.0]), Vec::new());
            let place = Place { centre: Centre::Pixel, down: 0, border: INNER };
            let first = sprites.row(Sprite::from_coc_px(coc_px), &place, 9, &mut weights);
            assert_eq!((first, &weights[..]), (0, &[1.0, 0.0][..]), "c = {coc_px}");
            assert_eq!(Sprite::from_coc_px(coc_px).reach(), 0, "and reaches no other pixel");
        }
    }

    #[test]
    fn the_intensity_is_linear_from_the_centre_to_the_edge() {
        let sprites = sprites(0, &[1.0, 0.5, 2.0]);
        // As a share of the maximum, 2: at the centre, a quarter of the way, halfway, at the edge.
        for (depth, expected) in [(8.0, 0.5), (6.0, 0.375), (4.0, 0.25), (0.0, 1.0)] {
            assert!((sprites.intensity_at(depth, 8.0) - expected).abs() < 1e-6, "{depth} px inside");
        }
    }

    #[test]
    fn a_triangle_is_mirrored_in_front_of_focus() {
        let (sprites, mut weights) = (Sprites::new(Aperture::new(3, 0.0).unwrap(), &[1.0]), Vec::new());
        let place = Place { centre: Centre::Pixel, down: 0, border: INNER };
        let mut ends = |coc_px| {
            let first = sprites.row(Sprite::from_coc_px(coc_px), &place, 99, &mut weights);
            let lit = weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0);
            let columns: Vec<i32> = lit.map(|(i, _)| first + i as i32).collect();
            [columns[0], columns[columns.len() - 1]]
        };
        // Behind focus its corner is 10 px to the left, and its side 5 px to the right.
        assert_eq!(ends(10.0), [-10, 5], "behind focus");
        assert_eq!(ends(-10.0), [-5, 10], "in front of it");
    }

    #[test]
    fn a_point_at_the_border_includes_its_repetitions_past_it() {
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
