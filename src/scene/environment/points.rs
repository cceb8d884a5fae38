//! Evenly spread points, the same on every machine.

/// Point `i` of `count` of the Hammersley set: `((i + ½) / n, radical inverse of i)`, both within 0 and 1.
pub(super) fn hammersley(i: u32, count: u32) -> [f32; 2] {
    let inverse = f64::from(i.reverse_bits()) / 4_294_967_296.0;
    // The radical inverse begins at 0; half a step further the points are centred.
    [((f64::from(i) + 0.5) / f64::from(count)) as f32, (inverse + 0.5 / f64::from(count)) as f32]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_points_are_spread_evenly_over_both_axes() {
        let points: Vec<[f32; 2]> = (0..16).map(|i| hammersley(i, 16)).collect();
        for axis in [0, 1] {
            let mut cells: Vec<usize> = points.iter().map(|point| (point[axis] * 16.0) as usize).collect();
            cells.sort_unstable();
            assert_eq!(cells, (0..16).collect::<Vec<_>>(), "one in each sixteenth");
        }
    }
}
