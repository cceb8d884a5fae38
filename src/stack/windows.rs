//! Where the parts of a stack lie: the data window that holds all peels, and each plane in its place there.
//!
//! Renderers crop each part of a file to what they drew. Pixels of parts with equal coordinates belong together; outside of its window a
//! peel is empty. Depth that ends before the picture does continues there as at its edge.

use super::{Frame, Window};
use crate::finding::Finding;
use crate::image::Plane;
use exr::image::FlatSamples;
use half::f16;
use std::ops::Range;

/// Samples on either side, along the edge and inwards, whose median continues depth beyond its window: a fragment that only touches the
/// edge of a crop is not drawn out.
const EDGE_SAMPLES: usize = 8;

/// The smallest window around `windows`; without pixels if there are none.
///
/// A part in which nothing was drawn is written as one pixel, anywhere. Such a pixel counts within the display window only, unless there
/// is nothing else.
pub(super) fn union(windows: &[Window], display: Window) -> Window {
    let counts = |window: &Window| window.width > 1 || window.height > 1 || display.contains(*window);
    let counted = windows.iter().copied().filter(counts).reduce(joined);
    counted.or(windows.first().copied()).unwrap_or(Window { width: 0, height: 0, ..display })
}

/// The smallest window around two. Coordinates are below 2^30 (see `guard`).
pub(super) fn joined(a: Window, b: Window) -> Window {
    let (x, y) = (a.x.min(b.x), a.y.min(b.y));
    let width = (end(a.x, a.width).max(end(b.x, b.width)) - i64::from(x)) as usize;
    let height = (end(a.y, a.height).max(end(b.y, b.height)) - i64::from(y)) as usize;
    Window { x, y, width, height }
}

/// The first coordinate after `size` pixels from `start` on.
fn end(start: i32, size: usize) -> i64 {
    i64::from(start) + size as i64
}

/// The part of `window` in `rows`, by their `y`; all of it if `None`.
pub(super) fn rows_of(window: Window, rows: Option<&Range<i32>>) -> Window {
    let Some(rows) = rows else { return window };
    let top = window.y.max(rows.start);
    let height = end(window.y, window.height).min(i64::from(rows.end)) - i64::from(top);
    Window { y: top, height: usize::try_from(height).unwrap_or(0), ..window }
}

/// The smallest window around `window` that consists of whole pixels of `samples` samples along each axis, counted from `display`.
pub(super) fn in_whole_pixels(window: Window, display: Window, samples: usize) -> Window {
    let step = samples.clamp(1, 1 << 20) as i64;
    let span = |start: i32, size: usize, origin: i32| {
        let origin = i64::from(origin);
        let first = (i64::from(start) - origin).div_euclid(step) * step;
        let past = (end(start, size) - origin + step - 1).div_euclid(step) * step;
        i32::try_from(first + origin).ok().zip(usize::try_from(past - first).ok())
    };
    match (span(window.x, window.width, display.x), span(window.y, window.height, display.y)) {
        (Some((x, width)), Some((y, height))) => Window { x, y, width, height },
        _ => window,
    }
}

/// Bytes of `peels` peels of the window `data`: red, green, blue, alpha and depth.
pub(super) fn bytes(data: Window, peels: usize) -> u64 {
    let pixels = (data.width as u64).saturating_mul(data.height as u64);
    pixels.saturating_mul(20).saturating_mul(peels as u64)
}

/// How far a picture with windows `own` has to be moved, right and down, to lie on one with windows `other`; `None` if they show different
/// frames.
///
/// Display windows of one size show the same frame. Equal data windows have the same pixels, and a picture without windows of its own lies
/// where a data window of its size does.
pub(super) fn offset(own: Frame, other: Frame) -> Option<[i32; 2]> {
    let size = |window: Window| (window.width, window.height);
    let between = |from: Window, to: Window| Some([to.x.checked_sub(from.x)?, to.y.checked_sub(from.y)?]);
    if size(own.display) == size(other.display) {
        return between(own.display, other.display);
    }
    let has_windows = own.data != own.display && own.data != other.data;
    (!has_windows && size(own.data) == size(other.data)).then(|| between(own.data, other.data)).flatten()
}

