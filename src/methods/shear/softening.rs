//! What softens the edge of a blurred light: the square of the pixel, convolved with the shape of what emits the light.

use std::f32::consts::FRAC_1_SQRT_2;

/// Rows over which the coverage of a pixel at an edge is integrated.
const EDGE_ROWS: usize = 16;

/// Samples along each side of a pixel over which the light varies.
pub(super) const GRID: usize = 6;

/// What softens the edge of a shape: the square of a pixel, convolved with the shape of what emits the light.
#[derive(Debug, Clone)]
pub(super) struct Softening {
    /// Rows across the emitter and the pixel.
    pub(super) rows: Vec<SofteningRow>,
    /// Radius in pixels that holds both.
    pub(super) reach_px: f32,
    /// Offsets along an axis of equal weight under their convolution, in pixels.
    pub(super) grid: [f32; GRID],
    /// Half the width of the ring of light around each of these samples, in pixels.
    pub(super) sample_half_px: f32,
    /// Half the width of a ring that approximates both by one sample, in pixels.
    pub(super) pixel_half_px: f32,
}

/// A row across an emitter and the pixel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SofteningRow {
    /// Offset of the row from the middle, in pixels.
    pub(super) offset_px: f32,
    /// Share of the light.
    pub(super) weight: f32,
    /// Width of the emitter in this row, in pixels.
    pub(super) width_px: f32,
}

impl Softening {
    /// Rows of a disc over which a square's rows are integrated.
    const DISC_ROWS: usize = 32;

    /// A square emitter of this width.
    pub(super) fn square(width_px: f32) -> Self {
        let height = (1.0 + width_px) / EDGE_ROWS as f32;
        let row = |i: usize| {
            let top = i as f32 * height - 0.5 * (1.0 + width_px);
            let weight = soft_step(top + height, width_px) - soft_step(top, width_px);
            SofteningRow { offset_px: top + 0.5 * height, weight, width_px }
        };
        Self::new((0..EDGE_ROWS).map(row).collect(), FRAC_1_SQRT_2 * width_px, width_px)
    }

    /// A uniform disc of this radius.
    pub(super) fn disc(radius_px: f32) -> Self {
        let radius_px = radius_px.max(1e-3);
        // A whole number of rows a pixel: their sum over the rows of the picture is then that of the kernel.
        let per_px = (2.0 * EDGE_ROWS as f32 / (1.0 + 2.0 * radius_px)).floor().clamp(4.0, 8.0);
        let (height, count) = (1.0 / per_px, ((1.0 + 2.0 * radius_px) * per_px).ceil());
        let top_px = -0.5 * count * height;
        let offset_px = |i: usize| top_px + (i as f32 + 0.5) * height;
        let row = |i: usize| SofteningRow { offset_px: offset_px(i), ..SofteningRow::default() };
        let mut rows: Vec<SofteningRow> = (0..count as usize).map(row).collect();
        // Each row of the disc, as high as the pixel, over the rows that it overlaps.
        let step = 2.0 * radius_px / Self::DISC_ROWS as f32;
        for disc_row in 0..Self::DISC_ROWS {
            let y = -radius_px + (disc_row as f32 + 0.5) * step;
            let half_px = (radius_px * radius_px - y * y).max(0.0).sqrt();
            for (i, row) in rows.iter_mut().enumerate() {
                let top = top_px + i as f32 * height;
                let overlap = (top + height).min(y + 0.5) - top.max(y - 0.5);
                let light = overlap.max(0.0) * half_px;
                row.weight += light;
                // For now four times the sum of squares.
                row.width_px += light * half_px * half_px;
            }
        }
        let sum: f32 = rows.iter().map(|row| row.weight).sum();
        for row in &mut rows {
            // A box of the variance of the boxes that the row is a mixture of.
            row.width_px = 2.0 * (row.width_px / row.weight.max(f32::MIN_POSITIVE)).sqrt();
            row.weight /= sum;
        }
        // A square of this width has the variance of the disc along an axis, r²/4.
        Self::new(rows, radius_px, 3f32.sqrt() * radius_px)
    }

