//! Statistics of single peels, taken in the pass of [`super::stats`].
//!
//! Cost: one comparison of neighbours per fragment, and a sum over bright fragments.

use super::surface;

/// Statistics of one peel.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
#[non_exhaustive]
pub struct PeelStats {
    /// Smallest and largest signed CoC radius in picture pixels; `0, 0` without fragments.
    pub coc_range_px: [f32; 2],
    /// Share of the samples that have a fragment.
    pub covered: f64,
    /// Share of the fragments that are translucent.
    pub translucent: f64,
    /// Share of the fragments with a CoC radius below one pixel.
    pub in_focus: f64,
    /// Light of the peel's highlights, the fragments with a CoC radius over one pixel and a brightness of at least 1: the sum of their
    /// brightness (largest of r, g, b), in scene-linear units times picture pixels. Exact discs would carry this light.
    pub highlight_light: f64,
    /// Share of the pairs of neighbours along rows with at least one fragment in which one is empty or the CoC radii differ by
    /// [`surface::AVERAGE_PX`] or more.
    pub jumps: f64,
}

/// Counts of pairs of neighbouring samples along rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Neighbours {
    /// Pairs with at least one fragment.
    pub(super) pairs: usize,
    /// Those in which one sample is empty or the CoC radii differ by [`surface::AVERAGE_PX`] or more.
    pub(super) jumps: usize,
}

impl Neighbours {
    /// The counts of one row. Inlined so that it is compiled for each instruction set.
    #[inline(always)]
    pub(super) fn from_row(alpha: &[f32], coc_px: &[f32]) -> Self {
        let Some(last) = alpha.len().checked_sub(1) else { return Self::default() };
        let (mut pairs, mut jumps) = (0_u32, 0_u32);
        let alphas = alpha[..last].iter().zip(&alpha[1..]);
        let cocs = coc_px[..last].iter().zip(&coc_px[1..]);
        for ((&here, &next), (&coc, &next_coc)) in alphas.zip(cocs) {
            let (here, next) = (here > 0.0, next > 0.0);
            pairs += u32::from(here | next);
            jumps += u32::from((here != next) | (here & !surface::may_average(coc, next_coc)));
        }
        Self { pairs: pairs as usize, jumps: jumps as usize }
    }

