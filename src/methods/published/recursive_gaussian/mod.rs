//! `recursive-gaussian`: depth layers matted out of the peels, blurred and composited in one cascade of Gaussians.
//!
//! Schedl & Wimmer 2012, "A Layered Depth-of-Field Method for Solving Partial Occlusion". The fragments of all peels
//! are distributed over depth layers ([`matting`]). In front of and behind focus separately, from the outermost layer
//! towards focus, the accumulated layers are blurred a little and composited with the next layer, so that the
//! outermost layers are blurred most often (eqs. 12 and 13). The picture is normalised by its coverage (section
//! 3.3.1).
//!
//! Misprints and gaps of the paper, and the rules used here: the falling ramp of eq. 4 is that of its Figure 4
//! ([`matting`]); the nearest layer has a finite boundary behind it ([`matting::Matte::new`]); eq. 15 runs away from
//! focus ([`layers::sigma_px`]); translucent fragments, which the paper does not cover, count once ([`matting`]); the
//! background comes behind all layers ([`Backdrop`]). The paper allows "various methods" for a Gaussian; the one
//! here has exact variance and the same cost for every size ([`gaussian`]).
//!
//! Cost: pixels × layers × peels for the matting, pixels × layers for the blur, whatever its size. The number of
//! layers grows with the CoC to the power of 2/3 (nine per side for 32 px). Memory: the scene, which is modified in
//! place, and two pictures; one more where layers are blurred one by one.
//!
//! Limits: a blurred point is a Gaussian, not a disc, and shows no aperture blades. Two more follow from the matting
//! as printed. A visible fragment shows in its own layer and in the next *nearer* one. So it is blurred too much in
//! front of focus and too little behind it, by half the distance between layers on average, and half of the surface
//! in focus is softened by a pixel. `anchor = 0`, a layer's boundary at its own CoC (as in Kraus 2011), removes this.
//! And layers overlap: each fragment is in two of them, which shows once the blur is wider than the object. Thin bars
//! far from focus come out up to twice as dense.
//!
//! GPU backend: `shaders/methods/recursive_gaussian.wgsl`.

mod cost;
mod gaussian;
#[cfg(feature = "gpu")]
mod gpu;
mod layers;
mod matting;
mod parameters;

