//! A picture for each built-in preset: one set, scaled to the typical subject of each lens.
//!
//! `cargo run --release --example preset_pictures -- docs/presets`
//!
//! A ball in focus stands on a tiled floor in front of a dark wall, with lights in front of the wall and a string of lights in front of the
//! ball. All lengths are in widths of the frame at the ball, which differ by preset: a face for a portrait, a tile for a macro.
//! Distances follow from the lens's angle of view, so that all pictures show the same view and differ only in their blur.

use glam::Vec2;
use std::path::PathBuf;
use thinlens::error::Error;
use thinlens::finish::finish;
use thinlens::image::Plane;
use thinlens::lens::{Field, LensSpec, ThinLens};
use thinlens::methods;
use thinlens::output::png;
use thinlens::scene::{Layer, Scene};
use thinlens::settings::{BUILT_IN, Effort, Origin, Preset, Settings, Values};
use thinlens::stack::StackKind;

/// Width and height of a picture.
const SIZE: [usize; 2] = [360, 240];

/// Samples per pixel along each axis.
const SAMPLES: usize = 3;

/// Distance of the floor below the axis, in frame widths.
const FLOOR: f32 = 0.22;

/// Width of the frame at the ball in metres, and distance of the wall in units of the ball's distance.
fn frame(preset: &str) -> (f32, f32) {
    match preset {
        "portrait" => (0.9, 4.0),
        "landscape" => (6.0, 4.0),
        "macro" => (0.06, 1.1),
        "product" => (0.3, 2.5),
        "miniature" => (12.0, 4.0),
        "swirl" => (0.6, 4.0),
        "soap-bubble" => (0.45, 4.0),
        "phone-like" => (0.25, 4.0),
        _ => (1.2, 4.0),
    }
}

/// A hit of a ray of the pinhole camera: distance and colour.
type Hit = (f32, [f32; 3]);

fn main() -> Result<(), Error> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "docs/presets".to_owned()));
    for built_in in BUILT_IN {
        let preset = Preset::load(built_in.name)?;
        let values = Values { effort: Some(Effort::Views(256)), ..preset.values.clone() };
        let origin = Origin::Preset(built_in.name.to_owned());
        let settings = Settings::resolve(&[(origin, &values)], preset.parameters);
        let (scene, stats, plan) =
            methods::Registry::default().prepare(set(built_in.name, &settings)?, &settings)?;
        let field = stats.field;
        let image = finish(methods::render(scene, &plan, &|_| {})?, &plan, field);
        png::write(&folder.join(format!("{}.png", built_in.name)), &image, 0.0)?;
    }
    Ok(())
}

/// The set as seen by the lens of `settings`.
fn set(preset: &str, settings: &Settings) -> Result<Scene, Error> {
    let lens = &settings.lens;
    let focal_widths = lens.focal_length_mm.value / lens.sensor_width_mm.value;
    let (frame_width_m, wall) = frame(preset);
    let ball_m = focal_widths * frame_width_m;
    let metres_per_unit = lens.metres_per_unit.value;
    let spec = LensSpec {
        focal_length_mm: lens.focal_length_mm.value,
        f_number: lens.f_number.value,
        // For the miniature preset, the width of the frame is in depth units instead of metres.
        focus_distance: if preset == "miniature" { ball_m } else { ball_m / metres_per_unit },
        sensor_width_mm: lens.sensor_width_mm.value,
        sensor_distance: lens.sensor_distance.value,
        metres_per_unit,
    };
    let thin = ThinLens::new(&spec, SIZE[0] as f32)?;
    let [width, height] = SIZE.map(|side| side * SAMPLES);
    let hits: Vec<[Option<Hit>; 3]> = (0..width * height)
        .map(|i| hits(Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5) / width as f32, wall))
        .collect();
    let layer = |k: usize| {
        let plane = |value: &dyn Fn(Hit) -> f32| {
            Plane::from_fn(width, height, |x, y| hits[y * width + x][k].map_or(0.0, value))
        };
        Layer {
            color: std::array::from_fn(|channel| plane(&|(_, color)| color[channel])),
            alpha: plane(&|_| 1.0),
            coc_px: plane(&|(distance, _)| thin.coc_radius_px(distance * thin.focus_distance)),
        }
    };
    let scene =
        Scene::new((0..3).map(layer).collect(), StackKind::Supersampled, SAMPLES, thin.coc_infinity_px);
    let field = Field { focal_length_px: focal_widths * SIZE[0] as f32, ..scene.field };
    Ok(Scene { field, ..scene })
}

