//! Depth layers matted out of the peels, blurred and composed in one cascade of Gaussians.
//!
//! Schedl & Wimmer 2012, "A Layered Depth-of-Field Method for Solving Partial Occlusion". The fragments of all peels are
//! shared out among depth layers ([`matting`]); from the outermost layer towards focus, in front of and behind focus apart,
//! what is there is blurred a little and composed with the next layer, so that the outermost layers are blurred again and
//! again (eqs. 12 and 13). The picture is normalised by its coverage (section 3.3.1).
//!
//! Misprints and gaps of the paper, and what is done here: the falling ramp of eq. 4 is the one of its Figure 4
//! ([`matting`]); the nearest layer has a finite boundary behind it ([`matting::Matte::new`]); eq. 15 runs away from
//! focus ([`layers::sigma_px`]); translucent fragments, which it does not speak of, count once ([`matting`]); the backdrop
//! of an open background is one more peel. Of its "various methods" for a Gaussian the one here has exact variance
//! and one cost for every size ([`gaussian`]).
//!
//! Cost: pixels × layers × peels for the matting, pixels × layers for the blur, whatever its size; the number of layers grows as the
//! CoC to the power of 2/3 (nine on a side for 32 px). Memory: the scene, in which it works, and two pictures; one more
//! where layers are blurred one by one.
//!
//! Limits: a blurred point is a Gaussian, not a disc, and shows no aperture blades. A fragment is blurred as something
//! between its own layer and the next *nearer* one: by eq. 4 too much in front of focus, too little behind it, by half
//! the distance between layers on average, and half of what is in focus goes by the first layer in front of it.

mod gaussian;
mod layers;
mod matting;

use super::shared::{Sheet, peels};
use super::{Method, MethodInfo, Progress};
use crate::error::Error;
use crate::image::Image;
use crate::scene::{EffectKind, Plan, Scene};
use layers::{Layers, cascade_sigma_px, sigma_px};
use matting::{DepthPeel, Matte, Side, compose};

/// Schedl & Wimmer's.
#[derive(Debug)]
pub(super) struct RecursiveGaussian;

impl Method for RecursiveGaussian {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "recursive-gaussian",
            source: "Schedl & Wimmer 2012",
            role: "paper",
            summary: "depth layers matted out of the peels, blurred and composed in a cascade of Gaussians",
            effects: &[EffectKind::Merge],
            deviations: &[],
        }
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let parameters = &plan.parameters.recursive_gaussian;
        let (size, coc_infinity_px) = (scene.picture_size(), scene.coc_infinity_px);
        let layers = Layers::new(plan.coc_range_px, coc_infinity_px, parameters);
        let peels: Vec<DepthPeel> =
            peels(scene, plan).into_iter().map(|peel| DepthPeel::new(peel, coc_infinity_px)).collect();
        let channels = if plan.does(EffectKind::OpenBackground) { 4 } else { 3 };
        let half = |side| Half { sheet: Sheet::unknown(size.0, size.1, channels), side, known: false };
        let (mut front, mut back) = (half(Side::Behind), half(Side::Before));
        let stack = Stack { layers, peels: &peels, cascaded: parameters.cascaded };
        let mut done = 0;
        let mut add = |half: &mut Half, layer| {
            half.add(&stack, layer);
            done += 1;
            progress(done as f32 / layers.count() as f32);
        };
        (-layers.front..0).for_each(|layer| add(&mut front, layer));
        (0..=layers.back).rev().for_each(|layer| add(&mut back, layer));
        front.sheet.over(&back.sheet);
        Ok(front.sheet.into_picture())
    }
}

/// The layers, and what they are made of.
struct Stack<'a> {
    layers: Layers,
    peels: &'a [DepthPeel],
    cascaded: bool,
}

/// The layers on one side of focus, composed from the outermost towards focus as far as they were added.
struct Half {
    sheet: Sheet,
    side: Side,
    /// Whether there is anything in it.
    known: bool,
}

impl Half {
    /// Adds the next layer towards focus.
    ///
    /// Cascaded, it is composed with what is there and both are blurred by `σ̂_k` (eq. 13); otherwise it alone is blurred, by
    /// `σ_k` (eq. 11), and composed.
    fn add(&mut self, stack: &Stack<'_>, layer: i32) {
        let matte = Matte::new(&stack.layers, layer);
        if stack.cascaded || layer == 0 {
            self.known |= compose(&mut self.sheet, stack.peels, &matte, self.side);
            if self.known {
                blur(&mut self.sheet, cascade_sigma_px(layer));
            }
            return;
        }
        let (width, height) = (self.sheet.coverage.width(), self.sheet.coverage.height());
        let mut own = Sheet::unknown(width, height, self.sheet.content.len());
        if !compose(&mut own, stack.peels, &matte, self.side) {
            return;
        }
        blur(&mut own, sigma_px(layer));
        match self.side {
            Side::Before => {
                own.over(&self.sheet);
                self.sheet = own;
            }
            Side::Behind => self.sheet.over(&own),
        }
        self.known = true;
    }
}

/// Blurs content and coverage alike.
fn blur(sheet: &mut Sheet, sigma_px: f32) {
    if sigma_px > 0.0 {
        let planes = sheet.content.iter_mut().chain([&mut sheet.coverage]);
        planes.for_each(|plane| gaussian::blur(plane, sigma_px));
    }
}
