//! Borders, for every method: scenes are padded, blurred and cropped to the frame.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

use std::f32::consts::PI;
use thinlens::image::{Image, Plane};
use thinlens::methods::{self, METHODS, Method, Plan};
use thinlens::probes::{self, Basis, ProbeSites, Probes, SEED};
use thinlens::scene::{Layer, Scene};
use thinlens::settings::{Border, Effort, Origin, ParameterValues, Settings, Values};
use thinlens::stack::StackKind;

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// A scene of one opaque layer, `value(x, y)` bright and of CoC radius `coc_px(x, y)`.
fn scene(value: impl Fn(usize, usize) -> f32, coc_px: impl Fn(usize, usize) -> f32) -> Scene {
    let layer = Layer {
        color: std::array::from_fn(|_| Plane::from_fn(WIDTH, HEIGHT, &value)),
        alpha: Plane::filled(WIDTH, HEIGHT, 1.0),
        coc_px: Plane::from_fn(WIDTH, HEIGHT, &coc_px),
    };
    Scene::new(vec![layer], StackKind::Coverage, 1, 1000.0)
}

/// A textured scene in front of, in and behind focus.
fn textured_scene() -> Scene {
    let noise = |x: usize, y: usize| ((x * 7919 + y * 104_729) % 251) as f32 / 251.0;
    scene(
        |x, y| noise(x / 4, y / 3),
        |x, y| if (x / 16 + y / 16).is_multiple_of(3) { -7.0 } else { 0.2 * y as f32 - 3.0 },
    )
}

fn plan(method: &dyn Method, scene: &Scene, views: usize) -> Plan {
    let samples_the_lens = method.samples_lens();
    let values = Values {
        method: Some(method.info().name.to_owned()),
        effort: samples_the_lens.then_some(Effort::Views(views)),
        ..Values::default()
    };
    let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
    methods::Registry::default().plan(&scene.analyze(), &settings).unwrap()
}

/// The blurred picture of `scene`, cropped to the frame.
fn blur(method: &dyn Method, scene: &Scene, views: usize) -> Image {
    let plan = plan(method, scene, views);
    methods::render(scene.clone(), &plan, &|_| {}).unwrap().trimmed(scene.outside_px)
}

/// `scene` padded with `border`, as far as the blur reaches.
fn padded(scene: &Scene, border: Border) -> Scene {
    scene.clone().padded(border, scene.reach_px(0.0))
}

/// Peak signal-to-noise ratio over all channels.
fn psnr_db(a: &Image, b: &Image) -> f64 {
    let planes = a.planes.iter().zip(&b.planes);
    let values = planes.flat_map(|(a, b)| a.values().iter().zip(b.values()));
    let squares: Vec<f64> = values.map(|(a, b)| f64::from(a - b).powi(2)).collect();
    -10.0 * (squares.iter().sum::<f64>() / squares.len() as f64).max(1e-20).log10()
}

