//! The one pixel type: planes of `f32`, scene-linear, colour premultiplied by alpha.

/// One channel of a picture: `[height][width]`, row by row from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    /// A plane of `value` everywhere.
    pub fn filled(width: usize, height: usize, value: f32) -> Self {
        Self { width, height, values: vec![value; width * height] }
    }

    /// A plane of zeros.
    pub fn zeros(width: usize, height: usize) -> Self {
        Self::filled(width, height, 0.0)
    }

    /// A plane of `value(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> f32) -> Self {
        let values = (0..width * height).map(|i| value(i % width, i / width)).collect();
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

    /// The value at column `x`, row `y`.
    pub fn get(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Sets the value at column `x`, row `y`.
    pub fn set(&mut self, x: usize, y: usize, value: f32) {
        self.values[y * self.width + x] = value;
    }

    /// Row `y`, `width` values.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.width..(y + 1) * self.width]
    }

    /// Row `y`, to write.
    pub fn row_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.values[y * self.width..(y + 1) * self.width]
    }

    /// All values, row by row.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// All values, to write.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
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
