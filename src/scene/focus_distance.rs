//! ANALYZE: the distance of what the lens is focused on.
//!
//! The distance of a pixel is that of its visible surface: of the fragment at which alpha, accumulated front to back, reaches a half, so
//! that dust and glass before a surface do not count. Where all fragments together stay below a half, it is the one that adds most to the
//! pixel, because nothing else is there to focus on. The distance of an object is the median over its pixels: those that it covers at least
//! by half, weighted by its coverage, so that neither its edges nor surfaces seen through it count. A focus pull takes the distances of its
//! two keys in this frame's stack and interpolates between them as [`crate::lens::Pull`] says.

use super::key_frames::{FrameNumber, no_frame_number, value_at};
use crate::error::Error;
use crate::parallel;
use crate::settings::{Focus, FocusKey, Interpolation};
use crate::stack::depth::DepthScale;
use crate::stack::{ObjectMatte, Stack, Window};

/// Accumulated alpha from which on a surface is visible.
const VISIBLE_ALPHA: f32 = 0.5;
/// Coverage from which on a pixel belongs to an object.
const OBJECT_COVERAGE: f32 = 0.5;
/// For an object that covers no pixel by [`OBJECT_COVERAGE`]: the share of its largest coverage from which on pixels belong to it.
const SHARE_OF_MAX_COVERAGE: f32 = 0.9;

/// A focus distance, and how it was found.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Focused {
    /// Planar distance in depth units.
    pub distance: f32,
    /// How it was found; `None` where the setting is the distance itself, or a point.
    pub reason: Option<String>,
    /// Whether focus is elsewhere than was asked for, because nothing is there.
    pub is_elsewhere: bool,
}

/// Planar distance of `focus` in `stack`, which is frame `frame` of its sequence. Points are in picture pixels of the display window.
///
/// # Errors
/// [`crate::error::ErrorKind::Settings`] for a point outside the picture, for a point or an object where there is only background, for
/// an unknown object ([`Stack::object`]), for focus keys without a frame number, and for a picture of background alone.
pub fn focus_distance(
    stack: &Stack,
    scale: &DepthScale,
    focus: &Focus,
    frame: Option<FrameNumber>,
) -> Result<Focused, Error> {
    let without_reason = |distance| Focused { distance, reason: None, is_elsewhere: false };
    match focus {
        Focus::Distance(distance) => Ok(without_reason(*distance)),
        Focus::Point(point) => distance_at(stack, scale, *point).map(without_reason),
        Focus::Centre => distance_at_centre(stack, scale),
        Focus::Object(name) => distance_of_object(stack, scale, name),
        Focus::Keys(keys) => {
            let frame = frame.ok_or_else(|| no_frame_number("focus"))?;
            distance_of_pull(keys, frame, |focus| focus_distance(stack, scale, focus, Some(frame)))
        }
    }
}

/// Planar distance of the visible surface nearest to the centre of the display window.
fn distance_at_centre(stack: &Stack, scale: &DepthScale) -> Result<Focused, Error> {
    let Window { width, height, .. } = stack.frame.display;
    let s = stack.supersample as f32;
    let centre = [width, height].map(|samples| 0.5 * samples as f32 / s);
    let Some([column, row]) = sample_at(stack, centre) else {
        return distance_beside_centre(stack, scale, centre);
    };
    let depth = visible_depth(stack, scale, column, row);
    if depth.is_finite() {
        return Ok(Focused { distance: depth, reason: None, is_elsewhere: false });
    }
    distance_beside_centre(stack, scale, centre)
}

/// Planar distance of the visible surface nearest to `centre`, a pixel of the display window without one: of a pixel that shows a surface,
/// else of any that has one.
fn distance_beside_centre(stack: &Stack, scale: &DepthScale, centre: [f32; 2]) -> Result<Focused, Error> {
    let [left, top] = origin_from_display(stack);
    let s = stack.supersample as f32;
    let from_centre = |column: usize, row: usize| {
        let [right, down] =
            [column as f32 + 0.5 + left - centre[0] * s, row as f32 + 0.5 + top - centre[1] * s];
        right * right + down * down
    };
    let nearest_of_row = |row: usize| {
        let found = (0..stack.width()).filter_map(|column| {
            let depth = visible_depth(stack, scale, column, row);
            let is_faint = covered(stack, column, row) < VISIBLE_ALPHA;
            depth.is_finite().then(|| Nearest {
                is_faint,
                square: from_centre(column, row),
                at: [column, row],
                depth,
            })
        });
        found.reduce(Nearest::nearer)
    };
    // Of two as near, the one above or to the left, whatever the number of threads.
    let rows: Vec<Option<Nearest>> = parallel::map(stack.height(), &nearest_of_row);
    let Some(nearest) = rows.into_iter().flatten().reduce(Nearest::nearer) else {
        return Err(Error::settings("there is only background in the picture: nothing to focus on")
            .help("check the depth, or give the distance with `focus_distance`"));
    };
    let [x, y] = [nearest.at[0] as f32 + left, nearest.at[1] as f32 + top].map(|sample| (sample / s).floor());
    let reason = format!(
        "nothing is at the centre of the picture, {}, {}: focused at {}, on what is nearest to it, at {x}, {y}; set `focus_point` or \
         `focus_distance`",
        centre[0], centre[1], nearest.depth
    );
    Ok(Focused { distance: nearest.depth, reason: Some(reason), is_elsewhere: true })
}

