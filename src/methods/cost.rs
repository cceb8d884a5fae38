//! What a method says of its own cost: a sum of terms, each an amount of work times what one unit of it takes.

use serde::Serialize;

/// Kinds of work at which machines differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum WorkKind {
    /// Rows of pixels in vectors, close together in memory.
    Rows,
    /// Rays that each look up scattered samples.
    Rays,
    /// Passes over planes as large as the picture.
    Planes,
}

impl WorkKind {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Rows, Self::Rays, Self::Planes];
}

/// One term of a method's cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// What is counted.
    pub name: &'static str,
    /// Processor time of one unit, on the machine that the table of costs was measured on.
    pub nanoseconds: f64,
    /// How many units there are.
    pub amount: f64,
}

/// A [`Term`]: `amount` units of `name`, of `nanoseconds` each.
pub fn term(name: &'static str, nanoseconds: f64, amount: f64) -> Term {
    Term { name, nanoseconds, amount }
}

/// What carrying out a plan costs.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// The kind of work.
    pub kind: WorkKind,
    /// The terms, the same ones in the same order for every plan of a method.
    pub terms: Vec<Term>,
}

impl Cost {
    /// A cost of one kind of work.
    pub fn new(kind: WorkKind, terms: impl Into<Vec<Term>>) -> Self {
        Self { kind, terms: terms.into() }
    }

    /// Processor seconds on the machine that the table of costs was measured on.
    pub fn cpu_seconds(&self) -> f64 {
        self.terms.iter().map(|term| term.nanoseconds * term.amount).sum::<f64>() * 1e-9
    }
}
