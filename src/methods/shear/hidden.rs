//! What nearer fragments hide of a row of a highlight's disc.

use super::spans::Span;
use std::ops::Range;

/// `p = offset + scale · s`: the projection of column `s` of an occluder's row to column `p` of the picture, seen from the
/// highlight.
#[derive(Clone, Copy)]
pub(super) struct Affine {
    pub(super) offset: f32,
    pub(super) scale: f32,
}

/// How far nearer fragments hide some columns of a row of a disc.
///
/// A surface is in several bins, which overlap where its fragments reach to their neighbours and adjoin where they do not. It hides what its
/// bins hide together, but no more than the one that hides most, so that the number of bins does not matter. What opaque surfaces hide adds
/// up, and so does what the opaque and the translucent fragments of one surface hide, because they hide different parts of a column. What
/// passes a translucent surface meets the next.
#[derive(Debug, Default)]
pub(super) struct Hidden {
    /// The first column.
    first: usize,
    /// Number of columns.
    count: usize,
    /// What is hidden of all columns at least.
    everywhere: f32,
    /// The layers that hide any of them.
    layers: Vec<u16>,
    /// For each of these and each column, for opaque and for translucent fragments, the sum over its bins of the share of the column that
    /// they cover times how far they hide.
    sums: Vec<[f32; 2]>,
    /// The same for the most that one of its bins hides where it covers.
    most: Vec<[f32; 2]>,
}

impl Hidden {
    /// Starts with at least the share `everywhere` hidden of `columns`.
    pub(super) fn clear(&mut self, columns: Range<usize>, everywhere: f32) {
        (self.first, self.count, self.everywhere) = (columns.start, columns.len(), everywhere);
        self.layers.clear();
        self.sums.clear();
        self.most.clear();
    }

    /// Where the columns of layer `layer` begin in the sums.
    fn start_of(&mut self, layer: u16) -> usize {
        let known = self.layers.iter().position(|&known| known == layer);
        let index = known.unwrap_or_else(|| {
            self.layers.push(layer);
            for values in [&mut self.sums, &mut self.most] {
                values.resize(self.layers.len() * self.count, [0.0; 2]);
            }
            self.layers.len() - 1
        });
        index * self.count
    }

    /// Adds `span`, which covers `columns` of its row, mapped to the disc's row by `map`, with fractional coverage at its ends; it hides the
    /// share `share`, and `alpha` is the coverage of its row if it is translucent.
    pub(super) fn add(
        &mut self,
        span: &Span,
        (columns, map): ([f32; 2], Affine),
        (share, alpha): (f32, Option<&[f32]>),
    ) {
        let ends = columns.map(|s| map.offset + map.scale * s);
        let (from, to) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let last = self.first + self.count - 1;
        if to < self.first as f32 - 0.5 || from > last as f32 + 0.5 {
            return;
        }
        let begin = (from + 0.5).floor().max(self.first as f32) as usize;
        let end = (to + 0.5).floor().min(last as f32) as usize;
        let (start, kind) = (self.start_of(span.layer), usize::from(!span.opaque));
        for x in begin..=end {
            let covered = (to.min(x as f32 + 0.5) - from.max(x as f32 - 0.5)).clamp(0.0, 1.0);
            let opacity = alpha.map_or(1.0, |row| {
                let source = (x as f32 - map.offset) / map.scale;
                row[(source.round() as usize).clamp(span.start as usize, span.end as usize - 1)]
            });
            let index = start + x - self.first;
            let hides = if covered > 0.0 { share * opacity } else { 0.0 };
            self.sums[index][kind] += covered * hides;
            self.most[index][kind] = self.most[index][kind].max(hides);
        }
    }

    /// How far each column is visible.
    pub(super) fn visible(&self) -> impl Iterator<Item = f32> {
        (0..self.count).map(move |column| {
            let (mut beside, mut through) = (1.0, 1.0);
            for index in (column..self.sums.len()).step_by(self.count) {
                let [opaque, translucent] =
                    [0, 1].map(|kind| self.sums[index][kind].min(self.most[index][kind]));
                beside -= opaque;
                if translucent > 0.0 {
                    through *= (1.0 - translucent / (1.0 - opaque).max(translucent)).max(0.0);
                }
            }
            (beside.max(0.0) * through).min(1.0 - self.everywhere)
        })
    }
}
