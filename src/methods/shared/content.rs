//! The stack as content and coverage, for methods that blend and then normalise; the same for closed and transparent backgrounds.
//!
//! Such methods divide accumulated content by accumulated coverage. This is correct only if coverage means that the layer has
//! data, so the two meanings of alpha are separate: *coverage* is the fraction of a pixel for which a layer has data; *content*
//! is the data: red, green, blue and, where the background is transparent, alpha. A transparent background counts as data: it is
//! a backdrop behind all layers, with full coverage and empty content.

use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::scene::{EffectKind, OPAQUE_ALPHA, Scene};
use rayon::prelude::*;

/// Planes of content and of its coverage.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct CoveragePlanes {
    /// Red, green, blue and, where the background is transparent, alpha; premultiplied by coverage.
    pub content: Vec<Plane>,
    /// Fraction of each pixel that has data, 0 … 1.
    pub coverage: Plane,
}

/// A layer of a scene.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Peel {
    /// Content and coverage of the layer.
    pub covered: CoveragePlanes,
    /// Signed CoC radius in pixels; valid where coverage is above 0.
    pub coc_px: Plane,
}

/// The image visible to the camera: one colour and one CoC radius per pixel, no holes.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::methods) struct Visible {
    /// Red, green, blue and, where the background is transparent, alpha.
    pub content: Vec<Plane>,
    /// Signed CoC radius in pixels of the fragment with the largest weight.
    pub coc_px: Plane,
}

/// CoC radius of a transparent background: behind all layers, and in focus where no layer is behind focus, since blurring an
/// empty background has no effect.
fn backdrop_coc_px(plan: &Plan) -> f32 {
    plan.coc_range_px[1].max(0.0)
}

/// Minimum and maximum CoC radius in pixels of the peels, a transparent background included.
pub(in crate::methods) fn coc_range_px(plan: &Plan) -> [f32; 2] {
    let [near, far] = plan.coc_range_px;
    [near, if plan.does(EffectKind::TransparentBackground) { backdrop_coc_px(plan) } else { far }]
}

/// The layers of `scene` at one sample per pixel, nearest first, then the backdrop of a transparent background.
pub(in crate::methods) fn peels(scene: Scene, plan: &Plan) -> Vec<Peel> {
    let scene = scene.merged();
    let transparent = plan.does(EffectKind::TransparentBackground);
    let (width, height) = (scene.width(), scene.height());
    let backdrop = transparent.then(|| Peel {
        covered: CoveragePlanes {
            content: vec![Plane::zeros(width, height); 4],
            coverage: Plane::filled(width, height, 1.0),
        },
        coc_px: Plane::filled(width, height, backdrop_coc_px(plan)),
    });
    let layers = scene.layers.into_iter().map(|layer| {
        let alpha = transparent.then(|| layer.alpha.clone());
        let content = layer.color.into_iter().chain(alpha).collect();
        Peel { covered: CoveragePlanes { content, coverage: layer.alpha }, coc_px: layer.coc_px }
    });
    layers.chain(backdrop).collect()
}

