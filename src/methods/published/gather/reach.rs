//! The radius around each pixel within which all pixels lie whose discs cover it.
//!
//! A fragment behind a pixel spreads over it no further than the CoC of the pixel itself, and a fragment in front of it but
//! behind focus has a smaller CoC. So only fragments in front of focus reach further, each over its own disc; over pixels that are no
//! surface, those behind focus do too. Radii are rounded up to the levels of `dilation`.

use crate::methods::shared::{LAST_LEVEL, VisibleSurfaces, dilate, level, radius_px};
use crate::parallel;
use std::ops::Range;

/// Adjacent pixels of a row that share the largest level among them, so that they are filtered together.
const CHUNK: usize = 16;

/// For each pixel, the level of the radius within which all pixels lie whose discs cover it.
pub(super) struct Reach {
    width: usize,
    levels: Vec<u8>,
    present: [bool; LAST_LEVEL as usize + 1],
    /// Diagonal of the frame in pixels: the largest distance between two pixels.
    diagonal_px: f32,
}

impl Reach {
    /// The reach of each pixel of `surfaces`.
    pub(super) fn new(surfaces: &VisibleSurfaces) -> Self {
        let (coc_px, presence) = (&surfaces.coc_px, surfaces.presence.as_ref());
        let (width, height) = (coc_px.width(), coc_px.height());
        let diagonal_px = (width as f32).hypot(height as f32);
        let presence = |i: usize| presence.map_or(1.0, |presence| presence.values()[i]);
        let mut own = vec![0; width * height];
        parallel::for_each_block(&mut own, &|block, own| {
            let own = own.iter_mut().zip(&coc_px.values()[block]);
            own.for_each(|(own, coc)| *own = level(coc.abs().min(diagonal_px)));
        });
        let mut levels = own.clone();
        parallel::for_each_block(&mut levels, &|block, levels| {
            for (level, i) in levels.iter_mut().zip(block) {
                *level = if presence(i) < 1.0 { 0 } else { *level };
            }
        });
        // The edge of a disc is a pixel wide.
        let reach_px = |level| radius_px(level) + 0.5;
        let surface = |i: usize, near: bool| {
            ((coc_px.values()[i] < 0.0) == near && presence(i) > 0.0).then_some(own[i])
        };
        dilate((&mut levels, width.max(1)), |i| surface(i, true), reach_px, |_| true);
        if surfaces.presence.is_some() {
            dilate((&mut levels, width.max(1)), |i| surface(i, false), reach_px, |i| presence(i) < 1.0);
        }
        parallel::for_each_row(&mut levels, width, &|_, row| {
            for chunk in row.chunks_mut(CHUNK) {
                let max_level = chunk.iter().copied().max().unwrap_or(0);
                chunk.fill(max_level);
            }
        });
        let mut present = [false; LAST_LEVEL as usize + 1];
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    /// The reach of a picture with signed CoC radii `coc_px`, in which every pixel or only the `present` ones are surfaces.
    fn reach(coc_px: Plane, presence: Option<Plane>) -> Reach {
        Reach::new(&VisibleSurfaces { content: Vec::new(), presence, coc_px })
    }

    #[test]
    fn a_near_fragment_raises_what_its_disc_covers_and_a_far_one_only_itself() {
        let raised = |coc: f32| {
            let plane = Plane::from_fn(48, 33, |x, y| if (x, y) == (24, 16) { coc } else { 0.0 });
            let reach = reach(plane, None);
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
    fn a_far_fragment_raises_the_empty_pixels_that_its_disc_covers() {
        let fragment = |x, y| (x, y) == (24, 16);
        let coc_px = Plane::from_fn(48, 33, |x, y| if fragment(x, y) { 4.0 } else { 0.0 });
        let presence = Plane::from_fn(48, 33, |x, y| f32::from(u8::from(fragment(x, y))));
        let reach = reach(coc_px, Some(presence));
        let raised = |x: usize, y: usize| reach.levels[y * 48 + x] > 0;
        assert_eq!(
            [raised(24, 12), raised(16, 16), raised(24, 11), raised(0, 16)],
            [true, true, false, false]
        );
    }

    #[test]
    fn the_spans_of_a_row_cover_it_in_whole_chunks() {
        let plane = Plane::from_fn(41, 1, |x, _| if x < 20 { 8.0 } else { 0.0 });
        let spans: Vec<_> = reach(plane, None).spans(0).collect();
        assert_eq!(spans, [(0..32, level(8.0)), (32..41, 0)], "in chunks");
    }
}