/// Largest difference between two pictures.
fn difference(a: &Image, b: &Image) -> f32 {
    let planes = a.planes.iter().zip(&b.planes);
    let values = planes.flat_map(|(a, b)| a.values().iter().zip(b.values()));
    values.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_constant_picture_with_a_mirrored_border_stays_constant() {
    let expected = Image::from_fn(WIDTH, HEIGHT, |_, _| [0.6, 0.6, 0.6, 1.0]);
    for method in METHODS {
        for coc_px in [-9.0, 14.0] {
            let found = blur(method, &padded(&scene(|_, _| 0.6, |_, _| coc_px), Border::Mirror), 64);
            let off = difference(&found, &expected);
            assert!(off < 1e-6, "{}, c = {coc_px}: off by {off}", method.info().name);
        }
    }
}

/// The part of a disc's area on the far side of a line at `distance` radii from its centre.
fn segment(distance: f32) -> f32 {
    let t = distance.clamp(-1.0, 1.0);
    (t.acos() - t * (1.0 - t * t).sqrt()) / PI
}

/// Tolerance of a method's alpha against the share of a disc, in front of and behind focus. Gaussians and
/// pyramids are not discs, and the glow of `opaque-blur` makes silhouettes too opaque.
fn allowed(method: &str, coc_px: f32) -> f32 {
    let [before, behind] = match method {
        "recursive-gaussian" => [0.14, 0.092],
        "b-buffer" => [0.06, 0.06],
        "pyramid-disocclusion" => [0.26, 0.17],
        "opaque-blur" => [0.48, 0.09],
        _ => [0.01, 0.01],
    };
    if coc_px < 0.0 { before } else { behind }
}

#[test]
fn with_a_transparent_border_alpha_decreases_by_the_share_of_the_disc_outside_the_frame() {
    for method in METHODS {
        for coc_px in [-12.0_f32, 12.0] {
            let found = blur(method, &padded(&scene(|_, _| 0.5, |_, _| coc_px), Border::Transparent), 1024);
            for x in 0..WIDTH / 2 {
                let expected = 1.0 - segment((x as f32 + 0.5) / coc_px.abs());
                let [red, _, _, alpha] = found.pixel(x, HEIGHT / 2);
                let name = method.info().name;
                let off = (alpha - expected).abs();
                assert!(
                    off < allowed(name, coc_px),
                    "{name}, c = {coc_px}, column {x}: {alpha}, not {expected}"
                );
                assert!((red - 0.5 * alpha).abs() < 1e-5, "{name}: still premultiplied: {red} of {alpha}");
            }
        }
    }
}

#[test]
fn a_mirrored_border_is_a_scene_that_continues_as_its_reflection() {
    for method in METHODS {
        let name = method.info().name;
        // Its random numbers differ between pixels: few rays are noisy.
        let views = if name == "layer-rays" { 1024 } else { 64 };
        let scene = textured_scene();
        let found = blur(method, &padded(&scene, Border::Mirror), views);
        // Wider by whole cells of the pyramids, so that the alignment of the frame does not change.
        let continued = scene.clone().padded(Border::Mirror, scene.reach_px(0.0) + 64);
        let expected = blur(method, &continued, views);
        // Disocclusion fill and pyramids read beyond the reach of the lens.
        let db = psnr_db(&found, &expected);
        let floor_db = match name {
            "accumulate" => 199.0,
            _ => 45.0,
        };
        assert!(db > floor_db, "{name}: {db} dB");
        let clamped_db = psnr_db(&blur(method, &scene, views), &expected);
        // Its pyramids read one cell beyond the border at each level, which is the same in both cases.
        let is_sensitive = name != "pyramid-disocclusion";
        assert!(
            !is_sensitive || clamped_db < db - 3.0,
            "{name}: another border is another picture: {clamped_db} dB"
        );
    }
}

#[test]
fn probes_are_inside_the_frame() {
    let scene = padded(&textured_scene(), Border::Mirror);
    let shear = methods::Registry::default().by_name("shear").unwrap();
    let plan = plan(shear, &scene, 256);
    let (width, [columns, rows]) = (scene.picture_size().0, scene.outside_px);
    let within = |pixel: usize| {
        (columns..columns + WIDTH).contains(&(pixel % width))
            && (rows..rows + HEIGHT).contains(&(pixel / width))
    };
    let basis = Basis::new(&scene, &plan);
    let pixels = Probes::new(&basis, &ProbeSites::new(&basis, 200, SEED), 1).pixels();
    let outside: Vec<&usize> = pixels.iter().filter(|&&pixel| !within(pixel)).collect();
    assert!(
        pixels.len() >= 100 && outside.is_empty(),
        "{} pixels, outside the frame: {outside:?}",
        pixels.len()
    );
    let picture = methods::render(scene.clone(), &plan, &|_| {}).unwrap();
    let mut spoilt = picture.clone();
    for plane in &mut spoilt.planes {
        let values = plane.values_mut().iter_mut().enumerate();
        values.filter(|(pixel, _)| !within(*pixel)).for_each(|(_, value)| *value = 9.0);
    }
    let estimate = |image: &Image| probes::verify(image, &scene, &plan, 200, SEED);
    assert_eq!(estimate(&spoilt), estimate(&picture), "pixels outside the frame do not count");
    assert!(estimate(&picture).interval_db.0 > 35.0, "{}", estimate(&picture));
}
