//! What several methods share: the stack as they read it and how their results become a picture, the area of a discrete disc,
//! image pyramids, and sub-images by depth.

mod content;
mod disc;
mod pyramid;
mod sub_images;

pub(super) use content::{Peel, Sheet, Visible, peels, picture, visible};
pub(super) use disc::{DiscAreas, soft_area};
pub(super) use pyramid::{BOX, Edge, Grid, Rows, SPLAT, most_levels};
pub(super) use sub_images::SubImages;
