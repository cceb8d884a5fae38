//! The picture of painted rows: rows are painted in bands, and the near light of a band is smoothed ([`near`]) as soon as the rows around it
//! are painted.
//!
//! Memory: the picture, the share of rays in focus, and the near light of one band and the rows around it. Any number of rows a band gives
//! the same bits.

use super::bins::Bins;
use super::near::{self, NearLight, SURROUNDINGS};
use super::sums::{ALPHA, FOCUSED, NEAR_COLOR, NEAR_RADIUS, NEAR_SHARE};
use crate::image::{Image, Plane};
use crate::methods::contract::{Plan, Progress};
use crate::methods::shared::{WriteRow, fill_rows};
use crate::scene::EffectKind;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Planes of an unfinished picture without near light: red, green, blue, alpha, and the share of rays that hit something in focus.
pub(super) const PLANES: usize = 5;

/// Rows of a band for each thread: enough that threads hardly wait for one another at its end.
const ROWS_PER_THREAD: usize = 64;

/// The filter of near light, if there is any.
#[derive(Debug, Clone, Copy)]
pub(super) struct NearFilter {
    /// See [`near::radius_per_coc`].
    radius_per_coc: f32,
    /// Whether red, green and blue have rays of their own, and so each its share of rays that near surfaces stop.
    by_channel: bool,
}

impl NearFilter {
    /// That of `views` views of `bins`; `None` if the plan has no prefilter or nothing is near.
    pub(super) fn new(plan: &Plan, bins: &Bins, views: usize) -> Option<Self> {
        let filters = plan.does(EffectKind::Prefilter) && bins.have_near();
        let strength = plan.strength(EffectKind::Prefilter).unwrap_or(0.0);
        filters.then(|| Self {
            radius_per_coc: near::radius_per_coc(views, strength),
            by_channel: plan.optics.has_axial_color(),
        })
    }

    /// Planes of near light, which follow those of the picture: CoC radius, red, green, blue, and the shares ([`NearLight`]).
    pub(super) fn planes(&self) -> usize {
        4 + if self.by_channel { 3 } else { 1 }
    }

    /// Near light of `rows` rows of `width` pixels, none of them painted.
    fn blank(&self, width: usize, rows: usize) -> NearLight {
        let plane = || Plane::zeros(width, rows);
        let shares = (4..self.planes()).map(|_| plane()).collect();
        NearLight { rows: 0, shares, radius_px: plane(), color: [plane(), plane(), plane()] }
    }
}

/// What views of these `channels` write: planes of the picture, and then, if `near` light is kept, those of [`NearFilter::planes`]; each with
/// the index in [`super::sums::Means`] of what is written there.
pub(super) fn written(channels: &[usize], near: bool) -> impl Iterator<Item = (usize, usize)> {
    let has_alpha = channels.contains(&ALPHA);
    let picture = channels.iter().copied().chain(has_alpha.then_some(FOCUSED)).map(|k| (k, k));
    let radius = has_alpha.then_some((PLANES, NEAR_RADIUS));
    let color = channels.iter().filter(|&&k| k != ALPHA).map(|k| (PLANES + 1 + k, NEAR_COLOR + k));
    picture.chain(color.chain(radius).chain([(near_share_plane(channels), NEAR_SHARE)]).filter(move |_| near))
}

/// The plane that has the share of the rays of these `channels` that near surfaces stop.
pub(super) fn near_share_plane(channels: &[usize]) -> usize {
    let first = PLANES + 4;
    match channels {
        [0] | [_, _, _, _] => first,
        [2] => first + 2,
        _ => first + 1,
    }
}

/// The planes of an unfinished picture of `size`, in the memory of `spare` planes as far as there are any of that size: pages that a process
/// has cost nothing, and new ones as much as writing to them a few times. Values are what they were.
pub(super) fn planes((width, height): (usize, usize), spare: Vec<Plane>) -> [Plane; PLANES] {
    let mut spare = spare.into_iter().filter(|plane| (plane.width(), plane.height()) == (width, height));
    std::array::from_fn(|_| spare.next().unwrap_or_else(|| Plane::zeros(width, height)))
}

/// The picture whose `planes` `row(scratch, y, planes)` paints row by row, with smooth near light if there is a filter for it, and for each
/// pixel the share of rays that hit something in focus. `scratch` makes the memory of a thread.
pub(super) fn painted<T>(
    mut planes: [Plane; PLANES],
    filter: Option<&NearFilter>,
    progress: &Progress<'_>,
    scratch: &(dyn Fn() -> T + Sync),
    row: &WriteRow<'_, T>,
) -> (Image, Plane) {
    let (width, height) = (planes[0].width(), planes[0].height());
    let done = AtomicUsize::new(0);
    let paint = |first: usize, planes: Vec<&mut [f32]>| {
        fill_rows(planes, width, scratch, &|scratch, y, planes| {
            row(scratch, first + y, planes);
            progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / height as f32);
        });
    };
    let Some(filter) = filter else {
        paint(0, planes.iter_mut().map(Plane::values_mut).collect());
        return finished(planes);
    };
    let band = (ROWS_PER_THREAD * rayon::current_num_threads()).next_multiple_of(SURROUNDINGS);
    let mut window = Window::new(filter, width, (band + 2 * SURROUNDINGS).min(height));
    for first in (0..height).step_by(band) {
        let (end, from) = ((first + band).min(height), window.end());
        let to = (end + SURROUNDINGS).min(height);
        window.drop_before(first.saturating_sub(SURROUNDINGS));
        let picture = planes.iter_mut().map(|plane| &mut plane.values_mut()[from * width..to * width]);
        paint(from, picture.chain(window.next_rows(to)).collect());
        let [red, green, blue, alpha, _] =
            planes.each_mut().map(|plane| &mut plane.values_mut()[first * width..end * width]);
        let rows = first - window.first..end - window.first;
        window.near.smooth([red, green, blue, alpha], rows, filter.radius_per_coc);
    }
    finished(planes)
}