/// `window` moved right and down.
pub(super) fn moved(window: Window, [right, down]: [i32; 2]) -> Window {
    Window { x: window.x.saturating_add(right), y: window.y.saturating_add(down), ..window }
}

/// The pixels that two windows share, in their coordinates; `None` if there are none.
pub(super) fn overlap(a: Window, b: Window) -> Option<Window> {
    let (x, y) = (a.x.max(b.x), a.y.max(b.y));
    let width = end(a.x, a.width).min(end(b.x, b.width)) - i64::from(x);
    let height = end(a.y, a.height).min(end(b.y, b.height)) - i64::from(y);
    (width > 0 && height > 0).then_some(Window { x, y, width: width as usize, height: height as usize })
}

/// Whether a part with window `inner` has all of its pixels in `outer`. Of a part that is cut to rows, none may be left.
pub(super) fn is_within(inner: Window, outer: Window) -> bool {
    let placed = if inner.height == 0 { Window { y: outer.y, ..inner } } else { inner };
    outer.contains(placed)
}

/// What is assumed of depth of the window `depth`, from the channel or file `name`, where only the colour has pixels: of the window `color`,
/// with this `alpha`. `None` if depth is known wherever there is alpha.
pub(super) fn depth_beyond(name: &str, depth: Window, (color, alpha): (Window, &Plane)) -> Option<Finding> {
    if depth == color {
        return None;
    }
    let known = overlap(depth, color);
    let is_known = |x: usize, y: usize| {
        let at = Window { x: color.x + x as i32, y: color.y + y as i32, width: 1, height: 1 };
        known.is_some_and(|known| known.contains(at))
    };
    let unknown_of_row = |y: usize| {
        let row = alpha.row(y).iter().enumerate();
        row.filter(|&(x, &alpha)| alpha > 0.0 && !is_known(x, y)).count()
    };
    let unknown: usize = (0..alpha.height()).map(unknown_of_row).sum();
    let share = 100.0 * unknown as f64 / (color.width * color.height).max(1) as f64;
    let assumed = if known.is_none() { "the background" } else { "that at its edge" };
    let text = format!(
        "{name} at {depth} has none for {share:.1} % of the picture at {color}: {assumed} is assumed there"
    );
    (unknown > 0).then(|| Finding::warning("depth", text))
}

/// `plane` of window `from` as a plane of window `to`, with `outside` where it has no pixels.
pub(super) fn place(plane: Plane, from: Window, to: Window, outside: f32) -> Plane {
    if from == to {
        return plane;
    }
    let mut placed = Plane::filled(to.width, to.height, outside);
    copy_shared((plane.values(), from), (placed.values_mut(), to));
    placed
}

/// Depth of window `from` as depth of window `to`. Beyond the window it continues as at its edge: with the median of the samples around the
/// nearest one that is known. It is infinite if no sample is known.
pub(super) fn place_depth(depth: Plane, from: Window, to: Window) -> Plane {
    if from == to {
        return depth;
    }
    let Some(known) = overlap(from, to) else {
        return Plane::filled(to.width, to.height, f32::INFINITY);
    };
    let mut placed = place(depth, from, to, f32::INFINITY);
    let known = Window { x: known.x - to.x, y: known.y - to.y, ..known };
    let edge = Edge::of(&placed, known);
    for y in 0..to.height {
        for (x, value) in placed.row_mut(y).iter_mut().enumerate() {
            *value = edge.beyond(x, y).unwrap_or(*value);
        }
    }
    placed
}

/// Depth along the edge of the known part of a plane.
struct Edge {
    left: usize,
    top: usize,
    /// Last column and row that are known.
    right: usize,
    bottom: usize,
    /// For each known column, the medians at the top and at the bottom.
    of_columns: Vec<[f32; 2]>,
    /// For each known row, the medians at the left and at the right.
    of_rows: Vec<[f32; 2]>,
}

