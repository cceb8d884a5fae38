//! Radii spread over the pixels that they reach, on a logarithmic scale of levels.
//!
//! One level at a time, by the distance to the nearest source of that level: first along columns; then along rows, where only whether a
//! source is within the radius matters, by counting intervals. Levels are an eighth of an octave apart.

use crate::parallel;

/// Radius in pixels of level 0: a disc of it covers only its own pixel.
const OWN_PIXEL_PX: f32 = 0.5;

/// Levels per octave of the radius.
const LEVELS_PER_OCTAVE: f32 = 8.0;

/// The highest level; its radius is larger than any frame.
pub(in crate::methods) const LAST_LEVEL: u8 = u8::MAX;

/// The lowest level whose radius is at least `radius_px`.
pub(in crate::methods) fn level(radius_px: f32) -> u8 {
    if radius_px <= OWN_PIXEL_PX {
        0
    } else {
        (LEVELS_PER_OCTAVE * (radius_px / OWN_PIXEL_PX).log2()).ceil().max(1.0) as u8
    }
}

/// The radius of `level` in pixels.
pub(in crate::methods) fn radius_px(level: u8) -> f32 {
    OWN_PIXEL_PX * (f32::from(level) / LEVELS_PER_OCTAVE).exp2()
}

/// Raises the levels of the pixels that are `raised` to the largest among the sources that reach them. `source` is the level of a
/// pixel, if it is a source, and `reach_px` how far a level reaches. A frame has `width` columns.
pub(in crate::methods) fn dilate(
    (levels, width): (&mut [u8], usize),
    source: impl Fn(usize) -> Option<u8> + Sync,
    reach_px: impl Fn(u8) -> f32 + Sync,
    raised: impl Fn(usize) -> bool + Sync,
) {
    let mut sources = vec![0; levels.len()];
    parallel::for_each_block(&mut sources, &|block, sources| {
        sources.iter_mut().zip(block).for_each(|(level, i)| *level = source(i).unwrap_or(0));
    });
    let mut present = [false; LAST_LEVEL as usize + 1];
    sources.iter().for_each(|&level| present[usize::from(level)] = true);
    for level in (1..=LAST_LEVEL).filter(|&level| present[usize::from(level)]) {
        let distances = distances_along_columns(width, &sources, level);
        parallel::for_each_row(levels, width, &|y, levels| {
            let distances = &distances[y * width..][..levels.len()];
            raise(levels, distances, (level, reach_px(level)), |x| raised(y * width + x));
        });
    }
}

/// For each pixel, the distance in rows to the nearest source of `level` in its column; larger than any frame where there is none.
fn distances_along_columns(width: usize, sources: &[u8], level: u8) -> Vec<u32> {
    let far = |&source: &u8| if source == level { 0 } else { u32::MAX / 2 };
    let mut distances: Vec<u32> = sources.iter().map(far).collect();
    for i in width..distances.len() {
        distances[i] = distances[i].min(distances[i - width] + 1);
    }
    for i in (0..distances.len().saturating_sub(width)).rev() {
        distances[i] = distances[i].min(distances[i + width] + 1);
    }
    distances
}

/// Raises the `levels` of the pixels of a row that are `raised` to `level` where a source is within `reach_px`.
fn raise(levels: &mut [u8], distances: &[u32], (level, reach_px): (u8, f32), raised: impl Fn(usize) -> bool) {
    let mut interval_ends = vec![0i32; levels.len() + 1];
    for (x, &distance) in distances.iter().enumerate().filter(|(_, distance)| **distance as f32 <= reach_px) {
        let half = (reach_px * reach_px - (distance as f32).powi(2)).sqrt() as usize;
        interval_ends[x.saturating_sub(half)] += 1;
        interval_ends[(x + half + 1).min(levels.len())] -= 1;
    }
    let mut active = 0;
    for (x, (own, change)) in levels.iter_mut().zip(interval_ends).enumerate() {
        active += change;
        *own = if active > 0 && raised(x) { level.max(*own) } else { *own };
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
    fn the_largest_level_that_reaches_a_pixel_wins_where_pixels_are_raised() {
        let (wide, narrow) = (level(4.0), level(2.0));
        let source = |i: usize| [(2, wide), (9, narrow)].into_iter().find(|(at, _)| *at == i).map(|(_, l)| l);
        let mut levels = vec![0; 12];
        dilate((&mut levels, 12), source, radius_px, |i| i != 5);
        let (w, n) = (wide, narrow);
        assert_eq!(levels, [w, w, w, w, w, 0, w, n, n, n, n, n]);
    }
}
