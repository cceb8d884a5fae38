//! LOOK and DECIDE: the stack in CoC space, the stats it shows, and the plan that follows from them.
//!
//! In coordinates `(x, y, c)` a lens ray through picture point `p` and lens sample `u` is the straight line
//! `(p + c·u, c)`, so every question of visibility is asked here and no method needs depth.

mod border;
pub(crate) mod effects;
mod extrapolation;
mod stats;
mod fill;
mod focus;
mod focus_distance;
mod light;
mod merge;
mod peel_stats;
mod spread;
pub(crate) mod surface;
mod workload;

pub(crate) use effects::percent;
pub use effects::{Effect, EffectKind, Inputs};
pub use extrapolation::Extrapolation;
pub use focus::FocusShares;
pub use focus_distance::{Focused, FrameNumber, focus_distance};
pub use peel_stats::PeelStats;
pub use stats::SceneStats;
pub(crate) use stats::{BrightStep, bright_step_floor};
pub(crate) use workload::Discs;
pub use workload::Workload;

use crate::image::{Image, Plane};
use crate::lens::{Field, ThinLens};
use crate::stack::{ColorRange, Frame, Peel, Stack, StackKind, depth::DepthScale};
use glam::Vec2;
use rayon::prelude::*;

/// Fragments of at least this alpha hide everything behind them.
pub const OPAQUE_ALPHA: f32 = 0.999;

/// One peel in CoC space.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Red, green, blue: scene-linear, premultiplied, finite.
    pub color: [Plane; 3],
    /// Coverage or opacity, 0 … 1; 0 where the peel is empty.
    pub alpha: Plane,
    /// Signed CoC radius in picture pixels, negative in front of focus; finite.
    pub coc_px: Plane,
}

impl Layer {
    /// Width in samples.
    pub fn width(&self) -> usize {
        self.alpha.width()
    }

    /// Height in samples.
    pub fn height(&self) -> usize {
        self.alpha.height()
    }

    /// Colour of column `x` of row `y`.
    pub fn color_at(&self, x: usize, y: usize) -> [f32; 3] {
        self.color.each_ref().map(|plane| plane.get(x, y))
    }
}

/// A stack as the methods see it: fragments `(x, y, c)`, no depth, no units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The layers, nearest first, all of one size.
    pub layers: Vec<Layer>,
    /// What the fragments stand for.
    pub kind: StackKind,
    /// Samples a picture pixel along each axis.
    pub supersample: usize,
    /// CoC radius at infinity in picture pixels: with it a CoC radius gives the depth, in units of the focus distance, as
    /// `1 / (1 − c / c_inf)`, which is all of depth that the papers' equations need.
    pub coc_infinity_px: f32,
    /// Fragments so near the lens that their CoC was limited to [`coc_limit_px`].
    pub limited_fragments: usize,
    /// Where in the lens's field the picture lies.
    pub field: Field,
    /// How bright the source's colours could be.
    pub color_range: ColorRange,
    /// Columns on either side, and rows above and below, that lie beyond the frame: see [`Scene::padded`].
    pub outside_px: [usize; 2],
}

/// Largest CoC radius kept for a picture of this size, in picture pixels; past it a fragment spreads over many frames and
/// its exact size shows no more.
pub fn coc_limit_px(width: usize, height: usize) -> f32 {
    (4 * width.max(height)).max(64) as f32
}

impl Scene {
    /// The scene of `layers`, nearest first, with the lens's axis at the picture's centre.
    pub fn new(layers: Vec<Layer>, kind: StackKind, supersample: usize, coc_infinity_px: f32) -> Self {
        let size = layers.first().map_or([0; 2], |layer| [layer.width(), layer.height()]);
        let [width, height] = size.map(|samples| samples / supersample);
        let field = Field::from_picture_size(width, height);
        Self {
            layers,
            kind,
            supersample,
            coc_infinity_px,
            limited_fragments: 0,
            field,
            color_range: ColorRange::Unbounded,
            outside_px: [0; 2],
        }
    }

