//! Merging: the samples of a supersampled stack become coverage layers at picture resolution.
//!
//! The `S²·M` fragments of each pixel are sorted by CoC radius and grouped into clusters, nearest first. A cluster's
//! coverage is the sum of its fragments' alpha divided by `S²`, its colour the same sum (premultiplied), its radius the mean
//! (`1/z` is affine in `c`). Fragments at infinity are the background, which continues behind whatever hides it from other samples: they
//! make one cluster, the last, with the opacity of the background and not with its share of the pixel. A pixel keeps at most
//! [`EXTRA_LAYERS`] clusters more than the stack has layers: if there are more, the least visible surfaces are dropped, never the
//! background. There are as many layers as the pixel with the most clusters needs.

use super::{Layer, MAX_TRANSLUCENT_LAYERS, Scene, surface};
use crate::image::Plane;
use crate::parallel;

/// Largest depth of a cluster, in units of [`surface::merge_gap_px`].
const MAX_CLUSTER_GAPS: f32 = 2.0;

/// Number of layers that merging may add to those of the stack. The samples of a pixel at an edge hit different surfaces, so that a pixel
/// has more surfaces than each of its samples.
const EXTRA_LAYERS: usize = 2;

/// Share of its alpha by which a cluster hides what is behind it, when the least visible cluster is chosen.
///
/// With all of it, clusters behind an opaque one would all be equally invisible. But lens rays pass beside the opaque one and hit the
/// nearest of those behind it first.
const HIDING_SHARE: f32 = 0.9;

/// One sample of one layer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Fragment {
    color: [f32; 3],
    alpha: f32,
    coc_px: f32,
    /// Index of its sample within the pixel.
    sample: usize,
}

/// Merged fragments; without coverage, an empty entry.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Cluster {
    color: [f32; 3],
    alpha: f32,
    coc_px: f32,
}

/// What one sample of a pixel shows of the background.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Backdrop {
    /// Its fragments at infinity, composited; premultiplied.
    color: [f32; 3],
    /// Their alpha; 0 without any.
    alpha: f32,
    /// Share of the light that passes all surfaces.
    passing: f32,
}

impl Default for Backdrop {
    fn default() -> Self {
        Self { color: [0.0; 3], alpha: 0.0, passing: 1.0 }
    }
}

impl Backdrop {
    /// Adds a fragment at infinity behind those before it.
    fn add(&mut self, color: [f32; 3], alpha: f32) {
        let rest = 1.0 - self.alpha;
        self.color.iter_mut().zip(color).for_each(|(sum, value)| *sum += rest * value);
        self.alpha += rest * alpha;
    }

    /// How much this sample says of the background's opacity: all where it is seen or where nothing else is, and nothing where the
    /// sample's surfaces end without it.
    fn weight(&self) -> f32 {
        self.passing.max(self.alpha)
    }
}

/// The clusters of one row of pixels, one pixel after the other, nearest first.
#[derive(Debug, Default)]
struct Row {
    clusters: Vec<Cluster>,
    /// For each pixel, the number of clusters up to and with its own.
    ends: Vec<usize>,
}

impl Row {
    /// The clusters of pixel `x`.
    fn pixel(&self, x: usize) -> &[Cluster] {
        let start = x.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.clusters[start..self.ends[x]]
    }
}

impl Scene {
    /// The scene at one sample per pixel: the layers of a supersampled scene become coverage layers, at least one and at most as many as
    /// [`max_merged_layers`] says; any other scene is unchanged.
    #[must_use]
    pub fn merged(self) -> Self {
        if self.supersample == 1 {
            return self;
        }
        // A closed lens has every fragment at one radius, and no infinity.
        let infinity_px = if self.coc_infinity_px > 0.0 { self.coc_infinity_px } else { f32::INFINITY };
        Self { layers: merge(&self.layers, self.supersample, infinity_px), supersample: 1, ..self }
    }
}

/// The largest number of layers that the samples of `layers` layers are merged into.
///
/// A GPU follows translucent fragments through [`MAX_TRANSLUCENT_LAYERS`]: merging does not exceed that by adding layers.
pub(super) fn max_merged_layers(layers: usize) -> usize {
    layers.max((layers + EXTRA_LAYERS).min(MAX_TRANSLUCENT_LAYERS))
}

