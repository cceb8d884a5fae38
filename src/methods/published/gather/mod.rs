//! `gather`: each pixel collects what spreads over it, from the visible picture alone.
//!
//! Zhou, Chen & Pullen 2007, "Accurate Depth of Field Simulation in Real Time". A pixel `p` is the weighted mean of the
//! pixels `q` around it, the weight a product of three:
//!
//! - *overlap*: whether the disc of `q` covers `p`; its rim is one pixel wide;
//! - *intensity*: one over the disc's area, as its energy is spread evenly;
//! - *leakage control*: a `q` behind `p` spreads no further than `p` itself does, so that nothing blurred bleeds into what
//!   is in focus before it. Its disc then has `p`'s radius in both weights above, which makes it fade in without a step.
//!
//! The paper filters along rows, then along columns: what its graphics cards could do, and no real disc. Here the disc is
//! whole. Every pixel of it is visited as long as they are no more than the parameter `samples`; a larger disc is sampled,
//! more densely towards its centre, where small discs have to be met too (see [`mod@quadrature`]). Only what is in front of
//! focus may reach further than the pixel's own CoC, so the disc to visit is known exactly (see [`reach`]). Past the frame
//! there is nothing to collect.
//!
//! Lee, Kim & Choi 2009, "Real-Time Depth-of-Field Rendering Using Anisotropically Filtered Mipmap Interpolation", is the
//! same filter on a pyramid. What the two share is what is here, and of the pyramid that a sample which stands for many
//! pixels brings their mean (see [`prefilter`]).
//!
//! Cost: pixels × their disc's area, up to `samples` each; pixels in focus that nothing reaches are copied. Memory: the
//! picture three times, and once more for each width of mean. Limits, by design: knows only what the pinhole sees, so a
//! blurred front has nothing behind it to show and keeps a sharp outline, on whose inside all is front; outside it the mean
//! of front and back is weighted by area where it should be by visibility. Behind what is blurred itself, the back's blur
//! changes with the outline: a faint edge between two blurs.

mod cost;
mod parameters;
mod prefilter;
mod quadrature;
mod reach;
mod sums;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::lens::Aperture;
use crate::methods::contract::Plan;
use crate::methods::contract::{Method, MethodInfo, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared::planes_from_rows;
use crate::methods::shared::{self, DiscAreas, Visible};
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use glam::Vec2;
use parameters::GatherParameters;
use pulp::Arch;
use quadrature::quadrature;
use rayon::prelude::*;
use reach::Reach;
use sums::{Sample, Stretch, Sums};

/// The filter of games and compositors.
#[derive(Debug)]
pub(in crate::methods) struct Gather;

impl Method for Gather {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "gather",
            source: "Zhou, Chen & Pullen 2007",
            role: Role::Baseline,
            summary: "each pixel the weighted mean of the visible pixels whose blur covers it",
            effects: &[EffectKind::Merge],
            lens_samples: Some("samples"),
            steps: &["64", "256", "1024"],
            deviations: DEVIATIONS,
        }
    }

    fn parameters(&self) -> ParameterTable {
        ParameterTable::of::<GatherParameters>()
    }

    fn cost(&self, plan: &Plan, workload: &Workload<'_>) -> Option<Cost> {
        Some(cost::cost(plan, workload))
    }

    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let visible = shared::visible(scene, plan);
        let (width, height) = (visible.coc_px.width(), visible.coc_px.height());
        let reach = Reach::new(&visible.coc_px);
        let samples: Vec<Option<Vec<Sample>>> = (0..=Reach::LAST)
            .into_par_iter()
            .map(|level| reach.has(level).then(|| samples(reach.radius_px(level), plan)))
            .collect();
        let last_box = samples.iter().flatten().flatten().map(|sample| sample.reads_box).max().unwrap_or(0);
        let channels = visible.content.len();
        let source = Source::new(visible, plan.optics.aperture, last_box);
        let arch = Arch::new();
        let new_sums = || Sums::new(width, channels);
        let planes = planes_from_rows((width, height), progress, new_sums, |sums, y, planes: &mut [_; 4]| {
            for (columns, level) in reach.stretches(y) {
                let samples = samples[usize::from(level)].as_deref().unwrap_or_default();
                if samples.len() > 1 {
                    arch.dispatch(Stretch { source: &source, samples, y, columns: columns.clone(), sums });
                }
                for (channel, plane) in planes[..channels].iter_mut().enumerate() {
                    let copied = &source.boxes[0][channel].row(y)[columns.clone()];
                    match samples.len() {
                        0 | 1 => plane[columns.clone()].copy_from_slice(copied),
                        _ => sums.mean(channel, &mut plane[columns.clone()]),
                    }
                }
            }
        });
        Ok(shared::picture(planes.into_iter().take(channels).collect()))
    }
}

/// Pixels to visit where nothing from further than `radius_px` spreads to: one alone, where that is within the pixel.
fn samples(radius_px: f32, plan: &Plan) -> Vec<Sample> {
    let [far, near] = [1.0, -1.0].map(|side| {
        // Distance from the centre, measured across the nearest side of the aperture.
        move |offset: Vec2| plan.optics.aperture.apothem() - plan.optics.aperture.depth_inside(offset, side)
    });
    let sample = |(offset, area_px): (glam::IVec2, f32)| Sample {
        offset,
        area_px,
        reads_box: prefilter::box_for(area_px),
        far_px: far(offset.as_vec2()),
        near_px: near(offset.as_vec2()),
    };
    quadrature(radius_px, plan.lens_samples()).into_iter().map(sample).collect()
}

/// What the filter reads.
struct Source {
    /// The picture's channels, and their means over ever wider boxes: see [`prefilter`].
    boxes: Vec<Vec<Plane>>,
    coc_px: Plane,
    /// One over the area of the disc.
    intensity: Plane,
    apothem: f32,
}

impl Source {
    fn new(visible: Visible, aperture: Aperture, last_box: usize) -> Self {
        let areas = DiscAreas::new(aperture);
        let mut intensity = visible.coc_px.clone();
        intensity.values_mut().par_iter_mut().for_each(|value| *value = 1.0 / areas.area(*value));
        let Visible { content, coc_px } = visible;
        let boxes = prefilter::boxes(content, &coc_px, last_box);
        Self { boxes, coc_px, intensity, apothem: aperture.apothem() }
    }
}

/// Measured over all cases of each law.
const DEVIATIONS: &[Deviation] = &[
    Deviation {
        law: Law::SeeThrough,
        within: [0.0, 0.001],
        reason: "one picture knows nothing behind a blurred front, and what is in focus spreads nowhere",
    },
    Deviation {
        law: Law::Transparency,
        within: [0.999, 1.22],
        reason: "inside a near outline all is front; outside it front and nothing are weighted by area",
    },
    Deviation {
        law: Law::Convergence,
        within: [31.5, 33.0],
        reason: "it is a filter of the visible picture: what is hidden is missing, however many the samples",
    },
];
