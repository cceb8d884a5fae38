//! How an environment lies in the world, and the world before the camera.

use crate::settings::EnvironmentAxes;
use glam::Mat3;

/// How the picture of an environment lies in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orientation {
    /// Which of the world's axes are where in the picture.
    pub axes: EnvironmentAxes,
    /// By how much it is turned about the axis that points up, anticlockwise seen from above, in degrees.
    pub rotation_deg: f32,
}

impl Orientation {
    /// From the world's axes to those of [`super::RadianceMap`].
    ///
    /// Blender's world has z upwards and its pictures +x at their centre: its (y, z, x) are OpenEXR's (x, y, z), so that `u = ½ − atan2(y, x) / 2π`.
    pub fn map_from_world(&self) -> Mat3 {
        let axes = match self.axes {
            EnvironmentAxes::Opengl => Mat3::IDENTITY,
            EnvironmentAxes::Blender => {
                Mat3::from_cols_array_2d(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
            }
        };
        Mat3::from_rotation_y(-self.rotation_deg.to_radians()) * axes
    }

    /// From camera space (x right, y up, z to the viewer) to the axes of [`super::RadianceMap`]; `world_from_camera` by rows.
    pub fn map_from_camera(&self, world_from_camera: [[f32; 3]; 3]) -> Mat3 {
        self.map_from_world() * Mat3::from_cols_array_2d(&world_from_camera).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::super::RadianceMap;
    use super::*;
    use glam::Vec3;

    /// Where `direction` of the world is in the picture, in shares of its width and height.
    fn place(orientation: Orientation, direction: Vec3) -> [f32; 2] {
        // The place is read from a picture of places. It is cut at the left edge, so directions are kept off it.
        let map =
            RadianceMap::from_fn(720, 360, |x, y| [(x as f32 + 0.5) / 720.0, (y as f32 + 0.5) / 360.0, 0.0]);
        let [u, v, _] = map.radiance(orientation.map_from_world() * direction);
        [u, v]
    }

    fn assert_at(orientation: Orientation, direction: Vec3, u: f32, v: f32) {
        let [found_u, found_v] = place(orientation, direction);
        assert!(
            (found_u - u).abs() < 1e-3 && (found_v - v).abs() < 1e-3,
            "{orientation:?}, {direction}: {found_u}, {found_v}"
        );
    }

    #[test]
    fn blenders_pictures_have_x_at_the_centre_and_y_at_a_quarter() {
        let blender = Orientation { axes: EnvironmentAxes::Blender, rotation_deg: 0.0 };
        assert_at(blender, Vec3::X, 0.5, 0.5);
        assert_at(blender, Vec3::Y, 0.25, 0.5);
        assert_at(blender, Vec3::NEG_Y, 0.75, 0.5);
        assert_at(blender, Vec3::new(1.0, 0.0, 1.0), 0.5, 0.25);
        assert_at(blender, Vec3::new(1.0, 1.0, 0.0), 0.375, 0.5);
        for degrees in [-150.0f32, -70.0, 20.0, 130.0] {
            let (y, x) = degrees.to_radians().sin_cos();
            assert_at(blender, Vec3::new(x, y, 0.0), 0.5 - degrees / 360.0, 0.5);
        }
    }

    #[test]
    fn openexrs_pictures_have_z_at_the_centre_and_x_at_a_quarter() {
        let opengl = Orientation { axes: EnvironmentAxes::Opengl, rotation_deg: 0.0 };
        assert_at(opengl, Vec3::Z, 0.5, 0.5);
        assert_at(opengl, Vec3::X, 0.25, 0.5);
        assert_at(opengl, Vec3::NEG_X, 0.75, 0.5);
        assert_at(opengl, Vec3::new(0.0, 1.0, 1.0), 0.5, 0.25);
    }

    #[test]
    fn a_turned_environment_is_anticlockwise_from_above() {
        // What lay towards one axis lies towards the next: from z to x about y, from x to y about z.
        assert_at(Orientation { axes: EnvironmentAxes::Opengl, rotation_deg: 90.0 }, Vec3::X, 0.5, 0.5);
        assert_at(Orientation { axes: EnvironmentAxes::Blender, rotation_deg: 90.0 }, Vec3::Y, 0.5, 0.5);
    }

    #[test]
    fn directions_leave_the_camera_before_they_are_looked_up() {
        // A camera that looks along the world's +x, with y up: its right is the world's +z, and its own z points to −x.
        let world_from_camera = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
        let opengl = Orientation { axes: EnvironmentAxes::Opengl, rotation_deg: 0.0 };
        let matrix = opengl.map_from_camera(world_from_camera);
        assert_eq!(matrix * Vec3::NEG_Z, Vec3::X);
        assert_eq!(matrix * Vec3::X, Vec3::Z);
    }
}