/// Merges `layers`, which have `supersample` samples per pixel along each axis, into coverage layers. Fragments of the CoC radius
/// `infinity_px` are background. No layer but the first is empty.
fn merge(layers: &[Layer], supersample: usize, infinity_px: f32) -> Vec<Layer> {
    let (width, height) =
        layers.first().map_or((0, 0), |s| (s.width() / supersample, s.height() / supersample));
    let merger = || Merger::new(supersample, max_merged_layers(layers.len()), infinity_px);
    let rows: Vec<Row> = parallel::map_with(height, &merger, &|merger, y| {
        let mut row = Row::default();
        for x in 0..width {
            merger.gather(layers, x, y);
            row.clusters.extend(merger.clusters());
            row.ends.push(row.clusters.len());
        }
        row
    });
    let clusters_of = |y: usize| (0..width).map(|x| rows[y].pixel(x).len()).max().unwrap_or(0);
    let most = parallel::map(height, &clusters_of).into_iter().max().unwrap_or(0);
    let count = most.max(layers.len().min(1));
    let layer = |layer: usize| {
        let plane = |value: &dyn Fn(&Cluster) -> f32| {
            Plane::from_fn(width, height, |x, y| rows[y].pixel(x).get(layer).map_or(0.0, value))
        };
        let color = std::array::from_fn(|k| plane(&|cluster| cluster.color[k]));
        Layer { color, alpha: plane(&|cluster| cluster.alpha), coc_px: plane(&|cluster| cluster.coc_px) }
    };
    parallel::map(count, &layer)
}

/// Merges one pixel after another, in the same memory.
#[derive(Debug)]
struct Merger {
    supersample: usize,
    /// Most clusters of a pixel.
    most: usize,
    /// The fragments of the pixel, nearest first.
    fragments: Vec<Fragment>,
    /// For each sample of the pixel, the number of the last cluster that it is in, from 1; 0 for none.
    last_cluster: Vec<usize>,
    /// CoC radius of background.
    infinity_px: f32,
    /// The background in each sample of the pixel.
    backdrops: Vec<Backdrop>,
}

impl Merger {
    fn new(supersample: usize, most: usize, infinity_px: f32) -> Self {
        let samples = supersample * supersample;
        Self {
            supersample,
            most,
            fragments: Vec::new(),
            last_cluster: vec![0; samples],
            infinity_px,
            backdrops: vec![Backdrop::default(); samples],
        }
    }

    /// Collects the fragments of picture pixel `x, y`, nearest first.
    fn gather(&mut self, layers: &[Layer], x: usize, y: usize) {
        let supersample = self.supersample;
        self.fragments.clear();
        self.backdrops.fill(Backdrop::default());
        for layer in layers {
            for sample in 0..supersample * supersample {
                let (sx, sy) =
                    (x * supersample + sample % supersample, y * supersample + sample / supersample);
                let alpha = layer.alpha.get(sx, sy);
                if alpha > 0.0 {
                    let (color, coc_px) = (layer.color_at(sx, sy), layer.coc_px.get(sx, sy));
                    self.add(Fragment { color, alpha, coc_px, sample });
                }
            }
        }
        self.fragments.sort_by(|a, b| a.coc_px.total_cmp(&b.coc_px));
    }

    /// Adds a fragment to the surfaces of the pixel or to its background.
    fn add(&mut self, fragment: Fragment) {
        let backdrop = &mut self.backdrops[fragment.sample];
        if fragment.coc_px == self.infinity_px {
            backdrop.add(fragment.color, fragment.alpha);
        } else {
            backdrop.passing *= 1.0 - fragment.alpha;
            self.fragments.push(fragment);
        }
    }

    /// The background of the pixel, as opaque as the samples that say so show it; `None` where none does.
    fn background(&self) -> Option<Cluster> {
        if self.backdrops.iter().all(|backdrop| backdrop.alpha <= 0.0) {
            return None;
        }
        let (mut sum, mut weights) = (Cluster::default(), 0.0);
        for backdrop in &self.backdrops {
            let weight = backdrop.weight();
            sum.color.iter_mut().zip(backdrop.color).for_each(|(sum, value)| *sum += weight * value);
            sum.alpha += weight * backdrop.alpha;
            weights += weight;
        }
        let color = sum.color.map(|sum| sum / weights);
        Some(Cluster { color, alpha: sum.alpha / weights, coc_px: self.infinity_px })
    }

