//! FLIP: the perceived difference between two pictures that are shown in alternation.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström & Fairchild 2020, "FLIP: A Difference Evaluator for Alternating
//! Images"; for scene-linear pictures Andersson, Nilsson, Shirley & Akenine-Möller 2021, "Visualizing and Communicating
//! Errors in Rendered Images". 0 is no visible difference, 1 the largest. The viewing distance is the papers' default: 0.7 m from
//! a screen 0.7 m and 3840 pixels wide.
//!
//! Colour and features are compared separately: colour after the eye's contrast sensitivity (separable Gaussians in `YCxCz`), in
//! Hunt-adjusted Lab by the distance `HyAB`; features, which are edges and points, by Gaussian derivatives of lightness. Border pixels
//! are repeated. Cost: about 200 multiplications per pixel. Memory: about ten planes.

use super::Rgb;
use crate::image::Plane;
use crate::parallel;
use glam::{DMat3, DVec3};

/// Pixels per degree of visual angle: 0.7 m away from 3840 pixels on 0.7 m.
const PIXELS_PER_DEGREE: f64 = 3840.0 * std::f64::consts::PI / 180.0;

/// Contrast sensitivity of lightness, red-green and blue-yellow: sums of Gaussians `a √(π/b) exp(−π² x²/b)`, `x` in degrees
/// (2020, table 1).
const SENSITIVITY: [&[[f64; 2]]; 3] = [&[[1.0, 0.0047]], &[[1.0, 0.0053]], &[[34.1, 0.04], [13.5, 0.025]]];

/// The widest `b` of [`SENSITIVITY`], which sets the filters' radius: three of its standard deviations.
const WIDEST_B: f64 = 0.04;

/// Exponent of colour differences (2020, eq. 11).
const COLOUR_EXPONENT: f64 = 0.7;

/// Colour differences up to this share of the largest map to the first [`MAPPED_SHARE`] of the range (2020, eq. 12).
const COMMON_SHARE: f64 = 0.4;
const MAPPED_SHARE: f64 = 0.95;

/// Width in degrees of the features to which the eye is most sensitive (2020, section 4.2).
const FEATURE_WIDTH_DEG: f64 = 0.082;

/// FLIP at each pixel of two linear pictures as shown on a display, clipped to 0 … 1.
pub fn flip(image: &Rgb, reference: &Rgb) -> Plane {
    let vision = VisionModel::new();
    let (image, reference) = (vision.perceive(image), vision.perceive(reference));
    vision.difference(&image, &reference)
}

/// HDR-FLIP at each pixel of two scene-linear pictures: the largest FLIP over a range of exposures, tone-mapped, from the one at which
/// the brightest pixel of the reference is not blown out to the one at which half of its pixels are not (2021, section 4).
pub fn hdr_flip(image: &Rgb, reference: &Rgb) -> Plane {
    let vision = VisionModel::new();
    let mut largest = Plane::zeros(reference[0].width(), reference[0].height());
    for stops in exposures(reference) {
        let [image, reference] =
            [image, reference].map(|picture| vision.perceive(&tone_mapped(picture, stops)));
        let error = vision.difference(&image, &reference);
        parallel::for_each_block(largest.values_mut(), &|block, largest| {
            let values = largest.iter_mut().zip(&error.values()[block]);
            values.for_each(|(largest, &error)| *largest = largest.max(error));
        });
    }
    largest
}

/// A picture as perceived by the eye.
struct Perceived {
    /// Lightness, red-green and blue-yellow after contrast sensitivity, in Hunt-adjusted Lab.
    lab: Rgb,
    /// Strength of edges and of points.
    features: [Plane; 2],
}

/// The colour spaces and filters of the model of vision.
struct VisionModel {
    xyz_from_rgb: DMat3,
    rgb_from_xyz: DMat3,
    white: DVec3,
    contrast: [Vec<(f64, Vec<f32>)>; 3],
    smooth: Vec<f32>,
    edge: Vec<f32>,
    point: Vec<f32>,
}

