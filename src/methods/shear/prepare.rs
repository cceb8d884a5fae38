//! The passes before painting: highlights, merge and disocclusion fill.

use super::highlights::Highlight;
use super::lights;
use crate::methods::contract::Plan;
use crate::scene::{EffectKind, Layer, Scene};

/// The layers of `scene` to paint, at picture resolution, and the highlights removed from them.
pub(super) fn layers(mut scene: Scene, plan: &Plan) -> (Vec<Layer>, Vec<Highlight>) {
    let highlights =
        if plan.does(EffectKind::Highlights) { lights::extract(&mut scene, plan) } else { Vec::new() };
    let scene = if plan.does(EffectKind::Fill) { scene.filled() } else { scene.merged() };
    (scene.layers, highlights)
}