    /// The clusters of the gathered fragments, nearest first: if there are too many, the most visible, and always the background.
    fn clusters(&mut self) -> Vec<Cluster> {
        self.last_cluster.fill(0);
        let mut kept: Vec<Cluster> = Vec::with_capacity(self.most);
        let mut rest = self.fragments.as_slice();
        while !rest.is_empty() {
            let count = cluster_length(rest, kept.len() + 1, &mut self.last_cluster);
            let (own, others) = rest.split_at(count);
            kept.push(merged(own, self.last_cluster.len() as f32));
            rest = others;
        }
        let background = self.background();
        while kept.len() + usize::from(background.is_some()) > self.most {
            let index = least_visible(&kept);
            kept.remove(index);
        }
        kept.extend(background);
        kept
    }
}

/// The cluster of `fragments` of a pixel of so many `samples`.
fn merged(fragments: &[Fragment], samples: f32) -> Cluster {
    let mut sum = Cluster::default();
    for fragment in fragments {
        sum.color.iter_mut().zip(fragment.color).for_each(|(sum, value)| *sum += value);
        sum.alpha += fragment.alpha;
        sum.coc_px += fragment.coc_px;
    }
    Cluster {
        color: sum.color.map(|sum| sum / samples),
        alpha: sum.alpha / samples,
        coc_px: sum.coc_px / fragments.len() as f32,
    }
}

/// Number of fragments, from the first on, that form cluster number `cluster`, from 1. `last_cluster` has the last cluster of each sample.
fn cluster_length(fragments: &[Fragment], cluster: usize, last_cluster: &mut [usize]) -> usize {
    let first = fragments[0];
    let mut last = first.coc_px;
    for (i, fragment) in fragments.iter().enumerate() {
        let gap = surface::merge_gap_px(fragment.coc_px);
        if fragment.coc_px - last >= gap
            || fragment.coc_px - first.coc_px >= MAX_CLUSTER_GAPS * gap
            || last_cluster[fragment.sample] == cluster
        {
            // Never 0: none of the conditions holds for the first fragment.
            return i;
        }
        last = fragment.coc_px;
        last_cluster[fragment.sample] = cluster;
    }
    fragments.len()
}