    /// The softening of an emitter by these rows; the emitter lies within `radius_px`, and has along an axis the variance of a box of
    /// `width_px`.
    fn new(rows: Vec<SofteningRow>, radius_px: f32, width_px: f32) -> Self {
        let grid = std::array::from_fn(|i| quantile((i as f32 + 0.5) / GRID as f32, width_px));
        let spread = grid.iter().map(|offset| offset * offset).sum::<f32>() / GRID as f32;
        Self {
            rows,
            reach_px: FRAC_1_SQRT_2 + radius_px,
            grid,
            // A box of this half width has the variance that the grid lacks.
            sample_half_px: (0.25 * (1.0 + width_px * width_px) - 3.0 * spread).max(0.0).sqrt(),
            pixel_half_px: 0.5 * 1f32.hypot(width_px),
        }
    }
}

/// The position at which [`soft_step`] reaches `share`: its inverse.
fn quantile(share: f32, size_px: f32) -> f32 {
    let end = 0.5 * (1.0 + size_px);
    let halved = |[low, high]: [f32; 2], _| {
        let middle = 0.5 * (low + high);
        if soft_step(middle, size_px) < share { [middle, high] } else { [low, middle] }
    };
    (0..24).fold([-end, end], halved)[0]
}

/// A step at 0, convolved with a box of width 1 and a box of width `size_px`: the integral of their trapezoid.
pub(super) fn soft_step(depth: f32, size_px: f32) -> f32 {
    let (flat, end) = (0.5 * (1.0 - size_px).abs(), 0.5 * (1.0 + size_px));
    let from_end = (end - depth.abs()).max(0.0);
    let sloped = depth.abs() > flat && size_px > 0.0;
    let outer = if sloped {
        from_end * from_end / (2.0 * size_px)
    } else {
        (0.5 - depth.abs() / size_px.max(1.0)).max(0.0)
    };
    if depth > 0.0 { 1.0 - outer } else { outer }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_soft_step_rises_from_0_through_a_half_to_1() {
        for size in [0.0, 0.25, 1.0, 4.0] {
            let end = 0.5 * (1.0 + size);
            assert_eq!([-end, 0.0, end].map(|depth| soft_step(depth, size)), [0.0, 0.5, 1.0], "size {size}");
            let steps: Vec<f32> = (-20..=20).map(|i| soft_step(i as f32 * 0.1, size)).collect();
            assert!(
                steps.windows(2).all(|pair| pair[1] >= pair[0] && pair[1] - pair[0] < 0.11),
                "size {size}: {steps:?}"
            );
        }
    }

    #[test]
    fn the_rows_of_an_emitter_hold_its_light_and_its_variances() {
        let moments = |softening: &Softening| {
            let sum = |value: &dyn Fn(&SofteningRow) -> f32| {
                softening.rows.iter().map(|row| row.weight * value(row)).sum::<f32>()
            };
            let across = sum(&|row| row.offset_px * row.offset_px);
            let along = sum(&|row| (1.0 + row.width_px * row.width_px) / 12.0);
            (sum(&|_| 1.0), sum(&|row| row.offset_px), [across, along])
        };
        let pixel = 1.0 / 12.0;
        for size in [0.1f32, 0.5, 1.0, 2.7] {
            for (softening, variance) in [
                (Softening::square(size), pixel + size * size / 12.0),
                (Softening::disc(size), pixel + size * size / 4.0),
            ] {
                let (light, middle, variances) = moments(&softening);
                assert!((light - 1.0).abs() < 1e-5 && middle.abs() < 1e-5, "size {size}: {light}, {middle}");
                for found in variances {
                    assert!(
                        (found / variance - 1.0).abs() < 0.02,
                        "size {size}: {found}, expected {variance}"
                    );
                }
            }
        }
    }
}
