//! The share of even light that a surface of microfacets reflects: `F0 · A + B` (Karis 2013).
//!
//! `A = ∫ (1 − F_c) G (v·h) / ((n·h) (n·v))` and `B` the same with `F_c = (1 − v·h)⁵` in place of `1 − F_c`, over half vectors h of the GGX distribution, with
//! Smith's shadowing `G = G₁(v) G₁(l)`. For a mirror, `A = 1 − F_c` and `B = F_c` of the view. Light that meets several facets is left out.

use super::points::hammersley;

/// Columns of the table: the cosine between normal and viewer, from 0 to 1.
const COLUMNS: usize = 33;

/// Rows of the table: steps of roughness from 0, whose row is not used, to 1.
const ROWS: usize = 17;

/// Half vectors summed for an entry.
const SAMPLES: u32 = 1024;

/// Smallest cosine of the table: seen from the side itself, the sums are 0 / 0.
const MIN_COSINE: f32 = 1e-3;

/// `A` and `B` by cosine and roughness.
#[derive(Debug, Clone, PartialEq)]
pub struct SplitSum {
    entries: Vec<[f32; 2]>,
}

impl SplitSum {
    /// Sums the table.
    #[expect(clippy::new_without_default, reason = "it is work, not a neutral value")]
    pub fn new() -> Self {
        let entry = |i: usize| {
            let cosine = (i % COLUMNS) as f32 / (COLUMNS - 1) as f32;
            let roughness = (i / COLUMNS) as f32 / (ROWS - 1) as f32;
            if i < COLUMNS { mirror(cosine) } else { integral(cosine.max(MIN_COSINE), roughness * roughness) }
        };
        Self { entries: (0..COLUMNS * ROWS).map(entry).collect() }
    }

    /// `A` and `B` where `cosine` is that between normal and viewer, 0 or above.
    pub fn at(&self, cosine: f32, roughness: f32) -> [f32; 2] {
        let cosine = cosine.clamp(0.0, 1.0);
        let row = roughness.clamp(0.0, 1.0) * (ROWS - 1) as f32;
        // The mirror's own law is curved more than the table resolves.
        let value = |row: usize| if row == 0 { mirror(cosine) } else { self.of_row(row, cosine) };
        let first = (row as usize).min(ROWS - 2);
        mix(value(first), value(first + 1), row - first as f32)
    }

    fn of_row(&self, row: usize, cosine: f32) -> [f32; 2] {
        let column = cosine * (COLUMNS - 1) as f32;
        let first = (column as usize).min(COLUMNS - 2);
        let entry = |column: usize| self.entries[row * COLUMNS + column];
        mix(entry(first), entry(first + 1), column - first as f32)
    }
}

fn mix(a: [f32; 2], b: [f32; 2], share: f32) -> [f32; 2] {
    std::array::from_fn(|k| a[k] + share * (b[k] - a[k]))
}

/// `A` and `B` of a mirror: Schlick's term.
fn mirror(cosine: f32) -> [f32; 2] {
    let bias = fifth_power(1.0 - cosine);
    [1.0 - bias, bias]
}

/// `value` to the fifth power, by products in one order: the same bits from every compiler.
fn fifth_power(value: f32) -> f32 {
    let squared = value * value;
    squared * squared * value
}

/// Share of facets seen along a direction of this `cosine` to the normal that others do not hide.
fn unhidden(cosine: f32, alpha: f32) -> f32 {
    2.0 * cosine / (cosine + (alpha * alpha + (1.0 - alpha * alpha) * cosine * cosine).sqrt())
}

