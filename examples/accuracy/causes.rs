//! The likely cause of the error at each pixel, decided from the stack alone.
//!
//! Five effects each have a strength at each pixel, from 0 to 1. The pixel belongs to the strongest one, or to the first of equals, if
//! that has at least [`NOTABLE`]; else it shows the inside of a surface, in focus or blurred.

use crate::distance::distances;
use crate::reach::{columns, rows, split};
use thinlens::image::srgb_encode;
use thinlens::scene::Scene;

/// What the error at a pixel is attributed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    /// Lens rays leave the data window. Strength: how evenly its border divides the rays.
    OffScreen,
    /// Discs of lights cover the pixel: of blurred fragments brighter than white. Strength: their light as shown on a display.
    Lights,
    /// A silhouette in focus is less than a pixel away. Strength: 1 beside it.
    FocusedSilhouettes,
    /// The edge of a surface in front of focus is within its own CoC. Strength: how evenly it divides the rays.
    NearEdges,
    /// The pixel shows a surface behind focus, and an edge is within its CoC. Strength: how evenly it divides the rays.
    FarEdges,
    /// The pixel shows the inside of a surface in focus.
    FocusedInsides,
    /// The pixel shows the inside of a blurred surface.
    Smooth,
}

impl Cause {
    /// All causes, in the order of the table.
    pub(crate) const ALL: [Self; 7] = [
        Self::OffScreen,
        Self::Lights,
        Self::FocusedSilhouettes,
        Self::NearEdges,
        Self::FarEdges,
        Self::FocusedInsides,
        Self::Smooth,
    ];

    /// The heading of its column.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::OffScreen => "off-screen",
            Self::Lights => "lights",
            Self::FocusedSilhouettes => "silhouettes in focus",
            Self::NearEdges => "near edges",
            Self::FarEdges => "far edges",
            Self::FocusedInsides => "insides in focus",
            Self::Smooth => "smooth",
        }
    }
}

/// Strength from which on an effect decides for a pixel: a tenth of the rays are divided, or of the display range is added.
const NOTABLE: f32 = 0.1;

/// CoC radius in picture pixels below which a fragment is in focus.
const FOCUSED_PX: f32 = 1.0;

/// Smallest difference in CoC radius between neighbouring pixels that is an edge, in picture pixels.
const EDGE_PX: f32 = 0.5;

/// A difference is an edge if it exceeds those before and after it by this factor: on a slope all are equal.
const EDGE_CHANGE: f32 = 2.0;

/// The nearest surface of a scene by picture pixel, without what lies beyond the frame.
struct Front {
    width: usize,
    height: usize,
    /// Signed CoC radius in picture pixels; that of infinity where there is no surface.
    coc_px: Vec<f32>,
}

/// The cause of each pixel of the frame, row by row.
pub(crate) fn causes(scene: &Scene) -> Vec<Cause> {
    let front = Front::new(scene);
    let edges = front.edges();
    let strengths = [
        front.off_screen(scene),
        lights(scene),
        front.focused_silhouettes(&edges),
        front.near_edges(&edges),
        front.far_edges(&edges),
    ];
    let cause = |(pixel, coc_px): (usize, &f32)| {
        let strongest = strengths.iter().map(|strength| strength[pixel]).fold(0.0, f32::max);
        match strengths.iter().position(|strength| strength[pixel] == strongest) {
            Some(effect) if strongest >= NOTABLE => Cause::ALL[effect],
            _ if coc_px.abs() < FOCUSED_PX => Cause::FocusedInsides,
            _ => Cause::Smooth,
        }
    };
    front.coc_px.iter().enumerate().map(cause).collect()
}

/// The fragments of pixel `x, y` of the frame: layer, column and row of each sample that shows a surface.
fn fragments(scene: &Scene, x: usize, y: usize) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    let s = scene.supersample;
    let [column, row] = [x + scene.outside_px[0], y + scene.outside_px[1]].map(|at| at * s);
    let samples = (0..s * s).map(move |i| (column + i % s, row + i / s));
    let of_layer = move |layer: usize| samples.clone().map(move |(x, y)| (layer, x, y));
    (0..scene.layers.len())
        .flat_map(of_layer)
        .filter(|&(layer, x, y)| scene.layers[layer].alpha.get(x, y) > 0.0)
}

