//! The sampling error estimated by probes is the actual sampling error.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

use std::path::PathBuf;
use thinlens::image::{Image, Plane};
use thinlens::methods;
use thinlens::methods::Plan;
use thinlens::probes::{ErrorEstimate, verify};
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::sample_budget::find_views;
use thinlens::scene::{EffectKind, Layer, Scene};
use thinlens::settings::{Effort, Origin, ParameterValues, Preset, Quality, Settings, Values};
use thinlens::stack::{Source, StackKind};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

/// The part of a sample's scene whose corner is at `x0, y0`.
fn part(sample: &str, [x0, y0]: [usize; 2]) -> Scene {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("samples").join(sample);
    let name = folder.join("preset.toml").display().to_string();
    let job = Job {
        sources: vec![Source::File(folder.join("stack.exr"))],
        preset: Some(NamedPreset { preset: Preset::load(&name).unwrap(), name }),
        ..Job::default()
    };
    let scene = prepare(&job).unwrap().scene;
    let cut = |plane: &Plane| Plane::from_fn(WIDTH, HEIGHT, |x, y| plane.get(x0 + x, y0 + y));
    let layers = scene.layers.iter().map(|layer| Layer {
        color: layer.color.each_ref().map(cut),
        alpha: cut(&layer.alpha),
        coc_px: cut(&layer.coc_px),
    });
    Scene { layers: layers.collect(), ..scene }
}

/// The picture of `scene` by `method`, and its plan.
fn picture(scene: &Scene, method: &str, views: Option<usize>) -> (Image, Plan) {
    let values =
        Values { method: Some(method.to_owned()), effort: views.map(Effort::Views), ..Values::default() };
    let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
    let plan = methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
    (methods::render(scene.clone(), &plan, &|_| {}).unwrap(), plan)
}

#[test]
fn the_95_percent_interval_contains_the_error_of_all_pixels_in_95_percent_of_cases() {
    // Expected value: the same estimate at every pixel, which has no sampling error. 4 scenes × 2 pictures and 3 × 2 more × 20 seeds at
    // 95 %: 266 of 280 expected, with a standard deviation of 3.6; five of these below is 248.
    let by_shear = [("shear", Some(16)), ("shear", Some(128))];
    let by_all = [&by_shear[..], &[("recursive-gaussian", None), ("accumulate", Some(24))]].concat();
    let (mut contained, mut all) = (0, 0);
    for (scene, pictures) in [
        (part("fence", [40, 90]), &by_all[..]),
        (part("fence", [200, 100]), &by_all[..]),
        (part("table", [120, 60]), &by_all[..]),
        (lit(part("table", [120, 60])), &by_shear[..]),
    ] {
        for &(method, views) in pictures {
            let (image, plan) = picture(&scene, method, views);
            let expected_db = verify(&image, &scene, &plan, WIDTH * HEIGHT, 7).psnr_db.unwrap();
            for seed in 100..120 {
                let (min_db, max_db) = verify(&image, &scene, &plan, 150, seed).interval_db;
                contained +=
                    usize::from(min_db <= expected_db && max_db.is_none_or(|max_db| expected_db <= max_db));
                all += 1;
            }
        }
    }
    assert!(contained >= 248, "{contained} of {all} intervals contain the error of all pixels");
}

/// `scene` with a light at some of its nearest fragments.
fn lit(mut scene: Scene) -> Scene {
    for (x, y) in (4..HEIGHT).step_by(9).flat_map(|y| (5..WIDTH).step_by(11).map(move |x| (x, y))) {
        for plane in &mut scene.layers[0].color {
            plane.set(x, y, 300.0 * plane.get(x, y));
        }
    }
    scene
}

