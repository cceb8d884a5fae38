//! The views of each row of a picture.
//!
//! Rows take turns with several sets of views ([`crate::lens::Optics::rays_in_turns`]). Where the colours of some places are point samples
//! and those of others averages over the pixel ([`Antialiasing`]), views start from different parts of the pixel. A view moves whole spans,
//! so a row with both is painted twice and blended by pixel.

use super::bins::Bins;
use super::canvas::Shear;
use crate::lens::{Rays, View};
use crate::methods::contract::Plan;
use crate::scene::Antialiasing;

/// The views of a set of colours, and the channels that they render: see [`Rays`].
pub(super) type ShearSet = (Vec<Shear>, &'static [usize]);

/// The sets of views that rows take turns with: row `y` has entry `y mod n` of `n`.
pub(super) type Turns = Vec<Vec<ShearSet>>;

/// The views of all rows.
#[derive(Debug)]
pub(super) enum RowViews {
    /// The same for all pixels of a row.
    Alike(Turns),
    /// Those for point samples, those for averages, and the share of averages in each pixel.
    ByPixel { points: Turns, averages: Turns, antialiasing: Antialiasing },
}

/// Some views of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Painting<'a> {
    /// The views of each set of colours.
    pub(super) sets: &'a [ShearSet],
    /// The weight of these views in each pixel, against those painted before; `None` where these are all.
    pub(super) weights: Option<&'a [f32]>,
    /// Weights of the views that are painted after these: where they are 1, these need not be painted.
    pub(super) covered_by: Option<&'a [f32]>,
}

impl Painting<'_> {
    /// Whether pixel `x` shows these views.
    pub(super) fn is_visible(&self, x: usize) -> bool {
        self.weights.is_none_or(|weights| weights[x] > 0.0)
            && self.covered_by.is_none_or(|weights| weights[x] < 1.0)
    }
}

impl RowViews {
    /// `count` views for each set of colours that move `bins`, in a picture whose colours are averages as `antialiasing` says.
    pub(super) fn new(plan: &Plan, antialiasing: &Antialiasing, bins: &Bins, count: usize) -> Self {
        let turns = |antialiased| turns(plan, plan.jitter(antialiased), bins, count);
        match antialiasing.everywhere() {
            Some(share) => Self::Alike(turns(share)),
            None => {
                Self::ByPixel { points: turns(0.0), averages: turns(1.0), antialiasing: antialiasing.clone() }
            }
        }
    }

    /// The views of all rows: those that are painted first and, by pixel over them, those of averages.
    #[cfg(feature = "gpu")]
    pub(super) fn paintings(&self) -> Vec<&Turns> {
        match self {
            Self::Alike(turns) => vec![turns],
            Self::ByPixel { points, averages, .. } => vec![points, averages],
        }
    }

    /// What is painted of row `y`, in order.
    pub(super) fn of_row(&self, y: usize) -> Vec<Painting<'_>> {
        match self {
            Self::Alike(turns) => vec![whole(turns, y)],
            Self::ByPixel { points, averages, antialiasing } => {
                let shares = antialiasing.plane().map_or(&[][..], |plane| plane.row(y));
                if shares.iter().all(|&share| share <= 0.0) {
                    vec![whole(points, y)]
                } else if shares.iter().all(|&share| share >= 1.0) {
                    vec![whole(averages, y)]
                } else {
                    vec![
                        Painting { covered_by: Some(shares), ..whole(points, y) },
                        Painting { weights: Some(shares), ..whole(averages, y) },
                    ]
                }
            }
        }
    }
}

/// The views of row `y` of `turns`, which are all that is painted.
fn whole(turns: &Turns, y: usize) -> Painting<'_> {
    Painting { sets: &turns[y % turns.len()], weights: None, covered_by: None }
}

/// `count` views that start from the part `jitter` of the pixel's width.
fn turns(plan: &Plan, jitter: f32, bins: &Bins, count: usize) -> Turns {
    let shear = |view: &View| Shear::new(&View { jitter: view.jitter * jitter, ..*view }, bins);
    let sets = |rays: &Rays| {
        rays.sets().map(|(views, channels)| (views.iter().map(shear).collect(), channels)).collect()
    };
    plan.optics.rays_in_turns(count).iter().map(sets).collect()
}
