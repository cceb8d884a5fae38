//! The pixel type of the whole program: planes of `f32`, scene-linear, colour premultiplied by alpha.

/// Number of readable values before the first and after the last value of a plane, so that a vector may begin or end outside a row.
pub const MARGIN: usize = 16;

/// One channel of a picture: `[height][width]`, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    width: usize,
    height: usize,
    /// [`MARGIN`] zeros, the rows without gaps, [`MARGIN`] zeros.
    padded: Vec<f32>,
}

impl Plane {
    /// A plane of `value` everywhere.
    pub fn filled(width: usize, height: usize, value: f32) -> Self {
        let mut plane = Self::zeros(width, height);
        plane.values_mut().fill(value);
        plane
    }

    /// A plane of zeros.
    pub fn zeros(width: usize, height: usize) -> Self {
        Self { width, height, padded: vec![0.0; MARGIN + width * height + MARGIN] }
    }

    /// A plane of `value(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> f32) -> Self {
        let mut plane = Self::zeros(width, height);
        for y in 0..height {
            plane.row_mut(y).iter_mut().enumerate().for_each(|(x, sample)| *sample = value(x, y));
        }
        plane
    }

    /// A plane of `values`, row by row from the top.
    ///
    /// # Panics
    /// If there are not `width · height` values.
    pub fn from_values(width: usize, height: usize, values: &[f32]) -> Self {
        let mut plane = Self::zeros(width, height);
        plane.values_mut().copy_from_slice(values);
        plane
    }

    /// The plane without `columns` on the left and on the right, and without `rows` above and below; unchanged if both are 0.
    #[must_use]
    pub fn trimmed(self, [columns, rows]: [usize; 2]) -> Self {
        if [columns, rows] == [0, 0] {
            return self;
        }
        self.part([columns, rows], (self.width - 2 * columns, self.height - 2 * rows))
    }

    /// The `width` × `height` values from column `x`, row `y` on, which are inside of the plane.
    #[must_use]
    pub fn part(&self, [x, y]: [usize; 2], (width, height): (usize, usize)) -> Self {
        let mut plane = Self::zeros(width, height);
        for row in 0..height {
            plane.row_mut(row).copy_from_slice(&self.row(y + row)[x..][..width]);
        }
        plane
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The value at column `x`, row `y`.
    pub fn get(&self, x: usize, y: usize) -> f32 {
        self.values()[y * self.width + x]
    }

    /// Sets the value at column `x`, row `y`.
    pub fn set(&mut self, x: usize, y: usize, value: f32) {
        self.padded[MARGIN + y * self.width + x] = value;
    }

    /// Row `y`, `width` values.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.values()[y * self.width..(y + 1) * self.width]
    }

    /// Row `y`, to write.
    pub fn row_mut(&mut self, y: usize) -> &mut [f32] {
        let width = self.width;
        &mut self.values_mut()[y * width..(y + 1) * width]
    }

    /// All values, row by row.
    pub fn values(&self) -> &[f32] {
        &self.padded[MARGIN..MARGIN + self.width * self.height]
    }

    /// Row `y` with [`MARGIN`] values on either side: column `x` is at `MARGIN + x`. The margins belong to the neighbouring
    /// rows, or to none.
    #[inline(always)]
    pub fn row_with_margins(&self, y: usize) -> &[f32] {
        &self.padded[y * self.width..][..MARGIN + self.width + MARGIN]
    }

    /// Where row `y` of a plane of this width begins among its values and the margins around them.
    #[inline(always)]
    pub(crate) fn row_start(width: usize, y: usize) -> usize {
        y * width + MARGIN
    }

    /// All values and the margins around them; column `x` of a row is at [`Plane::row_start`] + `x`.
    #[inline(always)]
    pub(crate) fn padded(&self) -> &[f32] {
        &self.padded
    }

    /// All values, to write.
    pub fn values_mut(&mut self) -> &mut [f32] {
        let length = self.width * self.height;
        &mut self.padded[MARGIN..MARGIN + length]
    }
}