/// Index of the cluster that contributes least behind those in front of it; of several, the farthest.
fn least_visible(clusters: &[Cluster]) -> usize {
    let mut passing = 1.0;
    let visibilities = clusters.iter().map(|cluster| {
        let visibility = passing * cluster.alpha;
        passing *= 1.0 - HIDING_SHARE * cluster.alpha;
        visibility
    });
    visibilities.enumerate().min_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))).map_or(0, |(i, _)| i)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CoC radius of background.
    const INFINITY_PX: f32 = 50.0;

    fn fragment(sample: usize, coc_px: f32, color: f32) -> Fragment {
        Fragment { color: [color; 3], alpha: 1.0, coc_px, sample }
    }

    /// The clusters of a pixel with `supersample` samples along each axis, at most `most`.
    fn clusters_of(fragments: &[Fragment], supersample: usize, most: usize) -> Vec<Cluster> {
        let mut merger = Merger::new(supersample, most, INFINITY_PX);
        fragments.iter().for_each(|&fragment| merger.add(fragment));
        merger.clusters()
    }

    fn clusters(fragments: &[Fragment], most: usize) -> Vec<Cluster> {
        clusters_of(fragments, 2, most)
    }

    /// The colour and the CoC radius of sample `x, y` of a layer, `None` where it is empty.
    type Sample = fn(usize, usize) -> Option<(f32, f32)>;

    /// Layers of pixels with 2 × 2 samples.
    fn layers(width: usize, height: usize, peels: &[Sample]) -> Vec<Layer> {
        let layer = |peel: &Sample| {
            let plane = |value: fn((f32, f32)) -> f32| {
                Plane::from_fn(2 * width, 2 * height, |x, y| peel(x, y).map_or(0.0, value))
            };
            Layer {
                color: std::array::from_fn(|_| plane(|(color, _)| color)),
                alpha: plane(|_| 1.0),
                coc_px: plane(|(_, coc_px)| coc_px),
            }
        };
        peels.iter().map(layer).collect()
    }

    #[test]
    fn four_samples_of_one_surface_are_one_opaque_cluster_of_their_mean() {
        let found = clusters(&[0, 1, 2, 3].map(|i| fragment(i, 5.0 + 0.1 * i as f32, i as f32)), 2);
        assert_eq!(found[0].alpha, 1.0, "the whole pixel");
        assert_eq!(found[0].color, [1.5; 3], "mean colour");
        assert!((found[0].coc_px - 5.15).abs() < 1e-5, "mean radius");
        assert_eq!(found.len(), 1, "no other cluster");
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
    fn a_surface_is_one_cluster_however_many_samples_it_has() {
        let surface: Vec<Fragment> = (0..81).map(|i| fragment(i, 5.0, 0.5)).collect();
        let found = clusters_of(&surface, 9, 4);
        assert_eq!(found.len(), 1, "81 samples");
        assert_eq!((found[0].alpha, found[0].color[0]), (1.0, 0.5), "opaque, without rounding");
        assert_eq!(clusters_of(&surface[..9], 3, 4)[0].alpha, 1.0, "a ninth each");
    }

    #[test]
    fn translucent_samples_are_a_cluster_of_their_alpha() {
        let glass = |sample| Fragment { color: [0.2; 3], alpha: 0.5, coc_px: -3.0, sample };
        let found = clusters(&[glass(0), glass(1), glass(2), glass(3)], 2);
        assert_eq!((found[0].alpha, found[0].color[0]), (0.5, 0.2));
    }

    #[test]
    fn the_least_visible_of_too_many_clusters_is_dropped() {
        let mut fragments: Vec<Fragment> = (0..3).map(|i| fragment(i, -20.0, 1.0)).collect();
        fragments.extend([fragment(3, 0.0, 0.5), fragment(0, 10.0, 0.2), fragment(1, 10.0, 0.2)]);
        let found = clusters(&fragments, 2);
        assert_eq!(
            [found[0].coc_px, found[1].coc_px],
            [-20.0, 10.0],
            "a quarter of what passes, against a half of three quarters of it"
        );
    }

    #[test]
    fn behind_an_opaque_cluster_the_nearest_are_kept() {
        let at = |coc_px: f32| (0..4).map(move |i| fragment(i, coc_px, 0.5));
        let fragments: Vec<Fragment> = at(-9.0).chain(at(-3.0)).chain(at(2.0)).chain(at(8.0)).collect();
        let found: Vec<f32> = clusters(&fragments, 3).iter().map(|cluster| cluster.coc_px).collect();
        assert_eq!(
            found,
            [-9.0, -3.0, 2.0],
            "a ray that passes the first meets the second before the others"
        );
    }

    #[test]
    fn of_clusters_that_are_visible_alike_the_farthest_is_dropped() {
        let veil = |sample, coc_px| Fragment { color: [0.0; 3], alpha: 1e-12, coc_px, sample };
        let found: Vec<f32> = clusters(&[veil(0, 0.0), veil(1, 4.0), veil(2, 8.0)], 2)
            .iter()
            .map(|cluster| cluster.coc_px)
            .collect();
        assert_eq!(found, [0.0, 4.0]);
    }

    #[test]
    fn a_pixel_whose_samples_see_different_surfaces_keeps_all_of_them() {
        // Each of the four samples of pixel 0 has its own pair of surfaces; pixel 1 has one surface.
        let near = |x: usize, y: usize| Some((0.5, if x < 2 { (4 * (x + 2 * y)) as f32 } else { 20.0 }));
        let far = |x: usize, y: usize| (x < 1).then_some((0.5, 30.0 + (10 * y) as f32));
        let found = merge(&layers(2, 1, &[near, far]), 2, INFINITY_PX);
        assert_eq!(found.len(), 4, "two more than the stack has");
        let cocs: Vec<f32> = found.iter().map(|layer| layer.coc_px.get(0, 0)).collect();
        assert_eq!(cocs, [0.0, 4.0, 8.0, 12.0], "the four that are seen, not the two behind them");
        assert_eq!(found.iter().map(|layer| layer.alpha.get(1, 0)).collect::<Vec<_>>(), [1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn the_background_continues_behind_a_surface_that_covers_part_of_the_pixel() {
        let edge = [fragment(0, -9.0, 1.0), fragment(1, -9.0, 1.0), fragment(2, -9.0, 1.0)];
        let sky = |sample| fragment(sample, INFINITY_PX, 0.5);
        for shown in [vec![sky(3)], vec![sky(2), sky(3)], vec![sky(0), sky(1), sky(2), sky(3)]] {
            let found = clusters(&[&edge[..], &shown].concat(), 4);
            let alphas: Vec<f32> = found.iter().map(|cluster| cluster.alpha).collect();
            assert_eq!((alphas, found[1].color[0]), (vec![0.75, 1.0], 0.5), "whoever records it");
        }
    }

    #[test]
    fn the_background_is_as_opaque_as_it_is_seen() {
        let haze = |sample| Fragment { color: [0.1; 3], alpha: 0.25, coc_px: INFINITY_PX, sample };
        let alone = clusters(&[haze(0), haze(1), haze(2), haze(3)], 4);
        assert_eq!((alone[0].alpha, alone[0].color[0]), (0.25, 0.1), "in every sample");
        let half = clusters(&[fragment(0, INFINITY_PX, 0.5), fragment(1, INFINITY_PX, 0.5)], 4);
        assert_eq!((half[0].alpha, half[0].color[0]), (0.5, 0.25), "nothing is in the other samples");
        // A trace of it in a sample that a surface hides changes little.
        let mut trace: Vec<Fragment> = (1..4).map(|i| fragment(i, INFINITY_PX, 0.5)).collect();
        trace.extend([fragment(0, 2.0, 1.0), Fragment { alpha: 1e-3, ..fragment(0, INFINITY_PX, 5e-4) }]);
        let found = clusters(&trace, 4);
        assert!((found[1].alpha - 1.0).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn the_background_is_neither_merged_with_a_surface_nor_dropped_for_one() {
        let far: Vec<Fragment> = (0..3).map(|i| fragment(i, INFINITY_PX - 0.1, 1.0)).collect();
        let found = clusters(&[&far[..], &[fragment(3, INFINITY_PX, 0.5)]].concat(), 4);
        assert_eq!([found[0].alpha, found[1].alpha], [0.75, 1.0], "a tenth of a pixel before it");
        let at = |coc_px: f32| (0..4).map(move |i| fragment(i, coc_px, 0.5));
        let many: Vec<Fragment> =
            at(-9.0).chain(at(-3.0)).chain(at(2.0)).chain([fragment(0, INFINITY_PX, 0.5)]).collect();
        let cocs: Vec<f32> = clusters(&many, 3).iter().map(|cluster| cluster.coc_px).collect();
        assert_eq!(cocs, [-9.0, -3.0, INFINITY_PX], "behind three opaque surfaces");
    }

    #[test]
    fn no_layer_is_made_that_no_pixel_needs() {
        let wall = |_, _| Some((0.5, 3.0));
        let nothing = |_, _| None;
        assert_eq!(merge(&layers(3, 2, &[wall, nothing, nothing]), 2, INFINITY_PX).len(), 1);
        assert_eq!(
            merge(&layers(3, 2, &[nothing, nothing]), 2, INFINITY_PX).len(),
            1,
            "a scene has at least one layer"
        );
        assert_eq!(merge(&layers(3, 2, &[wall, |_, _| Some((0.5, 9.0))]), 2, INFINITY_PX).len(), 2);
        assert_eq!(merge(&[], 2, INFINITY_PX).len(), 0);
    }

    #[test]
    fn merging_adds_no_layers_that_a_gpu_cannot_follow() {
        assert_eq!([1, 4, 30, 31, 32, 40].map(max_merged_layers), [3, 6, 32, 32, 32, 40]);
    }
}
