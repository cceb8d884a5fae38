//! The picture as a viewer shows it: the pixels of the display window, as wide as high.
//!
//! Overscan is left out; where the display window has no pixels it is empty. Of pixels that are wider than high there are more columns, of
//! others more rows, interpolated linearly: no detail is lost.

use super::png::Rgb8;
use crate::image::{Image, Plane};
use crate::stack::Frame;
use std::borrow::Cow;

/// A display window of more pixels than this, and more than [`MAX_RATIO`] times as many as the picture has, is not made: the picture's own
/// pixels are shown.
const MAX_PIXELS: u64 = 1 << 26;

/// See [`MAX_PIXELS`].
const MAX_RATIO: u64 = 16;

/// Which pixels of a picture are displayed, and where.
#[derive(Debug, Clone)]
pub struct Displayed {
    columns: Vec<Option<Between>>,
    rows: Vec<Option<Between>>,
    /// Whether the picture is displayed as it is.
    is_whole: bool,
}

/// A place between two pixels along an axis.
#[derive(Debug, Clone, Copy)]
struct Between {
    first: usize,
    second: usize,
    /// Weight of the second, 0 … 1.
    share: f32,
}

impl Displayed {
    /// How a picture with this `frame` is displayed.
    pub fn new(frame: &Frame) -> Self {
        let aspect = frame.usable_pixel_aspect();
        let stretch = [aspect.max(1.0), aspect.recip().max(1.0)];
        let Frame { data, display, .. } = *frame;
        let [width, height] = [length(display.width, stretch[0]), length(display.height, stretch[1])];
        let (pixels, own) = (width as u64 * height as u64, data.width as u64 * data.height as u64);
        let window = if pixels <= MAX_PIXELS.max(own.saturating_mul(MAX_RATIO)) { display } else { data };
        // Coordinates are below 2^30.
        let columns = axis(i64::from(window.x) - i64::from(data.x), window.width, (data.width, stretch[0]));
        let rows = axis(i64::from(window.y) - i64::from(data.y), window.height, (data.height, stretch[1]));
        let is_whole = window == data && stretch == [1.0; 2];
        Self { columns, rows, is_whole }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.columns.len(), self.rows.len())
    }

    /// Whether the picture is displayed as it is.
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// `image`, whose pixels are those of the frame's data window, as it is displayed.
    pub fn image<'a>(&self, image: &'a Image) -> Cow<'a, Image> {
        if self.is_whole {
            return Cow::Borrowed(image);
        }
        Cow::Owned(Image { planes: image.planes.each_ref().map(|plane| self.resampled(plane)) })
    }

    /// `plane`, whose values are those of the frame's data window, as it is displayed; 0 where there are none.
    pub fn plane<'a>(&self, plane: &'a Plane) -> Cow<'a, Plane> {
        if self.is_whole { Cow::Borrowed(plane) } else { Cow::Owned(self.resampled(plane)) }
    }

    /// `picture`, whose pixels are those of the frame's data window, as it is displayed; black where there are none. Its pixels are
    /// repeated, not mixed.
    pub(super) fn rgb(&self, picture: Rgb8) -> Rgb8 {
        if self.is_whole {
            return picture;
        }
        let (width, height) = self.size();
        let nearest =
            |between: &Option<Between>| between.map(|at| if at.share < 0.5 { at.first } else { at.second });
        let columns: Vec<Option<usize>> = self.columns.iter().map(nearest).collect();
        let rows = self.rows.iter().map(nearest);
        let pixel = |x: Option<usize>, y: Option<usize>| {
            let at = x.zip(y).map(|(x, y)| 3 * (y * picture.width + x));
            at.map_or([0; 3], |at| [0, 1, 2].map(|channel| picture.bytes[at + channel]))
        };
        let bytes =
            rows.flat_map(|y| columns.iter().flat_map(move |&x| pixel(x, y)).collect::<Vec<_>>()).collect();
        Rgb8 { width, height, bytes }
    }

    fn resampled(&self, plane: &Plane) -> Plane {
        let (width, height) = self.size();
        let mut displayed = Plane::zeros(width, height);
        for (y, rows) in self.rows.iter().enumerate() {
            let Some(rows) = rows else { continue };
            let [above, below] = [rows.first, rows.second].map(|row| plane.row(row));
            for (value, columns) in displayed.row_mut(y).iter_mut().zip(&self.columns) {
                let Some(columns) = columns else { continue };
                let [above, below] =
                    [above, below].map(|row| columns.mixed(row[columns.first], row[columns.second]));
                *value = rows.mixed(above, below);
            }
        }
        displayed
    }
}

