//! COST: predictions of the time of a blur.
//!
//! A method's processor time is a sum of a few terms, `Σ_k a_k · work_k` ([`Method::cost`](crate::methods::Method::cost), in the method's
//! own folder): an amount of work that follows from the scene's statistics and the plan alone, times the time per unit of work on the
//! machine where the terms were measured (fitted by `examples/cost_model.rs`, which also reports the error of the fit on scenes that it did
//! not include). Another machine is faster or slower by a factor for each kind of work, and distributes the work among its threads:
//! [`Calibration`], from a self-timing of less than a second, kept in a file.
//!
//! A prediction takes about a millisecond: the range of depths within reach is estimated in blocks of the picture.
//!
//! Limits: the blur alone, without reading, analysis and writing; an idle machine; enough memory. Properties that the statistics do
//! not contain (the frequency of occlusion, the connectivity of hidden layers) are assumed to be as in the scenes of the fit.

mod calibration;

#[doc(hidden)]
pub use calibration::timed;
pub use calibration::{CACHE_VARIABLE, Calibration, Factor, Remark, cache_folder};

use crate::methods::{Cost, Plan, WorkKind, term};
use crate::scene::{EffectKind, SceneStats, Workload};

/// The predicted time of a blur.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Prediction {
    /// Processor seconds, all threads together.
    pub cpu_seconds: f64,
    /// Wall seconds.
    pub seconds: f64,
}

/// The cost terms of `plan` on a scene with the statistics `stats`; `None` for a method without a cost model.
pub fn terms(stats: &SceneStats, plan: &Plan) -> Option<Cost> {
    let rays = plan.views.unwrap_or(0) * plan.optics.ray_sets();
    let shows_background = plan.does(EffectKind::TransparentBackground);
    let workload = Workload { stats, rays, shows_background };
    if plan.does(EffectKind::Blur) { plan.method.cost(plan, &workload) } else { Some(pinhole(&workload)) }
}

/// The cost of a picture without a lens.
fn pinhole(workload: &Workload<'_>) -> Cost {
    Cost::new(
        WorkKind::Planes,
        [
            term("pixels", 0.767, workload.pixels()),
            term("samples to composite", 13.428, workload.composited()),
        ],
    )
}

/// The predicted time of `plan` on a scene with the statistics `stats`, on the machine of `calibration`: that of the blur alone,
/// [`crate::methods::render`]. `None` for a method without a cost model.
pub fn predict(stats: &SceneStats, plan: &Plan, calibration: &Calibration) -> Option<Prediction> {
    let cost = terms(stats, plan)?;
    let Factor { cpu, speed_up } = calibration.factor(cost.kind);
    let cpu_seconds = cost.cpu_seconds() * cpu;
    Some(Prediction { cpu_seconds, seconds: cpu_seconds / speed_up })
}

