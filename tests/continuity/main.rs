//! The engine is local and continuous: every law of [`laws`], for every method that promises it, on the CPU and on a GPU.
//!
//! The tests on a GPU run on any adapter, including software drivers. Without an adapter they pass without checking anything, unless
//! `THINLENS_REQUIRE_GPU` is set: then they fail.

#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

mod laws;

use laws::engine::Engine;
use laws::{Figure, Measured, cracks, elements, focus, impulse, locality, panes, peels, sweeps, temporal};
use thinlens::methods::{Deviation, Role};

/// What is wrong with the figures of `law` on `engine`: all keep the law, or the deviation that the method declares. A declaration
/// that no figure needs is wrong too, on the CPU, where all cases run.
fn fault(law: &Measured, engine: &Engine) -> Option<String> {
    let figures = (law.figures)(engine);
    let lawful = |figure: &Figure| figure.value <= law.bound;
    let all_lawful = figures.iter().all(lawful);
    let expected = match law.deviation(engine) {
        None => (!all_lawful).then(|| format!("at most {}", law.bound)),
        Some(_) if all_lawful && engine.gpu.is_none() => {
            Some("no declared deviation, since every case keeps the law".to_owned())
        }
        Some(Deviation { within: [min, max], .. }) => {
            let declared = f64::from(min)..=f64::from(max);
            let outside = figures.iter().any(|figure| !declared.contains(&figure.value));
            outside.then(|| format!("from {min} to {max}, as declared"))
        }
    };
    let found =
        || figures.iter().map(|Figure { case, value }| format!("\n  {value:.3e} {case}")).collect::<String>();
    expected.map(|expected| format!("{engine}: {}: expected {expected}; found{}", law.law.figure(), found()))
}

/// Checks `law` on every engine whose method promises it.
fn check(law: &Measured) {
    let engines = [Engine::on_cpu(), Engine::on_gpu()].concat();
    let concerned: Vec<Engine> = engines.into_iter().filter(|engine| law.concerns(engine)).collect();
    assert!(!concerned.is_empty(), "no method promises it");
    let faults: Vec<String> = concerned.iter().filter_map(|engine| fault(law, engine)).collect();
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn a_tilted_pane_lets_the_light_pass_that_its_alpha_leaves() {
    check(&panes::TILTED_PANE);
}

#[test]
fn a_pane_counts_once_where_it_goes_on_in_the_next_peel() {
    check(&panes::SHEET_OF_TWO_PEELS);
}

#[test]
fn a_translucent_element_alone_keeps_its_alpha_and_its_colour() {
    check(&elements::LONE_ELEMENT);
}

#[test]
fn a_soft_disc_alone_has_the_mean_of_its_alpha_over_the_lens() {
    check(&elements::SOFT_DISC);
}

#[test]
fn one_colour_stays_that_colour_under_any_alpha() {
    check(&elements::ONE_COLOR);
}

#[test]
fn a_changed_sample_changes_nothing_beyond_its_blur() {
    check(&locality::LOCALITY);
}

#[test]
fn a_steep_opaque_surface_lets_no_light_pass() {
    check(&cracks::STEEP_RAMP);
}

#[test]
fn a_rough_opaque_surface_lets_hardly_any_light_pass() {
    check(&cracks::RELIEF);
}

#[test]
fn a_lens_that_changes_evenly_changes_the_picture_evenly() {
    check(&sweeps::EVEN_SWEEP);
}

#[test]
fn a_lens_that_changes_changes_the_picture() {
    check(&sweeps::FROZEN_FRAMES);
}

#[test]
fn the_peak_of_a_point_of_light_falls_by_the_closed_form() {
    check(&impulse::PEAK);
}

#[test]
fn the_picture_becomes_the_input_as_the_lens_closes() {
    check(&focus::NEAR_FOCUS);
}

#[test]
fn the_picture_does_not_jump_as_the_lens_closes() {
    check(&focus::STEP_NEAR_FOCUS);
}

#[test]
fn the_300th_peel_is_seen_where_the_others_let_light_pass() {
    check(&peels::MANY_PEELS);
}

#[test]
fn the_order_of_the_peels_in_a_file_does_not_matter() {
    check(&peels::PEEL_ORDER);
}

#[test]
fn blocks_of_pixels_change_from_frame_to_frame_as_in_truth() {
    // Each sequence takes as long as several laws, so for the default and the reference on the CPU.
    let is_main = |engine: &Engine| matches!(engine.method.info().role, Role::Default | Role::Reference);
    for sequence in temporal::sequences(256) {
        let truth = sequence.true_changes();
        for engine in Engine::on_cpu().into_iter().filter(is_main) {
            let found = sequence.changes(&engine, 64);
            let is_even = found.largest_over_mean <= 1.5 * truth.largest_over_mean && found.frozen <= 2;
            let is_true = found.error <= 1.2 && found.error_of_blocks <= 1.2;
            assert!(is_even && is_true, "{engine}: {}: {found:?}, true: {truth:?}", sequence.name);
        }
    }
}
