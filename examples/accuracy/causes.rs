//! The likely cause of the error at each pixel, decided from the stack alone.
//!
//! Six effects each have a strength at each pixel, in display values of 0 to 1: how much the pixel would change if the effect were not
//! simulated, roughly. The pixel belongs to the strongest one, or to the first of equals, if that has at least [`NOTABLE`]; else it shows
//! the inside of a surface, in focus or blurred.

use crate::distance::nearest;
use crate::front::{Edge, FOCUSED_PX, Front, contrast, fragments};
use crate::reach::{columns, rows, split};
use thinlens::image::srgb_encode;
use thinlens::scene::Scene;

/// What the error at a pixel is attributed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    /// Lens rays leave the data window. Strength: how evenly its border divides the rays, times the deviation of the whole picture from
    /// its mean, as nobody knows what is there.
    OffScreen,
    /// Discs of lights cover the pixel: of blurred fragments brighter than white. Strength: their light.
    Lights,
    /// Beside an edge whose nearer side is in focus. Strength: contrast of the edge.
    FocusedSilhouettes,
    /// The edge of a surface in front of focus is within its own CoC. Strength: how evenly it divides the rays, times its contrast.
    NearEdges,
    /// The pixel shows a surface behind focus, and an edge is within its CoC. Strength: how evenly it divides the rays, times its
    /// contrast.
    FarEdges,
    /// The inside of a surface in focus, seen directly or past others. Strength: contrast to the neighbouring pixels of the surface.
    FocusedInsides,
    /// The inside of a blurred surface: none of the others.
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
            Self::FocusedSilhouettes => "focused silhouettes",
            Self::NearEdges => "near edges",
            Self::FarEdges => "far edges",
            Self::FocusedInsides => "focused insides",
            Self::Smooth => "smooth",
        }
    }
}

/// Strength from which on an effect decides for a pixel, in display values of 0 to 1.
const NOTABLE: f32 = 0.02;