fn integral(cosine: f32, alpha: f32) -> [f32; 2] {
    let view = [(1.0 - cosine * cosine).max(0.0).sqrt(), cosine];
    let mut sum = [0.0; 2];
    for [across, around] in (0..SAMPLES).map(|i| hammersley(i, SAMPLES)) {
        let squared = (1.0 - across) / (1.0 + (alpha * alpha - 1.0) * across);
        let (facet_cosine, facet_sine) = (squared.sqrt(), (1.0 - squared).max(0.0).sqrt());
        let towards = view[0] * facet_sine * (std::f32::consts::TAU * around).cos() + view[1] * facet_cosine;
        let light_cosine = 2.0 * towards * facet_cosine - cosine;
        if light_cosine > 0.0 && towards > 0.0 {
            let shadowing = unhidden(cosine, alpha) * unhidden(light_cosine, alpha);
            let weight = shadowing * towards / (facet_cosine * cosine);
            let fresnel = fifth_power((1.0 - towards).max(0.0));
            sum[0] += (1.0 - fresnel) * weight;
            sum[1] += fresnel * weight;
        }
    }
    sum.map(|sum| sum / SAMPLES as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_reflects_by_schlicks_term() {
        let table = SplitSum::new();
        for cosine in [0.0f32, 0.13, 0.5, 0.77, 1.0] {
            let fresnel = (1.0 - cosine).powi(5);
            let [scale, bias] = table.at(cosine, 0.0);
            assert!(
                (bias - fresnel).abs() < 1e-6 && (scale + bias - 1.0).abs() < 1e-6,
                "{cosine}: {scale}, {bias}"
            );
        }
    }

    #[test]
    fn a_smooth_surface_is_nearly_a_mirror() {
        let table = SplitSum::new();
        for cosine in [0.2, 0.5, 0.9] {
            // α of 1/256: facets lean by less than half a degree, which Schlick's term shows in its third digit.
            let ([scale, bias], [sharp, sharp_bias]) = (table.at(cosine, 1.0 / 16.0), table.at(cosine, 0.0));
            assert!(
                (scale - sharp).abs() < 0.01 && (bias - sharp_bias).abs() < 0.01,
                "{cosine}: {scale}, {bias}"
            );
        }
    }

    #[test]
    fn no_surface_reflects_more_than_it_receives() {
        let table = SplitSum::new();
        for i in 0..=64 {
            for k in 0..=32 {
                let [scale, bias] = table.at(i as f32 / 64.0, k as f32 / 32.0);
                let sum = scale + bias;
                assert!(scale >= 0.0 && bias >= 0.0 && sum <= 1.02, "{i}, {k}: {scale} + {bias}");
            }
        }
    }

    #[test]
    fn the_table_is_that_of_a_finer_sum() {
        // By 200 × 200 half vectors: cosine 0.5, roughness 0.5 (α 0.25).
        let (mut sum, count) = ([0.0f64; 2], 200);
        for i in 0..count * count {
            let [across, around] = [i / count, i % count].map(|k| (f64::from(k) + 0.5) / f64::from(count));
            let (alpha, cosine) = (0.25f64, 0.5f64);
            let squared = (1.0 - across) / (1.0 + (alpha * alpha - 1.0) * across);
            let towards = (1.0 - cosine * cosine).sqrt()
                * (1.0 - squared).sqrt()
                * (std::f64::consts::TAU * around).cos()
                + cosine * squared.sqrt();
            let light = 2.0 * towards * squared.sqrt() - cosine;
            if light > 0.0 {
                let lambda = |c: f64| 2.0 * c / (c + (alpha * alpha + (1.0 - alpha * alpha) * c * c).sqrt());
                let weight = lambda(cosine) * lambda(light) * towards / (squared.sqrt() * cosine);
                let fresnel = (1.0 - towards).powi(5);
                sum[0] += (1.0 - fresnel) * weight;
                sum[1] += fresnel * weight;
            }
        }
        let expected = sum.map(|sum| (sum / f64::from(count * count)) as f32);
        let found = SplitSum::new().at(0.5, 0.5);
        for (found, expected) in found.into_iter().zip(expected) {
            // What 1024 half vectors leave.
            assert!((found - expected).abs() < 5e-3, "{found}, expected {expected}");
        }
    }
}
