//! Bands of rows, for frames larger than an adapter's limits.

use crate::error::Error;
use std::ops::Range;

/// Rows of the picture that are rendered together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Band {
    /// The rows that the band makes.
    pub rows: Range<usize>,
    /// The rows that the band reads.
    pub source: Range<usize>,
}

/// The bands of a picture of `height` rows. A band reads up to `reach` more rows on either side, and at most `max_rows` in total.
///
/// # Errors
/// [`crate::error::ErrorKind::Device`] if not even one row can be made.
pub(crate) fn bands(height: usize, reach: usize, max_rows: usize) -> Result<Vec<Band>, Error> {
    if height <= max_rows {
        return Ok(vec![Band { rows: 0..height, source: 0..height }]);
    }
    let rows = max_rows.saturating_sub(2 * reach);
    if rows == 0 {
        return Err(Error::device("the frame is too large for the GPU")
            .with("found", format!("{height} rows, each made from {reach} rows on either side"))
            .with("expected", format!("{max_rows} rows at most at once"))
            .help("use `device = cpu`"));
    }
    // The minimum number of bands, of equal height to within one row.
    let count = height.div_ceil(rows);
    let band = |i: usize| {
        let rows = i * height / count..(i + 1) * height / count;
        Band { source: rows.start.saturating_sub(reach)..(rows.end + reach).min(height), rows }
    };
    Ok((0..count).map(band).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_make_every_row_once_and_read_at_most_max_rows() {
        for (height, reach, max_rows) in
            [(100, 0, 7), (100, 3, 7), (101, 10, 64), (5, 9, 5), (4320, 200, 900)]
        {
            let bands = bands(height, reach, max_rows).unwrap();
            let made: Vec<usize> = bands.iter().flat_map(|band| band.rows.clone()).collect();
            assert_eq!(made, (0..height).collect::<Vec<_>>(), "{height} rows, reach {reach}");
            for Band { rows, source } in bands {
                assert!(source.len() <= max_rows, "{source:?} of {max_rows}");
                let expected = rows.start.saturating_sub(reach)..(rows.end + reach).min(height);
                assert_eq!(source, expected, "all rows that {rows:?} depend on");
            }
        }
    }

    #[test]
    fn a_reach_that_leaves_no_row_is_refused() {
        let error = bands(100, 30, 60).unwrap_err().to_string();
        assert!(error.contains("100 rows") && error.contains("`device = cpu`"), "{error}");
    }
}