/// The cause of each pixel of the frame, row by row.
pub(crate) fn causes(scene: &Scene) -> Vec<Cause> {
    let front = Front::new(scene);
    let edges = front.edges();
    // In the order of the table.
    let strengths = [
        off_screen(scene, &front),
        lights(scene),
        focused_silhouettes(&edges),
        near_edges(&front, &edges),
        far_edges(&front, &edges),
        focused_insides(&front),
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

/// The strength of [`Cause::OffScreen`]. The rays are those of the surface that the pixel shows, or of those at the border opposite,
/// whichever spread farther.
fn off_screen(scene: &Scene, front: &Front) -> Vec<f32> {
    let (width, height) = (front.width, front.height);
    let radius_px = |x: usize, y: usize| {
        let coc_px = |(layer, x, y): (usize, usize, usize)| scene.layers[layer].coc_px.get(x, y).abs();
        fragments(scene, x, y).map(coc_px).fold(0.0, f32::max)
    };
    let row_ends: Vec<[f32; 2]> = (0..height).map(|y| [radius_px(0, y), radius_px(width - 1, y)]).collect();
    let column_ends: Vec<[f32; 2]> =
        (0..width).map(|x| [radius_px(x, 0), radius_px(x, height - 1)]).collect();
    let deviation = deviation(front);
    let strength = |(pixel, own_px): (usize, &f32)| {
        let (x, y) = (pixel % width, pixel / width);
        let ([left, right], [top, bottom]) = (row_ends[y], column_ends[x]);
        let sides = [(x, left), (width - 1 - x, right), (y, top), (height - 1 - y, bottom)];
        let side =
            |(pixels, border_px): (usize, f32)| split(pixels as f32 + 0.5, border_px.max(own_px.abs()));
        deviation * sides.into_iter().map(side).fold(0.0, f32::max)
    };
    front.coc_px.iter().enumerate().map(strength).collect()
}

/// Root mean squared deviation of the pinhole picture's display values from their mean.
fn deviation(front: &Front) -> f32 {
    let mean_of = |value: &dyn Fn(usize) -> f64| {
        (0..front.color.len()).map(value).sum::<f64>() / front.color.len().max(1) as f64
    };
    let mean = [0, 1, 2].map(|c| mean_of(&|pixel| f64::from(front.color[pixel][c])) as f32);
    mean_of(&|pixel| f64::from(contrast(front.color[pixel], mean)).powi(2)).sqrt() as f32
}

/// The strength of [`Cause::Lights`].
fn lights(scene: &Scene) -> Vec<f32> {
    let (width, height) = scene.frame_size();
    let samples = (scene.supersample * scene.supersample) as f32;
    // What each row of discs adds from one column to the next.
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
    let shown = |row: &[f64]| {
        let sums = row[..width].iter().scan(0.0, |sum, step| {
            *sum += step;
            Some(srgb_encode((*sum as f32).clamp(0.0, 1.0)))
        });
        sums.collect::<Vec<_>>()
    };
    steps.chunks(width + 1).flat_map(shown).collect()
}

/// The strength of [`Cause::FocusedSilhouettes`].
fn focused_silhouettes(edges: &[Option<Edge>]) -> Vec<f32> {
    let focused = |edge: &Option<Edge>| edge.filter(|edge| edge.near_px.abs() < FOCUSED_PX);
    edges.iter().map(|edge| focused(edge).map_or(0.0, |edge| edge.contrast)).collect()
}

/// The strength of [`Cause::NearEdges`].
fn near_edges(front: &Front, edges: &[Option<Edge>]) -> Vec<f32> {
    let (width, height) = (front.width, front.height);
    let mut strengths = vec![0.0f32; edges.len()];
    let edges = edges.iter().enumerate().filter_map(|(pixel, edge)| edge.map(|edge| (pixel, edge)));
    for (pixel, edge) in edges.filter(|(_, edge)| edge.near_px <= -FOCUSED_PX) {
        let (x, y, radius_px) = (pixel % width, pixel / width, -edge.near_px);
        for row in rows(y, height, radius_px) {
            let rows_px = row.abs_diff(y) as f32;
            for column in columns(x, width, radius_px, rows_px) {
                let strength = &mut strengths[row * width + column];
                let distance_px = rows_px.hypot(column.abs_diff(x) as f32);
                // Most pixels have a stronger edge already.
                if edge.contrast > *strength {
                    *strength = strength.max(edge.contrast * split(distance_px, radius_px));
                }
            }
        }
    }
    strengths
}

/// The strength of [`Cause::FarEdges`].
fn far_edges(front: &Front, edges: &[Option<Edge>]) -> Vec<f32> {
    let limit_px = front.coc_px.iter().fold(0.0, |limit: f32, coc_px| limit.max(*coc_px)).ceil() as usize;
    let set: Vec<bool> = edges.iter().map(Option::is_some).collect();
    let strength = |(nearest, &coc_px): (Option<(usize, f32)>, &f32)| match nearest {
        Some((pixel, distance_px)) if coc_px >= FOCUSED_PX => {
            edges[pixel].map_or(0.0, |edge| edge.contrast * split(distance_px, coc_px))
        }
        _ => 0.0,
    };
    nearest(&set, front.width, limit_px).into_iter().zip(&front.coc_px).map(strength).collect()
}

/// The strength of [`Cause::FocusedInsides`].
fn focused_insides(front: &Front) -> Vec<f32> {
    let (width, height) = (front.width, front.height);
    let strength = |pixel: usize| {
        let Some(color) = front.focused[pixel] else { return 0.0 };
        let (x, y) = (pixel % width, pixel / width);
        let neighbours = [
            (x > 0).then(|| pixel - 1),
            (x + 1 < width).then(|| pixel + 1),
            (y > 0).then(|| pixel - width),
            (y + 1 < height).then(|| pixel + width),
        ];
        let others = neighbours.into_iter().flatten().filter_map(|other| front.focused[other]);
        others.map(|other| contrast(color, other)).fold(0.0, f32::max)
    };
    (0..front.color.len()).map(strength).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use thinlens::image::Plane;
    use thinlens::scene::Layer;
    use thinlens::stack::StackKind;

    const SIZE: usize = 64;

    /// A scene of one opaque layer, of CoC radius and light by pixel.
    fn scene(coc_px: impl Fn(usize, usize) -> f32, light: impl Fn(usize, usize) -> f32) -> Scene {
        let color = [0; 3].map(|_| Plane::from_fn(SIZE, SIZE, &light));
        let alpha = Plane::filled(SIZE, SIZE, 1.0);
        let layer = Layer { color, alpha, coc_px: Plane::from_fn(SIZE, SIZE, coc_px) };
        Scene::new(vec![layer], StackKind::PointSampled, 1, 12.0)
    }

    /// The causes along the middle row of a scene whose left half is darker.
    fn along_the_middle(coc_px: impl Fn(usize, usize) -> f32) -> Vec<Cause> {
        causes(&scene(coc_px, |x, _| if x < 32 { 0.1 } else { 0.3 }))[32 * SIZE..][..SIZE].to_vec()
    }

    #[test]
    fn a_plane_in_focus_is_the_inside_of_one_surface() {
        assert!(along_the_middle(|_, _| 0.4).iter().all(|&cause| cause == Cause::FocusedInsides));
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
        assert_eq!((row[20], row[44]), (Cause::Smooth, Cause::FocusedInsides));
    }

    #[test]
    fn a_surface_in_focus_has_a_silhouette_and_what_is_behind_it_a_far_edge() {
        let row = along_the_middle(|x, _| if x < 32 { 0.0 } else { 10.0 });
        assert_eq!((row[31], row[32]), (Cause::FocusedSilhouettes, Cause::FocusedSilhouettes));
        assert!(row[33..38].iter().all(|&cause| cause == Cause::FarEdges), "{row:?}");
        assert_eq!((row[28], row[44]), (Cause::FocusedInsides, Cause::Smooth));
    }

    #[test]
    fn an_edge_without_contrast_causes_no_error() {
        let causes = causes(&scene(|x, _| if x < 32 { -10.0 } else { 0.0 }, |_, _| 0.2));
        assert!(!causes.contains(&Cause::NearEdges));
    }

    #[test]
    fn detail_in_focus_behind_a_faint_near_surface_is_that_of_the_surface_in_focus() {
        let dots = |x: usize, y: usize| 0.9 * ((x + y) % 2) as f32;
        let mut scene = scene(|_, _| 0.0, dots);
        let alpha = Plane::from_fn(SIZE, SIZE, |x, _| f32::from(u8::from(x < 32)));
        let color = [0; 3].map(|_| Plane::from_fn(SIZE, SIZE, |x, _| if x < 32 { 0.5 } else { 0.0 }));
        scene.layers.insert(0, Layer { color, alpha, coc_px: Plane::filled(SIZE, SIZE, -6.0) });
        let row = &causes(&scene)[32 * SIZE..][..SIZE];
        assert!(row[8..].iter().all(|&cause| cause == Cause::FocusedInsides), "{row:?}");
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
        let inner = scene(|_, _| 8.0, |x, _| 0.01 * x as f32);
        let padded = inner.clone().padded(thinlens::settings::Border::Mirror, 10);
        assert_eq!(causes(&padded), causes(&inner));
    }
}
