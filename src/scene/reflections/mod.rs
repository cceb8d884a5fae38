//! What the surfaces of a scene reflect, and how the lens moves it: fragments of their own, in CoC space.
//!
//! A mirror is not focused at its surface but at what it shows. Seen from lens point `u`, the fragment at place `p` shows
//! `S_u(p) = S_0(p + M u)`: what the pinhole sees reflected at another place of the same surface. [`view`] has `M`. A flat mirror shows
//! a picture of fragments that lie behind it, each with a CoC radius of its own, and a ray goes on among them.
//!
//! A fragment's reflection moves from half a pixel on, fading in up to twice that: where it moves less, the picture is the one without.
//!
//! Lee, Eisemann & Seidel 2009, section 5, shade anew with an environment; here a reflection is moved, which needs no material.
//!
//! Cost: one read of the layers that reflect, and the planes of [`ReflectingLayer`], 52 bytes a sample. Limits: what no place of the surface
//! shows is not seen in it; a mirror in a mirror moves as its first reflection does.

mod build;
mod layer;
mod surfaces;
mod view;

pub(super) use build::reflections;
pub use layer::{ReflectingLayer, ReflectionStats, Reflections};
