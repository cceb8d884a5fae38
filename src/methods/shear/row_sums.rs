//! One output row: sums over views, and the rays of the view that is being painted.

use super::canvas::{Barrel, Shear};
use super::lanes::{Chunk, LANES, Mask, chunks_of, has, lanes_of};
use super::mirrors::Noted;
use super::opaque_hits::OpaqueHits;
use super::picture;
use super::row_mask::RowMask;
use super::sums::{Means, Sums};
use super::translucent_hits::TranslucentHits;
use crate::methods::contract::LostRays;
use crate::scene::Background;
use glam::{IVec2, Vec2};
use pulp::{Arch, NullaryFnOnce};
use std::ops::Range;

/// Sums over views for one output row, and the rays of the current view. Views may be added in several calls: the bits are those
/// of one call.
///
/// Each quantity has its own vector with one chunk or mask for each 16 pixels, so that what every span touches stays close
/// together.
#[derive(Debug)]
pub(super) struct RowSums {
    pub(super) width: usize,
    pub(super) views: usize,
    /// Lanes that are not painted: past the end of the row, or excluded by [`RowSums::only`].
    pub(super) skipped: RowMask,
    /// The smallest range that holds all painted columns.
    pub(super) columns: Range<i32>,
    /// For each column of all chunks, the number of views that the barrel hides, with fractions where a view fades in.
    pub(super) hidden: Vec<f32>,
    /// Sums of the current batch.
    pub(super) sums: Sums,
    /// Sums of all batches before it.
    pub(super) flushed: Sums,
    /// Rays that are occluded.
    pub(super) occluded: RowMask,
    /// Rays of transmittance below 1, which `transmittance` has.
    pub(super) attenuated: RowMask,
    /// Undefined for rays that are not attenuated.
    pub(super) transmittance: Vec<Chunk>,
    pub(super) hits: TranslucentHits,
    /// What rays hit that is not in `sums` yet.
    pub(super) opaque_hits: OpaqueHits,
    /// Rays of the current view that mirrors stop.
    pub(super) noted: Vec<Noted>,
}

impl RowSums {
    /// A row of `width` pixels with no views; `near` says whether near surfaces are kept apart.
    pub(super) fn new(width: usize, near: bool) -> Self {
        let chunks = width.div_ceil(LANES);
        Self {
            width,
            views: 0,
            skipped: RowMask::past_end(width),
            columns: 0..width as i32,
            hidden: vec![0.0; chunks * LANES],
            sums: Sums::blank(chunks, near),
            flushed: Sums::blank(chunks, near),
            occluded: RowMask::none(width),
            attenuated: RowMask::none(width),
            transmittance: vec![Chunk::default(); chunks],
            hits: TranslucentHits::default(),
            opaque_hits: OpaqueHits::new(chunks),
            noted: Vec::new(),
        }
    }

    /// A row of `width` pixels with no views, of which only `columns`, in ascending order, are painted.
    pub(super) fn only(width: usize, columns: &[usize]) -> Self {
        let mut row = Self::new(width, false);
        row.skipped.set_where(|x| columns.binary_search(&x).is_err());
        row.columns = match columns {
            [first, .., last] => *first as i32..*last as i32 + 1,
            [one] => *one as i32..*one as i32 + 1,
            [] => 0..0,
        };
        row
    }

    /// Paints only the columns for which `is_visible` holds from now on; for others, pixels have no meaning.
    pub(super) fn paint_only(&mut self, is_visible: impl Fn(usize) -> bool) {
        let width = self.width;
        self.skipped.set_where(|x| x >= width || !is_visible(x));
    }

    /// Removes all views from the row.
    pub(super) fn clear(&mut self) {
        self.views = 0;
        self.hidden.fill(0.0);
        self.sums.clear();
        self.flushed.clear();
    }

    /// Adds the sums of the current batch to those of the batches before it, and clears them.
    pub(super) fn flush(&mut self) {
        self.flushed.add(&self.sums);
        self.sums.clear();
    }

