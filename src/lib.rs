//! Depth of field for renders, after the render.
//!
//! A pinhole render, kept as a stack of depth peels, becomes the picture a real lens would have taken. Data flows one
//! way, and so do the modules:
//!
//! | step | module | from → to |
//! | --- | --- | --- |
//! | read | [`stack`] | files → [`stack::Stack`] |
//! | lens | [`lens`] | settings → [`lens::ThinLens`], [`lens::Optics`] |
//! | look, decide | [`scene`] | stack + lens → [`scene::Scene`] → [`scene::Plan`] |
//! | blur | [`methods`], [`finish`](mod@finish) | scene + plan → [`image::Image`] |
//! | write | [`output`] | picture → EXR, PNG, report |
//!
//! [`render`](mod@render) runs the steps up to the picture for one job; [`cost`] says before how long the blur will take.

extern crate self as thinlens;

pub mod error;
pub mod finding;
pub mod image;
pub mod usage;
mod machine;
pub mod settings;
pub mod stack;
pub mod lens;
pub mod scene;
pub mod gpu;
pub mod methods;
#[doc(hidden)]
pub mod finish;
pub mod output;
pub mod metrics;
pub mod probes;
mod confidence;
pub mod cost;
pub mod sample_budget;
pub mod render;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod compare;
#[cfg(feature = "cli")]
pub mod cli;
