//! WRITE: pictures and reports: the output formats and atomic writes.
//!
//! Every writer uses [`atomic::write()`]; none of them opens a file itself.

#[doc(hidden)]
pub mod atomic;
#[cfg(feature = "cli")]
pub(crate) mod data_uri;
mod digest_of;
pub mod displayed;
mod encoding;
pub mod exr;
pub mod focus_map;
mod made;
pub mod png;
pub mod report;

pub use digest_of::digest_of;
pub use encoding::Encoding;
pub use made::Made;
#[doc(hidden)]
pub mod temporary;
