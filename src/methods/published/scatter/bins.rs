//! Pixels by CoC radius: those of a bin are drawn with one sprite.

use super::sprite::Sprite;
use crate::image::Plane;
use crate::lens::Aperture;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Up to this radius bins are equally wide, past it in proportion to the radius.
const EVEN_TO_PX: f32 = 4.0;

/// Bins a pixel of radius near focus.
const A_PIXEL: f32 = 8.0;

/// Neighbours in a row that fall into one bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Run {
    pub y: u32,
    /// First column.
    pub from: u32,
    /// Column past the last.
    pub to: u32,
}

/// All pixels of about one CoC radius.
#[derive(Debug)]
pub(super) struct Bin {
    pub sprite: Sprite,
    /// From top to bottom.
    runs: Vec<Run>,
}

impl Bin {
    /// The runs whose sprites reach row `y`.
    pub(super) fn runs_reaching(&self, y: usize) -> &[Run] {
        let [above, below] = self.sprite.rows_reached();
        let from = self.runs.partition_point(|run| i64::from(run.y) + i64::from(below) < y as i64);
        let to = self.runs.partition_point(|run| i64::from(run.y) + i64::from(above) <= y as i64);
        &self.runs[from..to]
    }
}

/// Sorts the pixels of a picture by CoC radius, nearest first.
pub(super) fn sort(coc_px: &Plane, aperture: Aperture) -> Vec<Bin> {
    let (width, height) = (coc_px.width(), coc_px.height());
    let rows: Vec<Vec<(i32, Run)>> = (0..height).into_par_iter().map(|y| runs(coc_px.row(y), y)).collect();
    let mut bins: BTreeMap<i32, Vec<Run>> = BTreeMap::new();
    for (number, run) in rows.into_iter().flatten() {
        bins.entry(number).or_default().push(run);
    }
    let bins: Vec<(i32, Vec<Run>)> = bins.into_iter().collect();
    let with_sprite =
        |(number, runs)| Bin { sprite: Sprite::new(aperture, radius_px(number), (width, height)), runs };
    bins.into_par_iter().map(with_sprite).collect()
}

/// The runs of row `y`, each with its bin's number.
fn runs(coc_px: &[f32], y: usize) -> Vec<(i32, Run)> {
    let mut runs: Vec<(i32, Run)> = Vec::new();
    for (x, &coc) in coc_px.iter().enumerate() {
        let number = number(coc);
        match runs.last_mut() {
            Some((last, run)) if *last == number => run.to += 1,
            _ => runs.push((number, Run { y: y as u32, from: x as u32, to: x as u32 + 1 })),
        }
    }
    runs
}

/// The bin of a signed CoC radius; bins are numbered from near to far, 0 in focus.
fn number(coc_px: f32) -> i32 {
    let radius = coc_px.abs();
    let even = radius.min(EVEN_TO_PX) * A_PIXEL;
    let further = (radius / EVEN_TO_PX).max(1.0).ln() * EVEN_TO_PX * A_PIXEL;
    (even + further).round().copysign(coc_px) as i32
}

/// The signed CoC radius in the middle of a bin.
fn radius_px(number: i32) -> f32 {
    let place = number.abs() as f32 / A_PIXEL;
    let radius = if place <= EVEN_TO_PX { place } else { EVEN_TO_PX * (place / EVEN_TO_PX - 1.0).exp() };
    radius.copysign(number as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_rise_from_near_to_far_and_are_narrow() {
        let radii: Vec<f32> = (-300..300).map(radius_px).collect();
        assert!(radii.windows(2).all(|pair| pair[0] < pair[1]), "rising");
        for coc in [-7000.0f32, -74.3, -4.1, -0.3, 0.0, 0.07, 3.9, 12.0, 500.0] {
            let off = (radius_px(number(coc)) - coc).abs();
            assert!(off <= 0.505 * (coc.abs() / 32.0).max(0.125), "{coc} is drawn {off} px off");
        }
    }

    #[test]
    fn a_row_falls_into_runs_of_one_bin() {
        let run = |from, to| Run { y: 5, from, to };
        assert_eq!(runs(&[2.0, 2.01, -2.0], 5), [(16, run(0, 2)), (-16, run(2, 3))]);
    }
}
