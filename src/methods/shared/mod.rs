//! What several methods share: the stack as they read it, and how their results become a picture.

mod content;

pub(super) use content::{Peel, Sheet, Visible, peels, picture, visible};
