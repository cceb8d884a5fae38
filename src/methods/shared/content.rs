//! The stack as content and coverage, for methods that blend and then normalise.
//!
//! Such methods divide accumulated content by accumulated coverage. This is correct only if coverage means that the stack has
//! data, so the two meanings of alpha are separate: *coverage* is the fraction of a pixel for which there is data; *content* is the
//! data: red, green, blue and, in pictures of one surface per pixel, alpha. The background is no data: it comes behind the blurred
//! picture, see [`super::Backdrop`].

use super::backdrop::{Backdrop, before, known};
use super::dilation::{dilate, level, radius_px};
use super::rows::WriteRow;
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::parallel;
use crate::scene::{OPAQUE_ALPHA, Scene};

/// Coverage from which on a pixel of a picture of one surface per pixel is that surface: below it the surface fades out.
const SURFACE_FROM: f32 = 0.1;

/// How far a blurred pixel reaches, in its CoC radii: pyramids blur farther than the disc.
const PYRAMID_REACH: f32 = 3.0;

/// Planes of content and of its coverage.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct CoveragePlanes {
    /// Red, green, blue and, in some methods, alpha; premultiplied by coverage.
    pub content: Vec<Plane>,
    /// Fraction of each pixel that has data, 0 … 1.
    pub coverage: Plane,
}

/// A layer of a scene.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Peel {
    /// Content (red, green, blue) and coverage of the layer.
    pub covered: CoveragePlanes,
    /// Signed CoC radius in pixels; valid where coverage is above 0.
    pub coc_px: Plane,
}

/// The surfaces visible to the camera: one colour and one CoC radius per pixel.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct VisibleSurfaces {
    /// Red, green, blue and, where the background is visible, alpha; premultiplied by alpha.
    pub content: Vec<Plane>,
    /// Where the background is visible: to what part each pixel is a surface, 0 … 1. 1 from an alpha of [`SURFACE_FROM`] on.
    pub presence: Option<Plane>,
    /// Signed CoC radius in pixels of the fragment with the largest weight; valid where presence is above 0.
    pub coc_px: Plane,
}

/// The image visible to the camera: one colour and one CoC radius per pixel, no holes.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Visible {
    /// Red, green, blue and, where the background is visible, alpha.
    pub content: Vec<Plane>,
    /// Signed CoC radius in pixels.
    pub coc_px: Plane,
}

/// The layers of `scene` at one sample per pixel, nearest first.
pub(in crate::methods) fn peels(scene: Scene) -> Vec<Peel> {
    let layers = scene.merged().layers.into_iter().map(|layer| Peel {
        covered: CoveragePlanes { content: layer.color.into(), coverage: layer.alpha },
        coc_px: layer.coc_px,
    });
    layers.collect()
}

/// To what part a pixel that a surface covers to `alpha` is that surface.
#[inline]
pub(in crate::methods) fn presence(alpha: f32) -> f32 {
    (alpha / SURFACE_FROM).min(1.0)
}

/// The surfaces of `scene` visible to the camera, at one sample per pixel. The part of a pixel without data takes the colour of the part
/// with data.
pub(in crate::methods) fn visible_surfaces(scene: Scene, plan: &Plan) -> VisibleSurfaces {
    let background = plan.background(&scene);
    let scene = scene.merged();
    let (width, height) = scene.picture_size();
    let Image { planes: [mut red, mut green, mut blue, mut alpha] } = scene.pinhole();
    let coc_px = Plane::from_fn(width, height, |x, y| visible_coc_px(&scene, x, y));
    let known_parts: Vec<f32> = match &background {
        Some(background) => {
            let mut known_parts = alpha.values().to_vec();
            let shares = background.share().values();
            parallel::for_each_block(&mut known_parts, &|block, parts| {
                let parts = parts.iter_mut().zip(&shares[block]);
                parts.for_each(|(part, &share)| *part = known(*part, share));
            });
            known_parts
        }
        None => alpha.values().to_vec(),
    };
    for plane in [&mut red, &mut green, &mut blue] {
        parallel::for_each_block(plane.values_mut(), &|block, values| {
            for (value, &known) in values.iter_mut().zip(&known_parts[block]) {
                *value /= if known > 0.0 && known < OPAQUE_ALPHA { known } else { 1.0 };
            }
        });
    }
    if background.is_none() {
        return VisibleSurfaces { content: vec![red, green, blue], presence: None, coc_px };
    }
    parallel::for_each_block(alpha.values_mut(), &|block, alphas| {
        let alphas = alphas.iter_mut().zip(&known_parts[block]);
        alphas.for_each(|(alpha, &known)| *alpha /= if known > 0.0 { known } else { 1.0 });
    });
    let mut present = alpha.clone();
    parallel::for_each_block(present.values_mut(), &|_, values| {
        values.iter_mut().for_each(|value| *value = presence(*value));
    });
    VisibleSurfaces { content: vec![red, green, blue, alpha], presence: Some(present), coc_px }
}

