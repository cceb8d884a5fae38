//! Merging: the samples of a supersampled stack become coverage layers at picture resolution.
//!
//! The `S²·M` fragments of each pixel are sorted by CoC radius and grouped into clusters, nearest first. A cluster's
//! coverage is the sum of its fragments' alpha divided by `S²`, its colour the same sum (premultiplied), its radius the mean
//! (`1/z` is affine in `c`). If there are more clusters than layers, the least visible ones are dropped.

use super::{Layer, Scene, surface};
use crate::image::Plane;
use rayon::prelude::*;

/// Largest depth of a cluster, in units of [`surface::merge_gap_px`].
const MAX_CLUSTER_GAPS: f32 = 2.0;

/// One sample of one layer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Fragment {
    color: [f32; 3],
    alpha: f32,
    coc_px: f32,
    /// Index of its sample within the pixel.
    sample: u32,
}

/// Merged fragments; without coverage, an empty entry.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Cluster {
    color: [f32; 3],
    alpha: f32,
    coc_px: f32,
}

impl Scene {
    /// The scene at one sample per pixel: the layers of a supersampled scene become as many coverage layers; any other scene is unchanged.
    #[must_use]
    pub fn merged(self) -> Self {
        if self.supersample == 1 {
            return self;
        }
        Self { layers: merge(&self.layers, self.supersample), supersample: 1, ..self }
    }
}

/// Merges `layers`, which have `supersample` samples per pixel along each axis, into as many coverage layers.
fn merge(layers: &[Layer], supersample: usize) -> Vec<Layer> {
    let (width, height) =
        layers.first().map_or((0, 0), |s| (s.width() / supersample, s.height() / supersample));
    let count = layers.len();
    let mut clusters = vec![Cluster::default(); width * height * count];
    clusters.par_chunks_mut((width * count).max(1)).enumerate().for_each_init(
        Vec::new,
        |fragments, (y, row)| {
            for (x, pixel) in row.chunks_mut(count).enumerate() {
                gather(layers, x, y, supersample, fragments);
                cluster(fragments, (supersample * supersample) as f32, pixel);
            }
        },
    );
    (0..count)
        .map(|layer| {
            let plane = |value: &dyn Fn(&Cluster) -> f32| {
                Plane::from_fn(width, height, |x, y| value(&clusters[(y * width + x) * count + layer]))
            };
            let color = std::array::from_fn(|k| plane(&|cluster| cluster.color[k]));
            Layer { color, alpha: plane(&|cluster| cluster.alpha), coc_px: plane(&|cluster| cluster.coc_px) }
        })
        .collect()
}

/// Collects the fragments of picture pixel `x, y`, nearest first.
fn gather(layers: &[Layer], x: usize, y: usize, supersample: usize, fragments: &mut Vec<Fragment>) {
    fragments.clear();
    for layer in layers {
        for sample in 0..supersample * supersample {
            let (sx, sy) = (x * supersample + sample % supersample, y * supersample + sample / supersample);
            let alpha = layer.alpha.get(sx, sy);
            if alpha > 0.0 {
                let color = layer.color_at(sx, sy);
                fragments.push(Fragment {
                    color,
                    alpha,
                    coc_px: layer.coc_px.get(sx, sy),
                    sample: sample as u32,
                });
            }
        }
    }
    fragments.sort_by(|a, b| a.coc_px.total_cmp(&b.coc_px));
}

/// Groups sorted `fragments` into clusters and writes the most visible to `pixel`, nearest first; unused entries stay empty.
fn cluster(fragments: &[Fragment], samples: f32, pixel: &mut [Cluster]) {
    let mut kept: Vec<Cluster> = Vec::with_capacity(pixel.len() + 1);
    let mut rest = fragments;
    while !rest.is_empty() {
        let count = cluster_length(rest);
        let (own, others) = rest.split_at(count);
        let mut sum = Cluster::default();
        for fragment in own {
            sum.color.iter_mut().zip(fragment.color).for_each(|(sum, value)| *sum += value / samples);
            sum.alpha += fragment.alpha / samples;
            sum.coc_px += fragment.coc_px / count as f32;
        }
        kept.push(sum);
        rest = others;
    }
    while kept.len() > pixel.len() {
        let index = least_visible(&kept);
        kept.remove(index);
    }
    pixel[..kept.len()].copy_from_slice(&kept);
}

