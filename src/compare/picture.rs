//! A picture as displayed on a screen, stored compactly so that dozens of them fit into memory.

use crate::image::{Image, Plane, srgb_decode, srgb_encode};
use crate::output::data_uri::Rgb8;
use crate::parallel;
use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma};

/// sRGB values clipped to 0 … 1, 16 bits each: 6 bytes per pixel. The rounding error is about 100 dB below white, which no figure
/// made from such pictures shows. Colour is composited over black; alpha is not stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    /// Red, green and blue of each pixel, row by row.
    values: Vec<u16>,
}

/// A square of pixels inside a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Square {
    /// Its first column.
    pub x: usize,
    /// Its first row.
    pub y: usize,
    /// Its width and height.
    pub side: usize,
}

impl Picture {
    /// `image` as a screen displays it; NaN is black.
    pub fn new(image: &Image) -> Self {
        let (width, height) = (image.width(), image.height());
        let mut values = vec![0; width * height * 3];
        parallel::for_each_row(&mut values, 3 * width, &|y, row| {
            for (channel, plane) in image.planes[..3].iter().enumerate() {
                for (x, &linear) in plane.row(y).iter().enumerate() {
                    row[3 * x + channel] = (srgb_encode(linear.clamp(0.0, 1.0)) * 65535.0).round() as u16;
                }
            }
        });
        Self { width, height, values }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row `y`: red, green and blue of each pixel, 65535 for 1.
    pub fn row(&self, y: usize) -> &[u16] {
        &self.values[3 * y * self.width..3 * (y + 1) * self.width]
    }

    /// The scene-linear picture with these sRGB values, opaque.
    pub fn linear(&self) -> Image {
        let plane = |channel: usize| {
            let value = |x, y| f32::from(self.row(y)[3 * x + channel]) / 65535.0;
            Plane::from_fn(self.width, self.height, |x, y| srgb_decode(value(x, y)))
        };
        Image { planes: [plane(0), plane(1), plane(2), Plane::filled(self.width, self.height, 1.0)] }
    }

    /// The part within `square`, which lies inside of the picture.
    pub fn crop(&self, square: Square) -> Self {
        let rows = square.y..square.y + square.side;
        let values = rows.flat_map(|y| &self.row(y)[3 * square.x..3 * (square.x + square.side)]).copied();
        Self { width: square.side, height: square.side, values: values.collect() }
    }

    /// PSNR against `other`, of the same size, in dB; `None` for equal pictures.
    pub fn psnr_db(&self, other: &Self) -> Option<f64> {
        let squares = self.values.iter().zip(&other.values).map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2));
        let sum: u64 = squares.sum();
        let mean = sum as f64 / self.values.len().max(1) as f64 / 65535.0_f64.powi(2);
        (sum > 0).then(|| -10.0 * mean.log10())
    }

    /// The picture at most `width` pixels wide, downsampled in linear light.
    #[must_use]
    pub fn at_most(self, width: usize) -> Self {
        if self.width <= width {
            return self;
        }
        Self::new(&Image { planes: self.linear().planes.map(|plane| shrunk(plane, width)) })
    }

    /// The picture with 8 bits per value, rounded.
    pub(crate) fn to_rgb8(&self) -> Rgb8 {
        let byte = |&value: &u16| ((u32::from(value) + 128) / 257) as u8;
        Rgb8 { width: self.width, height: self.height, bytes: self.values.iter().map(byte).collect() }
    }
}

/// `plane`, values of 0 … 1, downsampled to at most `width` values per row with a triangle filter.
pub(super) fn shrunk(plane: Plane, width: usize) -> Plane {
    if plane.width() <= width {
        return plane;
    }
    let height = (plane.height() * width).div_ceil(plane.width());
    let buffer: Option<ImageBuffer<Luma<f32>, Vec<f32>>> =
        ImageBuffer::from_raw(plane.width() as u32, plane.height() as u32, plane.values().to_vec());
    let small = buffer.map(|buffer| resize(&buffer, width as u32, height as u32, FilterType::Triangle));
    let mut result = Plane::zeros(width, height);
    if let Some(small) = small {
        result.values_mut().copy_from_slice(small.as_raw());
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: usize, value: f32) -> Picture {
        Picture::new(&Image::from_fn(width, 40, |_, _| [value, value, value, 1.0]))
    }

    #[test]
    fn a_picture_has_the_srgb_values_that_a_screen_displays() {
        let image = Image::from_fn(2, 1, |x, _| if x == 0 { [0.18, 7.0, -1.0, 1.0] } else { [f32::NAN; 4] });
        let picture = Picture::new(&image);
        // sRGB: 0.18 is 0.4613, the 118th of 255.
        assert_eq!(picture.to_rgb8().bytes, [118, 255, 0, 0, 0, 0]);
        assert!((picture.linear().pixel(0, 0)[0] - 0.18).abs() < 1e-5);
    }

    #[test]
    fn psnr_agrees_with_the_metrics_module() {
        let [a, b] = [0.2, 0.3].map(|value| Image::from_fn(40, 40, |_, _| [value, value, value, 1.0]));
        let exact = crate::metrics::score(&a, &b, 0).unwrap().psnr_db;
        let found = Picture::new(&a).psnr_db(&Picture::new(&b)).unwrap();
        assert!((found - exact).abs() < 0.01, "{found}, {exact}");
        assert_eq!(Picture::new(&a).psnr_db(&Picture::new(&a)), None);
    }

    #[test]
    fn a_crop_is_a_part_of_the_picture() {
        let image = Image::from_fn(50, 40, |x, y| [x as f32 / 50.0, y as f32 / 40.0, 0.0, 1.0]);
        let picture = Picture::new(&image);
        let crop = picture.crop(Square { x: 7, y: 3, side: 5 });
        assert_eq!((crop.width(), crop.height()), (5, 5));
        assert_eq!(crop.row(2)[..3], picture.row(5)[21..24]);
    }

    #[test]
    fn downsampling_preserves_mean_linear_light() {
        // Columns of 0 and 1 are half the light of 1.
        let stripes = Image::from_fn(80, 40, |x, _| [(x % 2) as f32, 0.0, 0.0, 1.0]);
        let small = Picture::new(&stripes).at_most(20).linear();
        assert_eq!((small.width(), small.height()), (20, 10));
        assert!((small.pixel(10, 5)[0] - 0.5).abs() < 0.02, "{:?}", small.pixel(10, 5));
        assert_eq!(grey(20, 0.5).at_most(20), grey(20, 0.5));
    }
}
