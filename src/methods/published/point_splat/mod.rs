//! `point-splat`: every source pixel is splatted over its circle of confusion, into one of three layers of each pixel
//! that it reaches.
//!
//! Lee, Kim & Choi 2008, "Real-Time Depth-of-Field Rendering Using Point Splatting on Per-Pixel Layers". A visible
//! image `V` and an image `H` of hidden surfaces are splatted. A splat falls into the layer in front of the surface
//! visible at a pixel, at the same depth, or behind it. The three layers are blended.
//!
//! | step | module | paper |
//! | --- | --- | --- |
//! | visible and hidden image | [`hidden`] | section 3.2, eq. 4 |
//! | fewer points where the difference is not visible | [`reduce`] | section 5 |
//! | sprites | [`sprites`] | section 3.3, eq. 5 |
//! | splat into layers, blend | [`mod@splat`], [`layers`] | sections 3.4 and 3.5, eqs. 6 and 7 |
//!
//! Where the paper gives no rule:
//! * *Depth scale.* Its "normalised scale" is taken to be that of a depth buffer over the scene's range: affine in
//!   1/z and in CoC radius.
//! * *Hidden image.* `H` is, like `V`, the image of a camera: fragments that pass the tests, composited.
//! * *Depth changes.* The neighbours of eq. 4 are twelve fixed points with the symmetries of the pixel grid, so that
//!   a constant slope has a depth change of zero.
//! * *Sprites.* Edge pixels are weighted by their coverage, unlike those of a rasteriser, so that sprites grow
//!   smoothly with the CoC. Radii have steps of 1/64.
//! * *Blending.* Alpha over one in eq. 7 counts as a transmittance of zero, not as a negative one.
//! * *Background.* It comes behind all layers ([`crate::methods::shared::Backdrop`]), where the layers leave light through. Pixels
//!   without a surface have no point.
//! * *Border.* Pixels at the frame's border are repeated past it; otherwise the light missing there would count as
//!   transparency.
//! * *Reduced points.* They overlap the others at half the weight of either, so that energy is preserved. Their
//!   sprite is the mean of their pixels' sprites, so that no holes open between the two kinds. Blocks with an outlier
//!   are not reduced, as highlights would move.
//! * *Extrapolated highlights* (section 4, eq. 8) apply to every method: see [`crate::scene::Extrapolation`].
//!
//! Cost: one masked add per point and pixel of its sprite, clipped to the frame: O(pixels · C²), of which
//! acceleration saves up to three quarters; with a CoC as large as the frame, O(pixels²). Memory: the scene, about 32
//! bytes per point with at most two points per pixel, and the picture. Limits: there are one hidden image and three
//! layers per pixel, so where more surfaces lie within a CoC some are missing or mixed. The far side of an object
//! thicker than ε hides the surfaces behind it, and the object's outline stays sharp. Surfaces hidden by an object
//! behind focus are not seen.
//!
//! GPU backend: `gpu` and `shaders/methods/point_splat.wgsl`.

