//! Lens rays, one by one.

use super::{Method, MethodInfo, Progress};
use crate::error::Error;
use crate::image::Image;
use crate::scene::{Plan, Scene};

/// The reference.
#[derive(Debug)]
pub(super) struct Accumulate;

impl Method for Accumulate {
    fn info(&self) -> MethodInfo {
        MethodInfo {
            name: "accumulate",
            source: "Haeberli & Akeley 1990; Cook, Porter & Carpenter 1984",
            role: "reference",
            summary: "lens rays against the stack, one by one, no shortcut",
        }
    }

    fn blur(&self, _scene: &Scene, _plan: &Plan, _progress: &Progress<'_>) -> Result<Image, Error> {
        Err(Error::unsupported("not written yet"))
    }
}
