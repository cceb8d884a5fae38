//! From the environment of the settings and the stack's surfaces to what a scene reflects.

use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::scene::Scene;
use crate::scene::environment::{EnvironmentShading, Orientation, RadianceMap, SurfacePlanes};
use crate::settings::{EnvironmentAxes, Lobe, Settings};
use crate::stack::{Shading, Stack};
use glam::Mat3;
use std::sync::Arc;

/// An environment before a camera, and what of a stack reflects it.
#[derive(Debug)]
pub(super) struct Reflecting {
    map: RadianceMap,
    map_from_camera: Mat3,
    lobe: Lobe,
    surfaces: Vec<Option<Surfaces>>,
}

/// How the surfaces of a peel reflect.
#[derive(Debug)]
struct Surfaces {
    normal: [Plane; 3],
    specular: [Plane; 3],
    roughness: Option<Plane>,
    reflected_distance: Plane,
}

impl Reflecting {
    /// The environment of `settings` and what of `stack` reflects it, before the stack's peels move into a scene; `None` without an
    /// environment.
    ///
    /// # Errors
    /// A stack that does not say how its camera stands in the world, or what its surfaces reflect.
    pub(super) fn of(stack: &mut Stack, settings: &Settings) -> Result<Option<Self>, Error> {
        let Some(picture) = &settings.surroundings else { return Ok(None) };
        let surfaces: Vec<_> =
            stack.shading.iter().map(|shading| shading.as_ref().and_then(surfaces)).collect();
        if surfaces.iter().all(Option::is_none) {
            return Err(Error::input("the stack does not say how its surfaces reflect the environment")
                .with(
                    "looked for",
                    "Peel0.Diffuse, Peel0.Normal, Peel0.Specular, Peel0.ReflectedDistance, Peel0.Roughness",
                )
                .help("export these channels with the stack, or leave `environment` out"));
        }
        let Some(world_from_camera) = stack.world_from_camera() else {
            return Err(Error::input("the stack does not say how its camera stands in the world")
                .with("looked for", "the attribute `worldToCamera`, a matrix that turns and moves")
                .help("write the attribute with the stack, or leave `environment` out"));
        };
        let (axes, reason) = match settings.picture.environment_axes.value {
            Some(axes) => (axes, format!("set by {}", settings.picture.environment_axes.origin)),
            None if stack.is_by_blender() => (EnvironmentAxes::Blender, "Blender wrote the stack".to_owned()),
            None => (EnvironmentAxes::Opengl, "as OpenEXR and Mitsuba have them".to_owned()),
        };
        stack
            .findings
            .push(Finding::note("environment", format!("its axes are `{}`: {reason}", axes.name())));
        let orientation = Orientation { axes, rotation_deg: settings.picture.environment_rotation_deg.value };
        Ok(Some(Self {
            map: RadianceMap::new(picture),
            map_from_camera: orientation.map_from_camera(world_from_camera),
            lobe: settings.picture.environment_lobe.value,
            surfaces,
        }))
    }

    /// The shading of `scene`, which was made of the same stack; `None` if no fragment reflects the environment.
    pub(super) fn shading(self, scene: &Scene) -> Option<Arc<EnvironmentShading>> {
        let planes: Vec<_> =
            self.surfaces.iter().map(|surfaces| surfaces.as_ref().map(Surfaces::planes)).collect();
        EnvironmentShading::new(scene, &planes, self.map, self.map_from_camera, self.lobe).map(Arc::new)
    }
}

/// What `shading` has of the surfaces of a peel; `None` if it does not say how much they reflect.
fn surfaces(shading: &Shading) -> Option<Surfaces> {
    Some(Surfaces {
        normal: shading.normal.clone(),
        specular: shading.specular.clone()?,
        roughness: shading.roughness.clone(),
        reflected_distance: shading.reflected_distance.clone(),
    })
}

impl Surfaces {
    fn planes(&self) -> SurfacePlanes<'_> {
        let Self { normal, specular, roughness, reflected_distance } = self;
        SurfacePlanes { normal, specular, roughness: roughness.as_ref(), reflected_distance }
    }
}