/// Adds the light of all discs of lights: display value by pixel of the frame.
fn lights(scene: &Scene) -> Vec<f32> {
    let (width, height) = scene.frame_size();
    let samples = (scene.supersample * scene.supersample) as f32;
    // What each row changes from one column to the next.
    let mut steps = vec![0.0f64; (width + 1) * height];
    for (x, y) in (0..width * height).map(|pixel| (pixel % width, pixel / width)) {
        for (layer, column, row) in fragments(scene, x, y) {
            let layer = &scene.layers[layer];
            let radius_px = layer.coc_px.get(column, row).abs();
            let light = layer.color_at(column, row).into_iter().fold(0.0, f32::max);
            if light <= layer.alpha.get(column, row) || radius_px < FOCUSED_PX {
                continue;
            }
            let added = f64::from(light / (samples * std::f32::consts::PI * radius_px * radius_px));
            for row in rows(y, height, radius_px) {
                let covered = columns(x, width, radius_px, row.abs_diff(y) as f32);
                steps[row * (width + 1) + covered.start] += added;
                steps[row * (width + 1) + covered.end] -= added;
            }
        }
    }
    let sums = |row: &[f64]| {
        let sum = row[..width].iter().scan(0.0, |sum, step| {
            *sum += step;
            Some(srgb_encode((*sum as f32).clamp(0.0, 1.0)))
        });
        sum.collect::<Vec<_>>()
    };
    steps.chunks(width + 1).flat_map(sums).collect()
}

impl Front {
    fn new(scene: &Scene) -> Self {
        let (width, height) = scene.frame_size();
        let nearest = |pixel: usize| {
            let coc_px = |(layer, x, y): (usize, usize, usize)| scene.layers[layer].coc_px.get(x, y);
            fragments(scene, pixel % width, pixel / width).map(coc_px).fold(scene.coc_infinity_px, f32::min)
        };
        Self { width, height, coc_px: (0..width * height).map(nearest).collect() }
    }

    /// Pixels beside an edge, with the CoC radius of its nearer side; `None` away from edges.
    fn edges(&self) -> Vec<Option<f32>> {
        let mut edges = vec![None; self.coc_px.len()];
        let lines = (0..self.height).map(|y| (y * self.width, 1, self.width));
        let lines = lines.chain((0..self.width).map(|x| (x, self.width, self.height)));
        for (first, step, length) in lines {
            let at = |i: usize| first + i * step;
            let difference = |i: usize| self.coc_px[at(i + 1)] - self.coc_px[at(i)];
            let last = length.saturating_sub(2);
            for i in 0..length.saturating_sub(1) {
                let before = if i > 0 { difference(i - 1).abs() } else { 0.0 };
                let after = if i < last { difference(i + 1).abs() } else { 0.0 };
                if difference(i).abs() < EDGE_PX.max(EDGE_CHANGE * before.min(after)) {
                    continue;
                }
                let near = self.coc_px[at(i)].min(self.coc_px[at(i + 1)]);
                for pixel in [at(i), at(i + 1)] {
                    edges[pixel] = Some(edges[pixel].map_or(near, |other: f32| other.min(near)));
                }
            }
        }
        edges
    }

    /// How evenly the frame's border divides the rays: for the surface that the pixel shows, and for those at the border opposite.
    fn off_screen(&self, scene: &Scene) -> Vec<f32> {
        let (width, height) = (self.width, self.height);
        let radius = |x: usize, y: usize| {
            let coc_px = |(layer, x, y): (usize, usize, usize)| scene.layers[layer].coc_px.get(x, y).abs();
            fragments(scene, x, y).map(coc_px).fold(0.0, f32::max)
        };
        let row_ends: Vec<[f32; 2]> = (0..height).map(|y| [radius(0, y), radius(width - 1, y)]).collect();
        let column_ends: Vec<[f32; 2]> = (0..width).map(|x| [radius(x, 0), radius(x, height - 1)]).collect();
        let strength = |(pixel, own_px): (usize, &f32)| {
            let (x, y) = (pixel % width, pixel / width);
            let [left, right] = row_ends[y];
            let [top, bottom] = column_ends[x];
            let sides = [(x, left), (width - 1 - x, right), (y, top), (height - 1 - y, bottom)];
            let side =
                |(pixels, radius_px): (usize, f32)| split(pixels as f32 + 0.5, radius_px.max(own_px.abs()));
            sides.into_iter().map(side).fold(0.0, f32::max)
        };
        self.coc_px.iter().enumerate().map(strength).collect()
    }

    /// 1 beside a silhouette whose nearer side is in focus.
    fn focused_silhouettes(&self, edges: &[Option<f32>]) -> Vec<f32> {
        let is_focused = |edge: &Option<f32>| edge.is_some_and(|near_px| near_px.abs() < FOCUSED_PX);
        edges.iter().map(|edge| f32::from(u8::from(is_focused(edge)))).collect()
    }

    /// How evenly the edges of surfaces in front of focus divide the rays.
    fn near_edges(&self, edges: &[Option<f32>]) -> Vec<f32> {
        let mut strengths = vec![0.0f32; edges.len()];
        let blurred =
            edges.iter().enumerate().filter_map(|(pixel, edge)| edge.map(|near_px| (pixel, -near_px)));
        for (pixel, radius_px) in blurred.filter(|&(_, radius_px)| radius_px >= FOCUSED_PX) {
            let (x, y) = (pixel % self.width, pixel / self.width);
            for row in rows(y, self.height, radius_px) {
                let rows_px = row.abs_diff(y) as f32;
                for column in columns(x, self.width, radius_px, rows_px) {
                    let strength = &mut strengths[row * self.width + column];
                    *strength = strength.max(split(rows_px.hypot(column.abs_diff(x) as f32), radius_px));
                }
            }
        }
        strengths
    }

