//! The inputs of the filter: the visible picture, its prefiltered versions, and the disc of each pixel.

use super::prefilter;
use crate::image::Plane;
use crate::lens::Aperture;
use crate::methods::shared::{DiscAreas, Visible};
use rayon::prelude::*;

/// The inputs of the filter.
pub(super) struct Source {
    /// The channels of the picture, and their means over increasingly wide boxes: see [`prefilter`].
    pub boxes: Vec<Vec<Plane>>,
    /// Signed CoC radius in pixels.
    pub coc_px: Plane,
    /// One over the area of the disc in pixels.
    pub intensity: Plane,
    /// Distance of the sides of the aperture from its centre, in CoC radii.
    pub apothem: f32,
}

impl Source {
    /// The inputs for samples that read boxes up to number `max_box`.
    pub(super) fn new(visible: Visible, aperture: Aperture, max_box: usize) -> Self {
        let areas = DiscAreas::new(aperture);
        let mut intensity = visible.coc_px.clone();
        intensity.values_mut().par_iter_mut().for_each(|value| *value = 1.0 / areas.area(*value));
        let Visible { content, coc_px } = visible;
        let boxes = prefilter::boxes(content, &coc_px, max_box);
        Self { boxes, coc_px, intensity, apothem: aperture.apothem() }
    }
}
