//! The camera of the header (`worldToCamera`): depth from the position of surfaces, and how the camera stands in the world.
//!
//! OpenEXR's matrices multiply rows: `[x y z 1] · M`. Some programs write the transposed one, which is recognised by its last column: that of
//! an affine matrix is `0 0 0 1`. Cameras look along their own +z or −z, by the program: the positions that are seen lie in front.

use crate::image::Plane;
use exr::meta::attribute::{AttributeValue, Text};

/// The third column of the matrix from world to camera: `z = a·x + b·y + c·z + d`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WorldToCamera([f32; 4]);

/// The camera of a header, if it has one.
pub(super) fn world_to_camera(attributes: &[(Text, AttributeValue)]) -> Option<WorldToCamera> {
    matrices(attributes).find_map(WorldToCamera::of)
}

/// From the axes of the camera (x right, y up, z to the viewer) to those of the world, by rows; `None` without a camera in the header, and
/// for one that shears.
///
/// A camera's own axes are right-handed and look along −z, or left-handed and look along +z, as OpenEXR's documentation has them: in a
/// right-handed world the determinant tells which.
pub(super) fn world_from_camera(attributes: &[(Text, AttributeValue)]) -> Option<[[f32; 3]; 3]> {
    matrices(attributes).find_map(orientation)
}

/// The matrices of a camera in the header.
fn matrices(attributes: &[(Text, AttributeValue)]) -> impl Iterator<Item = &[f32; 16]> {
    let is_camera = |name: &Text| {
        let name = name.to_string();
        name.rsplit(['/', ':']).next().is_some_and(|last| last.eq_ignore_ascii_case("worldToCamera"))
    };
    attributes.iter().filter(move |(name, _)| is_camera(name)).filter_map(|(_, value)| match value {
        AttributeValue::Matrix4x4(matrix) => Some(matrix),
        _ => None,
    })
}

/// Whether these places of `matrix` hold the last column of an affine matrix.
fn is_affine(matrix: &[f32; 16], last: [usize; 4]) -> bool {
    last.map(|at| matrix[at]) == [0.0, 0.0, 0.0, 1.0]
}

/// The last column of a matrix that multiplies rows, and of a transposed one.
const LAST_COLUMN: [[usize; 4]; 2] = [[3, 7, 11, 15], [12, 13, 14, 15]];

/// The rotation of `matrix`, inverted.
fn orientation(matrix: &[f32; 16]) -> Option<[[f32; 3]; 3]> {
    /// By how much the axes may differ from a rotation, in shares of their length: programs write six digits or more.
    const TOLERANCE: f32 = 1e-3;
    // Row k has the world's axis k in the camera's coordinates.
    let at: fn(usize, usize) -> usize = match LAST_COLUMN.map(|last| is_affine(matrix, last)) {
        [true, _] => |row, column| 4 * row + column,
        [false, true] => |row, column| 4 * column + row,
        [false, false] => return None,
    };
    let axes: [[f32; 3]; 3] =
        std::array::from_fn(|row| std::array::from_fn(|column| matrix[at(row, column)]));
    let dot = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    let [x, y, z] = axes;
    let cross = [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]];
    let volume = dot(x, cross);
    let scale = volume.abs().cbrt();
    let forward = if volume < 0.0 { -1.0 } else { 1.0 };
    let unit = axes.map(|[x, y, z]| [x / scale, y / scale, forward * z / scale]);
    let pairs = [(0, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0), (0, 1, 0.0), (0, 2, 0.0), (1, 2, 0.0)];
    let is_rotation =
        pairs.iter().all(|&(a, b, product)| (dot(unit[a], unit[b]) - product).abs() < TOLERANCE);
    is_rotation.then_some(unit)
}

impl WorldToCamera {
    fn of(matrix: &[f32; 16]) -> Option<Self> {
        let column = [2, 6, 10, 14].map(|at: usize| matrix[at]);
        let row = [8, 9, 10, 11].map(|at: usize| matrix[at]);
        let found = match LAST_COLUMN.map(|last| is_affine(matrix, last)) {
            [true, _] => column,
            [false, true] => row,
            [false, false] => return None,
        };
        let axis: f32 = found[..3].iter().map(|x| x * x).sum();
        (found.iter().all(|x| x.is_finite()) && axis > 0.0).then_some(Self(found))
    }

    /// The planar depth of each position; `+∞` for the origin, which renderers write where there is no surface, and where it is not finite.
    pub(super) fn depth_of(&self, [x, y, z]: [Plane; 3]) -> Plane {
        let Self([a, b, c, d]) = *self;
        let mut depth = x;
        for ((x, y), z) in depth.values_mut().iter_mut().zip(y.values()).zip(z.values()) {
            let is_nothing = *x == 0.0 && *y == 0.0 && *z == 0.0;
            let along = a * *x + b * y + c * z + d;
            *x = if is_nothing || !along.is_finite() { f32::INFINITY } else { along };
        }
        let behind = depth.values().iter().filter(|z| **z < 0.0).count();
        let in_front = depth.values().iter().filter(|z| **z > 0.0 && z.is_finite()).count();
        if behind > in_front {
            depth.values_mut().iter_mut().filter(|z| z.is_finite()).for_each(|z| *z = -*z);
        }
        depth
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera at (1, 2, 3) that looks along −z: its space is the world moved by (−1, −2, −3).
    const MOVED: [f32; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., -1., -2., -3., 1.];

    fn transposed(matrix: &[f32; 16]) -> [f32; 16] {
        std::array::from_fn(|at| matrix[at % 4 * 4 + at / 4])
    }

    #[test]
    fn a_position_is_as_deep_as_it_lies_in_front_of_the_camera_however_the_matrix_is_written() {
        for matrix in [MOVED, transposed(&MOVED)] {
            let camera = WorldToCamera::of(&matrix).expect("an affine matrix");
            let plane = |values: [f32; 3]| {
                let mut plane = Plane::zeros(3, 1);
                plane.values_mut().copy_from_slice(&values);
                plane
            };
            let depth =
                camera.depth_of([plane([5.0, 0.0, 0.0]), plane([1.0, 0.0, 2.0]), plane([-2.0, 0.0, -9.0])]);
            assert_eq!(depth.values(), [5.0, f32::INFINITY, 12.0]);
        }
        assert_eq!(WorldToCamera::of(&[0.0; 16]), None);
    }

    #[test]
    fn the_camera_stands_in_the_world_as_its_matrix_says() {
        // A camera that looks along the world's +x, with y up: the world's x is its −z, the world's z its x.
        let looks_along_x = [0., 0., -1., 0., 0., 1., 0., 0., 1., 0., 0., 0., 5., 6., 7., 1.];
        let expected = Some([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        assert_eq!(orientation(&looks_along_x), expected);
        assert_eq!(orientation(&transposed(&looks_along_x)), expected, "transposed");
        assert_eq!(
            orientation(&looks_along_x.map(|x| if x.abs() == 1.0 { 100.0 * x } else { x })),
            None,
            "its corner is not 1"
        );
        let mut forward = looks_along_x;
        forward[2] = 1.0;
        assert_eq!(orientation(&forward), expected, "a left-handed camera looks along its +z");
        let mut scaled = looks_along_x;
        scaled[..11].iter_mut().for_each(|x| *x *= 100.0);
        assert_eq!(orientation(&scaled), expected, "in centimetres");
        let mut sheared = looks_along_x;
        sheared[0] = 0.5;
        assert_eq!(orientation(&sheared), None, "no rotation");
        assert_eq!(orientation(&[0.0; 16]), None);
    }
}