impl Edge {
    /// The edge of `known`, a part of `plane` that has pixels.
    fn of(plane: &Plane, known: Window) -> Self {
        let (left, top) = (known.x as usize, known.y as usize);
        let (right, bottom) = (left + known.width - 1, top + known.height - 1);
        let median = |x: usize, y: usize| {
            let (x0, x1) = (x.saturating_sub(EDGE_SAMPLES).max(left), (x + EDGE_SAMPLES).min(right));
            let (y0, y1) = (y.saturating_sub(EDGE_SAMPLES).max(top), (y + EDGE_SAMPLES).min(bottom));
            let mut around: Vec<f32> = (y0..=y1).flat_map(|y| plane.row(y)[x0..=x1].to_vec()).collect();
            let middle = around.len() / 2;
            *around.select_nth_unstable_by(middle, f32::total_cmp).1
        };
        let of_columns = (left..=right).map(|x| [top, bottom].map(|y| median(x, y))).collect();
        let of_rows = (top..=bottom).map(|y| [left, right].map(|x| median(x, y))).collect();
        Self { left, top, right, bottom, of_columns, of_rows }
    }

    /// Depth at `x, y`; `None` where it is known.
    fn beyond(&self, x: usize, y: usize) -> Option<f32> {
        let (column, row) = (x.clamp(self.left, self.right), y.clamp(self.top, self.bottom));
        if (column, row) == (x, y) {
            return None;
        }
        // In a corner both are the same median.
        Some(if row == y {
            self.of_rows[row - self.top][usize::from(x > column)]
        } else {
            self.of_columns[column - self.left][usize::from(y > row)]
        })
    }
}

/// `samples` of window `from` as samples of window `to`, with 0 where there are none.
pub(super) fn place_samples(samples: FlatSamples, from: Window, to: Window) -> FlatSamples {
    if from == to {
        return samples;
    }
    let placed = |values: &[f32]| placed_values(values, from, to, 0.0);
    match samples {
        FlatSamples::F16(values) => FlatSamples::F16(placed_values(&values, from, to, f16::ZERO)),
        FlatSamples::F32(values) => FlatSamples::F32(placed(&values)),
        FlatSamples::U32(values) => FlatSamples::U32(placed_values(&values, from, to, 0)),
    }
}

fn placed_values<T: Copy>(values: &[T], from: Window, to: Window, outside: T) -> Vec<T> {
    let mut placed = vec![outside; to.width * to.height];
    copy_shared((values, from), (&mut placed, to));
    placed
}

