//! What several methods share: the stack as they read it, and how their results become a picture.

mod content;
mod disc;

pub(super) use content::{Peel, Sheet, Visible, peels, picture, visible};
pub(super) use disc::{DiscAreas, soft_area};