/// The largest number of lens samples per pixel with which `plan` is predicted to take at most `seconds` of wall time, 0 where not even
/// one fits; `None` for a method that does not sample the lens or has no cost model.
pub fn views_within(
    stats: &SceneStats,
    plan: &Plan,
    calibration: &Calibration,
    seconds: f64,
) -> Option<usize> {
    plan.views?;
    predict(stats, plan, calibration)?;
    let fits = |views: usize| {
        let plan = Plan { views: Some(views), ..plan.clone() };
        predict(stats, &plan, calibration).is_some_and(|cost| cost.seconds <= seconds)
    };
    // Time grows with the number of views, so bisection finds the largest number that fits.
    let (mut fitting, mut too_many) = (0, Plan::MAX_VIEWS + 1);
    while too_many - fitting > 1 {
        let middle = fitting.midpoint(too_many);
        *(if fits(middle) { &mut fitting } else { &mut too_many }) = middle;
    }
    Some(fitting)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::methods::{METHODS, Registry};
    use crate::scene::{Layer, Scene};
    use crate::settings::{Effort, Origin, ParameterValues, Settings, Values};

    fn plan(stats: &SceneStats, method: &str, views: Option<usize>) -> Plan {
        let values =
            Values { method: Some(method.to_owned()), effort: views.map(Effort::Views), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        Registry::default().plan(stats, &settings).unwrap()
    }

    /// A plan of every method, with blur forced on.
    fn plans(stats: &SceneStats) -> impl Iterator<Item = Plan> {
        METHODS.iter().map(|method| plan(stats, method.info().name, None).forced(EffectKind::Blur, true))
    }

    fn cpu_seconds(stats: &SceneStats, plan: &Plan) -> f64 {
        predict(stats, plan, &Calibration::assumed()).unwrap().cpu_seconds
    }

    /// `scene` twice, one above the other.
    fn doubled(scene: &Scene) -> Scene {
        let (width, height) = (scene.width(), scene.height());
        let twice = |plane: &Plane| Plane::from_fn(width, 2 * height, |x, y| plane.get(x, y % height));
        let layer = |layer: &Layer| Layer {
            color: layer.color.each_ref().map(twice),
            alpha: twice(&layer.alpha),
            coc_px: twice(&layer.coc_px),
        };
        Scene { layers: scene.layers.iter().map(layer).collect(), ..scene.clone() }
    }

    #[test]
    fn every_method_has_the_same_cost_terms_for_every_scene() {
        let names = |stats: &SceneStats, plan: &Plan| -> Vec<&str> {
            terms(stats, plan).unwrap().terms.iter().map(|term| term.name).collect()
        };
        let [stats, other] = [(96, 64), (64, 48)].map(|size| calibration::test_scene(size).analyze());
        for (plan, elsewhere) in plans(&stats).zip(plans(&other)) {
            assert!(
                terms(&stats, &plan).unwrap().terms.iter().all(|term| term.nanoseconds >= 0.0),
                "{}",
                plan.method
            );
            assert_eq!(names(&stats, &plan), names(&other, &elsewhere), "{}", plan.method);
        }
    }

    #[test]
    fn every_prediction_is_finite_and_positive_even_for_an_empty_scene() {
        let scene = calibration::test_scene((64, 48));
        let mut empty = scene.clone();
        empty.layers.iter_mut().for_each(|layer| layer.alpha.values_mut().fill(0.0));
        for stats in [scene.analyze(), empty.analyze()] {
            let pinhole = plan(&stats, "auto", None).forced(EffectKind::Blur, false);
            for plan in plans(&stats).chain([pinhole]) {
                let Prediction { cpu_seconds, seconds } =
                    predict(&stats, &plan, &Calibration::assumed()).unwrap();
                let is_valid = |value: f64| value.is_finite() && value > 0.0;
                assert!(is_valid(cpu_seconds) && is_valid(seconds), "{}: {cpu_seconds}", plan.method);
            }
        }
        let blank = Scene { layers: Vec::new(), ..scene };
        for plan in plans(&blank.analyze()) {
            assert_eq!(cpu_seconds(&blank.analyze(), &plan), 0.0, "{}: no pixels", plan.method);
        }
    }

    #[test]
    fn twice_the_views_cost_one_to_two_times_as_much() {
        let stats = calibration::test_scene((256, 144)).analyze();
        for method in METHODS.iter().map(|method| method.info().name) {
            if plan(&stats, method, None).views.is_none() {
                continue;
            }
            let cost = |views| cpu_seconds(&stats, &plan(&stats, method, Some(views)));
            for views in [1, 4, 16, 32, 256, 4096] {
                let ratio = cost(2 * views) / cost(views);
                assert!((1.0..=2.000_001).contains(&ratio), "{method}, {views} views: {ratio}");
            }
            // From 128 views on shear has twice as many slices.
            assert!((1.0..4.0).contains(&(cost(128) / cost(64))), "{method}");
            let many = cost(4096) / cost(256);
            let grows = if method == "gather" { 1.0..=16.0 } else { 8.0..=16.0 };
            assert!(grows.contains(&many), "{method}: 16 times the views, {many} times the cost");
        }
    }

    #[test]
    fn separate_rays_for_each_colour_cost_as_much_as_three_times_the_views() {
        let stats = calibration::test_scene((256, 144)).analyze();
        for method in ["shear", "accumulate"] {
            let alike = plan(&stats, method, Some(48));
            let mut apart = plan(&stats, method, Some(16));
            apart.optics.axial_px = [1.0, 0.0, -1.0];
            assert_eq!(cpu_seconds(&stats, &apart), cpu_seconds(&stats, &alike), "{method}");
        }
    }

    #[test]
    fn a_picture_of_twice_the_height_costs_twice_as_much() {
        // Neither is higher than wide, so that the blocks have the same size. Surfaces reach from one half into the other, which counts less
        // the higher the halves are.
        let scene = calibration::test_scene((512, 256));
        let (once, twice) = (scene.analyze(), doubled(&scene).analyze());
        for (a, b) in plans(&once).zip(plans(&twice)) {
            let ratio = cpu_seconds(&twice, &b) / cpu_seconds(&once, &a);
            assert!((ratio - 2.0).abs() < 0.1, "{}: {ratio}", a.method);
        }
    }

    #[test]
    fn a_slower_machine_takes_longer_and_more_threads_less() {
        let stats = calibration::test_scene((64, 48)).analyze();
        let plan = plan(&stats, "shear", None);
        let mut calibration = Calibration::assumed();
        let uncalibrated = predict(&stats, &plan, &calibration).unwrap().cpu_seconds;
        calibration.factors[WorkKind::Rows as usize] = Factor { cpu: 3.0, speed_up: 1.5 };
        let Prediction { cpu_seconds, seconds } = predict(&stats, &plan, &calibration).unwrap();
        assert!((cpu_seconds / uncalibrated - 3.0).abs() < 1e-9, "{cpu_seconds}");
        assert!((seconds / cpu_seconds - 1.0 / 1.5).abs() < 1e-9, "{seconds}");
    }

    #[test]
    fn the_largest_number_of_views_fits_and_one_more_does_not() {
        let stats = calibration::test_scene((512, 288)).analyze();
        let calibration = Calibration::assumed();
        for method in ["shear", "accumulate", "layer-rays", "peel-rays"] {
            let plan = plan(&stats, method, None);
            let seconds = |views| predict(&stats, &plan.with_views(views), &calibration).unwrap().seconds;
            for budget in [0.3, 2.0] {
                let views = views_within(&stats, &plan, &calibration, budget).unwrap();
                assert!(views > 0 && seconds(views) <= budget, "{method}: {views}");
                assert!(seconds(views + 1) > budget, "{method}: {views}");
            }
            assert_eq!(views_within(&stats, &plan, &calibration, 0.0), Some(0), "not even one");
            assert_eq!(views_within(&stats, &plan, &calibration, 1e9), Some(Plan::MAX_VIEWS));
        }
        let scatter = plan(&stats, "scatter", None);
        assert_eq!(views_within(&stats, &scatter, &calibration, 1.0), None, "it does not sample the lens");
    }
}
