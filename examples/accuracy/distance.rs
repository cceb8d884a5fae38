//! Distance to the nearest of a set of pixels.

/// For each pixel of a picture of `width` columns the distance in pixels to the nearest pixel of `set`, as far as it is at most
/// `limit_px`; infinite beyond.
pub(crate) fn distances(set: &[bool], width: usize, limit_px: usize) -> Vec<f32> {
    let height = set.len() / width.max(1);
    let in_row: Vec<f32> = set.chunks(width.max(1)).flat_map(along_row).collect();
    let nearest = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(limit_px)..(y + limit_px + 1).min(height);
        let squares = rows.map(|row| (row.abs_diff(y) as f32).powi(2) + in_row[row * width + x].powi(2));
        squares.fold(f32::INFINITY, f32::min).sqrt()
    };
    (0..set.len())
        .map(nearest)
        .map(|distance| if distance <= limit_px as f32 { distance } else { f32::INFINITY })
        .collect()
}

/// The distance in pixels from each pixel of a row to the nearest one of the set in it; infinite without one.
fn along_row(row: &[bool]) -> Vec<f32> {
    let mut distances = vec![f32::INFINITY; row.len()];
    let mut sweep = |columns: &mut dyn Iterator<Item = usize>| {
        let mut distance = f32::INFINITY;
        for x in columns {
            distance = if row[x] { 0.0 } else { distance + 1.0 };
            distances[x] = distances[x].min(distance);
        }
    };
    sweep(&mut (0..row.len()));
    sweep(&mut (0..row.len()).rev());
    distances
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_euclidean_up_to_the_limit() {
        let (width, height) = (9, 7);
        let set: Vec<bool> = (0..width * height).map(|i| i == 2 * width + 3 || i == 6 * width + 8).collect();
        for (pixel, found) in distances(&set, width, 4).into_iter().enumerate() {
            let to = |x: f32, y: f32| ((pixel % width) as f32 - x).hypot((pixel / width) as f32 - y);
            let expected = to(3.0, 2.0).min(to(8.0, 6.0));
            let expected = if expected <= 4.0 { expected } else { f32::INFINITY };
            assert!(
                found == expected || (found - expected).abs() < 1e-5,
                "pixel {pixel}: {found}, {expected}"
            );
        }
    }
}
