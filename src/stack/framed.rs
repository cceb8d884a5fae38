//! Pictures with their windows, and what two of them show of the same frame.

use super::{Frame, Window};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Image;

/// A picture with its data and display window.
#[derive(Debug, Clone, PartialEq)]
pub struct FramedImage {
    /// The pixels of the data window.
    pub image: Image,
    /// Its windows.
    pub frame: Frame,
}

/// A picture as it is compared, with what a file has instead of numbers.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct CheckedPicture {
    /// The picture, its values all finite.
    pub picture: FramedImage,
    /// What was replaced for that, if anything.
    pub replaced: Option<Finding>,
    /// The pixels of an OpenEXR whose colour is NaN or infinite in the file, as column and row of the data window.
    pub broken: Vec<[usize; 2]>,
}

impl FramedImage {
    /// The pixels in `part` of the data window, which is inside of it.
    #[must_use]
    pub fn part(self, part: Window) -> Image {
        let Window { x, y, width, height } = part;
        self.image.part([x, y].map(|start| start.unsigned_abs() as usize), (width, height))
    }
}

impl Frame {
    /// The parts of this picture and of `other` that can be compared pixel by pixel, each in pixels of its own data window. Where they have
    /// display windows of one size: what both show of it, or where that is nothing, what both have of the frame. Else all of both.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Input`] for two parts of one frame that share no pixel.
    pub fn shared_with(&self, other: &Self) -> Result<[Window; 2], Error> {
        let frames = [self, other];
        let size = |window: Window| (window.width, window.height);
        if size(self.display) != size(other.display) {
            return Ok(frames.map(|frame| Window { x: 0, y: 0, ..frame.data }));
        }
        let x = frames.map(|frame| span(frame.data.x, frame.display.x, frame.data.width));
        let y = frames.map(|frame| span(frame.data.y, frame.display.y, frame.data.height));
        let displayed = [self.display.width, self.display.height].map(|size| [0, size as i64]);
        let of_display = [shared(x, Some(displayed[0])), shared(y, Some(displayed[1]))];
        let of_frame = || [shared(x, None), shared(y, None)];
        let found = if of_display.iter().all(Option::is_some) { of_display } else { of_frame() };
        match found {
            [Some((left, width)), Some((top, height))] => {
                Ok([0, 1].map(|picture| Window { x: left[picture], y: top[picture], width, height }))
            }
            _ => Err(Error::input("the pictures show different parts of the frame")
                .with("image", self.data.to_string())
                .with("reference", other.data.to_string())
                .help("compare pictures whose data windows overlap")),
        }
    }
}

/// First pixel and end of `size` pixels from `start` on, seen from `origin`.
fn span(start: i32, origin: i32, size: usize) -> [i64; 2] {
    let start = i64::from(start) - i64::from(origin);
    [start, start + size as i64]
}

/// Where the common pixels of two spans, and of the one `within`, begin in each of the two, and their number.
fn shared(spans: [[i64; 2]; 2], within: Option<[i64; 2]>) -> Option<([i32; 2], usize)> {
    let [[a, a_end], [b, b_end]] = spans;
    let [from, to] = within.unwrap_or([i64::MIN, i64::MAX]);
    let start = a.max(b).max(from);
    let count = usize::try_from(a_end.min(b_end).min(to) - start).ok().filter(|&count| count > 0)?;
    let from = |own: i64| i32::try_from(start - own).ok();
    Some(([from(a)?, from(b)?], count))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of 64 × 36 pixels, of which the data window is stored.
    fn frame(x: i32, y: i32, width: usize, height: usize) -> Frame {
        let display = Window { x: 0, y: 0, width: 64, height: 36 };
        Frame { data: Window { x, y, width, height }, display, pixel_aspect: 1.0 }
    }

    fn window(x: i32, y: i32, width: usize, height: usize) -> Window {
        Window { x, y, width, height }
    }

    #[test]
    fn overscan_and_crops_are_compared_where_both_have_pixels() {
        let [overscan, whole, crop] = [frame(-8, -4, 80, 44), frame(0, 0, 64, 36), frame(10, 20, 64, 36)];
        assert_eq!(overscan.shared_with(&whole).unwrap(), [window(8, 4, 64, 36), window(0, 0, 64, 36)]);
        assert_eq!(whole.shared_with(&crop).unwrap(), [window(10, 20, 54, 16), window(0, 0, 54, 16)]);
        assert_eq!(overscan.shared_with(&overscan).unwrap(), [window(8, 4, 64, 36); 2], "what is displayed");
        let beside = frame(-30, 0, 20, 36);
        assert_eq!(overscan.shared_with(&beside).unwrap_err().kind(), crate::error::ErrorKind::Input);
        let outside = frame(-8, -4, 8, 44);
        assert_eq!(outside.shared_with(&outside).unwrap(), [window(0, 0, 8, 44); 2], "all that there is");
    }

    #[test]
    fn display_windows_of_other_origins_show_the_same_frame() {
        let mut moved = frame(100, 50, 64, 36);
        moved.display = window(100, 50, 64, 36);
        assert_eq!(moved.shared_with(&frame(0, 0, 64, 36)).unwrap(), [window(0, 0, 64, 36); 2]);
    }

    #[test]
    fn pictures_of_other_frames_are_compared_whole() {
        let png = Frame::from_size(80, 44);
        assert_eq!(frame(-8, -4, 80, 44).shared_with(&png).unwrap(), [window(0, 0, 80, 44); 2]);
    }

    #[test]
    fn parts_without_a_common_pixel_are_an_error_also_at_the_ends_of_the_integers() {
        assert!(frame(0, 0, 32, 36).shared_with(&frame(32, 0, 32, 36)).is_err());
        assert!(frame(i32::MIN, 0, 32, 36).shared_with(&frame(i32::MAX, 0, 32, 36)).is_err());
    }
}
