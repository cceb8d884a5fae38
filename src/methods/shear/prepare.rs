//! The passes before painting: highlights, merge and disocclusion fill.

use super::highlights::Highlight;
use super::lights;
use super::mirrors::{self, Mirrors, Moving};
use crate::methods::contract::Plan;
use crate::scene::{EffectKind, Layer, Scene};

/// What is painted of a scene.
#[derive(Debug)]
pub(super) struct Painted {
    /// The layers, at picture resolution.
    pub(super) layers: Vec<Layer>,
    /// The highlights removed from them.
    pub(super) highlights: Vec<Highlight>,
    /// Their reflections that move, which are removed from them too.
    pub(super) mirrors: Option<Mirrors>,
}

/// What is painted of `scene`.
pub(super) fn painted(mut scene: Scene, plan: &Plan) -> Painted {
    let highlights = if plan.does(EffectKind::Highlights) {
        mirrors::without_moving(&mut scene, plan, |scene| lights::extract(scene, plan))
    } else {
        Vec::new()
    };
    let moving = Moving::of(&scene, plan);
    let scene = if plan.does(EffectKind::Fill) { scene.filled() } else { scene.merged() };
    let mut layers = scene.layers;
    let mirrors = moving.and_then(|moving| moving.taken_from(&mut layers));
    Painted { layers, highlights, mirrors }
}
