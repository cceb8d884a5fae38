//! The radius around each pixel within which all pixels lie whose discs cover it.
//!
//! A fragment behind a pixel spreads over it no further than the CoC of the pixel itself, and a fragment in front of it but
//! behind focus has a smaller CoC. So only fragments in front of focus reach further, each over its own disc. Their radii are
//! dilated, one level at a time, by the distance to the nearest such fragment: first along columns; then along rows, where only
//! whether a fragment is within the radius matters, by counting intervals. Radii are rounded up to levels an eighth of an
//! octave apart.

use crate::image::Plane;
use rayon::prelude::*;
use std::ops::Range;

/// Up to this radius in pixels a disc covers only its own pixel.
const OWN_PIXEL_PX: f32 = 0.5;

/// Levels per octave of the radius.
const LEVELS_PER_OCTAVE: f32 = 8.0;

/// Adjacent pixels of a row that share the largest level among them, so that they are filtered together.
const CHUNK: usize = 16;

/// For each pixel, the level of the radius within which all pixels lie whose discs cover it.
pub(super) struct Reach {
    width: usize,
    levels: Vec<u8>,
    present: [bool; Self::LAST as usize + 1],
    /// Diagonal of the frame in pixels: the largest distance between two pixels.
    diagonal_px: f32,
}

impl Reach {
    /// The highest level; its radius is larger than any frame.
    pub(super) const LAST: u8 = 255;

    /// The reach of each pixel of a picture with signed CoC radii `coc_px`.
    pub(super) fn new(coc_px: &Plane) -> Self {
        let (width, height) = (coc_px.width(), coc_px.height());
        let diagonal_px = (width as f32).hypot(height as f32);
        let mut levels: Vec<u8> =
            coc_px.values().par_iter().map(|coc| level(coc.abs().min(diagonal_px))).collect();
        let own = levels.clone();
        let mut near = [false; Self::LAST as usize + 1];
        for (&level, &coc) in own.iter().zip(coc_px.values()) {
            near[usize::from(level)] |= coc < 0.0;
        }
        for level in (1..=Self::LAST).filter(|&level| near[usize::from(level)]) {
            let is_source = |i: usize| own[i] == level && coc_px.values()[i] < 0.0;
            let distances = distances_along_columns(width, height, is_source);
            let rows = levels.par_chunks_mut(width).zip(distances.par_chunks(width));
            rows.for_each(|(levels, distances)| raise(levels, distances, level));
        }
        levels.par_chunks_mut(width.max(1)).flat_map(|row| row.par_chunks_mut(CHUNK)).for_each(|chunk| {
            let max_level = chunk.iter().copied().max().unwrap_or(0);
            chunk.fill(max_level);
        });
        let mut present = [false; Self::LAST as usize + 1];
        levels.iter().for_each(|&level| present[usize::from(level)] = true);
        Self { width, levels, present, diagonal_px }
    }

    /// Whether any pixel has `level`.
    pub(super) fn has(&self, level: u8) -> bool {
        self.present[usize::from(level)]
    }

    /// The radius of `level`, limited to the diagonal of the frame.
    pub(super) fn radius_px(&self, level: u8) -> f32 {
        radius_px(level).min(self.diagonal_px)
    }

    /// Row `y` as spans of one level each: columns and level.
    pub(super) fn spans(&self, y: usize) -> impl Iterator<Item = (Range<usize>, u8)> {
        let row = &self.levels[y * self.width..][..self.width];
        row.chunk_by(|a, b| a == b).scan(0, |start, chunk| {
            let columns = *start..*start + chunk.len();
            *start = columns.end;
            Some((columns, chunk[0]))
        })
    }
}

/// The lowest level whose radius is at least `radius` pixels.
fn level(radius: f32) -> u8 {
    if radius <= OWN_PIXEL_PX {
        0
    } else {
        (LEVELS_PER_OCTAVE * (radius / OWN_PIXEL_PX).log2()).ceil().max(1.0) as u8
    }
}

/// The radius of `level`.
fn radius_px(level: u8) -> f32 {
    OWN_PIXEL_PX * (f32::from(level) / LEVELS_PER_OCTAVE).exp2()
}

/// For each pixel, the distance in rows to the nearest source in its column; larger than any frame where there is none.
fn distances_along_columns(width: usize, height: usize, is_source: impl Fn(usize) -> bool) -> Vec<u32> {
    let mut distances: Vec<u32> =
        (0..width * height).map(|i| if is_source(i) { 0 } else { u32::MAX / 2 }).collect();
    for i in width..width * height {
        distances[i] = distances[i].min(distances[i - width] + 1);
    }
    for i in (0..(width * height).saturating_sub(width)).rev() {
        distances[i] = distances[i].min(distances[i + width] + 1);
    }
    distances
}

/// Raises the `levels` of a row to `level` where a source is within its radius plus half a pixel, the width of the disc edge.
fn raise(levels: &mut [u8], distances: &[u32], level: u8) {
    let reach = radius_px(level) + 0.5;
    let mut interval_ends = vec![0i32; levels.len() + 1];
    for (x, &distance) in distances.iter().enumerate().filter(|(_, distance)| **distance as f32 <= reach) {
        let half = (reach * reach - (distance as f32).powi(2)).sqrt() as usize;
        interval_ends[x.saturating_sub(half)] += 1;
        interval_ends[(x + half + 1).min(levels.len())] -= 1;
    }
    let mut active = 0;
    for (own, change) in levels.iter_mut().zip(interval_ends) {
        active += change;
        *own = if active > 0 { level.max(*own) } else { *own };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_radius_is_rounded_up_to_the_next_level() {
        for radius in [0.51f32, 0.6, 1.0, 3.3, 74.0, 40_000.0] {
            let level = level(radius);
            assert!(radius_px(level) >= radius * 0.9999, "{radius} fits into level {level}");
            assert!(radius_px(level - 1) < radius, "{radius} does not fit into the one below");
        }
        assert_eq!([level(0.0), level(0.5)], [0, 0], "within the pixel");
    }

    #[test]
    fn a_near_fragment_raises_what_its_disc_covers_and_a_far_one_only_itself() {
        let raised = |coc: f32| {
            let plane = Plane::from_fn(48, 33, |x, y| if (x, y) == (24, 16) { coc } else { 0.0 });
            let reach = Reach::new(&plane);
            // All pixels of a chunk share one level.
            let at = |x: usize, y: usize| reach.levels[y * 48 + x] > 0;
            [at(24, 16), at(24, 12), at(16, 16), at(24, 11), at(0, 16)]
        };
        // Columns 24 and 20, four pixels to the left, lie in the second chunk of 16 pixels.
        assert_eq!(
            raised(-4.0),
            [true, true, true, false, false],
            "four rows up and four columns to the left"
        );
        assert_eq!(raised(4.0), [true, false, true, false, false], "only its own chunk");
    }

    #[test]
    fn the_spans_of_a_row_cover_it_in_whole_chunks() {
        let plane = Plane::from_fn(41, 1, |x, _| if x < 20 { 8.0 } else { 0.0 });
        let spans: Vec<_> = Reach::new(&plane).spans(0).collect();
        assert_eq!(spans, [(0..32, level(8.0)), (32..41, 0)], "in chunks");
    }
}
