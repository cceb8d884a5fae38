//! `point-splat`: every source pixel scattered over its circle of confusion, into one of three layers of each pixel it
//! reaches.
//!
//! Lee, Kim & Choi 2008, "Real-Time Depth-of-Field Rendering Using Point Splatting on Per-Pixel Layers". A visible image
//! `V` and an image `H` of what it hides are scattered; what arrives at a pixel is in front of what is visible there, at
//! the same depth, or behind it; the three layers are blended.
//!
//! | step | module | paper |
//! | --- | --- | --- |
//! | visible and hidden image | [`hidden`] | section 3.2, eq. 4 |
//! | fewer points where that does not show | [`reduce`] | section 5 |
//! | sprites | [`sprites`] | section 3.3, eq. 5 |
//! | scatter into layers, blend | [`mod@splat`], [`layers`] | sections 3.4 and 3.5, eqs. 6 and 7 |
//!
//! Where the paper is silent: its "normalised scale" of depth is taken to be that of a depth buffer over the scene's range,
//! so affine in 1/z and in CoC radius. `H` is, like `V`, all that a camera would see: fragments that pass the tests, over
//! one another. The neighbours of eq. 4 are twelve fixed points with the symmetries of the pixel grid, so that a slope
//! that goes on evenly has a depth change of zero. Sprites have rims weighted by how much of the pixel they cover, not
//! those of a rasteriser, so that they grow evenly with the CoC; their radii have steps of 1/64. Alpha over one in eq. 7
//! lets nothing through, rather than less than nothing. Past the frame's border its pixels go on, or the missing light of
//! what is blurred there would be taken for see-through. Reduced points overlap the others at half the weight of either,
//! so that no energy is made; their sprite is the mean of their pixels' own, so that there are no holes between the two
//! kinds; and what stands out of its four pixels is not reduced, or highlights would move. Extrapolated highlights (section 4,
//! eq. 8) are for every method: see [`crate::scene::Extrapolation`].
//!
//! Cost: one masked add for each point and pixel of its sprite, clipped to the frame: O(pixels · C²), of which acceleration
//! saves up to three quarters; with a CoC as large as the frame, O(pixels²). Memory: the scene, some 32 bytes a point, of
//! which a pixel has at most two, and the picture. Limits: one hidden layer and three layers a pixel, so where more surfaces
//! meet within a CoC some are missing or mixed: the far side of an object thicker than ε hides what is behind it, and keeps
//! its outline hard. Nothing is seen past what lies behind focus.
//!
//! GPU twin: `gpu` and `shaders/methods/point_splat.wgsl`.

mod cost;
#[cfg(feature = "gpu")]
mod gpu;
mod parameters;
mod hidden;
mod layers;
mod reduce;
mod splat;
mod sprites;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{Method, MethodInfo, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::{Peel, coc_range_px, peels, picture};
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use hidden::{Edge, Fragment, Hiding, seen, visible_coc_px};
use layers::{Light, Limits};
use parameters::PointSplatParameters;
use rayon::prelude::*;
use reduce::{Shares, reduced};
use splat::{Grid, Point, splat};
use sprites::{Centre, Sprite, Sprites};

/// What the method's three layers, and its one hidden image, cannot do.
static DEVIATIONS: [Deviation; 4] = [
    Deviation {
        law: Law::Place,
        within: [0.0, 0.501],
        reason: "section 5 splats four blurred pixels as one, where they meet: half a pixel off",
    },
    Deviation {
        law: Law::NoCracks,
        within: [0.0, 0.26],
        reason: "of a slanted surface less than one arrives in its own layer (eq. 6), and eq. 7 takes the rest for see-through",
    },
    Deviation {
        law: Law::NoCracksAcrossCorners,
        within: [0.25, 0.32],
        reason: "of a slanted surface less than one arrives in its own layer (eq. 6), and eq. 7 takes the rest for see-through",
    },
    Deviation {
        law: Law::Convergence,
        within: [35.0, 39.0],
        reason: "three layers a pixel and one hidden image stand for all depths",
    },
];

/// Lee, Kim & Choi.
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
        let size = scene.picture_size();
        let peels = peels(scene, plan);
        let content = if plan.does(EffectKind::TransparentBackground) {
            scatter::<4>(peels, size, plan, progress)
        } else {
            scatter::<3>(peels, size, plan, progress)
        };
        Ok(picture(content))
    }

    #[cfg(feature = "gpu")]
    fn gpu(&self) -> Option<&dyn crate::methods::contract::GpuBackend> {
        Some(self)
    }
}