    /// How evenly an edge divides the rays of pixels that show a surface behind focus.
    fn far_edges(&self, edges: &[Option<f32>]) -> Vec<f32> {
        let limit_px = self.coc_px.iter().fold(0.0, |limit: f32, coc_px| limit.max(*coc_px)).ceil() as usize;
        let set: Vec<bool> = edges.iter().map(Option::is_some).collect();
        let strength = |(distance_px, &coc_px): (f32, &f32)| {
            if coc_px >= FOCUSED_PX { split(distance_px, coc_px) } else { 0.0 }
        };
        distances(&set, self.width, limit_px).into_iter().zip(&self.coc_px).map(strength).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thinlens::image::Plane;
    use thinlens::scene::Layer;
    use thinlens::stack::StackKind;

    const SIZE: usize = 64;

    /// A scene of one opaque layer of `light` and CoC radius by pixel.
    fn scene(coc_px: impl Fn(usize, usize) -> f32, light: impl Fn(usize, usize) -> f32) -> Scene {
        let color = [0; 3].map(|_| Plane::from_fn(SIZE, SIZE, &light));
        let alpha = Plane::filled(SIZE, SIZE, 1.0);
        let layer = Layer { color, alpha, coc_px: Plane::from_fn(SIZE, SIZE, coc_px) };
        Scene::new(vec![layer], StackKind::PointSampled, 1, 12.0)
    }

    /// The causes along row 32 of a dark scene.
    fn along_the_middle(coc_px: impl Fn(usize, usize) -> f32) -> Vec<Cause> {
        causes(&scene(coc_px, |_, _| 0.2))[32 * SIZE..][..SIZE].to_vec()
    }

    #[test]
    fn a_plane_in_focus_is_the_inside_of_one_surface() {
        assert!(along_the_middle(|_, _| 0.5).iter().all(|&cause| cause == Cause::FocusedInsides));
    }

    #[test]
    fn a_blurred_plane_is_smooth_away_from_the_border_and_loses_rays_near_it() {
        let row = along_the_middle(|_, _| 8.0);
        assert_eq!((row[0], row[63]), (Cause::OffScreen, Cause::OffScreen));
        assert!(row[8..56].iter().all(|&cause| cause == Cause::Smooth), "{row:?}");
    }

    #[test]
    fn a_steep_slope_has_no_edges() {
        // 1.5 px from one pixel to the next, which is more than the smallest edge.
        let row = along_the_middle(|x, _| 1.5 * (x as f32 - 20.0));
        assert!(!row.contains(&Cause::NearEdges) && !row.contains(&Cause::FarEdges), "{row:?}");
    }

    #[test]
    fn an_edge_in_front_of_focus_reaches_both_sides_of_it() {
        let row = along_the_middle(|x, _| if x < 32 { -10.0 } else { 0.0 });
        assert!(row[26..38].iter().all(|&cause| cause == Cause::NearEdges), "{row:?}");
        assert_eq!((row[18], row[46]), (Cause::Smooth, Cause::FocusedInsides));
    }

    #[test]
    fn a_surface_in_focus_has_a_silhouette_and_what_is_behind_it_a_far_edge() {
        let row = along_the_middle(|x, _| if x < 32 { 0.0 } else { 10.0 });
        assert_eq!((row[31], row[32]), (Cause::FocusedSilhouettes, Cause::FocusedSilhouettes));
        assert!(row[33..38].iter().all(|&cause| cause == Cause::FarEdges), "{row:?}");
        assert_eq!((row[28], row[44]), (Cause::FocusedInsides, Cause::Smooth));
    }

    #[test]
    fn a_light_reaches_as_far_as_its_disc() {
        let light = |x: usize, y: usize| if (x, y) == (32, 32) { 500.0 } else { 0.2 };
        let row = causes(&scene(|_, _| 10.0, light))[32 * SIZE..][..SIZE].to_vec();
        assert!(row[22..43].iter().all(|&cause| cause == Cause::Lights), "{row:?}");
        assert_eq!((row[21], row[43]), (Cause::Smooth, Cause::Smooth));
    }

    #[test]
    fn padding_beyond_the_frame_is_not_counted() {
        let inner = scene(|_, _| 8.0, |_, _| 0.2);
        let padded = inner.clone().padded(thinlens::settings::Border::Mirror, 10);
        assert_eq!(causes(&padded), causes(&inner));
    }
}
