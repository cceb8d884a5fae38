//! The output folder of a comparison: error maps, results.json, results.csv and report.html, beside the pictures.

use super::gallery::Gallery;
use super::html::{Assets, page};
use super::{Candidate, Results, csv};
use crate::error::Error;
use crate::output::{atomic, png, report};
use std::path::Path;

/// Files of every output folder.
pub const FILES: [&str; 3] = ["results.json", "results.csv", REPORT];

/// The report page.
pub const REPORT: &str = "report.html";

/// File names of the picture and of the error map of `candidate`.
pub fn files(candidate: &Candidate) -> [String; 2] {
    let name = candidate.file_stem();
    [format!("{name}.png"), format!("{name}-flip.png")]
}

/// Adds baseline and crops of the pictures in `gallery` to `results`, and writes everything but the pictures themselves into
/// `folder`.
///
/// # Errors
/// Those of encoding and of [`atomic::write()`].
pub fn write(folder: &Path, results: &mut Results, gallery: &Gallery) -> Result<(), Error> {
    let mut assets = Assets::default();
    if let Some(baseline) = gallery.baseline(&results.entries) {
        results.crops = gallery.crops(&baseline, &results.entries);
        assets = Assets::new(gallery, &results.crops)?;
        let mut mapped = vec![false; results.entries.len()];
        gallery.maps(&baseline, &results.entries, |i, map| {
            mapped[i] = true;
            if let Some(file) = &results.entries[i].map {
                png::write_false_color(&folder.join(file), &map)?;
            }
            assets.set_map(i, map)
        })?;
        for (entry, _) in results.entries.iter_mut().zip(mapped).filter(|(_, mapped)| !mapped) {
            entry.map = None;
        }
        results.baseline = Some(baseline);
    }
    let [json_file, csv_file, page_file] = FILES.map(|file| folder.join(file));
    report::write_json(&json_file, results)?;
    atomic::write_text(&csv_file, &csv(results))?;
    atomic::write_text(&page_file, &page(results, &assets)?)
}
