//! How a frame is cut into bands of rows.

use crate::error::Error;
use crate::memory::shown_bytes;
use crate::stack::Footprint;
use std::ops::Range;

/// Bands of rows of a frame, all of one height but for the last. Rows are those of samples, counted from the top of the data window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// Rows of the frame.
    pub(super) height: usize,
    /// Rows of each band.
    pub(super) rows: usize,
    /// Rows above and below a band on which its pixels depend.
    pub(super) around: usize,
}

/// One band.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Band {
    /// Its rows in the frame.
    pub(super) kept: Range<usize>,
    /// The rows that are read for it, which include them.
    pub(super) read: Range<usize>,
}

impl Layout {
    /// The highest bands, of a multiple of `step` rows with at least `around` rows on either side, of which `bytes` of the rows read is within
    /// `limit_bytes`.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Limits`] where a band would have fewer rows than lie around it: most of the work would be done several
    /// times. The error says which limit is enough.
    pub(super) fn within(
        limit_bytes: u64,
        footprint: &Footprint,
        (around, step): (usize, usize),
        bytes: impl Fn(usize) -> u64,
    ) -> Result<Self, Error> {
        let around = around.next_multiple_of(step);
        let height = footprint.height;
        let fitting = footprint.rows_within(limit_bytes, &bytes);
        let rows = fitting.saturating_sub(2 * around) / step * step;
        let fewest = around.max(step);
        if rows >= fewest {
            return Ok(Self { height, rows: rows.min(height.next_multiple_of(step)), around });
        }
        let enough = bytes((fewest + 2 * around).min(height)).min(bytes(height));
        Err(Error::limits("the frame does not fit into memory, not even in bands")
            .with("memory", shown_bytes(limit_bytes))
            .with(
                "needed",
                format!(
                    "{} for bands of {fewest} rows with {around} rows of their surroundings",
                    shown_bytes(enough)
                ),
            )
            .help(format!(
                "allow at least that much with `memory`, or {} for the whole frame",
                shown_bytes(bytes(height))
            )))
    }

    /// Number of bands.
    pub(super) fn count(&self) -> usize {
        self.height.div_ceil(self.rows.max(1))
    }

    /// Band `i`, from the top.
    pub(super) fn band(&self, i: usize) -> Band {
        let kept = i * self.rows..((i + 1) * self.rows).min(self.height);
        let read = kept.start.saturating_sub(self.around)..(kept.end + self.around).min(self.height);
        Band { kept, read }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::{ReadOptions, Source, footprint};

    /// The footprint of a sample of the repository.
    fn of_sample() -> Footprint {
        footprint(&[Source::file("samples/shelf/stack.exr")], &ReadOptions::default()).unwrap()
    }

    #[test]
    fn bands_cover_every_row_once_and_read_their_surroundings_within_the_frame() {
        let layout = Layout { height: 100, rows: 32, around: 16 };
        let bands: Vec<Band> = (0..layout.count()).map(|i| layout.band(i)).collect();
        let kept: Vec<usize> = bands.iter().flat_map(|band| band.kept.clone()).collect();
        assert_eq!(kept, (0..100).collect::<Vec<_>>());
        assert_eq!(bands[0].read, 0..48);
        assert_eq!(bands[1].read, 16..80);
        assert_eq!(bands[3], Band { kept: 96..100, read: 80..100 });
    }

    #[test]
    fn the_limit_that_an_error_names_is_enough() {
        let footprint = Footprint { height: 4000, ..of_sample() };
        let bytes = |rows: usize| footprint.render_bytes(rows);
        let fewest = bytes(40 + 80);
        assert!(Layout::within(fewest - 1, &footprint, (40, 8), bytes).is_err());
        let layout = Layout::within(fewest, &footprint, (40, 8), bytes).unwrap();
        assert_eq!((layout.rows, layout.around), (40, 40));
        let error = Layout::within(fewest - 1, &footprint, (40, 8), bytes).unwrap_err().to_string();
        assert!(error.contains(&shown_bytes(fewest)), "{error}");
    }
}
