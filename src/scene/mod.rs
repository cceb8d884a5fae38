//! ANALYZE and DECIDE: the stack in CoC space, its statistics, and the effects that a plan decides from them.
//!
//! In coordinates `(x, y, c)` a lens ray through picture point `p` and lens sample `u` is the straight line
//! `(p + c·u, c)`. Visibility along lens rays can therefore be computed in this space, and no method needs depth.

mod around;
mod background;
mod border;
mod bright;
mod depth_in_use;
pub(crate) mod effects;
pub mod environment;
mod extrapolation;
mod stats;
mod fill;
mod focus;
mod focus_distance;
mod join;
mod key_frames;
mod layer;
mod light;
mod merge;
mod peel_stats;
mod plates;
mod reflections;
mod smooth;
mod spread;
pub(crate) mod surface;
mod surroundings;
mod unmixing;
mod vector;
mod ways;
mod workload;

pub use background::Background;
pub(crate) use bright::{BrightStep, bright_step_floor, brightness, isolation, share_of_disc};
pub(crate) use depth_in_use::DepthInUse;
pub(crate) use effects::percent;
pub use effects::{Effect, EffectKind, Inputs};
pub use environment::{EnvironmentShading, EnvironmentStats};
pub use extrapolation::Extrapolation;
pub use focus::FocusShares;
pub use focus_distance::{Focused, focus_distance};
pub use key_frames::FrameNumber;
pub(crate) use key_frames::number_at;
pub(crate) use layer::MAX_TRANSLUCENT_LAYERS;
pub use layer::{Layer, OPAQUE_ALPHA};
pub use peel_stats::PeelStats;
pub use reflections::{ReflectingLayer, ReflectionStats, Reflections};
pub use stats::SceneStats;
pub(crate) use workload::Discs;
pub use workload::Workload;
#[cfg(test)]
pub(crate) use {bright::BRIGHT_STEPS, spread::Spread};

use crate::image::{Image, Plane};
use crate::lens::{Field, ThinLens};
use crate::parallel;
pub use crate::stack::Antialiasing;
use crate::stack::{ColorRange, Frame, Peel, Stack, StackKind, depth::DepthScale};
use glam::Vec2;
use pulp::Arch;
use std::sync::Arc;

/// A stack as methods get it: fragments `(x, y, c)`, no depth, no units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The layers, nearest first, all of one size.
    pub layers: Vec<Layer>,
    /// Which colours are point samples, and which are averages over the pixel: by pixel of the picture.
    pub antialiasing: Antialiasing,
    /// Samples per picture pixel along each axis.
    pub supersample: usize,
    /// CoC radius at infinity in picture pixels. With it a CoC radius gives the depth in units of the focus distance,
    /// `1 / (1 − c / c_inf)`; the papers' equations need no other depth.
    pub coc_infinity_px: f32,
    /// How open the lens is, in picture pixels: see [`ThinLens::opening_px`].
    pub opening_px: f32,
    /// Number of fragments whose CoC was limited to [`coc_limit_px`]: so near the lens, or behind focus of a lens that blurs so much.
    pub limited_fragments: usize,
    /// Position of the picture in the lens's field.
    pub field: Field,
    /// Range of the source's colours.
    pub color_range: ColorRange,
    /// Columns on either side, and rows above and below, that lie beyond the frame: see [`Scene::padded`].
    pub outside_px: [usize; 2],
    /// The background behind the layers as they were read, before any were merged or estimated; `None` where no pixel shows it.
    pub background: Option<Arc<Background>>,
    /// What the surfaces of the layers reflect, where the stack says so.
    pub reflections: Option<Arc<Reflections>>,
    /// The environment that surfaces of the layers reflect, where the user gives it.
    pub environment: Option<Arc<EnvironmentShading>>,
}

/// Largest CoC radius kept for a picture of this size, in picture pixels. A larger disc extends over several frame widths, so that its
/// exact size is not visible.
pub fn coc_limit_px(width: usize, height: usize) -> f32 {
    (4 * width.max(height)).max(64) as f32
}

impl Scene {
    /// The scene of `layers`, nearest first, which are of this `kind` everywhere, with the lens's axis at the picture's centre.
    pub fn new(layers: Vec<Layer>, kind: StackKind, supersample: usize, coc_infinity_px: f32) -> Self {
        let size = layers.first().map_or([0; 2], |layer| [layer.width(), layer.height()]);
        let [width, height] = size.map(|samples| samples / supersample);
        let field = Field::from_picture_size(width, height);
        let background = Background::behind(&layers, supersample, coc_infinity_px).map(Arc::new);
        Self {
            layers,
            antialiasing: kind.into(),
            supersample,
            coc_infinity_px,
            opening_px: coc_infinity_px,
            limited_fragments: 0,
            field,
            color_range: ColorRange::Unbounded,
            outside_px: [0; 2],
            background,
            reflections: None,
            environment: None,
        }
    }

