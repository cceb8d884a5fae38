//! The disc of a CoC radius, row by row, as steps of coverage up and down.

use crate::lens::Aperture;
use crate::methods::shared::soft_area;
use glam::Vec2;

/// Coverage of a pixel that lies completely inside a disc. Coverage is an integer, so that steps sum up to exactly 0.
pub(super) const FULL_COVERAGE: f64 = 4096.0;

/// Past this radius in pixels the area of a disc is computed instead of counted: its edge pixels are too small a part to matter.
const MAX_COUNTED_RADIUS_PX: f32 = 512.0;

/// A change of coverage along a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    /// First column after the change, relative to the centre of the disc.
    pub dx: i32,
    /// The change, where [`FULL_COVERAGE`] is one; an integer.
    pub height: f64,
}

/// A disc, clipped to the size of the picture.
#[derive(Debug)]
pub(super) struct Sprite {
    /// One over the area of the disc, where [`FULL_COVERAGE`] is one pixel, so that the whole disc adds up to the energy of one
    /// pixel.
    pub intensity: f64,
    /// Row of the first steps, relative to the centre of the disc.
    top: i32,
    /// First column, and column after the last.
    columns: [i32; 2],
    steps: Vec<Step>,
    /// Index of the first step of each row, and the number of steps.
    starts: Vec<usize>,
}

impl Sprite {
    /// The disc of signed CoC radius `coc_px` for a picture of `width × height` pixels.
    pub(super) fn new(aperture: Aperture, coc_px: f32, (width, height): (usize, usize)) -> Self {
        let shape = Shape::new(aperture, coc_px);
        let area = if coc_px.abs() <= MAX_COUNTED_RADIUS_PX {
            let rows = -shape.reach()..=shape.reach();
            // Each step holds from its column on, and the steps of a row sum up to 0, so this is the enclosed area.
            rows.flat_map(|dy| shape.row(dy, shape.reach()))
                .map(|step| -f64::from(step.dx) * step.height)
                .sum()
        } else {
            FULL_COVERAGE * soft_area(aperture, coc_px.abs())
        };
        let (limit_x, limit_y) = (shape.reach().min(width as i32), shape.reach().min(height as i32));
        let (mut steps, mut starts) = (Vec::new(), vec![0]);
        for dy in -limit_y..=limit_y {
            steps.extend(shape.row(dy, limit_x));
            starts.push(steps.len());
        }
        let columns =
            steps.iter().fold([0, 0], |[from, to], step: &Step| [from.min(step.dx), to.max(step.dx)]);
        Self { intensity: 1.0 / area, top: -limit_y, columns, steps, starts }
    }

    /// The steps of the row `dy` rows below the centre, from left to right.
    pub(super) fn row(&self, dy: i32) -> &[Step] {
        let row = (dy - self.top) as usize;
        &self.steps[self.starts[row]..self.starts[row + 1]]
    }

    /// Share of all pixels whose sprites of this shape cover pixel `x, y` that lie in a frame of `width × height` pixels.
    pub(super) fn share_within(&self, (width, height): (usize, usize), [x, y]: [usize; 2]) -> f64 {
        let [top, bottom] = self.rows_reached();
        let [x, y, width, height] = [x, y, width, height].map(|value| value as i32);
        // The pixel whose sprite covers the given one at the offset `dx, dy` is at `x − dx, y − dy`.
        let first_dx = x + 1 - width;
        let [from, to] = self.columns;
        if from >= first_dx && to <= x + 1 && top > y - height && bottom <= y {
            return 1.0;
        }
        let rows = (y + 1 - height).max(top)..=y.min(bottom);
        let in_row = |dy: i32| {
            let steps = self.row(dy).iter();
            steps.map(|step| step.height * f64::from(x + 1 - step.dx.clamp(first_dx, x + 1))).sum::<f64>()
        };
        self.intensity * rows.map(in_row).sum::<f64>()
    }

    /// First and last row, relative to the centre.
    pub(super) fn rows_reached(&self) -> [i32; 2] {
        [self.top, self.top + self.starts.len() as i32 - 2]
    }
}

/// The shape over which a pixel spreads: the aperture turned by 180°.
struct Shape {
    /// Outward normals of the sides; empty for a disc.
    normals: Vec<Vec2>,
    /// Distance of the sides from the centre, in pixels.
    apothem_px: f32,
    radius_px: f32,
}

impl Shape {
    fn new(aperture: Aperture, coc_px: f32) -> Self {
        let turn = if coc_px < 0.0 { 1.0 } else { -1.0 };
        Self {
            normals: aperture.side_normals().into_iter().map(|normal| turn * normal).collect(),
            apothem_px: coc_px.abs() * aperture.apothem(),
            radius_px: coc_px.abs(),
        }
    }

    /// No row or column further from the centre than this is covered.
    fn reach(&self) -> i32 {
        // The corners of a polygon, with half a pixel of soft edge, are further out than its radius plus half a pixel.
        let widest = self.radius_px / self.apothem_px.max(f32::MIN_POSITIVE);
        (self.radius_px + 0.5 * widest.clamp(1.0, 2.0)) as i32 + 1
    }

    /// Coverage at an offset from the centre: [`FULL_COVERAGE`] inside, falling to 0 over one pixel at the edge.
    fn coverage(&self, offset: Vec2) -> f64 {
        let distance = match self.normals.is_empty() {
            true => offset.length(),
            false => self.normals.iter().map(|normal| normal.dot(offset)).fold(f32::NEG_INFINITY, f32::max),
        };
        (f64::from((self.apothem_px - distance + 0.5).clamp(0.0, 1.0)) * FULL_COVERAGE).round()
    }

