//! Depth of field for renders, after the render.
//!
//! A pinhole render, kept as a stack of depth peels, becomes the picture a real lens would have taken: read a stack, set a lens,
//! blur, write.
//!
//! ```
//! use thinlens::output::{exr, png};
//! use thinlens::render::{Job, render};
//! use thinlens::settings::{Focus, Values};
//! use thinlens::stack::Source;
//!
//! # let folder = tempfile::tempdir().expect("a temporary folder");
//! # let (exr_path, png_path) = (folder.path().join("out.exr"), folder.path().join("out.png"));
//! let focus = Some(Focus::Point([60.0, 70.0]));
//! let lens = Values { focal_length_mm: Some(85.0), f_number: Some(1.4), focus, ..Values::default() };
//! let job = Job::new([Source::file("samples/fence/stack.exr")]).with_values(lens);
//! let rendered = render(&job, &|_share| {})?;
//! let options = exr::ExrOptions::new(rendered.stack.precision);
//! exr::write(&exr_path, &rendered.image, &rendered.frame, &rendered.stack.carried, &options)?;
//! png::write(&png_path, &rendered.image, 0.0)?;
//! # assert!(exr_path.is_file() && png_path.is_file());
//! # Ok::<(), thinlens::error::Error>(())
//! ```
//!
//! A stack can also be made of planes in memory ([`stack::Stack::from_peels`]) and rendered without a file
//! ([`render_stack`](render::render_stack)): `examples/library.rs` does that. A method of your own is a type that implements
//! [`methods::Method`], registered in a [`methods::Registry`].
//!
//! # Modules
//!
//! Data flows one way, and so do the modules:
//!
//! | step | module | from → to |
//! | --- | --- | --- |
//! | read | [`stack`] | files or planes → [`stack::Stack`] |
//! | settings | [`settings`] | presets and [`settings::Values`] → [`settings::Settings`] |
//! | lens | [`lens`] | settings → [`lens::ThinLens`], [`lens::Optics`] |
//! | look, decide | [`scene`], [`methods`] | stack + lens → [`scene::Scene`] → [`methods::Plan`] |
//! | blur | [`methods`] | scene + plan → [`image::Image`] |
//! | write | [`output`] | picture → EXR, PNG, report |
//!
//! [`render`](mod@render) runs the steps up to the picture for one [`Job`](render::Job), [`sequence`] finds the frames of a shot.
//! [`cost`] predicts how long the blur will take, [`probes`] measure its sampling error, [`metrics`] compare two pictures.
//!
//! # Features
//!
//! * `gpu` (default): methods on graphics cards, by `wgpu`. Without it everything runs on the CPU.
//! * `cli` (default): the program and its command line, `cli`. A library that only renders does without:
//!   `default-features = false`.
//!
//! # Threads, output, errors
//!
//! Work runs in the `rayon` pool it is called from. The library prints nothing and ends no process; it writes only the files that
//! it is asked to write, and a [`cost::Calibration`] where a time is to be kept. Every failure is an [`error::Error`], which says
//! whose fault it is and what to do.
//!
//! # Stability
//!
//! Before 1.0 a release with a new second number may change the interface. Structs that callers make, such as
//! [`settings::Values`], [`render::Job`] and [`stack::ReadOptions`], get a field with each new setting: end their expressions with
//! `..Default::default()`. Structs that the library makes, and enums, are `#[non_exhaustive]`. What is hidden from this
//! documentation is there for the project's own tests and may change at any time.
//!
//! Two types of other crates are part of the interface: [`glam::Vec2`](lens::Vec2) in lens samples and in the geometry of
//! apertures, and [`serde_json::Value`](settings::Json) in parameters of methods and in reports. Reports implement `serde`'s
//! `Serialize`.

extern crate self as thinlens;

#[doc(hidden)]
pub mod shown;
pub mod error;
pub mod finding;
pub mod image;
pub mod usage;
pub mod machine;
pub mod memory;
mod parallel;
mod zip_blocks;
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
pub mod sequence;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod compare;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod exporters;
#[cfg(feature = "cli")]
pub mod cli;
