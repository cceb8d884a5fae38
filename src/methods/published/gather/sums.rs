//! The weighted mean, for a span of a row at once.

use super::source::Source;
use glam::IVec2;
use pulp::NullaryFnOnce;
use std::ops::Range;

/// Samples summed in f32 before the sum is added to the f64 total, so that the f32 error does not grow with the sample count.
const BATCH: usize = 64;

/// A pixel to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Offset in pixels from the pixel that gathers to the one visited.
    pub offset: IVec2,
    /// How many pixels it stands for.
    pub area_px: f32,
    /// Index of the box that it reads, in [`Source::boxes`].
    pub box_index: usize,
    /// Distance in pixels, measured perpendicularly to the nearest side of the aperture, of a disc behind focus.
    pub far_distance_px: f32,
    /// The same of a disc in front of focus, where the aperture is turned by 180°.
    pub near_distance_px: f32,
}

/// Sums over the samples of each pixel of a span: one row per channel and, last, the sum of weights.
pub(super) struct Sums {
    /// Weights of one sample.
    weights: Vec<f32>,
    /// Sums over one batch of samples.
    batch: Vec<Vec<f32>>,
    /// Sums over all batches.
    total: Vec<Vec<f64>>,
}

impl Sums {
    /// Sums for rows of `width` pixels with `channels` channels.
    pub(super) fn new(width: usize, channels: usize) -> Self {
        Self {
            weights: vec![0.0; width],
            batch: vec![vec![0.0; width]; channels + 1],
            total: vec![vec![0.0; width]; channels + 1],
        }
    }

    /// Takes the pixels of a span of row `y` as they are.
    pub(super) fn copy(&mut self, source: &Source, y: usize, columns: Range<usize>) {
        let Some((weights, totals)) = self.total.split_last_mut() else { return };
        weights[..columns.len()].fill(1.0);
        for (total, plane) in totals.iter_mut().zip(&source.boxes[0]) {
            let values = plane.row(y)[columns.clone()].iter().copied().map(f64::from);
            total.iter_mut().zip(values).for_each(|(total, value)| *total = value);
        }
    }

    /// Writes the means of the first channels for the last span, weighted by the sums number `weight`; 0 where that is 0.
    pub(super) fn means(&self, weight: usize, means: &mut [&mut [f32]]) {
        for (means, sums) in means.iter_mut().zip(&self.total) {
            for ((mean, &sum), &weight) in means.iter_mut().zip(sums).zip(&self.total[weight]) {
                *mean = if weight > 0.0 { (sum / weight) as f32 } else { 0.0 };
            }
        }
    }

    /// Writes the sums number `channel` of the last span, with what is `outside` the frame of each of its pixels, at most 1.
    pub(super) fn coverage(&self, channel: usize, outside: impl Fn(usize) -> f32, coverage: &mut [f32]) {
        for (i, (value, &sum)) in coverage.iter_mut().zip(&self.total[channel]).enumerate() {
            *value = (sum as f32 + outside(i)).min(1.0);
        }
    }
}

/// Sums a span of row `y` with one set of samples; compiled for each instruction set.
pub(super) struct SumSpan<'a> {
    pub source: &'a Source,
    pub samples: &'a [Sample],
    pub y: usize,
    pub columns: Range<usize>,
    pub sums: &'a mut Sums,
}

impl NullaryFnOnce for SumSpan<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let length = self.columns.len();
        self.sums.total.iter_mut().for_each(|total| total[..length].fill(0.0));
        for samples in self.samples.chunks(BATCH) {
            self.sums.batch.iter_mut().for_each(|batch| batch[..length].fill(0.0));
            for sample in samples {
                add(self.source, sample, self.y, &self.columns, self.sums);
            }
            for (total, batch) in self.sums.total.iter_mut().zip(&self.sums.batch) {
                for (total, &batch) in total[..length].iter_mut().zip(batch) {
                    *total += f64::from(batch);
                }
            }
        }
    }
}

/// Adds one sample of each pixel of a span, where the sample lies in the frame.
#[inline(always)]
fn add(source: &Source, sample: &Sample, y: usize, columns: &Range<usize>, sums: &mut Sums) {
    let (width, height) = (source.coc_px.width() as i64, source.coc_px.height() as i64);
    let (dx, visited_y) = (i64::from(sample.offset.x), y as i64 + i64::from(sample.offset.y));
    let from = (columns.start as i64).max(-dx);
    let to = (columns.end as i64).min(width - dx);
    if visited_y < 0 || visited_y >= height || from >= to {
        return;
    }
    let own = from as usize..to as usize;
    let visited = (from + dx) as usize..(to + dx) as usize;
    let in_span = own.start - columns.start..own.end - columns.start;
    let visited_y = visited_y as usize;
    let weights = &mut sums.weights[..own.len()];
    weigh(
        weights,
        sample,
        source.apothem,
        source.gathering(y).map(|row| &row[own.clone()]),
        [&source.coc_px.row(visited_y)[visited.clone()], &source.intensity.row(visited_y)[visited.clone()]],
    );
    let (weight_sum, channel_sums) = sums.batch.split_last_mut().expect("the last row is the sum of weights");
    for (sum, plane) in channel_sums.iter_mut().zip(&source.boxes[sample.box_index]) {
        let values = &plane.row(visited_y)[visited.clone()];
        for ((sum, &weight), &value) in sum[in_span.clone()].iter_mut().zip(&*weights).zip(values) {
            *sum += weight * value;
        }
    }
    for (sum, &weight) in weight_sum[in_span].iter_mut().zip(&*weights) {
        *sum += weight;
    }
}

