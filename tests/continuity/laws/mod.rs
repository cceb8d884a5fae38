//! Laws that make the engine local and continuous. Each is a scene whose picture is known in closed form, or by rays that are traced
//! here, never by a method of the program; and one figure for each of its cases, at most the law's bound.
//!
//! `tests/continuity` asserts them. `examples/laws.rs` prints them as a table.

pub(crate) mod cracks;
pub(crate) mod elements;
pub(crate) mod engine;
pub(crate) mod focus;
pub(crate) mod impulse;
pub(crate) mod locality;
pub(crate) mod panes;
pub(crate) mod peels;
mod rays;
mod scenes;
pub(crate) mod sweeps;
pub(crate) mod temporal;

use engine::Engine;
use thinlens::methods::{Deviation, Law};

/// A law as it is measured here.
#[derive(Debug)]
pub(crate) struct Measured {
    /// The law.
    pub(crate) law: Law,
    /// Maximum of the figure ([`Law::figure`]).
    pub(crate) bound: f64,
    /// Which methods promise it.
    pub(crate) promised_by: Promise,
    /// The figure of every case on one engine.
    pub(crate) figures: fn(&Engine) -> Vec<Figure>,
}

/// The methods that promise a law.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Promise {
    /// Methods that sample the lens.
    LensSampling,
    /// Every method.
    All,
}

/// The figure of one case.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    /// The case.
    pub(crate) case: String,
    /// What was measured.
    pub(crate) value: f64,
}

/// Every law, in the order of the table.
pub(crate) const LAWS: [&Measured; 15] = [
    &panes::TILTED_PANE,
    &panes::SHEET_OF_TWO_PEELS,
    &elements::LONE_ELEMENT,
    &elements::SOFT_DISC,
    &elements::ONE_COLOR,
    &locality::LOCALITY,
    &cracks::STEEP_RAMP,
    &cracks::RELIEF,
    &sweeps::EVEN_SWEEP,
    &sweeps::FROZEN_FRAMES,
    &impulse::PEAK,
    &focus::NEAR_FOCUS,
    &focus::STEP_NEAR_FOCUS,
    &peels::MANY_PEELS,
    &peels::PEEL_ORDER,
];

impl Measured {
    /// Whether the method of `engine` promises the law.
    pub(crate) fn concerns(&self, engine: &Engine) -> bool {
        self.promised_by == Promise::All || engine.method.samples_lens()
    }

    /// The deviation that the method of `engine` declares.
    pub(crate) fn deviation(&self, engine: &Engine) -> Option<Deviation> {
        engine.method.info().deviations.iter().copied().find(|deviation| deviation.law == self.law)
    }

    /// Whether every figure keeps the law, or the deviation that the method declares. A declaration that no figure needs is refused.
    ///
    /// # Errors
    /// What was measured, by case.
    pub(crate) fn check(&self, engine: &Engine) -> Result<(), String> {
        let figures = (self.figures)(engine);
        let lawful = |figure: &Figure| figure.value <= self.bound;
        let fault = match self.deviation(engine) {
            None => figures.iter().find(|figure| !lawful(figure)).map(|_| format!("at most {}", self.bound)),
            Some(Deviation { within: [min, max], .. }) => {
                let declared = f64::from(min)..=f64::from(max);
                if figures.iter().all(lawful) {
                    Some("no declared deviation, since every case keeps the law".to_owned())
                } else {
                    let outside = figures.iter().any(|figure| !declared.contains(&figure.value));
                    outside.then(|| format!("declared from {min} to {max}"))
                }
            }
        };
        fault.map_or(Ok(()), |expected| {
            let list: Vec<String> = figures.iter().map(|f| format!("  {:.3e} {}", f.value, f.case)).collect();
            Err(format!("{engine}, {}: expected {expected}; found\n{}", self.law.figure(), list.join("\n")))
        })
    }
}

/// The worst of `figures`; a figure that is no number is the worst.
pub(crate) fn worst(figures: &[Figure]) -> Option<&Figure> {
    let rank = |figure: &Figure| if figure.value.is_nan() { f64::INFINITY } else { figure.value };
    figures.iter().max_by(|a, b| rank(a).total_cmp(&rank(b)))
}

fn figure(case: impl Into<String>, value: impl Into<f64>) -> Figure {
    Figure { case: case.into(), value: value.into() }
}
