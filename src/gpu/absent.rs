//! What stands for a GPU in a program that was built without.

use super::adapters::Adapter;
use super::clock::GpuUsage;
use crate::error::Error;

/// An adapter, opened: there is none.
#[derive(Debug)]
pub enum Gpu {}

impl Gpu {
    /// None.
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

    /// What it has spent its time on so far.
    ///
    /// # Errors
    /// Never.
    pub fn usage(&self) -> Result<GpuUsage, Error> {
        match *self {}
    }
}
