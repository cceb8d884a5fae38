//! The focus map: the pinhole picture tinted by focus zone, with contours of the CoC radius and the plane of focus.
//!
//! *Zones.* Pixels in focus keep their colours; in front of focus they are orange, behind focus blue, stronger with every
//! doubling of the CoC radius. Every kind of colour vision distinguishes these two hues, and the lines also differ in lightness.
//!
//! *Lines* are drawn on surfaces, not along their edges: [`surface::continues`] decides whether neighbours are on one surface.
//!
//! Cost: reads the neighbours of each pixel. Memory: one picture. Limits: the width of lines is fixed in pixels, whatever the resolution.

use super::displayed::Displayed;
use super::png::{self, Rgb8};
use crate::error::Error;
use crate::image::{Plane, srgb_encode};
use crate::lens::SHARP_COC_PX;
use crate::parallel;
use crate::scene::{Scene, surface};
use crate::stack::Frame;
use std::path::Path;

/// A smaller change across a sign change is rounding, on a surface in the plane of focus.
const MIN_STEP_PX: f32 = 1e-3;

/// Hue in front of focus: orange (an sRGB value, as all colours here).
const NEAR: [f32; 3] = [0.90, 0.50, 0.05];

/// Hue behind focus: blue.
const FAR: [f32; 3] = [0.05, 0.42, 0.85];

/// Contours in front of focus: dark.
const NEAR_LINE: [f32; 3] = [0.25, 0.08, 0.0];

/// Contours behind focus: light.
const FAR_LINE: [f32; 3] = [0.80, 0.93, 1.0];

/// The pixels in front of and behind the plane of focus: black beside white is visible on any picture.
const FOCUS_LINE: [[f32; 3]; 2] = [[0.0; 3], [1.0; 3]];

/// A line through a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Line {
    /// The plane of focus.
    Focus,
    /// A CoC radius of 1, 2, 4, … px.
    Contour,
}

/// Writes the map of `scene`, whose [`Scene::seen_coc_px`] is `coc_px`, as PNG to the file `path`: the display window of its `frame`, in
/// square pixels.
///
/// # Errors
/// As [`super::atomic::write()`], and for a picture without pixels.
pub fn write(path: &Path, scene: &Scene, coc_px: &Plane, frame: &Frame) -> Result<(), Error> {
    png::write_rgb(path, Displayed::new(frame).rgb(picture(scene, coc_px)))
}

fn picture(scene: &Scene, coc_px: &Plane) -> Rgb8 {
    let (width, height) = (coc_px.width(), coc_px.height());
    let [columns, rows] = scene.outside_px;
    let pixel = |x: usize, y: usize| {
        let [r, g, b, _] = scene.pinhole_pixel(x + columns, y + rows);
        let shown = [r, g, b].map(|linear| srgb_encode(linear.clamp(0.0, 1.0)));
        let color = color(shown, coc_px.get(x, y), line(coc_px, x, y));
        color.map(|value| (value * 255.0).round() as u8)
    };
    let mut pixels = vec![[0; 3]; width * height];
    parallel::for_each_row(&mut pixels, width, &|y, row| {
        row.iter_mut().enumerate().for_each(|(x, shown)| *shown = pixel(x, y));
    });
    Rgb8 { width, height, bytes: pixels.into_flattened() }
}

/// The map's colour for a pixel of the pinhole picture `shown` (sRGB) with CoC radius `coc_px` and `line`.
fn color(shown: [f32; 3], coc_px: f32, line: Option<Line>) -> [f32; 3] {
    match line {
        Some(Line::Focus) => FOCUS_LINE[usize::from(coc_px >= 0.0)],
        Some(Line::Contour) if coc_px < 0.0 => mix(tinted(shown, coc_px), NEAR_LINE, 0.75),
        Some(Line::Contour) => mix(tinted(shown, coc_px), FAR_LINE, 0.75),
        None => tinted(shown, coc_px),
    }
}

/// `shown`, darkened and tinted with the hue of its zone; unchanged in focus and without a surface.
fn tinted(shown: [f32; 3], coc_px: f32) -> [f32; 3] {
    let doublings = level(coc_px);
    if doublings == 0 {
        return shown;
    }
    let [r, g, b] = shown;
    // Luma (Rec. 709): the tinted picture keeps its lightness only.
    let grey = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let strength = (0.30 + 0.05 * doublings as f32).min(0.6);
    mix([0.85 * grey; 3], if coc_px < 0.0 { NEAR } else { FAR }, strength)
}

/// Linear interpolation from `a` to `b` by `share`.
fn mix(a: [f32; 3], b: [f32; 3], share: f32) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + share * (b[k] - a[k]))
}

/// The number of the contours 1, 2, 4, … px that `coc_px` reaches; 0 for NaN.
fn level(coc_px: f32) -> i32 {
    let doublings = (coc_px.abs() / SHARP_COC_PX).log2().floor();
    if doublings >= 0.0 { doublings as i32 + 1 } else { 0 }
}

