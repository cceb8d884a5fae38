//! The sampling error estimated by probes is the actual sampling error.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]

use std::path::PathBuf;
use thinlens::image::{Image, Plane};
use thinlens::methods;
use thinlens::methods::Plan;
use thinlens::probes::{ErrorEstimate, verify};
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::scene::{Layer, Scene};
use thinlens::settings::{Effort, Origin, ParameterValues, Preset, Settings, Values};
use thinlens::stack::Source;

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
    // Expected value: the same estimate at every pixel, which has no sampling error. 3 scenes × 4 methods × 20 seeds at
    // 95 %: 228 of 240 expected, with a standard deviation of 3.4; five of these below is 211.
    let (mut contained, mut all) = (0, 0);
    for (sample, corner) in [("fence", [40, 90]), ("fence", [200, 100]), ("table", [120, 60])] {
        let scene = part(sample, corner);
        for (method, views) in [
            ("shear", Some(16)),
            ("shear", Some(128)),
            ("recursive-gaussian", None),
            ("accumulate", Some(24)),
        ] {
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
    assert!(contained >= 211, "{contained} of {all} intervals contain the error of all pixels");
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