/// Signed CoC radius of the fragment with the largest weight at `x, y`; 0 where there is none.
fn visible_coc_px(scene: &Scene, x: usize, y: usize) -> f32 {
    let (mut transmittance, mut max_weight, mut coc_px) = (1.0, 0.0, 0.0);
    for layer in &scene.layers {
        let alpha = layer.alpha.get(x, y);
        if transmittance * alpha > max_weight {
            (max_weight, coc_px) = (transmittance * alpha, layer.coc_px.get(x, y));
        }
        transmittance *= 1.0 - alpha;
    }
    coc_px
}

/// The image of `scene` visible to the camera, at one sample per pixel.
///
/// An empty pixel has the CoC radius of the surfaces behind focus that reach it, the largest, so that it lies behind them; it is in
/// focus where there are none, since blurring an empty background has no effect.
pub(in crate::methods) fn visible(scene: Scene, plan: &Plan) -> Visible {
    let VisibleSurfaces { content, presence, mut coc_px } = visible_surfaces(scene, plan);
    let Some(presence) = presence else { return Visible { content, coc_px } };
    let (presence, mut levels) = (presence.values(), vec![0; presence.values().len()]);
    let surfaces = coc_px.values();
    dilate(
        (&mut levels, coc_px.width().max(1)),
        |i| (presence[i] > 0.0 && surfaces[i] > 0.0).then(|| level(surfaces[i])),
        |level| PYRAMID_REACH * radius_px(level) + 1.0,
        |i| presence[i] < 1.0,
    );
    parallel::for_each_block(coc_px.values_mut(), &|block, coc_px| {
        for ((coc_px, &presence), &level) in
            coc_px.iter_mut().zip(&presence[block.clone()]).zip(&levels[block])
        {
            let behind_px = if level > 0 { radius_px(level) } else { 0.0 };
            *coc_px = behind_px + presence * (*coc_px - behind_px);
        }
    });
    Visible { content, coc_px }
}

impl CoveragePlanes {
    /// Empty planes: zero coverage, `channels` planes of content.
    pub(in crate::methods) fn unknown(width: usize, height: usize, channels: usize) -> Self {
        Self { content: vec![Plane::zeros(width, height); channels], coverage: Plane::zeros(width, height) }
    }

    /// Processes the rows in parallel: `row(scratch, y, planes)` gets row `y` of each plane of content and, last, of coverage.
    /// `scratch` makes the scratch memory of a thread.
    pub(in crate::methods) fn for_rows<T>(
        &mut self,
        scratch: &(dyn Fn() -> T + Sync),
        row: &WriteRow<'_, T>,
    ) {
        let mut planes = std::mem::take(&mut self.content);
        planes.push(std::mem::take(&mut self.coverage));
        let rows = row_blocks(&mut planes, 1).into_iter();
        parallel::for_each_with(rows, scratch, &|scratch, y, mut planes| row(scratch, y, &mut planes));
        self.coverage = planes.pop().unwrap_or_default();
        self.content = planes;
    }

