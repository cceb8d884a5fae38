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
mod program;
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
    /// Methods that follow any number of rays through the lens.
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

impl Measured {
    /// Whether the method of `engine` promises the law.
    pub(crate) fn concerns(&self, engine: &Engine) -> bool {
        self.promised_by == Promise::All || engine.method.lens_sampling().is_some()
    }

    /// The deviation that the method of `engine` declares.
    pub(crate) fn deviation(&self, engine: &Engine) -> Option<Deviation> {
        engine.method.info().deviations.iter().copied().find(|deviation| deviation.law == self.law)
    }
}

fn figure(case: impl Into<String>, value: impl Into<f64>) -> Figure {
    Figure { case: case.into(), value: value.into() }
}