impl VisionModel {
    fn new() -> Self {
        // Linear sRGB to XYZ with a D65 white (IEC 61966-2-1, as fractions).
        let xyz_from_rgb = DMat3::from_cols(
            DVec3::new(10_135_552.0 / 24_577_794.0, 2_613_072.0 / 12_288_897.0, 1_425_312.0 / 73_733_382.0),
            DVec3::new(8_788_810.0 / 24_577_794.0, 8_788_810.0 / 12_288_897.0, 8_788_810.0 / 73_733_382.0),
            DVec3::new(4_435_075.0 / 24_577_794.0, 887_015.0 / 12_288_897.0, 70_074_185.0 / 73_733_382.0),
        );
        let deviation = 0.5 * FEATURE_WIDTH_DEG * PIXELS_PER_DEGREE;
        let radius = (3.0 * deviation).ceil() as i32;
        let gaussian = |x: f64| (-x * x / (2.0 * deviation * deviation)).exp();
        Self {
            xyz_from_rgb,
            rgb_from_xyz: xyz_from_rgb.inverse(),
            white: xyz_from_rgb * DVec3::ONE,
            contrast: SENSITIVITY.map(contrast_filter),
            smooth: balanced(radius, gaussian),
            edge: balanced(radius, |x| -x * gaussian(x)),
            point: balanced(radius, |x| (x * x / (deviation * deviation) - 1.0) * gaussian(x)),
        }
    }

    fn perceive(&self, picture: &Rgb) -> Perceived {
        let opponent = map(picture, |rgb| {
            let xyz = self.xyz_from_rgb * rgb.clamp(DVec3::ZERO, DVec3::ONE) / self.white;
            DVec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
        });
        let mut lightness = opponent[0].clone();
        lightness.values_mut().iter_mut().for_each(|value| *value = (*value + 16.0) / 116.0);
        let features = [&self.edge, &self.point].map(|filter| {
            let across = convolved(&lightness, filter, &self.smooth);
            let down = convolved(&lightness, &self.smooth, filter);
            let mut strength = across;
            let values = strength.values_mut().iter_mut().zip(down.values());
            values.for_each(|(across, &down)| *across = across.hypot(down));
            strength
        });
        let mut filters = self.contrast.iter();
        let filtered = opponent.map(|plane| {
            let filter = filters.next().expect("three channels, three filters");
            sum_of_blurs(&plane, filter)
        });
        let lab = map(&filtered, |opponent| {
            let y = (opponent.x + 16.0) / 116.0;
            let xyz = DVec3::new(opponent.y / 500.0 + y, y, y - opponent.z / 200.0) * self.white;
            let shown = (self.rgb_from_xyz * xyz).clamp(DVec3::ZERO, DVec3::ONE);
            self.hunt_lab(shown)
        });
        Perceived { lab, features }
    }

    /// FLIP between two perceived pictures (2020, eqs. 10 to 14).
    fn difference(&self, image: &Perceived, reference: &Perceived) -> Plane {
        let hyab = |a: DVec3, b: DVec3| {
            let difference = a - b;
            (difference.x.abs() + difference.y.hypot(difference.z)).powf(COLOUR_EXPONENT)
        };
        let largest = hyab(self.hunt_lab(DVec3::Y), self.hunt_lab(DVec3::Z));
        let common = COMMON_SHARE * largest;
        let at = |planes: &Rgb, i: usize| {
            let [x, y, z] = planes.each_ref().map(|plane| f64::from(plane.values()[i]));
            DVec3::new(x, y, z)
        };
        let mut result = image.features[0].clone();
        let width = result.width();
        let difference = |i: usize| {
            let distance = hyab(at(&image.lab, i), at(&reference.lab, i));
            let colour = if distance < common {
                MAPPED_SHARE / common * distance
            } else {
                MAPPED_SHARE + (distance - common) / (largest - common) * (1.0 - MAPPED_SHARE)
            };
            let [edge, point] =
                [0, 1].map(|k| (image.features[k].values()[i] - reference.features[k].values()[i]).abs());
            let feature = (f64::from(edge.max(point)) / std::f64::consts::SQRT_2).sqrt().min(1.0);
            colour.powf(1.0 - feature) as f32
        };
        parallel::for_each_row(result.values_mut(), width, &|y, row| {
            row.iter_mut().enumerate().for_each(|(x, value)| *value = difference(y * width + x));
        });
        result
    }

