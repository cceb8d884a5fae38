//! Damaged files and senseless settings: whatever they hold, reading them ends with a stack or an error, and never with a panic.
//!
//! Files of every kind are mutated at random, with a fixed seed, and read in this process. A mutant that ends badly is written to the
//! folder of temporary files of the tests, and its name is printed. What `fuzz/` finds joins the files here.

#![expect(clippy::unwrap_used, reason = "a test stops at the first failure")]
#![expect(clippy::print_stdout, reason = "counts, and the names of mutants that are kept")]

mod corpus;
#[expect(dead_code, reason = "only files are made here")]
#[path = "../fixtures/mod.rs"]
mod fixtures;
mod mutate;
mod presets;

use corpus::Sample;
use rayon::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use thinlens::stack::{ReadOptions, Source, footprint, is_complete, read, read_framed};

/// Mutants of all files together, at least.
const MUTANTS: usize = 20_000;

/// Memory that a mutant may ask for: far more than any of the originals takes.
const MAX_BYTES: u64 = 16 << 20;

/// What reading a file ended with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Read,
    Refused,
    Panicked,
}

/// Reads `bytes` in every way in which the program reads a picture.
fn outcome(bytes: &[u8]) -> Outcome {
    let source = Source::memory("mutant.exr", bytes);
    let options = ReadOptions { max_bytes: Some(MAX_BYTES), objects: true, ..ReadOptions::default() };
    let sources = std::slice::from_ref(&source);
    let work = || {
        // Errors are outcomes; only the last one is counted.
        let _ = is_complete(&source);
        let _ = footprint(sources, &options).map(|found| found.render_bytes(found.height));
        let picture = read_framed(&source, &options);
        let rows = ReadOptions { rows: Some(1..3), ..options.clone() };
        let _ = read(sources, &rows);
        let stack = read(sources, &options);
        let _ = stack.as_ref().map(|stack| {
            let _ = stack.objects();
            let size = (stack.width(), stack.height());
            for peel in &stack.peels {
                for plane in peel.color.iter().chain([&peel.alpha, &peel.depth]) {
                    assert_eq!((plane.width(), plane.height()), size, "every plane covers the data window");
                }
                let colors = peel.color.iter().chain([&peel.alpha]).flat_map(|plane| plane.values());
                assert!(colors.into_iter().all(|value| value.is_finite()), "colours are finite");
            }
        });
        // A picture without depth is no stack, but can be scored.
        stack.map(drop).or(picture.map(drop))
    };
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => Outcome::Read,
        Ok(Err(_)) => Outcome::Refused,
        Err(_) => Outcome::Panicked,
    }
}

/// The file that a bad mutant is kept in.
fn keep(name: &str, number: usize, bytes: &[u8]) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("mutant-{name}-{number}"));
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn every_file_of_the_corpus_is_read_before_it_is_mutated() {
    let samples = corpus::all();
    if let Some(folder) = std::env::var_os("THINLENS_CORPUS").map(PathBuf::from) {
        std::fs::create_dir_all(&folder).unwrap();
        samples
            .iter()
            .for_each(|Sample { name, bytes, .. }| std::fs::write(folder.join(name), bytes).unwrap());
    }
    for Sample { name, bytes, .. } in samples.iter().filter(|sample| sample.is_whole) {
        assert_eq!(
            outcome(bytes),
            Outcome::Read,
            "{name}: {:?}",
            read(&[Source::memory(name, &bytes[..])], &ReadOptions::default()).err()
        );
    }
}

#[test]
fn mutants_of_every_file_are_read_or_refused() {
    let samples = corpus::all();
    let each = MUTANTS.div_ceil(samples.len());
    let jobs = (0..samples.len()).flat_map(|sample| (0..each).map(move |number| (sample, number)));
    let jobs: Vec<(usize, usize)> = jobs.collect();
    let outcomes: Vec<Outcome> = jobs
        .par_iter()
        .map(|&(sample, number)| {
            let bytes = mutate::mutant(&samples, sample, number as u64);
            let outcome = outcome(&bytes);
            if outcome == Outcome::Panicked {
                println!("{}", keep(&samples[sample].name, number, &bytes).display());
            }
            outcome
        })
        .collect();
    let count = |wanted: Outcome| outcomes.iter().filter(|outcome| **outcome == wanted).count();
    let [read, refused, panicked] = [Outcome::Read, Outcome::Refused, Outcome::Panicked].map(count);
    println!("{} mutants of {} files: {read} read, {refused} refused", outcomes.len(), samples.len());
    assert_eq!(panicked, 0, "mutants that panicked are named above");
    // Mutants that are all read or all refused would test little.
    assert!(
        outcomes.len() >= MUTANTS && read > MUTANTS / 20 && refused > MUTANTS / 20,
        "{read} read, {refused} refused"
    );
}
