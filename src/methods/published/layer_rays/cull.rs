//! Early layer culling (section 4.3): one N-buffer per layer tells whether rays can hit anything in it.
//!
//! To bound memory, an N-buffer stores blocks of samples, and one N-buffer serves a slab of neighbouring layers where
//! there are very many. Both are conservative: a ray may be tested in vain, and no hit is lost.

use super::layers::{Ray, Spacing};
use crate::methods::shared::{Blocks, Fragments, NBuffer};
use glam::Vec2;

/// Maximum number of N-buffers.
pub(super) const MAX_SLABS: usize = 64;

/// Where each layer of a stack has fragments.
#[derive(Debug)]
pub(super) struct Cull {
    pub(super) blocks: Blocks,
    spacing: Spacing,
    pub(super) layers_per_slab: usize,
    /// Smallest CoC radius of the slab's layers in each block; infinite in empty blocks. `None` for an empty slab.
    pub(super) slabs: Vec<Option<NBuffer>>,
    supersample: f32,
}

impl Cull {
    /// Builds the N-buffers of all layers.
    pub(super) fn new(fragments: &Fragments, spacing: Spacing, supersample: f32) -> Self {
        let blocks = Blocks::of(fragments);
        let layers_per_slab = spacing.count.div_ceil(MAX_SLABS);
        let mut cull = Self { blocks, spacing, layers_per_slab, slabs: Vec::new(), supersample };
        let slab = |index: usize| {
            let [near, far] = cull.interval(index);
            let nearest = |sample: usize| {
                let coc = fragments.coc_px(sample).iter().copied().find(|&coc| coc >= near);
                coc.filter(|&coc| coc <= far).unwrap_or(f32::INFINITY)
            };
            let buffer = blocks.least(fragments, cull.reach(index) * 2.0, nearest);
            let (columns, rows) = buffer.size();
            let full_window =
                blocks.window(Vec2::ZERO, Vec2::splat((columns.max(rows) * blocks.side) as f32));
            (buffer.least(&full_window) < f32::INFINITY).then_some(buffer)
        };
        cull.slabs = (0..spacing.count.div_ceil(layers_per_slab)).map(slab).collect();
        cull
    }

    /// CoC radii of the layers of a slab.
    fn interval(&self, slab: usize) -> [f32; 2] {
        let last = ((slab + 1) * self.layers_per_slab).min(self.spacing.count) - 1;
        [self.spacing.interval(slab * self.layers_per_slab)[0], self.spacing.interval(last)[1]]
    }

    /// Largest distance of a pixel's rays from its centre within a slab, in samples: the slab's larger CoC radius
    /// plus half a pixel.
    pub(super) fn reach(&self, slab: usize) -> f32 {
        let [near, far] = self.interval(slab);
        (near.abs().max(far.abs()) + 0.5) * self.supersample
    }

    /// The layers, front to back, that rays through the pixel with centre `centre` (in samples) can hit.
    pub(super) fn layers_in_reach(&self, centre: Vec2, layers: &mut Vec<usize>) {
        layers.clear();
        for (index, slab) in self.slabs.iter().enumerate() {
            let Some(buffer) = slab else { continue };
            let reach = self.reach(index);
            let min_coc_px = buffer.least(&self.blocks.window(centre - reach, centre + reach));
            let first = index * self.layers_per_slab;
            let slab_layers = first..(first + self.layers_per_slab).min(self.spacing.count);
            layers.extend(slab_layers.filter(|&layer| min_coc_px <= self.spacing.interval(layer)[1]));
        }
    }

    /// Whether `ray` can hit anything in `layer`, whose CoC radii are `interval`.
    #[inline]
    pub(super) fn can_hit(&self, ray: &Ray, layer: usize, interval: [f32; 2]) -> bool {
        let Some(buffer) = &self.slabs[layer / self.layers_per_slab] else { return false };
        let (a, b) = (ray.at(interval[0]), ray.at(interval[1]));
        buffer.least(&self.blocks.window(a.min(b), a.max(b))) <= interval[1]
    }
}

#[cfg(test)]
mod tests {
    use super::super::layers::Segment;
    use super::*;
    use crate::methods::shared::noise;

    /// Sparse fragments at many depths.
    fn sparse() -> Fragments {
        Fragments::from_lists((70, 50), |x, y| match noise(x / 3, y / 3, 1) {
            v if v < 0.9 => vec![],
            v => vec![(v - 0.95) * 400.0, (v - 0.95) * 400.0 + 4.0],
        })
    }

    #[test]
    fn no_ray_hits_anything_in_a_culled_layer() {
        let fragments = sparse();
        // Thin layers share their N-buffers, thick ones do not.
        for delta in [0.2, 3.0] {
            let spacing = Spacing::new([-20.0, 24.0], delta, 0.1);
            let cull = Cull::new(&fragments, spacing, 1.0);
            let (mut kept, mut culled, mut layers) = (0, 0, Vec::new());
            for i in 0..300 {
                let random = |k| noise(i, k, 5);
                let centre = Vec2::new((70.0 * random(0)).floor(), (50.0 * random(1)).floor()) + 0.5;
                cull.layers_in_reach(centre, &mut layers);
                let start = centre + Vec2::new(random(2), random(3)) - 0.5;
                let ray = Ray { start, step: Vec2::from_angle(6.3 * random(4)) * random(6).sqrt() };
                for layer in 0..spacing.count {
                    let interval = spacing.interval(layer);
                    let segment =
                        Segment { fragments: &fragments, ray, interval, passed_coc_px: f32::NEG_INFINITY };
                    if layers.contains(&layer) && cull.can_hit(&ray, layer, interval) {
                        kept += 1;
                    } else {
                        culled += 1;
                        assert_eq!(segment.intersect(3), None, "layer {layer} of δ = {delta}");
                    }
                }
            }
            assert!(kept > 100 && culled > 100, "δ = {delta}: {kept} kept, {culled} culled");
        }
    }

    #[test]
    fn the_number_of_n_buffers_is_bounded_for_thin_layers() {
        let cull = Cull::new(&sparse(), Spacing::new([-20.0, 24.0], 0.001, 0.1), 1.0);
        assert!(cull.slabs.len() <= MAX_SLABS, "{} N-buffers", cull.slabs.len());
    }
}