/// A scene of one layer of the CoC radius `coc_px`, with its colours.
fn wall(coc_px: f32, color: impl Fn(usize, usize) -> f32) -> Scene {
    let layer = Layer {
        color: std::array::from_fn(|_| Plane::from_fn(WIDTH, HEIGHT, &color)),
        alpha: Plane::filled(WIDTH, HEIGHT, 1.0),
        coc_px: Plane::filled(WIDTH, HEIGHT, coc_px),
    };
    Scene::new(vec![layer], StackKind::PointSampled, 1, 20.0)
}

#[test]
fn anti_aliasing_by_the_method_is_no_sampling_error() {
    let scene = wall(0.75, |x, y| if (7 * x + 5 * y) % 11 < 4 { 0.1 } else { 0.9 });
    let (image, plan) = picture(&scene, "shear", Some(256));
    let plain = plan.clone().forced(EffectKind::Resolve, false);
    let without = methods::render(scene.clone(), &plain, &|_| {}).unwrap();
    let estimate = |image: &Image, plan: &Plan| verify(image, &scene, plan, 400, 1).psnr_db.unwrap();
    let found = [estimate(&image, &plan), estimate(&without, &plain), estimate(&without, &plan)];
    assert!(found[0] > 45.0 && found[1] > 45.0, "each against its own truth: {found:?}");
    assert!(found[2] < 38.0, "but a picture that lacks the filter is not right: {found:?}");
}

#[test]
fn a_light_that_is_drawn_exactly_adds_no_error_and_is_missed_where_it_lacks() {
    let dim = |x: usize, y: usize| 0.3 + 0.1 * (0.4 * x as f32).sin() * (0.3 * y as f32).cos();
    let lights = |x, y| if (x % 21, y % 17) == (8, 8) { 400.0 } else { dim(x, y) };
    let scene = wall(6.0, lights);
    let (image, plan) = picture(&scene, "shear", Some(64));
    assert!(plan.does(EffectKind::Highlights), "{}", plan.effect(EffectKind::Highlights).reason);
    let found = verify(&image, &scene, &plan, 400, 1);
    assert!(found.interval_db.0 > 40.0, "64 rays of which few hit a light do not count: {found}");
    let (dark, _) = picture(&wall(6.0, dim), "shear", Some(64));
    let missing = verify(&dark, &scene, &plan, 400, 1);
    assert!(missing.psnr_db.is_some_and(|db| db < 20.0), "the lights are missing: {missing}");
}

#[test]
fn lights_do_not_end_a_search_at_few_views() {
    let scene = lit(part("fence", [40, 90]));
    let (_, plan) = picture(&scene, "shear", Some(64));
    assert!(plan.does(EffectKind::Highlights), "{}", plan.effect(EffectKind::Highlights).reason);
    let views = |quality: Quality| {
        let target = (quality.target_db(), quality.max_views());
        find_views(scene.clone(), &plan, target).unwrap().views
    };
    let found = [Quality::Draft, Quality::Preview, Quality::Final].map(views);
    assert!(found.is_sorted() && found[2] >= 64, "draft, preview, final: {found:?}");
}

#[test]
fn a_picture_by_many_rays_has_almost_no_sampling_error() {
    let scene = part("table", [120, 60]);
    let (image, plan) = picture(&scene, "accumulate", Some(16_384));
    let ErrorEstimate { interval_db: (min_db, _), pixels, rays_per_pixel, .. } =
        verify(&image, &scene, &plan, 400, 1);
    assert!(min_db > 48.0, "{min_db} dB with {rays_per_pixel} rays at {pixels} pixels");
}

#[test]
fn the_same_seed_gives_the_same_estimate_with_any_number_of_threads() {
    let scene = part("fence", [40, 90]);
    let (image, plan) = picture(&scene, "scatter", None);
    let with_threads = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| verify(&image, &scene, &plan, 60, seed))
    };
    assert_eq!(with_threads(1, 3), with_threads(3, 3));
    assert_ne!(with_threads(1, 3).interval_db, with_threads(1, 4).interval_db, "another seed, other pixels");
}