    /// The means of chunk `chunk` over all views so far, of which lost rays count as `lost_rays` says.
    #[inline(always)]
    pub(super) fn means(&self, chunk: usize, lost_rays: LostRays) -> Means {
        let hidden = &self.hidden[chunk * LANES..][..LANES];
        let views = Chunk::from_fn(|lane| self.views as f32 - hidden[lane]);
        self.flushed.means(&self.sums, chunk, &views, lost_rays)
    }

    /// Writes what views of these `channels` painted to `planes` of the row ([`picture::written`]), blended by `weights` with what is there.
    pub(super) fn write(
        &self,
        (channels, weights): (&[usize], Option<&[f32]>),
        lost_rays: LostRays,
        planes: &mut [&mut [f32]],
        arch: Arch,
    ) {
        arch.dispatch(WriteRow { row: self, channels, weights, lost_rays, planes });
    }

    /// Starts a view with every ray unoccluded. Returns their number.
    pub(super) fn start_view(&mut self) -> usize {
        self.occluded.copy_from(&self.skipped);
        self.attenuated.clear();
        self.occluded.count_without()
    }

    /// Starts the view through `lens` for row `y` with those rays unoccluded that pass `barrel`. Returns their number.
    #[inline(always)]
    pub(super) fn start_view_through(&mut self, barrel: &Barrel<'_>, lens: Vec2, y: usize) -> usize {
        let inside = |x: i32| x.clamp(0, self.width as i32) as usize;
        let [[first, end], [first_whole, end_whole]] = barrel
            .columns(lens, y)
            .map(|columns| [columns.start, columns.end.max(columns.start)].map(inside));
        self.occluded.copy_from(&self.skipped);
        self.attenuated.clear();
        for hidden in [0..first, end..self.hidden.len()] {
            self.hidden[hidden.clone()].iter_mut().for_each(|views| *views += 1.0);
            self.occluded.mark(&hidden);
        }
        let [first_whole, end_whole] =
            if first_whole < end_whole { [first_whole, end_whole] } else { [end; 2] };
        for fading in [first..first_whole, end_whole..end] {
            self.attenuated.mark(&fading);
            self.attenuate(barrel, (lens, y), &fading);
        }
        self.occluded.count_without()
    }

    /// Attenuates the rays of the view through `lens` of row `y` at the columns `fading` by what `barrel` stops of them.
    #[inline(always)]
    fn attenuate(&mut self, barrel: &Barrel<'_>, (lens, y): (Vec2, usize), fading: &Range<usize>) {
        if fading.is_empty() {
            return;
        }
        for chunk in chunks_of(fading) {
            let hidden = self.hidden[chunk * LANES..][..LANES].iter_mut();
            let (first, lanes) = (chunk * LANES, lanes_of(fading, chunk));
            let transmittance = &mut self.transmittance[chunk].0;
            for (lane, (transmittance, hidden)) in transmittance.iter_mut().zip(hidden).enumerate() {
                let passing = barrel.passing(lens, first + lane, y);
                let fades = has(lanes, lane);
                *transmittance = if fades { passing } else { *transmittance };
                *hidden += if fades { 1.0 - passing } else { 0.0 };
            }
        }
    }

    /// Ends the attenuated rays of the lanes in `spent`: what they have left is lost.
    #[inline(always)]
    pub(super) fn occlude(&mut self, chunk: usize, spent: Mask) {
        self.occluded.add(chunk, spent);
        for lane in (0..LANES).filter(|&lane| has(spent, lane)) {
            self.sums.lost[chunk].0[lane] += self.transmittance[chunk].0[lane];
        }
    }

