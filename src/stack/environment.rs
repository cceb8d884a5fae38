//! Reads the picture of an environment.

use super::read::read_main_layer;
use super::{ReadOptions, Source};
use crate::error::Error;
use crate::image::Image;
use exr::meta::attribute::{AttributeValue, EnvironmentMap, Text};

/// The environment in `source`: longitude across, latitude down.
///
/// # Errors
/// Those of a picture, and the faces of a cube, which OpenEXR's attribute `envmap` announces.
pub fn read_environment(source: &Source, options: &ReadOptions) -> Result<Image, Error> {
    let (layer, layers) = read_main_layer(source, options)?;
    if is_cube(&layers.attributes) {
        return Err(Error::input(
            "the environment is the six faces of a cube, not a map of longitude and latitude",
        )
        .in_file(source.name())
        .with("found", "the attribute `envmap` is `cube`")
        .help("convert it: `exrenvmap -l cube.exr latlong.exr` of OpenEXR does so"));
    }
    let [red, green, blue] = layer.color;
    Ok(Image { planes: [red, green, blue, layer.alpha] })
}

fn is_cube(attributes: &[(Text, AttributeValue)]) -> bool {
    attributes.iter().any(|(name, value)| {
        name.eq("envmap") && matches!(value, AttributeValue::EnvironmentMap(EnvironmentMap::Cube))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::image::Image as Written;
    use exr::prelude::*;

    fn written(map: EnvironmentMap) -> Source {
        let channels = SpecificChannels::rgb(|at: Vec2<usize>| (at.x() as f32, at.y() as f32, 0.5f32));
        let mut image = Written::from_channels((8, 4), channels);
        image.layer_data.attributes.environment_map = Some(map);
        let mut bytes = Vec::new();
        image.write().to_buffered(std::io::Cursor::new(&mut bytes)).unwrap();
        Source::memory("sky.exr", bytes)
    }

    #[test]
    fn a_map_of_longitude_and_latitude_is_read_and_a_cube_is_refused_in_words() {
        let image =
            read_environment(&written(EnvironmentMap::LatitudeLongitude), &ReadOptions::default()).unwrap();
        assert_eq!(image.pixel(5, 2)[..3], [5.0, 2.0, 0.5]);
        let error = read_environment(&written(EnvironmentMap::Cube), &ReadOptions::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains("six faces of a cube") && error.contains("exrenvmap"), "{error}");
    }
}
