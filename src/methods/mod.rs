//! DECIDE and BLUR: the methods, a folder each.
//!
//! A method is one [`Method`]: its folder holds its parameters, the decisions about its own passes, its cost, its kernel and its GPU
//! backend ([`contract`] says what the program asks of it). It reads a [`Scene`](crate::scene::Scene) and a [`Plan`] and returns a picture. It does no I/O,
//! prints nothing, and decides nothing that the plan could have decided.
//!
//! [`shear`] is the default, [`accumulate`] the reference; [`published`] are the papers' methods and their baselines. What several methods
//! share is in [`shared`].

mod contract;
mod cost;
mod decide;
mod execute;
mod laws;
mod registry;
mod switches;
mod target;

mod accumulate;
mod published;
mod shared;
mod shear;

pub(crate) use accumulate::Volume;
pub use contract::{GpuBackend, LensSampling, Method, MethodInfo, Plan, Progress, Role, Sampler};
pub use cost::{Cost, Term, WorkKind, term};
pub use decide::plan_for;
pub(crate) use execute::cpu_only_reason;
pub use execute::{render, render_on};
pub use laws::{Deviation, Law};
pub use registry::{METHODS, Registry};
pub(crate) use switches::requested;
pub use target::Target;