    /// Takes the peels out of `stack` and puts them behind `lens`: depth becomes CoC radius, in place.
    pub fn from_stack(stack: &mut Stack, lens: &ThinLens, scale: &DepthScale) -> Self {
        let (kind, supersample) = (stack.kind, stack.supersample);
        let limit = coc_limit_px(stack.width() / supersample, stack.height() / supersample);
        let mut limited_fragments = 0;
        let mut layers = Vec::with_capacity(stack.peels.len());
        for mut peel in std::mem::take(&mut stack.peels) {
            limited_fragments += depth_to_coc(&mut peel, &stack.frame, lens, scale, limit);
            layers.push(Layer { color: peel.color, alpha: peel.alpha, coc_px: peel.depth });
        }
        let field = field(&stack.frame, supersample, scale);
        let color_range = stack.color_range;
        Self {
            limited_fragments,
            field,
            color_range,
            ..Self::new(layers, kind, supersample, lens.coc_infinity_px)
        }
    }

    /// Width of the layers in samples.
    pub fn width(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.alpha.width())
    }

    /// Height of the layers in samples.
    pub fn height(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.alpha.height())
    }

    /// Width and height of the picture that a method makes, in pixels: the frame and what was put around it.
    pub fn picture_size(&self) -> (usize, usize) {
        (self.width() / self.supersample, self.height() / self.supersample)
    }

    /// Width and height of the frame in pixels: what is left of the picture without what lies beyond.
    pub fn frame_size(&self) -> (usize, usize) {
        let ((width, height), [columns, rows]) = (self.picture_size(), self.outside_px);
        (width - 2 * columns, height - 2 * rows)
    }

    /// The picture without a lens: the layers over one another, averaged over a pixel's samples.
    ///
    /// Where the nearest layer is opaque and there is one sample a pixel, this is that layer bit for bit.
    pub fn pinhole(&self) -> Image {
        let (width, height) = self.picture_size();
        let mut image = Image::transparent(width, height);
        let [red, green, blue, alpha] =
            image.planes.each_mut().map(|plane| plane.values_mut().par_chunks_mut(width.max(1)));
        red.zip(green).zip(blue).zip(alpha).enumerate().for_each(|(y, (((red, green), blue), alpha))| {
            for x in 0..width {
                [red[x], green[x], blue[x], alpha[x]] = self.pinhole_pixel(x, y);
            }
        });
        image
    }

    /// [`Scene::pinhole`] for a scene that is given away: where the nearest layer hides everything, it is the picture, as it was
    /// read.
    pub fn into_pinhole(mut self) -> Image {
        let hides_all = |layer: &Layer| layer.alpha.values().iter().all(|&alpha| alpha >= OPAQUE_ALPHA);
        if self.supersample == 1 && self.layers.first().is_some_and(hides_all) {
            let Layer { color: [red, green, blue], alpha, .. } = self.layers.swap_remove(0);
            return Image { planes: [red, green, blue, alpha] };
        }
        self.pinhole()
    }

    /// Pixel `x, y` of the picture without a lens: red, green, blue, alpha.
    pub fn pinhole_pixel(&self, x: usize, y: usize) -> [f32; 4] {
        let s = self.supersample;
        if s == 1 {
            return self.flattened(x, y);
        }
        let mut sum = [0.0; 4];
        for sample in 0..s * s {
            let value = self.flattened(x * s + sample % s, y * s + sample / s);
            sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
        }
        sum.map(|sum| sum / (s * s) as f32)
    }

    /// All layers at one sample, nearest over farther.
    fn flattened(&self, x: usize, y: usize) -> [f32; 4] {
        let mut result = [0.0; 4];
        let mut transmitted = 1.0;
        for layer in &self.layers {
            let alpha = layer.alpha.get(x, y);
            if alpha <= 0.0 {
                continue;
            }
            let [r, g, b] = layer.color_at(x, y);
            for (sum, value) in result.iter_mut().zip([r, g, b, alpha]) {
                *sum += transmitted * value;
            }
            transmitted *= 1.0 - alpha;
            if alpha >= OPAQUE_ALPHA {
                break;
            }
        }
        result
    }
}

