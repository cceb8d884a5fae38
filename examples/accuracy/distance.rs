//! The nearest of a set of pixels.

/// For each pixel of a picture of `width` columns the nearest pixel of `set` and its distance in pixels, where that is at most `limit_px`.
pub(crate) fn nearest(set: &[bool], width: usize, limit_px: usize) -> Vec<Option<(usize, f32)>> {
    let height = set.len() / width.max(1);
    let in_row: Vec<Option<usize>> = set.chunks(width.max(1)).flat_map(along_row).collect();
    let nearest = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(limit_px)..(y + limit_px + 1).min(height);
        let found = rows.filter_map(|row| {
            let column = in_row[row * width + x]?;
            let distance_px = (row.abs_diff(y) as f32).hypot(column.abs_diff(x) as f32);
            Some((row * width + column, distance_px))
        });
        found.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|&(_, distance_px)| distance_px <= limit_px as f32)
    };
    (0..set.len()).map(nearest).collect()
}

/// The column of the set that is nearest to each pixel of a row.
fn along_row(row: &[bool]) -> Vec<Option<usize>> {
    let last = |last: &mut Option<usize>, x: usize| {
        *last = if row[x] { Some(x) } else { *last };
        Some(*last)
    };
    let before = (0..row.len()).scan(None, last);
    let mut after: Vec<Option<usize>> = (0..row.len()).rev().scan(None, last).collect();
    after.reverse();
    let nearer = |(x, (before, after)): (usize, (Option<usize>, Option<usize>))| {
        before.into_iter().chain(after).min_by_key(|column| column.abs_diff(x))
    };
    before.zip(after).enumerate().map(nearer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pixel_is_found_up_to_the_limit() {
        let (width, height) = (9, 7);
        let members = [2 * width + 3, 6 * width + 8];
        let set: Vec<bool> = (0..width * height).map(|pixel| members.contains(&pixel)).collect();
        for (pixel, found) in nearest(&set, width, 4).into_iter().enumerate() {
            let distance = |other: usize| {
                ((pixel % width) as f32 - (other % width) as f32)
                    .hypot((pixel / width) as f32 - (other / width) as f32)
            };
            let expected = members.map(distance).into_iter().fold(f32::INFINITY, f32::min);
            match found {
                Some((member, distance_px)) => {
                    assert!(members.contains(&member), "pixel {pixel}");
                    assert_eq!((distance_px, distance(member)), (expected, expected), "pixel {pixel}");
                }
                None => assert!(expected > 4.0, "pixel {pixel}: {expected}"),
            }
        }
    }
}
