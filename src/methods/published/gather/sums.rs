//! The weighted mean, for neighbouring pixels of a row at once.

use super::Source;
use glam::IVec2;
use pulp::NullaryFnOnce;
use std::ops::Range;

/// So many samples are summed in single precision before they join the sum in double: thousands would drift.
const A_GO: usize = 64;

/// A pixel to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// From the pixel that collects to the one visited.
    pub offset: IVec2,
    /// How many pixels it stands for.
    pub area_px: f32,
    /// Which of the source's boxes it brings.
    pub reads_box: usize,
    /// Distance across the nearest side of the aperture, as a disc behind focus has it.
    pub far_px: f32,
    /// The same in front of focus, where the aperture is turned by 180°.
    pub near_px: f32,
}

/// Sums of a row: of weights, and of each channel.
pub(super) struct Sums {
    weights: Vec<f32>,
    go: Vec<Vec<f32>>,
    total: Vec<Vec<f64>>,
}

impl Sums {
    /// For rows of `width` pixels with `channels` channels.
    pub(super) fn new(width: usize, channels: usize) -> Self {
        Self {
            weights: vec![0.0; width],
            go: vec![vec![0.0; width]; channels + 1],
            total: vec![vec![0.0; width]; channels + 1],
        }
    }

    /// The mean of `channel` over the stretch last summed.
    pub(super) fn mean(&self, channel: usize, means: &mut [f32]) {
        let weights = &self.total[self.total.len() - 1];
        for ((mean, &sum), &weight) in means.iter_mut().zip(&self.total[channel]).zip(weights) {
            *mean = (sum / weight) as f32;
        }
    }
}

/// Sums a stretch of row `y` with one set of samples; to be compiled for each instruction set.
pub(super) struct Stretch<'a> {
    pub source: &'a Source,
    pub samples: &'a [Sample],
    pub y: usize,
    pub columns: Range<usize>,
    pub sums: &'a mut Sums,
}

impl NullaryFnOnce for Stretch<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let length = self.columns.len();
        self.sums.total.iter_mut().for_each(|total| total[..length].fill(0.0));
        for samples in self.samples.chunks(A_GO) {
            self.sums.go.iter_mut().for_each(|go| go[..length].fill(0.0));
            for sample in samples {
                add(self.source, sample, self.y, &self.columns, self.sums);
            }
            for (total, go) in self.sums.total.iter_mut().zip(&self.sums.go) {
                for (total, &go) in total[..length].iter_mut().zip(go) {
                    *total += f64::from(go);
                }
            }
        }
    }
}

/// Adds one sample of each pixel of a stretch, where it lies in the frame.
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
    let in_stretch = own.start - columns.start..own.end - columns.start;
    let visited_y = visited_y as usize;
    let weights = &mut sums.weights[..own.len()];
    weigh(
        weights,
        sample,
        source.apothem,
        [&source.coc_px.row(y)[own.clone()], &source.intensity.row(y)[own]],
        [&source.coc_px.row(visited_y)[visited.clone()], &source.intensity.row(visited_y)[visited.clone()]],
    );
    let (of_weights, of_channels) = sums.go.split_last_mut().expect("there is always the sum of weights");
    for (sum, plane) in of_channels.iter_mut().zip(&source.boxes[sample.reads_box]) {
        let values = &plane.row(visited_y)[visited.clone()];
        for ((sum, &weight), &value) in sum[in_stretch.clone()].iter_mut().zip(&*weights).zip(values) {
            *sum += weight * value;
        }
    }
    for (sum, &weight) in of_weights[in_stretch].iter_mut().zip(&*weights) {
        *sum += weight;
    }
}

/// Weights of the pixels visited, `[c, 1/area]` each as the pixels that collect: overlap × intensity, with leakage control,
/// × the pixels that the sample stands for.
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
        // Behind, the smaller of the two discs counts, which is the more intense.
        let as_own = behind & (own_radius < radius);
        let radius = if as_own { own_radius } else { radius };
        let intensity = if as_own { own_intensity } else { intensity };
        let distance = if coc < 0.0 { sample.near_px } else { sample.far_px };
        let overlap = (radius * apothem - distance + 0.5).clamp(0.0, 1.0);
        weights[i] = overlap * intensity * sample.area_px;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Aperture;
    use crate::methods::shared::DiscAreas;

    /// Weight of a pixel with CoC radius `coc`, `distance` pixels away, for one with `own`, with a disc for an aperture.
    fn weight(own: f32, coc: f32, distance: f32) -> f32 {
        let areas = DiscAreas::new(Aperture::DISC);
        let sample =
            Sample { offset: IVec2::ZERO, area_px: 1.0, reads_box: 0, far_px: distance, near_px: distance };
        let mut weights = [0.0];
        let [own, visited] = [own, coc].map(|coc| ([coc], [1.0 / areas.area(coc)]));
        weigh(&mut weights, &sample, 1.0, [&own.0, &own.1], [&visited.0, &visited.1]);
        weights[0]
    }

    #[test]
    fn what_is_blurred_behind_a_sharp_pixel_has_no_weight() {
        assert_eq!(weight(0.0, 20.0, 3.0), 0.0);
    }

    #[test]
    fn what_is_blurred_before_a_sharp_pixel_spreads_its_light_evenly_over_it() {
        let area = DiscAreas::new(Aperture::DISC).area(20.0);
        assert_eq!([weight(0.0, -20.0, 3.0), weight(0.0, -20.0, 19.0)], [1.0 / area; 2]);
    }

    #[test]
    fn what_is_behind_a_blurred_pixel_spreads_as_far_as_that_pixel_does() {
        let as_its_own = weight(5.0, 5.0, 3.0);
        assert_eq!([weight(5.0, 20.0, 3.0), weight(5.0, 20.0, 6.0)], [as_its_own, 0.0]);
    }

    #[test]
    fn a_pixel_always_counts_itself_and_in_focus_it_counts_once() {
        for coc in [-3000.0, -4.0, 0.0, 0.4, 7.0] {
            assert!(weight(coc, coc, 0.0) > 0.0, "c = {coc}");
        }
        assert!((weight(0.3, 0.3, 0.0) - 1.0).abs() < 1e-6, "its disc is its own pixel");
    }

    #[test]
    fn the_rim_of_a_disc_is_one_pixel_wide() {
        let inside = weight(0.0, -4.0, 0.0);
        let share = |distance| weight(0.0, -4.0, distance) / inside;
        assert_eq!([share(3.5), share(4.0), share(4.25), share(4.5)], [1.0, 0.5, 0.25, 0.0]);
    }
}