/// The first three hits, nearest first, of the ray through `place`, in frame widths from the top left, up to a wall at distance `far`.
fn hits(place: Vec2, far: f32) -> [Option<Hit>; 3] {
    let centre = Vec2::new(0.5, 0.5 * SIZE[1] as f32 / SIZE[0] as f32);
    let ray = place - centre;
    let mut found: Vec<Hit> = [
        lights(place, 1.0 - 0.09 * (far - 1.0), 5),
        ball(ray),
        floor(ray, far),
        lights(place, 1.0 + 0.7 * (far - 1.0), 11),
        Some(wall(ray, far)),
    ]
    .into_iter()
    .flatten()
    .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    std::array::from_fn(|k| found.get(k).copied())
}

/// A ball, about a quarter of the frame's width in diameter, with the distance of its centre everywhere.
fn ball(ray: Vec2) -> Option<Hit> {
    let from_middle = (ray - Vec2::new(-0.04, FLOOR - 0.12)) / 0.12;
    let depth = 1.0 - from_middle.length_squared();
    (depth > 0.0).then(|| {
        let shade = 0.15 + 0.7 * (0.45 * -from_middle.x - 0.6 * from_middle.y + 0.6 * depth.sqrt()).max(0.0);
        let stripe =
            if ((from_middle.x + 0.4 * from_middle.y) * 7.0).floor() as i32 % 2 == 0 { 1.0 } else { 0.55 };
        (1.0, [0.9, 0.32, 0.12].map(|value: f32| value * shade * stripe))
    })
}

/// Tiles on the floor.
fn floor(ray: Vec2, far: f32) -> Option<Hit> {
    let distance = FLOOR / ray.y;
    (ray.y > 0.0 && distance < far).then(|| {
        let tile = (ray.x * distance / 0.08).floor() as i32 + (distance / 0.16).floor() as i32;
        let value = if tile.rem_euclid(2) == 0 { 0.3 } else { 0.09 };
        (distance, [value * 0.9, value, value * 1.1])
    })
}

/// A dark brick wall with bricks of the same size in every picture.
fn wall(ray: Vec2, far: f32) -> Hit {
    let place = 4.0 * ray / Vec2::new(0.3, 0.12);
    let row = place.y.floor();
    let joint = (place.y - row < 0.12) | ((place.x + 0.5 * row).rem_euclid(1.0) < 0.05);
    let value =
        if joint { 0.012 } else { 0.03 + 0.02 * (row * 12.9 + (place.x + 0.5 * row).floor() * 78.2).sin() };
    (far, [value * 1.2, value, value * 1.4])
}

/// A string of `count` small lights at `distance`.
fn lights(place: Vec2, distance: f32, count: usize) -> Option<Hit> {
    let behind = distance > 1.0;
    let light = |i: usize| {
        let x = (i as f32 + 0.5) / count as f32;
        let y = if behind {
            0.08 + 0.22 * (i as f32 * 2.4).sin().abs()
        } else {
            0.6 - 0.06 * (i as f32 * 1.7).cos()
        };
        (Vec2::new(x, y) - place).abs().max_element() < 0.7 / SIZE[0] as f32
    };
    (0..count).find(|&i| light(i)).map(|i| {
        let hue = [[60.0, 34.0, 12.0], [16.0, 30.0, 60.0], [52.0, 48.0, 44.0]][i % 3];
        (distance, hue)
    })
}