/// Copies what both windows have.
fn copy_shared<T: Copy>((source, from): (&[T], Window), (target, to): (&mut [T], Window)) {
    let Some(shared) = overlap(from, to) else { return };
    // Differences of coordinates below 2^30; the shared window lies in both.
    let start =
        |of: Window, y: usize| ((shared.y - of.y) as usize + y) * of.width + (shared.x - of.x) as usize;
    for y in 0..shared.height {
        let (read, written) = (start(from, y), start(to, y));
        target[written..written + shared.width].copy_from_slice(&source[read..read + shared.width]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(x: i32, y: i32, width: usize, height: usize) -> Window {
        Window { x, y, width, height }
    }

    const DISPLAY: Window = Window { x: 0, y: 0, width: 64, height: 36 };

    #[test]
    fn a_crop_is_placed_in_the_larger_window_and_surrounded_by_the_outside_value() {
        let (crop, whole) = (window(-1, 5, 1, 1), window(-2, 4, 3, 2));
        let placed = place(Plane::filled(1, 1, 7.0), crop, whole, 0.0);
        assert_eq!(placed.values(), [0.0, 0.0, 0.0, 0.0, 7.0, 0.0]);
        assert_eq!(place(placed, whole, crop, 0.0).values(), [7.0]);
        let FlatSamples::U32(samples) = place_samples(FlatSamples::U32(vec![7]), crop, whole) else {
            panic!("another type")
        };
        assert_eq!(samples, [0, 0, 0, 0, 7, 0]);
        assert_eq!(place(Plane::filled(1, 1, 7.0), window(9, 9, 1, 1), whole, 0.5).values(), [0.5; 6]);
    }

    #[test]
    fn the_union_holds_every_window_and_a_lone_pixel_only_within_the_display() {
        let parts = [window(10, 10, 5, 5), window(-3, 12, 4, 2)];
        assert_eq!(union(&parts, DISPLAY), window(-3, 10, 18, 5));
        let far = window(1 << 29, -7, 1, 1);
        assert_eq!(union(&[far, parts[0], parts[1]], DISPLAY), window(-3, 10, 18, 5));
        assert_eq!(union(&[parts[0], window(0, 0, 1, 1)], DISPLAY), window(0, 0, 15, 15));
        assert_eq!(union(&[far, window(-1, -1, 1, 1)], DISPLAY), far, "nothing else is there");
        assert_eq!(union(&[], DISPLAY), window(0, 0, 0, 0));
    }

    #[test]
    fn a_window_grows_to_whole_pixels_of_the_display_window() {
        assert_eq!(in_whole_pixels(window(-3, 4, 5, 4), DISPLAY, 4), window(-4, 4, 8, 4));
        assert_eq!(in_whole_pixels(window(-3, 4, 5, 4), Window { x: 1, ..DISPLAY }, 4), window(-3, 4, 8, 4));
        assert_eq!(in_whole_pixels(window(-3, 4, 5, 4), DISPLAY, 1), window(-3, 4, 5, 4));
    }

    #[test]
    fn depth_is_missed_only_where_there_is_alpha() {
        let (whole, left) = (window(0, 0, 4, 1), window(0, 0, 2, 1));
        let alpha = |values: [f32; 4]| Plane::from_fn(4, 1, |x, _| values[x]);
        let said = |values| depth_beyond("Z", left, (whole, &alpha(values)));
        assert_eq!(said([1.0, 1.0, 0.0, 0.0]), None);
        assert!(said([1.0, 0.0, 0.0, 0.5]).is_some_and(|found| found.text.contains("25.0 %")));
        assert_eq!(depth_beyond("Z", whole, (whole, &alpha([1.0; 4]))), None);
    }

    #[test]
    fn rows_of_parts_above_and_below_join_to_the_rows_between() {
        // Cut to rows 3 to 9, a part that ends above is left with none, and so is one that begins below.
        let parts = [window(0, 3, 8, 0), window(2, 9, 8, 0), window(1, 3, 2, 6)];
        assert_eq!(rows_of(union(&parts, DISPLAY), Some(&(3..9))), window(0, 3, 10, 6));
        let [above, below] = [window(0, 5, 8, 0), window(0, 15, 8, 0)];
        assert_eq!(
            rows_of(union(&[above, below], DISPLAY), Some(&(7..10))),
            window(0, 7, 8, 3),
            "between two parts"
        );
    }

    #[test]
    fn frames_lie_on_one_another_by_display_window_else_by_size() {
        let frame = |data, display| Frame { data, display, pixel_aspect: 1.0 };
        let overscan = frame(window(-8, -4, 80, 44), DISPLAY);
        let moved = frame(window(90, 50, 70, 40), Window { x: 100, y: 50, ..DISPLAY });
        assert_eq!(offset(moved, overscan), Some([-100, -50]));
        assert_eq!(offset(Frame::from_size(64, 36), overscan), Some([0, 0]), "a picture of the display");
        assert_eq!(offset(Frame::from_size(80, 44), overscan), Some([-8, -4]), "one of all the pixels");
        assert_eq!(offset(Frame::from_size(40, 22), overscan), None);
        assert_eq!(offset(frame(window(1, 1, 80, 44), window(0, 0, 90, 50)), overscan), None);
        assert_eq!(
            offset(frame(overscan.data, window(0, 0, 90, 50)), overscan),
            Some([0, 0]),
            "the same pixels"
        );
    }

    #[test]
    fn depth_continues_beyond_its_window_by_the_median_at_its_edge() {
        let from = window(0, 0, 20, 20);
        let at =
            |x: usize, y: usize| if y < 10 { 4.0 } else { 9.0 } + if x == 19 && y == 3 { 1e10 } else { 0.0 };
        let placed = place_depth(Plane::from_fn(20, 20, at), from, window(-5, -5, 30, 30));
        assert_eq!(placed.get(8, 13), at(3, 8), "what is known stays");
        assert_eq!(
            [placed.get(0, 7), placed.get(29, 8), placed.get(10, 0)],
            [4.0; 3],
            "no speck is drawn out"
        );
        assert_eq!([placed.get(0, 24), placed.get(29, 29)], [9.0; 2]);
        let apart = place_depth(Plane::filled(2, 2, 1.0), window(90, 0, 2, 2), from);
        assert!(apart.values().iter().all(|depth| depth.is_infinite()));
    }
}