/// The line through pixel `x, y`. The line of the plane of focus is two pixels wide on each side.
fn line(coc_px: &Plane, x: usize, y: usize) -> Option<Line> {
    let [left, right, above, below] = steps(coc_px, x, y);
    let beside = |step: Step, x: usize, y: usize| step.joined() && meets_focus(coc_px, x, y);
    let near_focus = meets_focus(coc_px, x, y)
        || beside(left, x.wrapping_sub(1), y)
        || beside(right, x + 1, y)
        || beside(above, x, y.wrapping_sub(1))
        || beside(below, x, y + 1);
    if near_focus {
        return Some(Line::Focus);
    }
    let crosses = [right, below].into_iter().any(|step| step.joined() && step.crosses_contour());
    crosses.then_some(Line::Contour)
}

/// Whether the plane of focus passes between pixel `x, y` and a neighbour on the same surface.
fn meets_focus(coc_px: &Plane, x: usize, y: usize) -> bool {
    steps(coc_px, x, y).into_iter().any(|step| step.joined() && step.crosses_focus())
}

/// The CoC radii of four consecutive pixels; the step is from the second to the third.
#[derive(Debug, Clone, Copy)]
struct Step([f32; 4]);

/// The steps from a pixel to the left, right, up and down; NaN outside the picture.
fn steps(coc_px: &Plane, x: usize, y: usize) -> [Step; 4] {
    let at = |dx: isize, dy: isize| match (x.checked_add_signed(dx), y.checked_add_signed(dy)) {
        (Some(x), Some(y)) if x < coc_px.width() && y < coc_px.height() => coc_px.get(x, y),
        _ => f32::NAN,
    };
    [(-1, 0), (1, 0), (0, -1), (0, 1)]
        .map(|(dx, dy)| Step([-1, 0, 1, 2].map(|distance| at(distance * dx, distance * dy))))
}

impl Step {
    /// Whether both pixels are on one surface.
    fn joined(self) -> bool {
        surface::continues(self.0)
    }

    fn crosses_focus(self) -> bool {
        let [_, from, to, _] = self.0;
        (from < 0.0) != (to < 0.0) && (to - from).abs() >= MIN_STEP_PX
    }

    fn crosses_contour(self) -> bool {
        let [_, from, to, _] = self.0;
        level(from) != level(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOCUS: Option<Line> = Some(Line::Focus);

    /// The lines along a row of pixels of these CoC radii.
    fn lines<const W: usize>(coc_px: [f32; W]) -> [Option<Line>; W] {
        let plane = Plane::from_fn(W, 1, |x, _| coc_px[x]);
        std::array::from_fn(|x| line(&plane, x, 0))
    }

    #[test]
    fn a_surface_that_crosses_the_plane_of_focus_has_a_line_there() {
        let found = lines([-0.95, -0.75, -0.25, 0.25, 0.75, 0.95]);
        assert_eq!(found, [None, FOCUS, FOCUS, FOCUS, FOCUS, None], "two pixels on each side");
    }

    #[test]
    fn contours_are_at_powers_of_two() {
        let found = lines([0.7, 0.9, 1.1, 1.5, 1.9, 2.1, 2.5]);
        let contours: Vec<usize> = (0..7).filter(|&x| found[x] == Some(Line::Contour)).collect();
        assert_eq!(contours, [1, 4], "before 1 and before 2");
        assert_eq!([0.3, 1.0, 3.9, -4.0, 8.0, f32::NAN].map(level), [0, 1, 2, 3, 4, 0]);
    }

    #[test]
    fn steep_surfaces_have_lines_and_edges_between_surfaces_have_none() {
        assert_eq!(lines([1.0, 3.0, 5.0, 7.0])[0], Some(Line::Contour), "a slope of 2 px a pixel");
        assert_eq!(lines([-3.0, -3.0, 5.0, 5.0]), [None; 4], "an object in front of another");
        assert_eq!(lines([5.0, 5.0, f32::NAN, f32::NAN]), [None; 4], "an object in front of the background");
    }

    #[test]
    fn rounding_draws_no_line_on_a_surface_in_the_plane_of_focus() {
        assert_eq!(lines([1e-5, -1e-5, 1e-5, -1e-5]), [None; 4]);
    }

    #[test]
    fn lines_differ_in_lightness_before_and_behind_focus() {
        let at = |coc: f32, line| color([0.5; 3], coc, Some(line));
        assert_eq!([at(-0.1, Line::Focus), at(0.1, Line::Focus)], [[0.0; 3], [1.0; 3]]);
        let sum = |color: [f32; 3]| color.iter().sum::<f32>();
        let [near, far] = [-2.0, 2.0].map(|coc| sum(at(coc, Line::Contour)));
        let surroundings = [-2.0, 2.0].map(|coc| sum(color([0.5; 3], coc, None)));
        assert!(
            near < 0.5 * surroundings[0] && far > 1.3 * surroundings[1],
            "{near} {far} in {surroundings:?}"
        );
    }

    #[test]
    fn colours_in_focus_are_kept_and_other_zones_are_orange_and_blue() {
        let shown = [0.2, 0.6, 0.3];
        assert_eq!(color(shown, 0.9, None), shown);
        assert_eq!(color(shown, f32::NAN, None), shown);
        let [near, far] = [-4.0, 4.0].map(|coc| color(shown, coc, None));
        assert!(near[0] > near[1] && near[1] > near[2], "orange: {near:?}");
        assert!(far[2] > far[1] && far[1] > far[0], "blue: {far:?}");
        let [nearer, farther] = [-32.0, 32.0].map(|coc| color(shown, coc, None));
        assert!(nearer[2] < near[2] && farther[0] < far[0], "the stronger the blur, the stronger the hue");
    }
}