/// Content planes of the picture: `V` and `H` of `peels`, splatted.
fn scatter<const N: usize>(
    peels: Vec<Peel>,
    size: (usize, usize),
    plan: &Plan,
    progress: &Progress<'_>,
) -> Vec<Plane> {
    let Prepared { grids, sprites, visible_px } = Prepared::<N>::new(peels, size, plan);
    let limits = Limits::of_picture(&visible_px, plan.parameters.get::<PointSplatParameters>().delta);
    drop(visible_px);
    splat(&grids, &sprites, &limits, size, progress)
}

/// What is splatted.
struct Prepared<const N: usize> {
    /// Reduced points, where there are any, and points at full resolution.
    grids: Vec<Grid<N>>,
    sprites: Sprites,
    /// CoC radius of what is visible, by which pixels have their layers.
    visible_px: Plane,
}

impl<const N: usize> Prepared<N> {
    /// The points of `V` and `H` of `peels`.
    fn new(peels: Vec<Peel>, (width, height): (usize, usize), plan: &Plan) -> Self {
        let parameters = plan.parameters.get::<PointSplatParameters>();
        let hiding = Hiding::new(parameters.epsilon, parameters.edge, coc_range_px(plan));
        let sprites = Sprites::new(plan.optics.aperture, &parameters.intensity);
        let visible_px = visible_coc_px(&peels, (width, height));
        let edge = |at: usize| hiding.edge(&visible_px, at % width, at / width);
        let edges: Vec<Edge> = (0..width * height).into_par_iter().map(edge).collect();
        let images = Images { peels, visible_px, edges, hiding, parameters };
        let mut grids = Vec::new();
        let mut shares = Shares::none();
        if parameters.accelerated {
            let surface = (&images.visible_px, &images.edges[..]);
            let (reduced_shares, grid) = reduced(|x, y| images.visible::<N>(x, y), surface, parameters.delta);
            shares = reduced_shares;
            grids.push(grid);
        }
        grids.push(images.points(&shares));
        Self { grids, sprites, visible_px: images.visible_px }
    }
}

/// The visible and the hidden image.
struct Images<'a> {
    peels: Vec<Peel>,
    visible_px: Plane,
    edges: Vec<Edge>,
    hiding: Hiding,
    parameters: &'a PointSplatParameters,
}

impl Images<'_> {
    /// `V` at `x, y`.
    fn visible<const N: usize>(&self, x: usize, y: usize) -> Option<Fragment<N>> {
        Some(seen(&self.peels, (x, y), f32::NEG_INFINITY)?.whole())
    }

    /// `H` at `x, y`.
    fn hidden<const N: usize>(&self, x: usize, y: usize) -> Option<Fragment<N>> {
        if !self.parameters.hidden || self.edges[y * self.visible_px.width() + x] == Edge::None {
            return None;
        }
        seen(&self.peels, (x, y), self.hiding.hidden_from_px(self.visible_px.get(x, y)))
    }

    /// The points at full resolution: what of `V` is not in reduced ones, by `shares`, and `H`.
    fn points<const N: usize>(&self, shares: &Shares) -> Grid<N> {
        let row = |y: usize| {
            let points = |x: usize| {
                let point = |fragment: Fragment<N>, share: f32, hidden| Point {
                    column: x as i32,
                    sprite: Sprite::of(fragment.coc_px),
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
        let rows = (0..self.visible_px.height()).into_par_iter().map(row).collect();
        Grid { centre: Centre::Pixel, rows }
    }
}
