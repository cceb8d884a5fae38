//! A method's cost: a sum of terms, each an amount of work times the time of one unit.

use serde::Serialize;

/// Kinds of work whose relative speed differs between machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum WorkKind {
    /// Vectorised loops over rows of pixels, contiguous in memory.
    Rows,
    /// Rays that read samples scattered in memory.
    Rays,
    /// Passes over planes of the picture's size.
    Planes,
}

impl WorkKind {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Rows, Self::Rays, Self::Planes];
}

/// One term of a method's cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// The unit of work.
    pub name: &'static str,
    /// CPU time of one unit, on the machine that the costs were measured on.
    pub nanoseconds: f64,
    /// Number of units.
    pub amount: f64,
}

/// Makes a [`Term`]: `amount` units of `name`, `nanoseconds` each.
pub fn term(name: &'static str, nanoseconds: f64, amount: f64) -> Term {
    Term { name, nanoseconds, amount }
}

/// Cost of executing a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// The kind of work.
    pub kind: WorkKind,
    /// The terms: the same names in the same order for every plan of a method.
    pub terms: Vec<Term>,
}

impl Cost {
    /// The cost of `terms`, all of one kind of work.
    pub fn new(kind: WorkKind, terms: impl Into<Vec<Term>>) -> Self {
        Self { kind, terms: terms.into() }
    }

    /// CPU seconds on the machine that the costs were measured on.
    pub fn cpu_seconds(&self) -> f64 {
        self.terms.iter().map(|term| term.nanoseconds * term.amount).sum::<f64>() * 1e-9
    }
}