    /// Ends the rays of `shear` that are left: in the `background`, or where the stack has nothing.
    pub(super) fn end_rays(&mut self, background: Option<&Background>, shear: &Shear, y: usize) {
        for chunk in 0..self.transmittance.len() {
            let (occluded, attenuated) = (self.occluded.chunk(chunk), self.attenuated.chunk(chunk));
            for lane in (0..LANES).filter(|&lane| !has(occluded, lane)) {
                let left = if has(attenuated, lane) { self.transmittance[chunk].0[lane] } else { 1.0 };
                let transparent = background.map_or(0.0, |background| {
                    let pixel = IVec2::new((chunk * LANES + lane) as i32, y as i32);
                    left.min(background.met_by(|coc_px| shear.pixel_at(pixel, coc_px)))
                });
                self.sums.transparent[chunk].0[lane] += transparent;
                self.sums.lost[chunk].0[lane] += left - transparent;
            }
        }
    }
}
/// [`RowSums::write`], to be compiled for each instruction set.
struct WriteRow<'a, 'b> {
    row: &'a RowSums,
    channels: &'a [usize],
    weights: Option<&'a [f32]>,
    lost_rays: LostRays,
    planes: &'a mut [&'b mut [f32]],
}

impl NullaryFnOnce for WriteRow<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { row, channels, weights, lost_rays, planes } = self;
        for (chunk, first) in (0..row.width).step_by(LANES).enumerate() {
            let columns = first..(first + LANES).min(row.width);
            let means = row.means(chunk, lost_rays);
            for (plane, mean) in picture::written(channels, planes.len() > picture::PLANES) {
                let (values, found) = (&mut planes[plane][columns.clone()], &means[mean].0[..columns.len()]);
                match weights {
                    None => values.copy_from_slice(found),
                    Some(weights) => {
                        let found = found.iter().zip(&weights[columns.clone()]);
                        for (value, (&found, &weight)) in values.iter_mut().zip(found) {
                            *value = blended(*value, found, weight);
                        }
                    }
                }
            }
        }
    }
}

/// `before`, with `value` in its place by `weight`.
#[inline(always)]
pub(super) fn blended(before: f32, value: f32, weight: f32) -> f32 {
    match weight {
        1.0.. => value,
        ..=0.0 => before,
        _ => before + weight * (value - before),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::{Aperture, Field, Optics};

    /// Width and height; the width is no multiple of [`LANES`].
    const SIZE: (usize, usize) = (83, 47);

    #[test]
    fn a_view_through_the_barrel_has_the_rays_that_pass_it_and_hides_the_rest_of_itself() {
        let optics = Optics { cats_eye: 1.2, ..Optics::from_aperture(Aperture::DISC) };
        let barrel =
            Barrel { optics: &optics, field: Field::from_picture_size(SIZE.0, SIZE.1), softness: 0.3 };
        let (mut whole, mut fading, mut stopped) = (0, 0, 0);
        for lens in [Vec2::new(0.7, 0.5), Vec2::new(-0.9, 0.1), Vec2::new(0.0, -0.97), Vec2::ZERO] {
            for y in 0..SIZE.1 {
                let mut row = RowSums::new(SIZE.0, false);
                let rays = row.start_view_through(&barrel, lens, y);
                assert_eq!(rays, row.occluded.count_without());
                for x in 0..row.hidden.len() {
                    let place = (lens, x, y);
                    let (chunk, lane) = (x / LANES, x % LANES);
                    let is_left = !has(row.occluded.chunk(chunk), lane);
                    if x >= SIZE.0 {
                        assert!(!is_left, "{place:?} is past the row's end");
                        continue;
                    }
                    let is_attenuated = has(row.attenuated.chunk(chunk), lane);
                    let left = if is_attenuated { row.transmittance[chunk].0[lane] } else { 1.0 };
                    let left = if is_left { left } else { 0.0 };
                    let passing = barrel.passing(lens, x, y);
                    assert!((left - passing).abs() < 1e-4, "{place:?}: {left}, not {passing}");
                    assert!((row.hidden[x] - (1.0 - passing)).abs() < 1e-4, "{place:?}: {}", row.hidden[x]);
                    whole += usize::from(passing == 1.0);
                    stopped += usize::from(passing == 0.0);
                    fading += usize::from(0.0 < passing && passing < 1.0);
                }
            }
        }
        assert!(whole > 500 && fading > 500 && stopped > 500, "{whole}, {fading}, {stopped}");
    }
}
