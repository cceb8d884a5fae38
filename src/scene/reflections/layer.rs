//! What is kept of reflections: planes of each layer, and statistics.

use crate::finding::Finding;
use crate::image::Plane;
use glam::Vec2;

/// Movement in picture pixels from which a reflection moves; it does in full from twice that on.
pub(super) const MOVES_FROM_PX: f32 = 0.5;

/// What the surfaces of one layer reflect. All planes have the layer's size; what they hold where nothing moves has no meaning.
#[derive(Debug, Clone, PartialEq)]
pub struct ReflectingLayer {
    /// Red, green, blue that the surface reflects, not multiplied by alpha.
    pub light: [Plane; 3],
    /// The matrix `M`, in picture pixels per aperture radius: `[xx, xy, yx, yy]`, the place moves by `(xx u_x + xy u_y, yx u_x + yy u_y)`.
    pub movement: [Plane; 4],
    /// CoC radius of the surface, in picture pixels.
    pub coc_px: Plane,
    /// Nearest and farthest CoC radius of what a flat mirror shows: half-way to what it shows beside it.
    pub mirrored_px: [Plane; 2],
    /// Share of the light that moves as in a flat mirror.
    pub flat: Plane,
    /// Share of the light that moves as on a curved surface.
    pub curved: Plane,
    /// The number of the surface, 0 for none, row by row.
    pub surface: Vec<u32>,
}

/// What the surfaces of a scene reflect.
#[derive(Debug, Clone, PartialEq)]
pub struct Reflections {
    /// For each layer of the scene what its surfaces reflect; `None` where they reflect nothing.
    pub layers: Vec<Option<ReflectingLayer>>,
    /// For each surface, by its number, the largest CoC radius of what it shows as a flat mirror, in picture pixels.
    pub farthest_px: Vec<f32>,
    /// What is known of all of them.
    pub stats: ReflectionStats,
}

/// Statistics of what surfaces reflect.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
#[non_exhaustive]
pub struct ReflectionStats {
    /// Fragments that reflect light specularly.
    pub reflecting_fragments: usize,
    /// Those of them whose reflection moves by more than [`MOVES_FROM_PX`] and shows something else there.
    pub moving_fragments: usize,
    /// The largest movement, in picture pixels per aperture radius.
    pub largest_movement_px: f32,
    /// Fragments whose movement was limited to the largest blur: concave mirrors near their focus.
    pub limited_fragments: usize,
    /// Fragments without a normal, or with one that faces away: their reflection does not move.
    pub without_normal: usize,
    /// Fragments without a distance of what they reflect (0, negative or not a number): their reflection does not move.
    pub without_distance: usize,
}

impl ReflectingLayer {
    /// Index of the sample in column `x` of row `y`.
    fn index(&self, x: usize, y: usize) -> usize {
        y * self.coc_px.width() + x
    }

    /// The surface of the sample in column `x` of row `y`.
    pub(crate) fn surface_at(&self, x: usize, y: usize) -> u32 {
        self.surface[self.index(x, y)]
    }

    /// By how much the place moves, in picture pixels, at which the sample is seen reflected from the lens point `lens`.
    #[inline]
    pub(crate) fn moved_by(&self, (x, y): (usize, usize), lens: Vec2) -> Vec2 {
        let [xx, xy, yx, yy] = self.movement.each_ref().map(|plane| plane.get(x, y));
        Vec2::new(xx * lens.x + xy * lens.y, yx * lens.x + yy * lens.y)
    }

    /// Share of the light there that moves.
    pub(crate) fn share(&self, x: usize, y: usize) -> f32 {
        self.flat.get(x, y) + self.curved.get(x, y)
    }
}

impl Reflections {
    /// The reflections of a scene whose planes are padded by `pad`, with zeros.
    pub(in crate::scene) fn padded(&self, pad: impl Fn(&Plane) -> Plane) -> Self {
        let of_layer = |layer: &ReflectingLayer| {
            // Numbers of surfaces are whole numbers, and few enough for a float.
            let (width, height) = (layer.coc_px.width(), layer.coc_px.height());
            let numbers: Vec<f32> = layer.surface.iter().map(|&number| number as f32).collect();
            let surface = pad(&Plane::from_values(width, height, &numbers));
            ReflectingLayer {
                light: layer.light.each_ref().map(&pad),
                movement: layer.movement.each_ref().map(&pad),
                coc_px: pad(&layer.coc_px),
                mirrored_px: layer.mirrored_px.each_ref().map(&pad),
                flat: pad(&layer.flat),
                curved: pad(&layer.curved),
                surface: surface.values().iter().map(|&number| number as u32).collect(),
            }
        };
        let layers = self.layers.iter().map(|layer| layer.as_ref().map(of_layer)).collect();
        Self { layers, farthest_px: self.farthest_px.clone(), stats: self.stats }
    }

    /// The fragment of `surface` in column `x` of row `y`: its layer, that of `own` before others.
    #[inline]
    pub(crate) fn fragment(&self, (x, y): (usize, usize), surface: u32, own: usize) -> Option<usize> {
        let is_of = |layer: &usize| {
            self.layers[*layer].as_ref().is_some_and(|reflecting| reflecting.surface_at(x, y) == surface)
        };
        Some(own).filter(is_of).or_else(|| (0..self.layers.len()).filter(|&layer| layer != own).find(is_of))
    }

    /// The layer `number`, if its surfaces reflect.
    #[inline]
    pub(crate) fn layer(&self, number: usize) -> Option<&ReflectingLayer> {
        self.layers.get(number)?.as_ref()
    }
}

impl ReflectionStats {
    /// What is to be said of them.
    pub(super) fn findings(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        let mut warn = |count: usize, text: &str| {
            if count > 0 {
                findings.push(Finding::warning("reflections", format!("{count} fragments {text}")));
            }
        };
        warn(
            self.limited_fragments,
            "reflect what the lens would move by more than its largest blur, as a concave mirror does near its focus: their movement was limited to that",
        );
        warn(
            self.without_normal,
            "reflect light and have no normal that faces the camera: their reflection does not move with the lens",
        );
        warn(
            self.without_distance,
            "reflect light from a distance of 0 or less, or none: their reflection does not move with the lens",
        );
        findings
    }
}
