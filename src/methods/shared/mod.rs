//! What several methods share: the stack as they read it, how their results become a picture, image pyramids, and
//! sub-images by depth.

mod content;
mod pyramid;
mod sub_images;

pub(super) use content::{Peel, Sheet, Visible, peels, picture, visible};
pub(super) use pyramid::{BOX, Edge, Grid, Rows, SPLAT, most_levels};
pub(super) use sub_images::SubImages;