    pub(super) fn add(&mut self, other: Self) {
        self.pairs += other.pairs;
        self.jumps += other.jumps;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::scene::{Layer, Scene};
    use crate::stack::StackKind;

    /// A layer of fragments `brightness, alpha, CoC radius`, in rows of `width`.
    fn layer(width: usize, fragments: &[(f32, f32, f32)]) -> Layer {
        let plane = |value: fn(&(f32, f32, f32)) -> f32| {
            Plane::from_fn(width, fragments.len() / width, |x, y| value(&fragments[y * width + x]))
        };
        let brightest = plane(|fragment| fragment.0);
        let dim = plane(|fragment| 0.25 * fragment.0);
        Layer {
            color: [dim.clone(), brightest, dim],
            alpha: plane(|fragment| fragment.1),
            coc_px: plane(|fragment| fragment.2),
        }
    }

    fn peels(layers: Vec<Layer>, supersample: usize) -> Vec<PeelStats> {
        Scene::new(layers, StackKind::PointSampled, supersample, 20.0).analyze().peels
    }

    #[test]
    fn every_peel_has_its_own_statistics() {
        let front =
            layer(4, &[(0.5, 1.0, -3.0), (0.5, 0.5, -2.0), (0.5, 1.0, 0.9), (9.0, 0.0, 50.0)].repeat(2));
        let back = layer(4, &[(0.5, 1.0, 7.0); 8]);
        let found = peels(vec![front, back], 1);
        let front = PeelStats {
            coc_range_px: [-3.0, 0.9],
            covered: 0.75,
            translucent: 1.0 / 3.0,
            in_focus: 1.0 / 3.0,
            // −3 | −2 | 0.9 | empty.
            jumps: 1.0,
            highlight_light: 0.0,
        };
        let back = PeelStats { coc_range_px: [7.0; 2], covered: 1.0, ..PeelStats::default() };
        assert_eq!(found, [front, back]);
    }

    #[test]
    fn the_statistics_of_a_peel_without_fragments_are_zero() {
        let empty = layer(3, &[(0.0, 0.0, 5.0); 6]);
        assert_eq!(peels(vec![empty], 1), [PeelStats::default()]);
    }

    #[test]
    fn neighbours_jump_where_their_radii_differ_by_the_limit_or_one_is_empty() {
        // 0 and 0.5 do not jump, 0.5 and 1.125 do, as do 1.125 and an empty sample; two empty samples are no pair.
        let found = Neighbours::from_row(&[1.0, 1.0, 1.0, 0.0, 0.0], &[0.0, 0.5, 1.125, 1.125, 1.125]);
        assert_eq!(found, Neighbours { pairs: 3, jumps: 2 });
        let limit = Neighbours::from_row(&[1.0; 2], &[0.0, surface::AVERAGE_PX]);
        assert_eq!(limit, Neighbours { pairs: 1, jumps: 1 });
        assert_eq!(Neighbours::from_row(&[1.0], &[2.0]), Neighbours::default());
        assert_eq!(Neighbours::from_row(&[], &[]), Neighbours::default());
    }

    #[test]
    fn samples_of_two_rows_are_no_neighbours() {
        // Each row is one surface; the last sample of a row and the first of the next are no pair.
        let rows = layer(20, &[[(0.5, 1.0, -4.0); 20], [(0.5, 1.0, 4.0); 20]].concat());
        assert_eq!(peels(vec![rows], 1)[0].jumps, 0.0);
    }

    #[test]
    fn barely_blurred_lights_are_bright_points_with_a_little_blur() {
        let lights = |supersample: usize, layer: Layer| {
            let scene = Scene::new(vec![layer], StackKind::PointSampled, supersample, 20.0);
            scene.analyze().barely_blurred_lights
        };
        let dark = (0.5, 1.0, 0.5);
        let row = |light| [dark, light, dark];
        let counted = [
            ((500.0, 1.0, 0.5), 1.0),
            ((500.0, 1.0, -0.05), 0.5),
            ((500.0, 1.0, 0.0), 0.0),
            ((500.0, 1.0, 1.25), 0.5),
            ((500.0, 1.0, 1.5), 0.0),
            ((16.0, 1.0, 0.5), 0.5),
            ((8.0, 1.0, 0.5), 0.0),
            ((500.0, 0.0, 0.5), 0.0),
        ];
        for (light, expected) in counted {
            let found = lights(1, layer(3, &row(light)));
            assert!((found - expected).abs() < 1e-6, "{light:?}: {found}");
        }
        assert_eq!(lights(1, layer(5, &[(500.0, 1.0, 0.5); 5])), 0.0, "an area has no noise inside");
        let edge = [dark, (500.0, 1.0, 0.5), (500.0, 1.0, 0.5), (500.0, 1.0, 0.5), dark];
        assert_eq!(lights(1, layer(5, &edge)), 2.0, "its edge has");
        let samples = layer(4, &[dark, (500.0, 1.0, 0.5), dark, dark].repeat(2));
        assert_eq!(lights(2, samples), 0.5, "in picture pixels");
        for (alpha, expected) in [(1.0, 0.0), (0.9, 1.0), (0.968, 0.5)] {
            let layers = vec![layer(3, &[(0.5, alpha, 0.5); 3]), layer(3, &row((500.0, 1.0, 0.5)))];
            let found = Scene::new(layers, StackKind::PointSampled, 1, 20.0).analyze().barely_blurred_lights;
            assert!((found - expected).abs() < 1e-3, "behind alpha {alpha}: {found}");
        }
    }

    #[test]
    fn highlight_light_is_that_of_bright_and_blurred_fragments() {
        // 4 and 1 count; 0.9 is too dark, the 8 is in focus, the 16 is no fragment.
        let fragments = [
            (4.0, 1.0, -3.0),
            (1.0, 1.0, 1.5),
            (0.9, 1.0, 3.0),
            (8.0, 1.0, 1.0),
            (16.0, 0.0, 9.0),
            (0.0, 1.0, 9.0),
        ];
        assert_eq!(peels(vec![layer(6, &fragments)], 1)[0].highlight_light, 5.0);
        // The same light in 2 × 2 samples per pixel.
        let samples = layer(12, &fragments.map(|fragment| [fragment; 2]).concat().repeat(2));
        assert_eq!(peels(vec![samples], 2)[0].highlight_light, 5.0);
    }
}