impl Default for Plane {
    /// A plane without values.
    fn default() -> Self {
        Self::zeros(0, 0)
    }
}

/// A picture: red, green, blue and alpha planes of one size.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Image {
    /// Red, green, blue (premultiplied, scene-linear), alpha.
    pub planes: [Plane; 4],
}

impl Image {
    /// Transparent black.
    pub fn transparent(width: usize, height: usize) -> Self {
        Self { planes: std::array::from_fn(|_| Plane::zeros(width, height)) }
    }

    /// A picture of `pixel(x, y)`, `[r, g, b, a]` each.
    pub fn from_fn(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [f32; 4]) -> Self {
        Self { planes: std::array::from_fn(|k| Plane::from_fn(width, height, |x, y| pixel(x, y)[k])) }
    }

    /// The picture without `columns` on the left and on the right, and without `rows` above and below.
    #[must_use]
    pub fn trimmed(self, outside: [usize; 2]) -> Self {
        Self { planes: self.planes.map(|plane| plane.trimmed(outside)) }
    }

    /// The `width` × `height` pixels from column `x`, row `y` on, which are inside of the picture; unchanged if they are all of it.
    #[must_use]
    pub fn part(self, from: [usize; 2], (width, height): (usize, usize)) -> Self {
        if (self.width(), self.height()) == (width, height) {
            return self;
        }
        Self { planes: self.planes.each_ref().map(|plane| plane.part(from, (width, height))) }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.planes[0].width()
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.planes[0].height()
    }

    /// `[r, g, b, a]` at column `x`, row `y`.
    pub fn pixel(&self, x: usize, y: usize) -> [f32; 4] {
        self.planes.each_ref().map(|plane| plane.get(x, y))
    }
}

/// The pixels left, right, above and below `pixel` of a picture of `width` × `height` pixels, `y · width + x` each; past the border the
/// border's own pixel.
pub(crate) fn neighbours(pixel: usize, (width, height): (usize, usize)) -> [usize; 4] {
    let (x, y) = (pixel % width, pixel / width);
    let at = |x: usize, y: usize| y * width + x;
    [
        at(x.saturating_sub(1), y),
        at((x + 1).min(width - 1), y),
        at(x, y.saturating_sub(1)),
        at(x, (y + 1).min(height - 1)),
    ]
}

/// The sRGB transfer function: scene-linear to display value. Nothing is clipped: negative values follow the
/// linear segment, values above 1 the curve.
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_encode`].
pub fn srgb_decode(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_decodes_what_it_encodes() {
        for i in 0..=1000 {
            let linear = i as f32 / 1000.0;
            assert!((srgb_decode(srgb_encode(linear)) - linear).abs() < 1e-6, "{linear}");
        }
    }

    #[test]
    fn a_trimmed_plane_is_its_inner_part() {
        let place = |x: usize, y: usize| (x + 10 * y) as f32;
        let whole = Plane::from_fn(6, 5, place);
        assert_eq!(whole.clone().trimmed([2, 1]), Plane::from_fn(2, 3, |x, y| place(x + 2, y + 1)));
        assert_eq!(whole.clone().trimmed([0, 0]), whole);
    }

    #[test]
    fn a_pixel_at_the_border_is_its_own_neighbour_beyond_it() {
        assert_eq!(neighbours(4, (3, 3)), [3, 5, 1, 7], "in the middle");
        assert_eq!(neighbours(0, (3, 3)), [0, 1, 0, 3], "at the first corner");
        assert_eq!(neighbours(8, (3, 3)), [7, 8, 5, 8], "at the last corner");
    }

    #[test]
    fn srgb_middle_grey_is_the_published_value() {
        // IEC 61966-2-1: linear 0.18 encodes to 0.4613.
        assert!((srgb_encode(0.18) - 0.4613).abs() < 1e-4);
        assert_eq!(srgb_encode(0.0), 0.0);
        assert!((srgb_encode(1.0) - 1.0).abs() < 1e-6);
    }
}
