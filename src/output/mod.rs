//! WRITE: pictures and reports. Knows the formats it writes and how to put a file in place whole or not at all.
//!
//! Every writer goes through [`atomic::write()`]; none of them opens a file itself.

#[doc(hidden)]
pub mod atomic;
#[cfg(feature = "cli")]
pub(crate) mod data_uri;
pub mod exr;
pub mod focus_map;
pub mod png;
pub mod report;