/// Number of fragments, from the first on, that form one cluster.
fn cluster_length(fragments: &[Fragment]) -> usize {
    let first = fragments[0];
    let mut last = first.coc_px;
    let mut samples = 0u64;
    for (i, fragment) in fragments.iter().enumerate() {
        let gap = surface::merge_gap_px(fragment.coc_px);
        // Samples past the 64th of a pixel share bits, which at worst ends a cluster early.
        let bit = 1u64 << (fragment.sample % 64);
        if fragment.coc_px - last >= gap
            || fragment.coc_px - first.coc_px >= MAX_CLUSTER_GAPS * gap
            || samples & bit != 0
        {
            // Never 0: none of the conditions holds for the first fragment.
            return i;
        }
        last = fragment.coc_px;
        samples |= bit;
    }
    fragments.len()
}

/// Index of the cluster that contributes least behind those in front of it.
fn least_visible(clusters: &[Cluster]) -> usize {
    let mut transmittance = 1.0;
    let visibilities = clusters.iter().map(|cluster| {
        let visibility = transmittance * cluster.alpha;
        transmittance *= 1.0 - cluster.alpha;
        visibility
    });
    visibilities.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fragment(sample: u32, coc_px: f32, color: f32) -> Fragment {
        Fragment { color: [color; 3], alpha: 1.0, coc_px, sample }
    }

    fn clusters(fragments: &[Fragment], places: usize) -> Vec<Cluster> {
        let mut pixel = vec![Cluster::default(); places];
        cluster(fragments, 4.0, &mut pixel);
        pixel
    }

    #[test]
    fn four_samples_of_one_surface_are_one_opaque_cluster_of_their_mean() {
        let found = clusters(&[0, 1, 2, 3].map(|i| fragment(i, 5.0 + 0.1 * i as f32, i as f32)), 2);
        assert_eq!(found[0].alpha, 1.0, "the whole pixel");
        assert_eq!(found[0].color, [1.5; 3], "mean colour");
        assert!((found[0].coc_px - 5.15).abs() < 1e-5, "mean radius");
        assert_eq!(found[1], Cluster::default(), "no other cluster");
    }

    #[test]
    fn an_edge_becomes_coverage_over_the_surface_behind() {
        let found = clusters(
            &[fragment(0, -9.0, 1.0), fragment(1, 4.0, 0.5), fragment(2, 4.0, 0.5), fragment(3, 4.0, 0.5)],
            2,
        );
        assert_eq!((found[0].alpha, found[0].color[0]), (0.25, 0.25), "a quarter, premultiplied");
        assert_eq!((found[1].alpha, found[1].color[0]), (0.75, 0.375), "three samples of the surface behind");
    }

    #[test]
    fn two_fragments_of_one_sample_are_two_layers_however_near() {
        let found = clusters(&[fragment(0, 3.0, 1.0), fragment(0, 3.1, 0.0)], 2);
        assert_eq!([found[0].alpha, found[1].alpha], [0.25, 0.25], "two clusters");
    }

    #[test]
    fn the_least_visible_of_too_many_clusters_is_dropped() {
        let mut fragments: Vec<Fragment> = (0..3).map(|i| fragment(i, -20.0, 1.0)).collect();
        fragments.extend([fragment(3, 0.0, 0.5), fragment(0, 10.0, 0.2), fragment(1, 10.0, 0.2)]);
        let found = clusters(&fragments, 2);
        assert_eq!(
            [found[0].coc_px, found[1].coc_px],
            [-20.0, 10.0],
            "visibility: 1/16 of the one between, 3/32 of the farthest"
        );
    }
}