    /// CIELAB of a linear colour, its chroma scaled by lightness for the Hunt effect (2020, eq. 7).
    fn hunt_lab(&self, rgb: DVec3) -> DVec3 {
        const DELTA: f64 = 6.0 / 29.0;
        let compressed = |t: f64| {
            if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
        };
        let xyz = self.xyz_from_rgb * rgb / self.white;
        let [x, y, z] = [xyz.x, xyz.y, xyz.z].map(compressed);
        let lightness = 116.0 * y - 16.0;
        DVec3::new(lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z))
    }
}

/// The Gaussians of one channel's contrast sensitivity, each with its weight in the sum.
fn contrast_filter(terms: &[[f64; 2]]) -> Vec<(f64, Vec<f32>)> {
    let pi = std::f64::consts::PI;
    let radius = (3.0 * (WIDEST_B / (2.0 * pi * pi)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let gaussian = |b: f64| move |x: f64| (-(pi * x / PIXELS_PER_DEGREE).powi(2) / b).exp();
    // The weight of a two-dimensional Gaussian is its height times the square of its sum along a line.
    let weight = |&[a, b]: &[f64; 2]| {
        let line: f64 = (-radius..=radius).map(|x| gaussian(b)(f64::from(x))).sum();
        a * (pi / b).sqrt() * line * line
    };
    let whole: f64 = terms.iter().map(weight).sum();
    terms.iter().map(|term| (weight(term) / whole, balanced(radius, gaussian(term[1])))).collect()
}

/// `value` at −radius … radius, its positive part scaled to sum to 1 and its negative part to −1.
fn balanced(radius: i32, value: impl Fn(f64) -> f64) -> Vec<f32> {
    let values: Vec<f64> = (-radius..=radius).map(|x| value(f64::from(x))).collect();
    let positive: f64 = values.iter().filter(|&&v| v > 0.0).sum();
    let negative: f64 = values.iter().filter(|&&v| v < 0.0).sum();
    values.iter().map(|&v| (if v < 0.0 { -v / negative } else { v / positive }) as f32).collect()
}

fn sum_of_blurs(plane: &Plane, filter: &[(f64, Vec<f32>)]) -> Plane {
    let mut sum = Plane::zeros(plane.width(), plane.height());
    for (share, weights) in filter {
        let blurred = convolved(plane, weights, weights);
        let values = sum.values_mut().iter_mut().zip(blurred.values());
        values.for_each(|(sum, &value)| *sum += *share as f32 * value);
    }
    sum
}

/// `plane` filtered by `across` along its rows and by `down` along its columns, with border pixels repeated.
fn convolved(plane: &Plane, across: &[f32], down: &[f32]) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let radius = across.len() / 2;
    let mut rows = Plane::zeros(width, height);
    parallel::for_each_with(rows.values_mut().chunks_mut(width), &Vec::new, &|padded, y, row| {
        let source = plane.row(y);
        padded.clear();
        padded.extend(std::iter::repeat_n(source[0], radius));
        padded.extend_from_slice(source);
        padded.extend(std::iter::repeat_n(source[width - 1], radius));
        for (tap, &weight) in across.iter().enumerate() {
            row.iter_mut().zip(&padded[tap..]).for_each(|(sum, &value)| *sum += weight * value);
        }
    });
    let mut result = Plane::zeros(width, height);
    parallel::for_each_row(result.values_mut(), width, &|y, row| {
        for (tap, &weight) in down.iter().enumerate() {
            let source = rows.row((y + tap).saturating_sub(down.len() / 2).min(height - 1));
            row.iter_mut().zip(source).for_each(|(sum, &value)| *sum += weight * value);
        }
    });
    result
}

/// `picture` with `value` applied to every pixel.
fn map(picture: &Rgb, value: impl Fn(DVec3) -> DVec3 + Sync) -> Rgb {
    let mut result = picture.clone();
    let width = result[0].width();
    parallel::for_each_row_of(result.each_mut().map(Plane::values_mut), width, &|_, [a, b, c]| {
        for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
            let mapped = value(DVec3::new(f64::from(*a), f64::from(*b), f64::from(*c)));
            (*a, *b, *c) = (mapped.x as f32, mapped.y as f32, mapped.z as f32);
        }
    });
    result
}