    /// Composites these planes over `behind`: `A ⊕ B = A + (1 − A.a) B`, premultiplied.
    pub(in crate::methods) fn over(&mut self, behind: &Self) {
        for (front, back) in self.content.iter_mut().zip(&behind.content) {
            composite_over(front, &self.coverage, back);
        }
        parallel::for_each_block(self.coverage.values_mut(), &|block, front| {
            let values = front.iter_mut().zip(&behind.coverage.values()[block]);
            values.for_each(|(front, &back)| *front += (1.0 - *front) * back);
        });
    }

    /// Divides content by coverage: the picture, without colour where coverage is 0.
    pub(in crate::methods) fn into_picture(self) -> Image {
        self.into_picture_before(None)
    }

    /// The same before `backdrop`.
    pub(in crate::methods) fn into_picture_before(mut self, backdrop: Option<&Backdrop>) -> Image {
        for plane in &mut self.content {
            parallel::for_each_block(plane.values_mut(), &|block, values| {
                for (value, &coverage) in values.iter_mut().zip(&self.coverage.values()[block]) {
                    *value = if coverage > 0.0 { *value / coverage } else { 0.0 };
                }
            });
        }
        before(picture(self.content), &self.coverage, backdrop)
    }
}

/// Splits planes of one size into blocks of `lines` rows: for each block, its part of each plane.
pub(in crate::methods) fn row_blocks(planes: &mut [Plane], lines: usize) -> Vec<Vec<&mut [f32]>> {
    let mut result = Vec::new();
    for plane in planes {
        let length = (plane.width() * lines).max(1);
        for (block, rows) in plane.values_mut().chunks_mut(length).enumerate() {
            if block == result.len() {
                result.push(Vec::new());
            }
            result[block].push(rows);
        }
    }
    result
}

fn composite_over(front: &mut Plane, coverage: &Plane, back: &Plane) {
    parallel::for_each_block(front.values_mut(), &|block, front| {
        let behind = coverage.values()[block.clone()].iter().zip(&back.values()[block]);
        front
            .iter_mut()
            .zip(behind)
            .for_each(|(front, (&coverage, &back))| *front += (1.0 - coverage) * back);
    });
}

