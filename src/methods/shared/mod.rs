//! What several methods share: the stack as they read it, and how their results become a picture.

mod content;
mod fragments;
mod nbuffer;

pub(super) use content::{Peel, Sheet, Visible, peels, picture, visible};
#[cfg(test)]
pub(super) use fragments::noise;
pub(super) use fragments::{Blocks, Fragments};
pub(super) use nbuffer::{NBuffer, Window};