    /// Takes the peels out of `stack` and turns their depth into the CoC radius of `lens`, in place.
    pub fn from_stack(stack: &mut Stack, lens: &ThinLens, scale: &DepthScale) -> Self {
        let supersample = stack.supersample;
        let limit = coc_limit_px(stack.width() / supersample, stack.height() / supersample);
        let (reflections, findings) = reflections::reflections(stack, (lens, limit), scale);
        stack.findings.extend(findings);
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
            opening_px: lens.opening_px,
            antialiasing: stack.antialiasing.clone(),
            reflections,
            ..Self::new(layers, StackKind::PointSampled, supersample, lens.coc_infinity_px.min(limit))
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

    /// Width and height of the picture that a method renders, in pixels: the frame and its padding.
    pub fn picture_size(&self) -> (usize, usize) {
        (self.width() / self.supersample, self.height() / self.supersample)
    }

    /// Width and height of the frame in pixels: the picture without its padding.
    pub fn frame_size(&self) -> (usize, usize) {
        let ((width, height), [columns, rows]) = (self.picture_size(), self.outside_px);
        (width - 2 * columns, height - 2 * rows)
    }

    /// The picture without a lens: the layers composited over one another and averaged over a pixel's samples.
    ///
    /// Where the nearest layer is opaque and there is one sample per pixel, the result is that layer bit for bit.
    pub fn pinhole(&self) -> Image {
        let (width, height) = self.picture_size();
        let mut image = Image::transparent(width, height);
        let planes = image.planes.each_mut().map(Plane::values_mut);
        parallel::for_each_row_of(planes, width, &|y, [red, green, blue, alpha]| {
            for x in 0..width {
                [red[x], green[x], blue[x], alpha[x]] = self.pinhole_pixel(x, y);
            }
        });
        image
    }

    /// [`Scene::pinhole`] that consumes the scene: a nearest layer that is opaque everywhere is returned without a copy.
    pub fn into_pinhole(mut self) -> Image {
        let is_opaque = |layer: &Layer| layer.alpha.values().iter().all(|&alpha| alpha >= OPAQUE_ALPHA);
        if self.supersample == 1 && self.layers.first().is_some_and(is_opaque) {
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

    /// All layers at one sample, composited nearest over farther.
    fn flattened(&self, x: usize, y: usize) -> [f32; 4] {
        let mut result = [0.0; 4];
        let mut transmittance = 1.0;
        for layer in &self.layers {
            let alpha = layer.alpha.get(x, y);
            if alpha <= 0.0 {
                continue;
            }
            let [r, g, b] = layer.color_at(x, y);
            for (sum, value) in result.iter_mut().zip([r, g, b, alpha]) {
                *sum += transmittance * value;
            }
            transmittance *= 1.0 - alpha;
            if alpha >= OPAQUE_ALPHA {
                break;
            }
        }
        result
    }
}

/// Position in the lens's field of the picture of a stack with this `frame`, which is in samples.
fn field(frame: &Frame, supersample: usize, scale: &DepthScale) -> Field {
    let samples = supersample as f32;
    let [left, top] = frame.data_origin_from_centre().map(|origin| origin - 0.5);
    let [width, height] = [frame.display.width, frame.display.height].map(|side| side as f32);
    Field {
        axis_px: -Vec2::new(left, top) / samples,
        half_diagonal_px: 0.5 * width.hypot(height) / samples,
        focal_length_px: scale.focal_px / samples,
        pixel_aspect: frame.usable_pixel_aspect(),
    }
}

/// Turns a peel's depth into CoC radius and returns how many fragments exceeded the limit.
fn depth_to_coc(peel: &mut Peel, frame: &Frame, lens: &ThinLens, scale: &DepthScale, limit: f32) -> usize {
    let width = peel.depth.width();
    let ([x0, _], arch) = (frame.data_origin_from_centre(), Arch::new());
    let rows = peel.depth.values_mut().chunks_mut(width.max(1));
    let limited = parallel::map_each(rows, &|y, depth| {
        scale.planar_row(depth, frame.row_from_centre(y as f32), x0);
        arch.dispatch(|| planar_to_coc(depth, peel.alpha.row(y), lens, limit))
    });
    limited.into_iter().sum()
}

/// Turns a row of planar depths into CoC radii and returns how many exceeded the limit.
#[inline(always)]
fn planar_to_coc(depth: &mut [f32], alpha: &[f32], lens: &ThinLens, limit: f32) -> usize {
    let mut limited = 0_u32;
    for (depth, &alpha) in depth.iter_mut().zip(alpha) {
        let coc = if alpha > 0.0 { lens.coc_radius_px(*depth) } else { 0.0 };
        limited += u32::from(coc.abs() > limit);
        *depth = coc.clamp(-limit, limit);
    }
    limited as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
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
    fn the_pinhole_picture_of_an_opaque_front_layer_is_that_layer_bit_for_bit() {
        let front = [0.1, 0.2, 70000.0, 1.0];
        let scene =
            Scene::new(vec![layer(front), layer([5.0, 5.0, 5.0, 1.0])], StackKind::PointSampled, 1, 1.0);
        assert_eq!(scene.pinhole().pixel(1, 1), front, "the front layer, unchanged");
        let pinhole = scene.pinhole();
        assert_eq!(scene.into_pinhole(), pinhole, "the same if the scene is consumed");
    }

    #[test]
    fn the_pinhole_picture_composites_coverage_front_to_back() {
        let scene = Scene::new(
            vec![layer([0.25, 0.0, 0.0, 0.25]), layer([0.0, 1.0, 0.0, 1.0])],
            StackKind::Coverage,
            1,
            1.0,
        );
        assert_eq!(scene.pinhole().pixel(0, 0), [0.25, 0.75, 0.0, 1.0], "a quarter red over green");
        let pinhole = scene.pinhole();
        assert_eq!(scene.into_pinhole(), pinhole, "the same if the scene is consumed");
    }

    #[test]
    fn the_axis_is_at_the_centre_of_the_display_window_for_any_data_window() {
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
