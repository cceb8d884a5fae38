//! BLUR: one trait, one registry, one file a method.
//!
//! A method reads a [`Scene`] and a [`Plan`] and returns a picture. It does no I/O, prints nothing, and decides nothing
//! that the plan could have decided.

mod accumulate;
mod shear;

use crate::error::Error;
use crate::image::Image;
use crate::scene::{Plan, Scene};
use std::fmt;

/// What a method is, for `thinlens methods`, the README and the laws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct MethodInfo {
    /// The name of `--method`.
    pub name: &'static str,
    /// Where it comes from.
    pub source: &'static str,
    /// Default, reference, paper or baseline.
    pub role: &'static str,
    /// One sentence.
    pub summary: &'static str,
}

/// Called now and then with the share of the work that is done, 0 … 1, from any thread.
pub type Progress<'a> = dyn Fn(f32) + Sync + 'a;

/// A way to put a lens on a stack.
pub trait Method: fmt::Debug + Sync {
    /// What it is.
    fn info(&self) -> MethodInfo;

    /// The picture of `scene` as `plan` asks for it, of the scene's picture size.
    ///
    /// # Errors
    /// When a device fails; on the CPU a method that has a plan succeeds.
    fn blur(&self, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;
}

/// Every method, in the order they are listed.
pub static METHODS: [&dyn Method; 2] = [&shear::Shear, &accumulate::Accumulate];

/// The method called `name`.
pub fn by_name(name: &str) -> Option<&'static dyn Method> {
    METHODS.into_iter().find(|method| method.info().name == name)
}