/// The picture of whole `planes` ([`PLANES`], and those of `filter`), with near light smoothed, and the share of rays in focus.
#[cfg(feature = "gpu")]
pub(super) fn smoothed(mut planes: Vec<Plane>, filter: Option<&NearFilter>) -> (Image, Plane) {
    let mut near = planes.split_off(PLANES.min(planes.len())).into_iter();
    let mut planes = planes.into_iter();
    let mut picture = std::array::from_fn(|_| planes.next().unwrap_or_default());
    if let Some(filter) = filter {
        let mut next = || near.next().unwrap_or_default();
        let (radius_px, color) = (next(), [next(), next(), next()]);
        let rows = radius_px.height();
        let near = NearLight { rows, shares: near.collect(), radius_px, color };
        let [red, green, blue, alpha, _] = picture.each_mut().map(Plane::values_mut);
        near.smooth([red, green, blue, alpha], 0..rows, filter.radius_per_coc);
    }
    finished(picture)
}

fn finished([red, green, blue, alpha, focused_share]: [Plane; PLANES]) -> (Image, Plane) {
    (Image { planes: [red, green, blue, alpha] }, focused_share)
}

/// The near light of some rows of the picture.
struct Window {
    /// The row of the picture that is its first.
    first: usize,
    near: NearLight,
}

impl Window {
    /// No rows yet, and room for `rows`.
    fn new(filter: &NearFilter, width: usize, rows: usize) -> Self {
        Self { first: 0, near: filter.blank(width, rows) }
    }

    /// The row of the picture after the last.
    fn end(&self) -> usize {
        self.first + self.near.rows
    }

    /// Removes the rows before row `first` of the picture.
    fn drop_before(&mut self, first: usize) {
        let (width, kept) = (self.near.radius_px.width(), self.end() - first);
        let dropped = first - self.first;
        for plane in self.near.planes_mut() {
            plane.values_mut().copy_within(dropped * width..(dropped + kept) * width, 0);
        }
        (self.first, self.near.rows) = (first, kept);
    }

    /// Adds the rows up to row `end` of the picture, and returns them plane by plane to be written.
    fn next_rows(&mut self, end: usize) -> impl Iterator<Item = &mut [f32]> {
        let (width, from) = (self.near.radius_px.width(), self.near.rows);
        let to = end - self.first;
        self.near.rows = to;
        self.near.planes_mut().map(move |plane| &mut plane.values_mut()[from * width..to * width])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Odd in both directions, and of several bands for few threads.
    const SIZE: (usize, usize) = (37, 391);

    /// Value `k` of a pixel: the share of near rays changes from pixel to pixel, its CoC radius from place to place, and there is none in
    /// the middle.
    fn value((x, y): (usize, usize), k: usize) -> f32 {
        let noise = |seed: usize| ((x * 7 + y * 13 + seed * 5) % 11) as f32 / 22.0;
        let share = if (170..240).contains(&y) { 0.0 } else { 0.2 + noise(0) };
        let near_color = share * (0.3 + 0.1 * k as f32);
        match k {
            3 => 1.0,
            PLANES => share * (20.0 + (x + y) as f32 / 10.0),
            k if k > PLANES + 3 => share,
            k if k > PLANES => near_color,
            _ => near_color + noise(k),
        }
    }

    fn with_threads(threads: usize, filter: &NearFilter) -> (Image, Plane) {
        in_memory_of(Vec::new(), threads, filter)
    }

    fn in_memory_of(spare: Vec<Plane>, threads: usize, filter: &NearFilter) -> (Image, Plane) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let paint = |(): &mut (), y: usize, planes: &mut [&mut [f32]]| {
            for (k, row) in planes.iter_mut().enumerate() {
                row.iter_mut().enumerate().for_each(|(x, sample)| *sample = value((x, y), k));
            }
        };
        pool.install(|| painted(planes(SIZE, spare), Some(filter), &|_| {}, &|| (), &paint))
    }

    #[test]
    fn any_number_of_rows_a_band_gives_the_bits_of_the_whole_picture() {
        for by_channel in [false, true] {
            let filter = NearFilter { radius_per_coc: near::radius_per_coc(64, 1.4), by_channel };
            // One band has the whole picture.
            let whole = with_threads(SIZE.1.div_ceil(ROWS_PER_THREAD), &filter);
            let change = (0..SIZE.0 * SIZE.1)
                .filter(|&i| whole.0.planes[0].values()[i] != value((i % SIZE.0, i / SIZE.0), 0));
            assert!(change.count() > SIZE.0 * SIZE.1 / 2, "most pixels are smoothed");
            for threads in [1, 2, 3] {
                assert_eq!(with_threads(threads, &filter), whole, "{threads} threads");
            }
        }
    }

    #[test]
    fn what_was_in_the_memory_of_a_picture_does_not_show() {
        let filter = NearFilter { radius_per_coc: near::radius_per_coc(64, 1.4), by_channel: false };
        let used = |(width, height)| Plane::filled(width, height, f32::NAN);
        let spare = vec![used(SIZE), used((SIZE.1, SIZE.0)), used(SIZE), Plane::default()];
        assert_eq!(in_memory_of(spare, 2, &filter), with_threads(2, &filter));
    }
}