impl Source {
    /// Sum of the weights of those of `samples` of pixel `x, y`, within `radius_px`, that lie outside the frame, as if they were like
    /// the pixel itself.
    pub(super) fn weight_outside(&self, (samples, radius_px): (&[Sample], f32), x: usize, y: usize) -> f32 {
        let presence = self.boxes[0][self.boxes[0].len() - 1].get(x, y);
        let gathering = self.gathering(y).map(|row| [row[x]]);
        let visited = [[self.coc_px.get(x, y)], [self.intensity.get(x, y)]];
        let (width, height) = (self.coc_px.width() as i32, self.coc_px.height() as i32);
        let to_border = (x as i32).min(y as i32).min(width - 1 - x as i32).min(height - 1 - y as i32);
        // A sample is rounded to a pixel within half a pixel of the disc and its edge.
        if to_border as f32 > radius_px + 1.0 {
            return 0.0;
        }
        let is_outside = |sample: &&Sample| {
            let at = sample.offset + IVec2::new(x as i32, y as i32);
            at.x < 0 || at.y < 0 || at.x >= width || at.y >= height
        };
        let weight = |sample: &Sample| {
            let mut weight = [0.0];
            let [gathering, visited] = [&gathering, &visited].map(|pair| pair.each_ref().map(|one| &one[..]));
            weigh(&mut weight, sample, self.apothem, gathering, visited);
            weight[0]
        };
        presence * samples.iter().filter(is_outside).map(weight).sum::<f32>()
    }
}

/// Weights of the visited pixels: overlap × intensity, with leakage control, × the number of pixels that the sample stands for.
/// Gathering (`own_…`) and visited pixels are each given by signed CoC radius and one over the disc area.
#[inline(always)]
fn weigh(
    weights: &mut [f32],
    sample: &Sample,
    apothem: f32,
    [own_coc, own_intensity]: [&[f32]; 2],
    [coc, intensity]: [&[f32]; 2],
) {
    let count = weights.len();
    let (own_coc, own_intensity) = (&own_coc[..count], &own_intensity[..count]);
    let (coc, intensity) = (&coc[..count], &intensity[..count]);
    for i in 0..count {
        let (coc, own_coc) = (coc[i], own_coc[i]);
        let (intensity, own_intensity) = (intensity[i], own_intensity[i]);
        let behind = coc > own_coc;
        let (radius, own_radius) = (coc.abs(), own_coc.abs());
        // Leakage control: the smaller of the two discs, which has the higher intensity, for pixels behind.
        let as_own = behind & (own_radius < radius);
        let radius = if as_own { own_radius } else { radius };
        let intensity = if as_own { own_intensity } else { intensity };
        let distance = if coc < 0.0 { sample.near_distance_px } else { sample.far_distance_px };
        let overlap = (radius * apothem - distance + 0.5).clamp(0.0, 1.0);
        weights[i] = overlap * intensity * sample.area_px;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Aperture;
    use crate::methods::shared::DiscAreas;

    /// Weight of a pixel of CoC radius `coc`, `distance` pixels away, for a pixel of CoC radius `own`; the aperture is a disc.
    fn weight(own: f32, coc: f32, distance: f32) -> f32 {
        let areas = DiscAreas::new(Aperture::DISC);
        let sample = Sample {
            offset: IVec2::ZERO,
            area_px: 1.0,
            box_index: 0,
            far_distance_px: distance,
            near_distance_px: distance,
        };
        let mut weights = [0.0];
        let [own, visited] = [own, coc].map(|coc| ([coc], [1.0 / areas.area(coc)]));
        weigh(&mut weights, &sample, 1.0, [&own.0, &own.1], [&visited.0, &visited.1]);
        weights[0]
    }

    #[test]
    fn a_blurred_pixel_behind_a_sharp_one_has_no_weight() {
        assert_eq!(weight(0.0, 20.0, 3.0), 0.0);
    }

    #[test]
    fn a_blurred_pixel_in_front_of_a_sharp_one_has_the_same_weight_over_its_whole_disc() {
        let area = DiscAreas::new(Aperture::DISC).area(20.0);
        assert_eq!([weight(0.0, -20.0, 3.0), weight(0.0, -20.0, 19.0)], [1.0 / area; 2]);
    }

    #[test]
    fn a_pixel_behind_a_blurred_one_spreads_as_far_as_the_blurred_one() {
        let own = weight(5.0, 5.0, 3.0);
        assert_eq!([weight(5.0, 20.0, 3.0), weight(5.0, 20.0, 6.0)], [own, 0.0]);
    }

    #[test]
    fn the_own_weight_of_a_pixel_is_positive_and_one_in_focus() {
        for coc in [-3000.0, -4.0, 0.0, 0.4, 7.0] {
            assert!(weight(coc, coc, 0.0) > 0.0, "c = {coc}");
        }
        assert!((weight(0.3, 0.3, 0.0) - 1.0).abs() < 1e-6, "its disc is its own pixel");
    }

    #[test]
    fn the_edge_of_a_disc_is_one_pixel_wide() {
        let inside = weight(0.0, -4.0, 0.0);
        let share = |distance| weight(0.0, -4.0, distance) / inside;
        assert_eq!([share(3.5), share(4.0), share(4.25), share(4.5)], [1.0, 0.5, 0.25, 0.0]);
    }
}