/// Where in the lens's field the picture of a stack with this `frame`, in samples, lies.
fn field(frame: &Frame, supersample: usize, scale: &DepthScale) -> Field {
    let samples = supersample as f32;
    let [left, top] = frame.data_origin_from_centre().map(|origin| origin - 0.5);
    let [width, height] = [frame.display.width, frame.display.height].map(|side| side as f32);
    Field {
        axis_px: -Vec2::new(left, top) / samples,
        half_diagonal_px: 0.5 * width.hypot(height) / samples,
        focal_length_px: scale.focal_px / samples,
    }
}

/// Turns a peel's depth into CoC radius and returns how many fragments met the limit.
fn depth_to_coc(peel: &mut Peel, frame: &Frame, lens: &ThinLens, scale: &DepthScale, limit: f32) -> usize {
    let width = peel.depth.width();
    if width == 0 {
        return 0;
    }
    let [x0, y0] = frame.data_origin_from_centre();
    let rows = peel.depth.values_mut().par_chunks_mut(width).zip(peel.alpha.values().par_chunks(width));
    rows.enumerate()
        .map(|(y, (depth, alpha))| {
            scale.planar_row(depth, y0 + y as f32, x0);
            let mut limited = 0;
            for (depth, &alpha) in depth.iter_mut().zip(alpha) {
                let coc = if alpha > 0.0 { lens.coc_radius_px(*depth) } else { 0.0 };
                // Only the near side is unbounded: behind focus |c| stays below c_inf, which the lens checked.
                limited += usize::from(coc < -limit);
                *depth = coc.clamp(-limit, limit);
            }
            limited
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::DepthConvention;
    use crate::stack::Window;

    fn layer(pixel: [f32; 4]) -> Layer {
        let plane = |value| Plane::filled(2, 2, value);
        Layer {
            color: [plane(pixel[0]), plane(pixel[1]), plane(pixel[2])],
            alpha: plane(pixel[3]),
            coc_px: plane(0.0),
        }
    }

    #[test]
    fn without_a_lens_an_opaque_layer_hides_the_rest_bit_for_bit() {
        let front = [0.1, 0.2, 70000.0, 1.0];
        let scene =
            Scene::new(vec![layer(front), layer([5.0, 5.0, 5.0, 1.0])], StackKind::PointSampled, 1, 1.0);
        assert_eq!(scene.pinhole().pixel(1, 1), front, "the front layer, untouched");
        let pinhole = scene.pinhole();
        assert_eq!(scene.into_pinhole(), pinhole, "also where it is given away");
    }

    #[test]
    fn without_a_lens_coverage_adds_up_front_to_back() {
        let scene = Scene::new(
            vec![layer([0.25, 0.0, 0.0, 0.25]), layer([0.0, 1.0, 0.0, 1.0])],
            StackKind::Coverage,
            1,
            1.0,
        );
        assert_eq!(scene.pinhole().pixel(0, 0), [0.25, 0.75, 0.0, 1.0], "a quarter red over green");
        let pinhole = scene.pinhole();
        assert_eq!(scene.into_pinhole(), pinhole, "also where it is given away");
    }

    #[test]
    fn the_axis_is_at_the_centre_of_the_display_window_wherever_the_data_lies() {
        let display = Window { x: 0, y: 0, width: 160, height: 90 };
        let scale = DepthScale {
            convention: DepthConvention::Planar,
            near_clip: 0.0,
            near_far: [0.0, 1.0],
            focal_px: 200.0,
        };
        let at = |data: Window, samples| {
            field(&Frame { data, display, pixel_aspect: 1.0 }, samples, &scale).axis_px.to_array()
        };
        assert_eq!(at(display, 1), [80.0, 45.0]);
        assert_eq!(at(Window { x: -8, y: 5, width: 176, height: 80 }, 1), [88.0, 40.0], "overscan and crop");
        assert_eq!(at(display, 2), [40.0, 22.5], "in picture pixels");
    }
}