impl Between {
    /// The value here of the two at the pixels on either side; exactly the first at a pixel.
    fn mixed(self, first: f32, second: f32) -> f32 {
        if self.share == 0.0 { first } else { first + self.share * (second - first) }
    }
}

/// Number of square pixels of `count` that are `stretch` times as long.
fn length(count: usize, stretch: f32) -> usize {
    if stretch == 1.0 { count } else { (count as f64 * f64::from(stretch)).round().max(1.0) as usize }
}

/// The places of `count` pixels, each as long as `stretch` square ones, along a picture of `own` pixels, whose first is `start` pixels before
/// them.
fn axis(start: i64, count: usize, (own, stretch): (usize, f32)) -> Vec<Option<Between>> {
    let displayed = length(count, stretch);
    let step = count as f64 / displayed.max(1) as f64;
    let place = |i: usize| {
        let place = (i as f64 + 0.5) * step - 0.5 + start as f64;
        // A place belongs to the pixel that it lies in.
        let within = place >= -0.5 && place < own as f64 - 0.5;
        let inside = place.clamp(0.0, own.saturating_sub(1) as f64);
        let first = inside as usize;
        let second = (first + 1).min(own.saturating_sub(1));
        within.then_some(Between { first, second, share: (inside - first as f64) as f32 })
    };
    (0..displayed).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::Window;

    fn displayed(data: Window, display: Window, pixel_aspect: f32) -> Displayed {
        Displayed::new(&Frame { data, display, pixel_aspect })
    }

    fn window(x: i32, y: i32, width: usize, height: usize) -> Window {
        Window { x, y, width, height }
    }

    /// A plane whose values say where they are in the data window.
    fn places(width: usize, height: usize) -> Plane {
        Plane::from_fn(width, height, |x, y| (10 * y + x + 1) as f32)
    }

    #[test]
    fn overscan_is_left_out_and_what_is_missing_is_empty() {
        let shown =
            displayed(window(-2, -1, 6, 4), window(0, 0, 3, 2), 1.0).plane(&places(6, 4)).into_owned();
        assert_eq!(shown.values(), [13.0, 14.0, 15.0, 23.0, 24.0, 25.0]);
        let crop = displayed(window(1, 1, 2, 1), window(0, 0, 4, 3), 1.0).plane(&places(2, 1)).into_owned();
        assert_eq!(crop.values(), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(displayed(window(3, 3, 4, 2), window(3, 3, 4, 2), 1.0).is_whole());
    }

    #[test]
    fn wide_pixels_become_more_columns_and_high_ones_more_rows() {
        let whole = window(0, 0, 4, 2);
        let wide = displayed(whole, whole, 2.0);
        assert_eq!(wide.size(), (8, 2));
        let ramp = Plane::from_fn(4, 2, |x, _| x as f32);
        let row = wide.plane(&ramp).row(0).to_vec();
        assert_eq!(row, [0.0, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3.0], "pixel centres keep their places");
        assert_eq!(displayed(whole, whole, 0.5).size(), (4, 4));
        assert_eq!(displayed(whole, whole, f32::NAN).size(), (4, 2), "no aspect is none");
    }

    #[test]
    fn a_map_is_displayed_as_the_picture_is() {
        let bytes = (0..24).collect();
        let map = Rgb8 { width: 4, height: 2, bytes };
        let shown = displayed(window(-1, 0, 4, 2), window(0, 0, 2, 3), 1.0).rgb(map);
        assert_eq!((shown.width, shown.height), (2, 3));
        assert_eq!(shown.bytes, [3, 4, 5, 6, 7, 8, 15, 16, 17, 18, 19, 20, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn a_display_window_out_of_all_proportion_is_not_made() {
        let shown = displayed(window(0, 0, 4, 4), window(0, 0, 1 << 20, 1 << 20), 1.0);
        assert!(shown.is_whole() && shown.size() == (4, 4));
    }
}