/// A surface beside the centre.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    /// Whether its pixel shows less than half of it.
    is_faint: bool,
    /// Square of its distance from the centre in samples.
    square: f32,
    /// Its column and row.
    at: [usize; 2],
    /// Its planar depth.
    depth: f32,
}

impl Nearest {
    fn nearer(self, other: Self) -> Self {
        let of = |nearest: &Self| (nearest.is_faint, nearest.square);
        if of(&other) < of(&self) { other } else { self }
    }
}

/// Alpha of all fragments of a sample together.
fn covered(stack: &Stack, column: usize, row: usize) -> f32 {
    1.0 - stack.peels.iter().map(|peel| 1.0 - peel.alpha.get(column, row)).product::<f32>()
}

/// The first sample of the data window, from the corner of the display window.
fn origin_from_display(stack: &Stack) -> [f32; 2] {
    let (data, display) = (stack.frame.data, stack.frame.display);
    [(data.x - display.x) as f32, (data.y - display.y) as f32]
}

/// The sample at pixel `point` of the display window; `None` outside of the data window.
fn sample_at(stack: &Stack, point: [f32; 2]) -> Option<[usize; 2]> {
    let ([left, top], s) = (origin_from_display(stack), stack.supersample as f32);
    let (column, row) = ((point[0] * s).floor() - left, (point[1] * s).floor() - top);
    let is_inside =
        column >= 0.0 && row >= 0.0 && column < stack.width() as f32 && row < stack.height() as f32;
    is_inside.then_some([column as usize, row as usize])
}

/// Planar distance of the visible surface at pixel `point` of the display window.
fn distance_at(stack: &Stack, scale: &DepthScale, point: [f32; 2]) -> Result<f32, Error> {
    let place = format!("{}, {}", point[0], point[1]);
    let Some([column, row]) = sample_at(stack, point) else {
        let Window { width, height, .. } = stack.picture_frame().display;
        let s = stack.supersample as f32;
        let [left, top] = origin_from_display(stack).map(|start| start / s);
        let [right, bottom] = [left + stack.width() as f32 / s, top + stack.height() as f32 / s];
        return Err(Error::settings("the focus point lies outside the picture")
            .with("found", place)
            .with("picture", format!("{width} × {height} pixels"))
            .with("its pixels", format!("{left} to {right} from the left, {top} to {bottom} from the top"))
            .help("give pixels from the left and from the top: `focus_point = [X, Y]`"));
    };
    let depth = visible_depth(stack, scale, column, row);
    if depth.is_finite() {
        return Ok(depth);
    }
    Err(Error::settings("there is only background at the focus point")
        .with("found", place)
        .help(
            "pick a point on an object with `focus_point = [X, Y]`, name one with `focus_object`, or give the distance \
             with `focus_distance`",
        ))
}

/// Planar depth of the visible surface at a sample of the data window; `+∞` for background.
fn visible_depth(stack: &Stack, scale: &DepthScale, column: usize, row: usize) -> f32 {
    let [x0, _] = stack.frame.data_origin_from_centre();
    let y = stack.frame.row_from_centre(row as f32);
    let visible = visible_fragment(stack.peels.iter().map(|peel| peel.alpha.get(column, row)));
    visible
        .map_or(f32::INFINITY, |i| scale.planar(stack.peels[i].depth.get(column, row), x0 + column as f32, y))
}

/// Index of the fragment that a pixel shows, of fragments of these alphas, nearest first; `None` if all are empty.
fn visible_fragment(alphas: impl Iterator<Item = f32>) -> Option<usize> {
    let (mut transmittance, mut most, mut visible) = (1.0, 0.0, None);
    for (i, alpha) in alphas.enumerate() {
        let share = transmittance * alpha;
        transmittance -= share;
        if 1.0 - transmittance >= VISIBLE_ALPHA {
            return Some(i);
        }
        if share > most {
            (most, visible) = (share, Some(i));
        }
    }
    visible
}

