//! DECIDE and BLUR: the methods, one folder per method.
//!
//! A method implements [`Method`] ([`contract`]). Its folder holds its parameters, the decisions about its own passes, its cost,
//! its kernel and its GPU backend. It reads a [`Scene`](crate::scene::Scene) and a [`Plan`] and returns a picture. It does no
//! I/O, prints nothing, and makes no decision that the plan could make.
//!
//! [`shear`] is the default and [`accumulate`] the reference; [`published`] has the methods of papers and their baselines. Code
//! that several methods use is in [`shared`].

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
pub use contract::{
    GpuBackend, LensSampling, LostRays, Method, MethodInfo, PixelFilter, Plan, Progress, Role, Sampler,
};
pub use cost::{Cost, Term, WorkKind, term};
pub use decide::plan_for;
pub(crate) use execute::cpu_only_reason;
pub use execute::{render, render_on};
pub use laws::{Deviation, Law};
pub use registry::{METHODS, Registry};
pub(crate) use switches::{joined, requested};
pub use target::Target;