use crate::error::Error;
use crate::image::Image;
use crate::methods::contract::{Method, MethodInfo, Plan, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{Backdrop, CoveragePlanes, peels};
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use layers::{Layers, cascade_sigma_px, sigma_px};
use matting::{CompositeOrder, DepthPeel, Matte, composite_layer};
use parameters::RecursiveGaussianParameters;

/// Deviations that follow from layers that overlap by design, and from a Gaussian in place of a disc.
const DEVIATIONS: [Deviation; 11] = [
    Deviation {
        law: Law::Spread,
        within: [0.36, 3.13],
        reason: "by eq. 4 a fragment is blurred between its own layer and the next nearer one, whatever its own CoC and the blades",
    },
    Deviation {
        law: Law::Sharpness,
        within: [0.24, 0.27],
        reason: "half of the surface in focus fades into the first layer in front of it, which is blurred by a pixel",
    },
    Deviation {
        law: Law::Occlusion,
        within: [0.28, 0.31],
        reason: "surfaces in focus are softened, as for sharpness; no hidden surface shows through",
    },
    Deviation {
        law: Law::Transparency,
        within: [0.999, 1.24],
        reason: "layers overlap: where blur lowers the coverage of a fragment, the other layers that hold it add to it",
    },
    Deviation {
        law: Law::SeeThrough,
        within: [0.25, 0.27],
        reason: "layers overlap, as for transparency: a bar narrower than its blur is too dense",
    },
    Deviation {
        law: Law::NoCracks,
        within: [0.001, 0.01],
        reason: "a blurred layer loses coverage where it ends, and surfaces behind its neighbours show through",
    },
    Deviation {
        law: Law::NoCracksAcrossCorners,
        within: [0.01, 0.032],
        reason: "as for gentler slants: the steeper, the narrower the layers",
    },
    Deviation {
        law: Law::Locality,
        within: [0.0, 0.0012],
        reason: "the blur is a Gaussian, which reaches past the disc",
    },
    Deviation {
        law: Law::Edge,
        within: [0.14, 0.23],
        reason: "a fragment is blurred by the Gaussians of two layers, not by its disc",
    },
    Deviation {
        law: Law::Convergence,
        within: [32.5, 33.5],
        reason: "a Gaussian of the nearest layers' size stands for the disc",
    },
    Deviation {
        law: Law::Supersampling,
        within: [30.5, 31.7],
        reason: "a Gaussian of the nearest layers' size stands for the disc",
    },
];

/// The method.
#[derive(Debug)]
pub(in crate::methods) struct RecursiveGaussian;

impl Method for RecursiveGaussian {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "recursive-gaussian",
            source: "Schedl & Wimmer 2012",
            role: Role::Paper,
            summary: "depth layers matted out of the peels, blurred and composed in a cascade of Gaussians",
            effects: &[EffectKind::Merge],
            lens_samples: None,
            steps: &["layers=4", "layers=16", "layers=auto"],
            deviations: &DEVIATIONS,
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<RecursiveGaussianParameters>()
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let parameters = plan.parameters.get::<RecursiveGaussianParameters>();
        let (size, coc_infinity_px) = (scene.picture_size(), scene.coc_infinity_px);
        let layers = Layers::new(plan.coc_range_px, coc_infinity_px, parameters);
        let backdrop = Backdrop::new(&scene, plan);
        let peels: Vec<DepthPeel> =
            peels(scene).into_iter().map(|peel| DepthPeel::new(peel, coc_infinity_px)).collect();
        let focus_side = |order| FocusSide {
            composite: CoveragePlanes::unknown(size.0, size.1, 3),
            order,
            has_content: false,
        };
        let (mut front, mut back) = (focus_side(CompositeOrder::Under), focus_side(CompositeOrder::Over));
        let stack = Stack { layers, peels: &peels, cascaded: parameters.cascaded };
        let mut layers_done = 0;
        let mut add = |focus_side: &mut FocusSide, layer| {
            focus_side.add(&stack, layer);
            layers_done += 1;
            progress(layers_done as f32 / layers.count() as f32);
        };
        (-layers.front..0).for_each(|layer| add(&mut front, layer));
        (0..=layers.back).rev().for_each(|layer| add(&mut back, layer));
        front.composite.over(&back.composite);
        Ok(front.composite.into_picture_before(backdrop.as_ref()))
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

/// The layers, and the peels that they are matted from.
struct Stack<'a> {
    layers: Layers,
    peels: &'a [DepthPeel],
    cascaded: bool,
}

/// The layers on one side of focus, composited from the outermost towards focus.
struct FocusSide {
    composite: CoveragePlanes,
    order: CompositeOrder,
    /// Whether any fragment was added.
    has_content: bool,
}

impl FocusSide {
    /// Adds the next layer towards focus.
    ///
    /// Cascaded, it is composited with the layers added before, and all are blurred by `σ̂_k` (eq. 13). Otherwise it
    /// is blurred alone, by `σ_k` (eq. 11), and then composited.
    fn add(&mut self, stack: &Stack<'_>, layer: i32) {
        let matte = Matte::new(&stack.layers, layer);
        if stack.cascaded || layer == 0 {
            self.has_content |= composite_layer(&mut self.composite, stack.peels, &matte, self.order);
            if self.has_content {
                blur(&mut self.composite, cascade_sigma_px(layer));
            }
            return;
        }
        let (width, height) = (self.composite.coverage.width(), self.composite.coverage.height());
        let mut layer_planes = CoveragePlanes::unknown(width, height, self.composite.content.len());
        if !composite_layer(&mut layer_planes, stack.peels, &matte, self.order) {
            return;
        }
        blur(&mut layer_planes, sigma_px(layer));
        match self.order {
            CompositeOrder::Over => {
                layer_planes.over(&self.composite);
                self.composite = layer_planes;
            }
            CompositeOrder::Under => self.composite.over(&layer_planes),
        }
        self.has_content = true;
    }
}

/// Blurs content and coverage alike.
fn blur(composite: &mut CoveragePlanes, sigma_px: f32) {
    if sigma_px > 0.0 {
        let planes = composite.content.iter_mut().chain([&mut composite.coverage]);
        planes.for_each(|plane| gaussian::blur(plane, sigma_px));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::scene::Layer;
    use crate::settings::{Origin, ParameterValues, Settings, Values};
    use crate::stack::StackKind;
    use serde_json::Value as Json;

    /// An emitter in the middle of a black plane of CoC radius `coc_px`, blurred with parameter `key` set to `value`.
    fn blurred(coc_px: f32, (key, value): (&str, Json)) -> Image {
        let emitter = |x, y| if (x, y) == (40, 40) { 1.0 } else { 0.0 };
        let layer = Layer {
            color: std::array::from_fn(|_| Plane::from_fn(81, 81, emitter)),
            alpha: Plane::filled(81, 81, 1.0),
            coc_px: Plane::filled(81, 81, coc_px),
        };
        let scene = Scene::new(vec![layer], StackKind::PointSampled, 1, 1000.0);
        let values = Values { method: Some("recursive-gaussian".to_owned()), ..Values::default() };
        let mut parameters = ParameterValues::default();
        parameters.set("recursive-gaussian", key, value);
        let settings = Settings::resolve(&[(Origin::Flag, &values)], parameters);
        let plan = crate::methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
        RecursiveGaussian.blur(scene, &plan, &|_| {}).unwrap()
    }

    /// Variance along x of the picture's red channel about its middle.
    fn variance(image: &Image) -> f32 {
        let (mut sum, mut square) = (0.0, 0.0);
        for y in 0..81 {
            for x in 0..81 {
                let value = image.planes[0].get(x, y);
                sum += value;
                square += value * (x as f32 - 40.0).powi(2);
            }
        }
        square / sum
    }

    #[test]
    fn the_cascade_blurs_a_surface_like_a_single_blur() {
        for coc in [-12.0, -3.0, 3.0, 12.0] {
            let cascade = blurred(coc, ("cascaded", true.into()));
            let single = blurred(coc, ("cascaded", false.into()));
            let (cascade_variance, variance) = (variance(&cascade), variance(&single));
            assert!(
                (cascade_variance / variance - 1.0).abs() < 1e-3,
                "c = {coc}: variance {cascade_variance} and {variance}"
            );
            let peak = single.planes[0].get(40, 40);
            let pairs = cascade.planes[0].values().iter().zip(single.planes[0].values());
            let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // The peak of a single blur is lower than a Gaussian's by less than 4 % along each axis.
            assert!(off < 0.08 * peak, "c = {coc}: {} of the peak", off / peak);
        }
    }

    #[test]
    fn a_surface_at_the_boundary_of_its_layer_has_the_variance_of_its_disc() {
        // With the boundary at the layer's own CoC radius, 4 σ_2 / 2 = 2 √5, no part fades into a neighbour.
        for side in [-1.0, 1.0] {
            let radius = 2.0 * 5f32.sqrt();
            let image = blurred(side * radius, ("anchor", 0.0.into()));
            let disc = radius * radius / 4.0;
            assert!((variance(&image) / disc - 1.0).abs() < 1e-3, "{} for {disc}", variance(&image));
        }
    }

    #[test]
    fn the_printed_matting_blurs_a_surface_between_its_layer_and_the_next_nearer_one() {
        // At c = ±2, between the boundaries 1 and 3.24, the nearer layer has the share (3.24 − 2) / 2.24 = 0.55 behind focus
        // (variances 0 and 1) and (2 − 1) / 2.24 = 0.45 in front of it (variances 5 and 1).
        let variance_of = |coc: f32| variance(&blurred(coc, ("cascaded", true.into())));
        let boundary = 1.0 + 5f32.sqrt();
        let farther = (2.0 - 1.0) / (boundary - 1.0);
        assert!((variance_of(2.0) - farther).abs() < 2e-3, "{}", variance_of(2.0));
        assert!((variance_of(-2.0) - (1.0 + 4.0 * farther)).abs() < 2e-2, "{}", variance_of(-2.0));
    }
}