fn distance_of_object(stack: &Stack, scale: &DepthScale, name: &str) -> Result<Focused, Error> {
    let ObjectMatte { cryptomatte, coverage } = stack.object(name)?;
    let max = coverage.iter().copied().fold(0.0, f32::max);
    let min = if max >= OBJECT_COVERAGE { OBJECT_COVERAGE } else { SHARE_OF_MAX_COVERAGE * max };
    let covered = coverage.iter().enumerate().filter(|&(_, &share)| share >= min);
    let samples =
        covered.map(|(i, &share)| (visible_depth(stack, scale, i % stack.width(), i / stack.width()), share));
    let mut depths: Vec<(f32, f32)> = samples.filter(|(depth, _)| depth.is_finite()).collect();
    let Some(distance) = weighted_median(&mut depths) else {
        return Err(Error::settings(format!("the object '{name}' has no depth: only background is there"))
            .with("found", format!("the object in {cryptomatte}"))
            .help("pick a point with `focus_point = [X, Y]`, or give the distance with `focus_distance`"));
    };
    let (count, pixels) = (depths.len(), if stack.supersample == 1 { "pixels" } else { "samples" });
    let weak =
        if max < OBJECT_COVERAGE { format!(", none covered by more than {max:.2}") } else { String::new() };
    let reason =
        format!("object '{name}' of {cryptomatte}: {distance}, the median of {count} {pixels}{weak}");
    Ok(Focused { distance, reason: Some(reason), is_elsewhere: false })
}

/// The weighted median of pairs of value and weight: the first value, in rising order, at which the sum of weights reaches half of their
/// total. Sorts `values`; `None` if there are none.
fn weighted_median(values: &mut [(f32, f32)]) -> Option<f32> {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|&(_, weight)| f64::from(weight)).sum::<f64>();
    let mut reached = 0.0;
    let median = values.iter().find(|(_, weight)| {
        reached += f64::from(*weight);
        reached >= half
    });
    median.map(|&(value, _)| value)
}

/// The distance at `frame` of a focus pull between `keys`; `find` gives the distance of a key's focus.
fn distance_of_pull(
    keys: &[FocusKey],
    frame: FrameNumber,
    find: impl Fn(&Focus) -> Result<Focused, Error>,
) -> Result<Focused, Error> {
    let at_key = |place: usize| {
        let FocusKey { frame, focus, .. } = &keys[place];
        let found = find(focus).map_err(|error| error.with("focus key", format!("of frame {frame}")))?;
        let how = found.reason.map(|reason| format!("; frame {frame} has {reason}")).unwrap_or_default();
        Ok((found.distance, how))
    };
    let (distance, reason) = value_at(keys, frame, Interpolation::Reciprocal, at_key)?;
    Ok(Focused { distance, reason: Some(reason), is_elsewhere: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_shows_the_fragment_at_which_accumulated_alpha_reaches_a_half() {
        let shown = |alphas: &[f32]| visible_fragment(alphas.iter().copied());
        assert_eq!(shown(&[0.004, 1.0]), Some(1), "behind dust");
        assert_eq!(shown(&[0.0, 0.5, 1.0]), Some(1));
        assert_eq!(shown(&[0.3, 0.3, 1.0]), Some(1), "0.3 and 0.7 · 0.3 make 0.51");
        assert_eq!(shown(&[0.25, 0.25, 1.0]), Some(2), "0.25 and 0.75 · 0.25 make 0.4375");
    }

    #[test]
    fn a_translucent_pixel_shows_the_fragment_that_adds_most_to_it() {
        let shown = |alphas: &[f32]| visible_fragment(alphas.iter().copied());
        assert_eq!(shown(&[0.1, 0.3, 0.0]), Some(1));
        assert_eq!(shown(&[0.2, 0.2]), Some(0), "0.8 · 0.2 is less");
        assert_eq!(shown(&[0.0, 0.0]), None);
    }

    #[test]
    fn the_median_is_where_half_of_the_weight_is_reached() {
        let median = |values: &[(f32, f32)]| weighted_median(&mut values.to_vec());
        assert_eq!(median(&[(9.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), Some(2.0), "the middle, not the mean");
        assert_eq!(median(&[(9.0, 3.0), (1.0, 1.0), (2.0, 1.0)]), Some(9.0), "by weight, not by count");
        assert_eq!(median(&[(5.0, 1.0), (4.0, 1.0)]), Some(4.0), "the nearer of two in the middle");
        assert_eq!(median(&[]), None);
    }
}