/// The picture of `content` with full coverage; alpha is the fourth plane, or 1 where there is none.
pub(in crate::methods) fn picture(content: Vec<Plane>) -> Image {
    let mut planes = content.into_iter();
    let mut next = || planes.next();
    let [red, green, blue] = std::array::from_fn(|_| next().unwrap_or_default());
    let alpha = next().map(|mut alpha| {
        // Rounding in a blur may make alpha slightly larger than 1.
        parallel::for_each_block(alpha.values_mut(), &|_, values| {
            values.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        });
        alpha
    });
    let alpha = alpha.unwrap_or_else(|| Plane::filled(red.width(), red.height(), 1.0));
    Image { planes: [red, green, blue, alpha] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{EffectKind, Layer};
    use crate::settings::{Origin, ParameterValues, Settings, Values};
    use crate::stack::StackKind;

    /// A scene one pixel high: for each layer the colour, alpha and CoC radius of its pixels.
    fn scene<const W: usize>(layers: &[[(f32, f32, f32); W]]) -> Scene {
        let plane = |layer: &[(f32, f32, f32); W], value: fn(&(f32, f32, f32)) -> f32| {
            Plane::from_fn(W, 1, |x, _| value(&layer[x]))
        };
        let layers = layers.iter().map(|layer| Layer {
            color: std::array::from_fn(|_| plane(layer, |pixel| pixel.0)),
            alpha: plane(layer, |pixel| pixel.1),
            coc_px: plane(layer, |pixel| pixel.2),
        });
        Scene::new(layers.collect(), StackKind::Coverage, 1, 100.0)
    }

    fn plan(scene: &Scene) -> Plan {
        let values = Values { method: Some("scatter".to_owned()), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        crate::methods::Registry::default().plan(&scene.analyze(), &settings).unwrap()
    }

    #[test]
    fn the_visible_image_blends_colours_and_has_the_coc_of_the_fragment_of_largest_weight() {
        // Premultiplied red 0.2 at alpha 0.25 over 0.3 at alpha 0.6 over 0.1 at alpha 1, in the second pixel without the last: 0.2 +
        // 0.75 · 0.3 = 0.425, coverage 0.25 + 0.75 · 0.6 = 0.7, transmittance 0.3.
        let veil = [(0.2, 0.25, -6.0); 2];
        let scene = scene(&[veil, [(0.3, 0.6, 4.0); 2], [(0.1, 1.0, 9.0), (0.0, 0.0, 0.0)]]);
        let plan = plan(&scene);
        let VisibleSurfaces { content, presence, coc_px } = visible_surfaces(scene, &plan);
        let near =
            |found: f32, expected: f32| assert!((found - expected).abs() < 1e-6, "{found}, {expected}");
        near(content[0].get(0, 0), 0.425 + 0.3 * 0.1);
        near(content[0].get(1, 0), 0.425);
        near(content[3].get(1, 0), 0.7);
        assert_eq!(presence.unwrap().values(), [1.0; 2]);
        assert_eq!(coc_px.values(), [4.0; 2]);
    }

    #[test]
    fn in_a_closed_scene_the_part_without_data_takes_the_colour_of_the_part_with_data() {
        let scene = scene(&[[(0.2, 0.25, -6.0), (0.3, 1.0, 2.0)]]);
        let plan = plan(&scene).forced(EffectKind::TransparentBackground, false);
        let VisibleSurfaces { content, presence, .. } = visible_surfaces(scene, &plan);
        assert_eq!((content.len(), presence), (3, None));
        assert_eq!(content[0].values(), [0.8, 0.3]);
    }

    #[test]
    fn a_pixel_that_hides_its_background_is_as_in_a_closed_scene() {
        // Of the first pixel 0.0005 of the light passes, a two-hundredth of what shows the background alone.
        let scene =
            scene(&[[(0.9, 0.9, 2.0), (0.0, 0.0, 0.0)], [(0.0995 / 0.1, 0.995, 3.0), (0.0, 0.0, 0.0)]]);
        let plan = plan(&scene);
        let VisibleSurfaces { content, .. } = visible_surfaces(scene, &plan);
        assert!((content[3].get(0, 0) - 1.0).abs() < 1e-3, "{}", content[3].get(0, 0));
        assert_eq!(content[3].get(1, 0), 0.0);
    }

    #[test]
    fn an_empty_pixel_lies_behind_the_surfaces_that_reach_it_and_in_focus_elsewhere() {
        let mut row = [(0.0, 0.0, 0.0); 40];
        (row[4], row[30]) = ((0.5, 1.0, 2.0), (0.5, 1.0, -2.0));
        let scene = scene(&[row]);
        let plan = plan(&scene);
        let Visible { coc_px, .. } = visible(scene, &plan);
        assert_eq!([coc_px.get(4, 0), coc_px.get(30, 0)], [2.0, -2.0], "surfaces keep theirs");
        assert_eq!([coc_px.get(5, 0), coc_px.get(11, 0)], [2.0; 2], "three CoC radii and a pixel away");
        assert_eq!([coc_px.get(12, 0), coc_px.get(29, 0)], [0.0; 2], "past that, and beside a near surface");
    }

    #[test]
    fn coverage_planes_composite_by_coverage_and_are_normalised_by_it() {
        let planes = |content, coverage| CoveragePlanes {
            content: vec![Plane::filled(1, 1, content); 3],
            coverage: Plane::filled(1, 1, coverage),
        };
        let mut front = planes(0.1, 0.5);
        front.over(&planes(0.4, 0.5));
        assert_eq!((front.content[0].get(0, 0), front.coverage.get(0, 0)), (0.1 + 0.5 * 0.4, 0.75));
        let pixel = front.into_picture().pixel(0, 0);
        assert!((pixel[0] - 0.4).abs() < 1e-6 && pixel[3] == 1.0, "{pixel:?}");
        assert_eq!(CoveragePlanes::unknown(1, 1, 4).into_picture().pixel(0, 0), [0.0; 4], "no coverage");
    }
}
