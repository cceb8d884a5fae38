//! Replacement of [`Gpu`] for builds without GPU support.

use super::adapters::Adapter;
use super::clock::GpuUsage;
use crate::error::Error;

/// An opened adapter; this type has no values.
#[derive(Debug)]
pub enum Gpu {}

impl Gpu {
    /// Always `None`.
    ///
    /// # Errors
    /// Never.
    pub fn open(_software: bool) -> Result<Option<Self>, Error> {
        Ok(None)
    }

    /// The adapter.
    pub fn adapter(&self) -> &Adapter {
        match *self {}
    }

    /// Usage of the GPU so far.
    ///
    /// # Errors
    /// Never.
    pub fn usage(&self) -> Result<GpuUsage, Error> {
        match *self {}
    }
}