    /// First and last column of row `dy` that lie at least `depth_px` pixels inside; the first is past the last where there is
    /// none.
    fn columns_inside(&self, dy: i32, depth_px: f32) -> [f32; 2] {
        let (distance, dy) = (self.apothem_px - depth_px, dy as f32);
        if self.normals.is_empty() {
            let half = if distance < dy.abs() { -1.0 } else { (distance * distance - dy * dy).sqrt() };
            return [-half, half];
        }
        self.normals.iter().fold([f32::NEG_INFINITY, f32::INFINITY], |[from, to], normal| {
            let rest = distance - normal.y * dy;
            // A nearly horizontal side limits rows, not columns.
            match normal.x {
                x if x > 1e-6 => [from, to.min(rest / x)],
                x if x < -1e-6 => [from.max(rest / x), to],
                _ if rest < 0.0 => [f32::INFINITY, f32::NEG_INFINITY],
                _ => [from, to],
            }
        })
    }

    /// The steps of row `dy`, of columns up to `limit` to either side; steps further left are moved to the first of these
    /// columns.
    fn row(&self, dy: i32, limit: i32) -> Vec<Step> {
        let clip = |x: f32| x.clamp(-limit as f32, limit as f32) as i32;
        let [outer_from, outer_to] = self.columns_inside(dy, -0.5);
        if outer_from > outer_to {
            return Vec::new();
        }
        let (from, to) = (clip(outer_from.floor()), clip(outer_to.ceil()));
        let [inner_from, inner_to] = self.columns_inside(dy, 0.5);
        // Between these two columns, each moved one pixel inwards against rounding, coverage is constant.
        let (full_from, full_to) = (clip(inner_from.ceil()) + 1, clip(inner_to.floor()) - 1);
        let (mut steps, mut before, mut x) = (Vec::new(), 0.0, from);
        while x <= to {
            let coverage = self.coverage(Vec2::new(x as f32, dy as f32));
            if coverage != before {
                steps.push(Step { dx: x, height: coverage - before });
                before = coverage;
            }
            x = if inner_from <= inner_to && x >= full_from && x < full_to { full_to } else { x + 1 };
        }
        if before != 0.0 {
            steps.push(Step { dx: to + 1, height: -before });
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coverage of a sprite, from its steps, at each pixel within `reach` of its centre.
    fn drawn(sprite: &Sprite, reach: i32) -> impl Iterator<Item = (Vec2, f64)> {
        let [top, bottom] = sprite.rows_reached();
        (-reach..=reach).flat_map(move |y| {
            let steps = if (top..=bottom).contains(&y) { sprite.row(y) } else { &[] };
            (-reach..=reach).map(move |x| {
                let sum = steps.iter().filter(|step| step.dx <= x).map(|step| step.height).sum();
                (Vec2::new(x as f32, y as f32), sum)
            })
        })
    }

    #[test]
    fn a_sprite_adds_up_to_one_and_covers_the_pixels_that_see_its_fragment() {
        for blades in [0, 3, 5, 6] {
            let aperture = Aperture::new(blades, 11.0).unwrap();
            for coc in [0.0f32, 0.3, -0.6, 1.0, -1.7, 4.0, -9.3, 30.0] {
                let sprite = Sprite::new(aperture, coc, (200, 200));
                let mut sum = 0.0;
                for (offset, coverage) in drawn(&sprite, 40) {
                    sum += coverage * sprite.intensity;
                    // Seen from the pixel, the offset to the fragment has the opposite sign.
                    let depth = aperture.depth_inside(-offset, coc);
                    let expected = f64::from((depth + 0.5).clamp(0.0, 1.0)) * FULL_COVERAGE;
                    assert!((coverage - expected).abs() < 1.0, "{blades} blades, {coc} px at {offset}");
                }
                assert!((sum - 1.0).abs() < 1e-12, "{blades} blades, {coc} px: {sum}");
            }
        }
    }

    #[test]
    fn the_share_within_a_frame_is_that_of_the_pixels_whose_sprites_cover_the_given_one() {
        let sprite = Sprite::new(Aperture::new(5, 11.0).unwrap(), 4.3, (30, 20));
        for [x, y] in [[15, 10], [0, 0], [29, 3], [2, 19]] {
            let offsets = drawn(&sprite, 8).filter(|(offset, _)| {
                let (x, y) = (x as f32 - offset.x, y as f32 - offset.y);
                (0.0..30.0).contains(&x) && (0.0..20.0).contains(&y)
            });
            let expected: f64 = offsets.map(|(_, coverage)| coverage * sprite.intensity).sum();
            let found = sprite.share_within((30, 20), [x, y]);
            assert!((found - expected).abs() < 1e-12, "{x}, {y}: {found}, expected {expected}");
        }
    }

    #[test]
    fn a_disc_within_a_pixel_is_that_pixel() {
        for coc in [0.0, 0.49, -0.49] {
            let sprite = Sprite::new(Aperture::DISC, coc, (9, 9));
            let covered: Vec<_> = drawn(&sprite, 3).filter(|(_, coverage)| *coverage > 0.0).collect();
            assert_eq!(covered.len(), 1, "{coc} px covers {covered:?}");
            assert_eq!(covered[0].1 * sprite.intensity, 1.0, "completely");
        }
    }

    #[test]
    fn a_disc_larger_than_the_picture_costs_no_more_than_the_picture() {
        let sprite = Sprite::new(Aperture::DISC, 30_000.0, (64, 48));
        assert!(sprite.steps.len() <= 2 * (2 * 48 + 1), "{} steps", sprite.steps.len());
        let area = std::f64::consts::PI * 9e8 * FULL_COVERAGE;
        assert!((sprite.intensity * area - 1.0).abs() < 1e-6, "its energy is spread over the whole disc");
    }
}
