//! Bins of pixels by CoC radius: all pixels of a bin are drawn with one sprite.

use super::sprite::Sprite;
use crate::image::Plane;
use crate::lens::Aperture;
use crate::parallel;
use std::collections::BTreeMap;

/// Up to this radius in pixels bins have equal width; past it their width is proportional to the radius.
const UNIFORM_TO_PX: f32 = 4.0;

/// Bins per pixel of radius, up to [`UNIFORM_TO_PX`].
const BINS_PER_PX: f32 = 8.0;

/// Adjacent pixels of a row that fall into one bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    pub y: u32,
    /// First column.
    pub from: u32,
    /// Column after the last.
    pub to: u32,
}

/// All pixels of about one CoC radius.
#[derive(Debug)]
pub(super) struct Bin {
    pub sprite: Sprite,
    /// From top to bottom.
    spans: Vec<Span>,
}

impl Bin {
    /// The pixels of row `y`.
    pub(super) fn columns(&self, y: usize) -> impl Iterator<Item = usize> {
        let from = self.spans.partition_point(|span| (span.y as usize) < y);
        let spans = self.spans[from..].iter().take_while(move |span| span.y as usize == y);
        spans.flat_map(|span| span.from as usize..span.to as usize)
    }

    /// The spans whose sprites reach row `y`.
    pub(super) fn spans_reaching(&self, y: usize) -> &[Span] {
        let [above, below] = self.sprite.rows_reached();
        let from = self.spans.partition_point(|span| i64::from(span.y) + i64::from(below) < y as i64);
        let to = self.spans.partition_point(|span| i64::from(span.y) + i64::from(above) <= y as i64);
        &self.spans[from..to]
    }
}

/// Sorts the pixels of a picture by CoC radius, nearest first.
pub(super) fn sort(coc_px: &Plane, aperture: Aperture) -> Vec<Bin> {
    let (width, height) = (coc_px.width(), coc_px.height());
    let rows: Vec<Vec<(i32, Span)>> = parallel::map(height, &|y| spans(coc_px.row(y), y));
    let mut bins: BTreeMap<i32, Vec<Span>> = BTreeMap::new();
    for (number, span) in rows.into_iter().flatten() {
        bins.entry(number).or_default().push(span);
    }
    let (numbers, spans): (Vec<i32>, Vec<Vec<Span>>) = bins.into_iter().unzip();
    let sprite = |bin: usize| Sprite::new(aperture, radius_px(numbers[bin]), (width, height));
    let sprites = parallel::map(numbers.len(), &sprite);
    sprites.into_iter().zip(spans).map(|(sprite, spans)| Bin { sprite, spans }).collect()
}

/// The spans of row `y`, each with the number of its bin.
fn spans(coc_px: &[f32], y: usize) -> Vec<(i32, Span)> {
    let mut spans: Vec<(i32, Span)> = Vec::new();
    for (x, &coc) in coc_px.iter().enumerate() {
        let number = number(coc);
        match spans.last_mut() {
            Some((last, span)) if *last == number => span.to += 1,
            _ => spans.push((number, Span { y: y as u32, from: x as u32, to: x as u32 + 1 })),
        }
    }
    spans
}

/// The number of the bin of a signed CoC radius; numbers rise from near to far, 0 is in focus.
fn number(coc_px: f32) -> i32 {
    let radius = coc_px.abs();
    let uniform = radius.min(UNIFORM_TO_PX) * BINS_PER_PX;
    let logarithmic = (radius / UNIFORM_TO_PX).max(1.0).ln() * UNIFORM_TO_PX * BINS_PER_PX;
    (uniform + logarithmic).round().copysign(coc_px) as i32
}

/// The signed CoC radius in the middle of a bin.
fn radius_px(number: i32) -> f32 {
    let position = number.abs() as f32 / BINS_PER_PX;
    let radius = if position <= UNIFORM_TO_PX {
        position
    } else {
        UNIFORM_TO_PX * (position / UNIFORM_TO_PX - 1.0).exp()
    };
    radius.copysign(number as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_of_bins_rise_from_near_to_far_and_are_close_to_those_of_their_pixels() {
        let radii: Vec<f32> = (-300..300).map(radius_px).collect();
        assert!(radii.windows(2).all(|pair| pair[0] < pair[1]), "rising");
        for coc in [-7000.0f32, -74.3, -4.1, -0.3, 0.0, 0.07, 3.9, 12.0, 500.0] {
            let error = (radius_px(number(coc)) - coc).abs();
            assert!(
                error <= 0.505 * (coc.abs() / 32.0).max(0.125),
                "{coc} is drawn with an error of {error} px"
            );
        }
    }

    #[test]
    fn a_row_is_split_into_spans_of_one_bin() {
        let span = |from, to| Span { y: 5, from, to };
        assert_eq!(spans(&[2.0, 2.01, -2.0], 5), [(16, span(0, 2)), (-16, span(2, 3))]);
    }
}