/// The image of `scene` visible to the camera, at one sample per pixel.
pub(in crate::methods) fn visible(scene: Scene, plan: &Plan) -> Visible {
    let scene = scene.merged();
    let transparent = plan.does(EffectKind::TransparentBackground);
    let (width, height) = scene.picture_size();
    let Image { planes: [mut red, mut green, mut blue, alpha] } = scene.pinhole();
    let coc_px = Plane::from_fn(width, height, |x, y| {
        let (mut transmittance, mut max_weight, mut coc) = (1.0, 0.0, backdrop_coc_px(plan));
        for layer in &scene.layers {
            let alpha = layer.alpha.get(x, y);
            if transmittance * alpha > max_weight {
                (max_weight, coc) = (transmittance * alpha, layer.coc_px.get(x, y));
            }
            transmittance *= 1.0 - alpha;
        }
        if transparent && transmittance > max_weight { backdrop_coc_px(plan) } else { coc }
    });
    if transparent {
        return Visible { content: vec![red, green, blue, alpha], coc_px };
    }
    // Closed background: the part of a pixel without data takes the colour of the part with data.
    for plane in [&mut red, &mut green, &mut blue] {
        let values = plane.values_mut().par_iter_mut().zip(alpha.values());
        values.for_each(|(value, &alpha)| {
            *value /= if alpha > 0.0 && alpha < OPAQUE_ALPHA { alpha } else { 1.0 }
        });
    }
    Visible { content: vec![red, green, blue], coc_px }
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
        scratch: impl Fn() -> T + Sync + Send,
        row: impl Fn(&mut T, usize, &mut [&mut [f32]]) + Sync + Send,
    ) {
        let mut planes = std::mem::take(&mut self.content);
        planes.push(std::mem::take(&mut self.coverage));
        let rows = row_blocks(&mut planes, 1).into_par_iter().enumerate();
        rows.for_each_init(scratch, |scratch, (y, mut planes)| row(scratch, y, &mut planes));
        self.coverage = planes.pop().unwrap_or_default();
        self.content = planes;
    }

    /// Composites these planes over `behind`: `A ⊕ B = A + (1 − A.a) B`, premultiplied.
    pub(in crate::methods) fn over(&mut self, behind: &Self) {
        for (front, back) in self.content.iter_mut().zip(&behind.content) {
            composite_over(front, &self.coverage, back);
        }
        let values = self.coverage.values_mut().par_iter_mut().zip(behind.coverage.values());
        values.for_each(|(front, &back)| *front += (1.0 - *front) * back);
    }

    /// Divides content by coverage: the picture, transparent where coverage is 0.
    pub(in crate::methods) fn into_picture(mut self) -> Image {
        for plane in &mut self.content {
            let values = plane.values_mut().par_iter_mut().zip(self.coverage.values());
            values
                .for_each(|(value, &coverage)| *value = if coverage > 0.0 { *value / coverage } else { 0.0 });
        }
        picture(self.content)
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
    let values = front.values_mut().par_iter_mut().zip(coverage.values()).zip(back.values());
    values.for_each(|((front, &coverage), &back)| *front += (1.0 - coverage) * back);
}

/// The picture of `content` with full coverage; alpha is the fourth plane, or 1 where there is none.
pub(in crate::methods) fn picture(content: Vec<Plane>) -> Image {
    let mut planes = content.into_iter();
    let mut next = || planes.next();
    let [red, green, blue] = std::array::from_fn(|_| next().unwrap_or_default());
    let alpha = next().map(|mut alpha| {
        // Rounding in a blur may make alpha slightly larger than 1.
        alpha.values_mut().par_iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        alpha
    });
    let alpha = alpha.unwrap_or_else(|| Plane::filled(red.width(), red.height(), 1.0));
    Image { planes: [red, green, blue, alpha] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Layer;
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
    fn a_transparent_background_is_an_empty_peel_of_full_coverage_behind_all_others() {
        let scene = scene(&[[(0.5, 1.0, -6.0), (0.0, 0.0, 0.0)]]);
        let plan = plan(&scene);
        let peels = peels(scene, &plan);
        assert_eq!(peels.len(), 2);
        assert_eq!(peels[0].covered.content[3].values(), [1.0, 0.0], "the object is opaque");
        assert_eq!(peels[1].covered.coverage.values(), [1.0; 2], "full coverage behind the object too");
        assert_eq!(peels[1].covered.content[3].values(), [0.0; 2], "and transparent");
        assert_eq!(coc_range_px(&plan), [-6.0, 0.0], "in focus, since no layer is behind focus");
    }

    #[test]
    fn a_closed_background_needs_neither_alpha_nor_backdrop() {
        let scene = scene(&[[(0.5, 1.0, -6.0), (0.2, 1.0, 3.0)]]);
        let plan = plan(&scene);
        let peels = peels(scene, &plan);
        assert_eq!((peels.len(), peels[0].covered.content.len()), (1, 3));
        assert_eq!(coc_range_px(&plan), [-6.0, 3.0]);
    }

    #[test]
    fn the_visible_image_blends_colours_and_has_the_coc_of_the_fragment_of_largest_weight() {
        // Premultiplied red 0.2 at alpha 0.25 over 0.3 at alpha 0.6: 0.2 + 0.75 · 0.3 = 0.425, coverage 0.25 + 0.75 · 0.6 = 0.7.
        let scene = scene(&[[(0.2, 0.25, -6.0)], [(0.3, 0.6, 4.0)]]);
        let plan = plan(&scene);
        let Visible { content, coc_px } = visible(scene, &plan);
        assert!((content[0].get(0, 0) - 0.425 / 0.7).abs() < 1e-6, "{}", content[0].get(0, 0));
        assert_eq!(coc_px.get(0, 0), 4.0);
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