mod cost;
#[cfg(feature = "gpu")]
mod gpu;
mod hidden;
mod layers;
mod parameters;
mod reduce;
mod splat;
mod sprites;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::{Method, MethodInfo, Plan, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{Backdrop, Peel, before, peels, picture};
use crate::parallel;
use crate::scene::{Background, EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use hidden::{Edge, Fragment, OcclusionTests, composite, visible_coc_px};
use layers::{Light, Limits};
use parameters::PointSplatParameters;
use reduce::{ReducedShares, reduce_points};
use splat::{Grid, Point, splat};
use sprites::{Centre, Sprite, Sprites};
use std::sync::Arc;

/// Deviations that follow from three layers per pixel and one hidden image.
static DEVIATIONS: [Deviation; 4] = [
    Deviation {
        law: Law::Place,
        within: [0.0, 0.501],
        reason: "section 5 splats four blurred pixels as one at their common corner: half a pixel off",
    },
    Deviation {
        law: Law::NoCracks,
        within: [0.0, 0.26],
        reason: "a slanted surface falls into its own layer with an alpha below one (eq. 6), which eq. 7 takes for transparency",
    },
    Deviation {
        law: Law::NoCracksAcrossCorners,
        within: [0.25, 0.32],
        reason: "a slanted surface falls into its own layer with an alpha below one (eq. 6), which eq. 7 takes for transparency",
    },
    Deviation {
        law: Law::Convergence,
        within: [35.0, 39.0],
        reason: "three layers per pixel and one hidden image stand for all depths",
    },
];

/// The method.
#[derive(Debug)]
pub(in crate::methods) struct PointSplat;

impl Method for PointSplat {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "point-splat",
            source: "Lee, Kim & Choi 2008",
            role: Role::Paper,
            summary: "pixels scattered as sprites into three layers of each pixel that they reach",
            effects: &[EffectKind::Merge],
            lens_samples: None,
            steps: &["hidden=false", "accelerated=true", "accelerated=false"],
            deviations: &DEVIATIONS,
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<PointSplatParameters>()
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let backdrop = Backdrop::new(&scene, plan);
        let (content, coverage) = if backdrop.is_some() {
            splat_picture::<4>(scene, plan, progress)
        } else {
            splat_picture::<3>(scene, plan, progress)
        };
        Ok(before(picture(content), &coverage, backdrop.as_ref()))
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

/// Splats `V` and `H` of `scene`; returns the content planes of the picture, and its coverage.
fn splat_picture<const N: usize>(scene: Scene, plan: &Plan, progress: &Progress<'_>) -> (Vec<Plane>, Plane) {
    let size = scene.picture_size();
    let SplatInputs { grids, sprites, visible_px } = SplatInputs::<N>::new(scene, plan);
    let limits = Limits::from_picture(&visible_px, plan.parameters.get::<PointSplatParameters>().delta);
    drop(visible_px);
    splat(&grids, &sprites, &limits, size, progress)
}

/// Inputs of the splat pass.
struct SplatInputs<const N: usize> {
    /// Reduced points, if any, and points at full resolution.
    grids: Vec<Grid<N>>,
    sprites: Sprites,
    /// CoC radius of the visible surface, which defines the layers of a pixel.
    visible_px: Plane,
}

impl<const N: usize> SplatInputs<N> {
    /// Prepares the points of `V` and `H` of `scene`.
    fn new(scene: Scene, plan: &Plan) -> Self {
        let parameters = plan.parameters.get::<PointSplatParameters>();
        let tests = OcclusionTests::new(parameters.epsilon, parameters.edge, plan.coc_range_px);
        let (width, height) = scene.picture_size();
        let background = plan.background(&scene);
        let peels = peels(scene);
        let sprites = Sprites::new(plan.optics.aperture, &parameters.intensity);
        let visible_px = visible_coc_px(&peels, (width, height));
        let edges_of_row = |y: usize| (0..width).map(|x| tests.edge(&visible_px, x, y)).collect();
        let edges: Vec<Edge> = parallel::flat_map(height, &edges_of_row);
        let images = Images { peels, background, visible_px, edges, tests, parameters };
        let mut grids = Vec::new();
        let mut shares = ReducedShares::none();
        if parameters.accelerated {
            let surface = (&images.visible_px, &images.edges[..]);
            let (block_shares, grid) =
                reduce_points(|x, y| images.visible::<N>(x, y), surface, parameters.delta);
            shares = block_shares;
            grids.push(grid);
        }
        grids.push(images.points(&shares));
        Self { grids, sprites, visible_px: images.visible_px }
    }
}

/// The visible and the hidden image.
struct Images<'a> {
    peels: Vec<Peel>,
    background: Option<Arc<Background>>,
    visible_px: Plane,
    edges: Vec<Edge>,
    tests: OcclusionTests,
    parameters: &'a PointSplatParameters,
}

impl Images<'_> {
    /// `V` at `x, y`.
    fn visible<const N: usize>(&self, x: usize, y: usize) -> Option<Fragment<N>> {
        let share = self.background.as_ref().map_or(0.0, |background| background.share().get(x, y));
        Some(composite(&self.peels, (x, y), f32::NEG_INFINITY)?.normalised(share))
    }

    /// `H` at `x, y`.
    fn hidden<const N: usize>(&self, x: usize, y: usize) -> Option<Fragment<N>> {
        if !self.parameters.hidden || self.edges[y * self.visible_px.width() + x] == Edge::None {
            return None;
        }
        composite(&self.peels, (x, y), self.tests.hidden_from_px(self.visible_px.get(x, y)))
    }

    /// The points at full resolution: the part of `V` that is not in reduced points, by `shares`, and `H`.
    fn points<const N: usize>(&self, shares: &ReducedShares) -> Grid<N> {
        let row = |y: usize| {
            let points = |x: usize| {
                let point = |fragment: Fragment<N>, share: f32, hidden| Point {
                    column: x as i32,
                    sprite: Sprite::from_coc_px(fragment.coc_px),
                    light: Light {
                        content: fragment.content.map(|value| share * value),
                        alpha: share * fragment.weight,
                        coc_px: fragment.coc_px,
                        hidden,
                    },
                };
                let share = 1.0 - shares.at(x, y);
                let visible = if share > 0.0 { self.visible(x, y) } else { None };
                let visible = visible.map(|fragment| point(fragment, share, false));
                visible.into_iter().chain(self.hidden(x, y).map(|fragment| point(fragment, 1.0, true)))
            };
            (0..self.visible_px.width()).flat_map(points).collect()
        };
        let rows = parallel::map(self.visible_px.height(), &row);
        Grid { centre: Centre::Pixel, rows }
    }
}