/// The ACES tone curve `(k₀x² + k₁x + k₂) / (k₃x² + k₄x + k₅)`, with its exposure of 0.6 included in the coefficients.
const ACES: [f64; 6] = [0.36 * 2.51, 0.6 * 0.03, 0.0, 0.36 * 2.43, 0.6 * 0.59, 0.14];

/// The tone curve's value up to which a pixel counts as not blown out.
const NOT_BLOWN_OUT: f64 = 0.85;

/// The exposures, in stops, at which pictures with this reference are compared (2021, section 4.1).
fn exposures(reference: &Rgb) -> Vec<f64> {
    let [r, g, b] = reference.each_ref().map(Plane::values);
    let mut luminance: Vec<f64> = (0..r.len())
        .map(|i| 0.2126 * f64::from(r[i]) + 0.7152 * f64::from(g[i]) + 0.0722 * f64::from(b[i]))
        .collect();
    luminance.sort_by(f64::total_cmp);
    let (brightest, median) = (luminance[luminance.len() - 1], middle(&luminance));
    // The input at which the tone curve reaches the limit is the root of a quadratic.
    let [a, b, c] = [0, 1, 2].map(|k| ACES[k] - NOT_BLOWN_OUT * ACES[k + 3]);
    let limit = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let first = (limit / brightest.max(1e-5)).log2();
    let last = (limit / median.max(1e-5)).log2();
    let count = (last - first).ceil().max(2.0) as usize;
    (0..count).map(|i| first + (last - first) * i as f64 / (count - 1) as f64).collect()
}

/// Median of sorted `values`.
fn middle(values: &[f64]) -> f64 {
    let half = values.len() / 2;
    if values.len().is_multiple_of(2) { 0.5 * (values[half - 1] + values[half]) } else { values[half] }
}

/// `picture` exposed by `stops` and tone-mapped; negative values count as 0.
fn tone_mapped(picture: &Rgb, stops: f64) -> Rgb {
    let [k0, k1, k2, k3, k4, k5] = ACES;
    let exposure = stops.exp2();
    map(picture, |rgb| {
        let x = (rgb * exposure).max(DVec3::ZERO);
        let mapped = (k0 * x * x + k1 * x + k2) / (k3 * x * x + k4 * x + k5);
        mapped.clamp(DVec3::ZERO, DVec3::ONE)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(color: [f32; 3]) -> Rgb {
        color.map(|value| Plane::filled(40, 30, value))
    }

    #[test]
    fn green_and_blue_are_the_most_different_and_equal_pictures_do_not_differ() {
        let [green, blue] = [plain([0.0, 1.0, 0.0]), plain([0.0, 0.0, 1.0])];
        let differs = |a: &Rgb, b: &Rgb| flip(a, b).get(20, 15);
        assert!((differs(&green, &blue) - 1.0).abs() < 1e-4, "the pair that defines the scale");
        assert_eq!(differs(&green, &green), 0.0);
    }

    #[test]
    fn a_fine_line_counts_more_than_its_colour_difference() {
        let grey = plain([0.5; 3]);
        let line = [0, 1, 2].map(|_| Plane::from_fn(40, 30, |x, _| if x == 20 { 0.6 } else { 0.5 }));
        let broad = plain([0.502; 3]);
        assert!(flip(&line, &grey).get(20, 15) > 2.0 * flip(&broad, &grey).get(20, 15));
    }

    #[test]
    fn pictures_of_one_pixel_can_be_compared() {
        let dot = |value| [0, 1, 2].map(|_| Plane::filled(1, 1, value));
        assert!(flip(&dot(1.0), &dot(0.0)).get(0, 0) > 0.5);
        assert!(hdr_flip(&dot(0.0), &dot(0.0)).get(0, 0) == 0.0);
    }
}
