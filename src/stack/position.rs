//! Depth from the position of surfaces, by the camera of the header (`worldToCamera`).
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
    let is_camera = |name: &Text| {
        let name = name.to_string();
        name.rsplit(['/', ':']).next().is_some_and(|last| last.eq_ignore_ascii_case("worldToCamera"))
    };
    attributes.iter().filter(|(name, _)| is_camera(name)).find_map(|(_, value)| match value {
        AttributeValue::Matrix4x4(matrix) => WorldToCamera::of(matrix),
        _ => None,
    })
}

impl WorldToCamera {
    fn of(matrix: &[f32; 16]) -> Option<Self> {
        let column = [2, 6, 10, 14].map(|at: usize| matrix[at]);
        let row = [8, 9, 10, 11].map(|at: usize| matrix[at]);
        let is_affine = |last: [usize; 4]| last.map(|at| matrix[at]) == [0.0, 0.0, 0.0, 1.0];
        let found = if is_affine([3, 7, 11, 15]) {
            column
        } else if is_affine([12, 13, 14, 15]) {
            row
        } else {
            return None;
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
}
