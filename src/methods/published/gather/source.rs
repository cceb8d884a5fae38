//! The inputs of the filter: the visible picture, its prefiltered versions, and the disc of each pixel.

use super::prefilter;
use crate::image::Plane;
use crate::lens::Aperture;
use crate::methods::shared::{DiscAreas, VisibleSurfaces};
use crate::parallel;

/// A signed CoC radius in pixels that lies behind all surfaces.
const BEHIND_ALL_PX: f32 = 1e6;

/// The inputs of the filter.
pub(super) struct Source {
    /// The channels of the picture, content and, where it differs from 1, presence; and their means over increasingly wide boxes:
    /// see [`prefilter`].
    pub boxes: Vec<Vec<Plane>>,
    /// Whether the last channel is presence.
    pub has_presence: bool,
    /// Signed CoC radius in pixels.
    pub coc_px: Plane,
    /// One over the area of the disc in pixels.
    pub intensity: Plane,
    /// The same two of the pixels that gather, where presence differs from 1: there they lie behind their surface.
    gathering: Option<[Plane; 2]>,
    /// Distance of the sides of the aperture from its centre, in CoC radii.
    pub apothem: f32,
}

impl Source {
    /// The inputs for samples that read boxes up to number `max_box`.
    pub(super) fn new(surfaces: VisibleSurfaces, aperture: Aperture, max_box: usize) -> Self {
        let VisibleSurfaces { mut content, presence, coc_px } = surfaces;
        let areas = DiscAreas::new(aperture);
        let intensity = |coc_px: &Plane| {
            let mut intensity = coc_px.clone();
            parallel::for_each_block(intensity.values_mut(), &|_, values| {
                values.iter_mut().for_each(|value| *value = 1.0 / areas.area(*value));
            });
            intensity
        };
        let gathering = presence.as_ref().map(|presence| {
            let mut behind = coc_px.clone();
            parallel::for_each_block(behind.values_mut(), &|block, coc_px| {
                let pixels = coc_px.iter_mut().zip(&presence.values()[block]);
                pixels.for_each(|(coc_px, &presence)| *coc_px = behind_px(*coc_px, presence));
            });
            [intensity(&behind), behind]
        });
        let has_presence = presence.is_some();
        content.extend(presence);
        let intensity = intensity(&coc_px);
        let boxes = prefilter::boxes(content, &coc_px, max_box);
        Self { boxes, has_presence, coc_px, intensity, gathering, apothem: aperture.apothem() }
    }
}

impl Source {
    /// Presence of the pixels of row `y`, of a source that has it.
    pub(super) fn presence(&self, y: usize) -> &[f32] {
        self.boxes[0].last().map_or(&[], |presence| presence.row(y))
    }

    /// Signed CoC radius of the pixels of row `y` that gather, and one over the areas of their discs.
    #[inline(always)]
    pub(super) fn gathering(&self, y: usize) -> [&[f32]; 2] {
        match &self.gathering {
            Some([intensity, coc_px]) => [coc_px.row(y), intensity.row(y)],
            None => [self.coc_px.row(y), self.intensity.row(y)],
        }
    }
}

/// Signed CoC radius of a pixel that is a surface of radius `coc_px` to the part `presence`, and otherwise lies behind all surfaces.
fn behind_px(coc_px: f32, presence: f32) -> f32 {
    if presence < 1.0 { (coc_px + (1.0 - presence) / presence).min(BEHIND_ALL_PX) } else { coc_px }
}
