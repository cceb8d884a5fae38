//! `gather`: each pixel is a weighted mean of the visible pixels whose discs cover it.
//!
//! Zhou, Chen & Pullen 2007, "Accurate Depth of Field Simulation in Real Time". A pixel `p` is the weighted mean of the
//! pixels `q` around it. The weight is a product of three factors:
//!
//! - *overlap*: whether the disc of `q` covers `p`; the edge of the disc is one pixel wide;
//! - *intensity*: one over the area of the disc, because its energy is spread evenly;
//! - *leakage control*: a `q` behind `p` spreads no further than `p` itself does, so that no blurred background leaks into an
//!   in-focus foreground. The disc of `q` then has the radius of `p` in both factors above, so that it fades in continuously.
//!
//! The paper filters along rows, then along columns, as the graphics cards of its time required; that is not a true disc. Here
//! the whole disc is evaluated. Every pixel of it is visited if their number is at most the parameter `samples`. A larger disc is
//! sampled, more densely towards its centre so that small discs are found too (see [`mod@quadrature`]). Only fragments in front
//! of focus can reach further than the CoC of the pixel itself, so the radius to visit is known exactly (see [`reach`]). Samples
//! past the frame are skipped.
//!
//! A pixel without a surface has no weight, and lies behind all others. The background comes behind the mean
//! ([`shared::Backdrop`]), in the part of a pixel that is left uncovered: of its own disc the part without a surface or, where the
//! pixel itself has none, what the weights leave below one.
//!
//! Lee, Kim & Choi 2009, "Real-Time Depth-of-Field Rendering Using Anisotropically Filtered Mipmap Interpolation", apply the
//! same filter to a pyramid. This module implements what both papers share. From the pyramid it takes one idea: a sample that
//! stands for many pixels reads their mean (see [`prefilter`]).
//!
//! Cost: pixels × the area of their discs, at most `samples` each; in-focus pixels that nothing reaches are copied. Memory: three
//! times the picture, and once more for each box width. Limits, by design: the method reads only the pinhole picture, so there is
//! nothing to show behind a blurred foreground, which keeps a sharp outline. Inside the outline all is foreground; outside it,
//! foreground and background are weighted by area instead of visibility. Behind a blurred foreground, the blur of the background
//! changes at the outline, which leaves a faint edge between two blurs.

mod cost;
mod parameters;
mod prefilter;
mod quadrature;
mod reach;
mod source;
mod sums;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::methods::contract::{Method, MethodInfo, Plan, Progress, Role};
use crate::methods::cost::Cost;
use crate::methods::laws::{Deviation, Law};
use crate::methods::shared;
use crate::methods::shared::{Backdrop, LAST_LEVEL, before, planes_from_rows};
use crate::parallel;
use crate::scene::{EffectKind, Scene, Workload};
use crate::settings::ParameterTable;
use glam::Vec2;
use parameters::GatherParameters;
use pulp::Arch;
use quadrature::quadrature;
use reach::Reach;
use source::Source;
use sums::{Sample, SumSpan, Sums};

/// The gather filter that is usual in games and compositors.
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
        let backdrop = Backdrop::new(&scene, plan);
        let surfaces = shared::visible_surfaces(scene, plan);
        let reach = Reach::new(&surfaces);
        let samples: Vec<Option<Vec<Sample>>> = parallel::map(usize::from(LAST_LEVEL) + 1, &|level| {
            let level = level as u8;
            reach.has(level).then(|| samples(reach.radius_px(level), plan))
        });
        let max_box = samples.iter().flatten().flatten().map(|sample| sample.box_index).max().unwrap_or(0);
        let source = Source::new(surfaces, plan.optics.aperture, max_box);
        let filter = Filter { reach, samples, source };
        if backdrop.is_none() {
            return Ok(shared::picture(filter.planes::<3>(progress).into()));
        }
        let [red, green, blue, alpha, coverage] = filter.planes::<5>(progress);
        Ok(before(shared::picture(vec![red, green, blue, alpha]), &coverage, backdrop.as_ref()))
    }
}

/// The filter of one picture.
struct Filter {
    reach: Reach,
    /// Samples by level of reach.
    samples: Vec<Option<Vec<Sample>>>,
    source: Source,
}

impl Filter {
    /// The weighted means of the source's channels. Where they have presence, the last: content divided by it, and coverage.
    fn planes<const N: usize>(&self, progress: &Progress<'_>) -> [Plane; N] {
        let (source, arch) = (&self.source, Arch::new());
        let size = (source.coc_px.width(), source.coc_px.height());
        planes_from_rows(size, progress, &|| Sums::new(size.0, source), &|sums, y, planes: &mut [_; N]| {
            for (columns, level) in self.reach.spans(y) {
                let samples = self.samples[usize::from(level)].as_deref().unwrap_or_default();
                if samples.len() > 1 {
                    arch.dispatch(SumSpan { source, samples, y, columns: columns.clone(), sums });
                } else {
                    sums.copy(source, y, columns.clone());
                }
                let mut spans = planes.each_mut().map(|plane| &mut plane[columns.clone()]);
                match spans.split_last_mut() {
                    Some((coverage, content)) if source.has_presence => {
                        sums.means(sums.channels - 1, content);
                        sums.coverage(&source.presence(y)[columns.clone()], coverage);
                    }
                    _ => sums.means(sums.channels, &mut spans),
                }
            }
        })
    }
}

/// The samples of a pixel that no disc reaches from further than `radius_px`; only its own where the radius is within the pixel.
fn samples(radius_px: f32, plan: &Plan) -> Vec<Sample> {
    let [far_distance_px, near_distance_px] = [1.0, -1.0].map(|side| {
        // Distance from the centre, measured perpendicularly to the nearest side of the aperture.
        move |offset: Vec2| plan.optics.aperture.apothem() - plan.optics.aperture.depth_inside(offset, side)
    });
    let sample = |(offset, area_px): (glam::IVec2, f32)| Sample {
        offset,
        area_px,
        box_index: prefilter::box_for(area_px),
        far_distance_px: far_distance_px(offset.as_vec2()),
        near_distance_px: near_distance_px(offset.as_vec2()),
    };
    quadrature(radius_px, plan.lens_samples()).into_iter().map(sample).collect()
}

/// Measured over all cases of each law.
const DEVIATIONS: &[Deviation] = &[
    Deviation {
        law: Law::SeeThrough,
        within: [0.0, 0.001],
        reason: "one picture shows nothing behind a blurred foreground, and pixels in focus do not spread",
    },
    Deviation {
        law: Law::Convergence,
        within: [31.5, 33.0],
        reason: "a filter of the visible picture lacks hidden surfaces at any number of samples",
    },
];
