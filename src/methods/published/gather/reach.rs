//! How far away the pixels may be that spread over a pixel.
//!
//! What lies behind a pixel spreads over it no further than the pixel's own CoC, and what lies before it but behind focus is
//! blurred less than itself. So only fragments in front of focus reach further, each exactly over its own disc: dilated
//! here, one level of radii at a time, by the distance to the nearest such fragment (first along columns, then, as rows
//! only ask whether it is within the radius, by counting intervals). Radii are rounded up to levels an eighth of an octave
//! apart.

use crate::image::Plane;
use rayon::prelude::*;
use std::ops::Range;

/// Nothing spreads beyond its own pixel up to this radius.
const WITHIN_PX: f32 = 0.5;

/// Levels an octave.
const LEVELS: f32 = 8.0;

/// Pixels of a row, side by side, that share the largest level among them, so that they are filtered together.
const TOGETHER: usize = 16;

/// For each pixel, the level of the radius within which all lies that spreads over it.
pub(super) struct Reach {
    width: usize,
    levels: Vec<u8>,
    present: [bool; Self::LAST as usize + 1],
    /// The frame's diagonal: nothing is farther away.
    max_px: f32,
}

impl Reach {
    /// The highest level, of a radius no frame has.
    pub(super) const LAST: u8 = 255;

    /// The reach of each pixel of a picture with signed CoC radii `coc_px`.
    pub(super) fn new(coc_px: &Plane) -> Self {
        let (width, height) = (coc_px.width(), coc_px.height());
        let max_px = (width as f32).hypot(height as f32);
        let mut levels: Vec<u8> =
            coc_px.values().par_iter().map(|coc| level(coc.abs().min(max_px))).collect();
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
        levels.par_chunks_mut(width.max(1)).flat_map(|row| row.par_chunks_mut(TOGETHER)).for_each(|group| {
            let most = group.iter().copied().max().unwrap_or(0);
            group.fill(most);
        });
        let mut present = [false; Self::LAST as usize + 1];
        levels.iter().for_each(|&level| present[usize::from(level)] = true);
        Self { width, levels, present, max_px }
    }

    /// Whether any pixel has `level`.
    pub(super) fn has(&self, level: u8) -> bool {
        self.present[usize::from(level)]
    }

    /// The largest radius of `level` that the frame has room for.
    pub(super) fn radius_px(&self, level: u8) -> f32 {
        radius_px(level).min(self.max_px)
    }

    /// Row `y` as stretches of one level each.
    pub(super) fn stretches(&self, y: usize) -> impl Iterator<Item = (Range<usize>, u8)> {
        let row = &self.levels[y * self.width..][..self.width];
        row.chunk_by(|a, b| a == b).scan(0, |start, chunk| {
            let columns = *start..*start + chunk.len();
            *start = columns.end;
            Some((columns, chunk[0]))
        })
    }
}

/// The lowest level whose radius is `radius` or more.
fn level(radius: f32) -> u8 {
    if radius <= WITHIN_PX { 0 } else { (LEVELS * (radius / WITHIN_PX).log2()).ceil().max(1.0) as u8 }
}

fn radius_px(level: u8) -> f32 {
    WITHIN_PX * (f32::from(level) / LEVELS).exp2()
}

/// For each pixel, how many rows away the nearest source in its column is; huge where there is none.
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

/// Raises the `levels` of a row to `level` where a source is within its radius and the half pixel of a rim.
fn raise(levels: &mut [u8], distances: &[u32], level: u8) {
    let reach = radius_px(level) + 0.5;
    let mut starts = vec![0i32; levels.len() + 1];
    for (x, &distance) in distances.iter().enumerate().filter(|(_, distance)| **distance as f32 <= reach) {
        let half = (reach * reach - (distance as f32).powi(2)).sqrt() as usize;
        starts[x.saturating_sub(half)] += 1;
        starts[(x + half + 1).min(levels.len())] -= 1;
    }
    let mut open = 0;
    for (own, start) in levels.iter_mut().zip(starts) {
        open += start;
        *own = if open > 0 { level.max(*own) } else { *own };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_is_the_next_radius_up() {
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
            // The first of the pixels that share a level stands for all of them.
            let at = |x: usize, y: usize| reach.levels[y * 48 + x] > 0;
            [at(24, 16), at(24, 12), at(16, 16), at(24, 11), at(0, 16)]
        };
        // 24 lies in the second group of 16 pixels, and so does column 20, four pixels to the left.
        assert_eq!(
            raised(-4.0),
            [true, true, true, false, false],
            "four rows up and four columns to the left"
        );
        assert_eq!(raised(4.0), [true, false, true, false, false], "its own group");
    }

    #[test]
    fn a_row_falls_into_stretches_that_cover_it() {
        let plane = Plane::from_fn(41, 1, |x, _| if x < 20 { 8.0 } else { 0.0 });
        let stretches: Vec<_> = Reach::new(&plane).stretches(0).collect();
        assert_eq!(stretches, [(0..32, level(8.0)), (32..41, 0)], "in groups");
    }
}
