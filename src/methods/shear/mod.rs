//! Shear.

use super::{Method, MethodInfo, Progress};
use crate::error::Error;
use crate::image::Image;
use crate::scene::{Plan, Scene};

/// The reference.
#[derive(Debug)]
pub(super) struct Shear;

impl Method for Shear {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "shear",
            source: "ours",
            role: "default",
            summary: "lens rays against the stack, one by one, no shortcut",
        }
    }

    fn blur(&self, _scene: &Scene, _plan: &Plan, _progress: &Progress<'_>) -> Result<Image, Error> {
        Err(Error::unsupported("not written yet"))
    }
}
