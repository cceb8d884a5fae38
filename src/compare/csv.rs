//! The entries as comma-separated values (RFC 4180), one per line; a missing figure is an empty field.

use super::{Entry, Results};
use std::fmt::Write as _;

/// Names of the columns; later versions add columns at the end only.
const HEADER: &str = "name,method,views,cpu_seconds,seconds,runs,sampling_psnr_db,sampling_least_db,sampling_most_db,\
                      model_psnr_db,model_ssim,model_flip,on_front,whole_cpu_seconds,whole_seconds,\
                      predicted_cpu_seconds,predicted_seconds,picture,map,command";

/// The entries of `results`, after a line of column names.
pub fn csv(results: &Results) -> String {
    let mut text = format!("{HEADER}\n");
    for entry in &results.entries {
        let fields: Vec<String> = row(entry).into_iter().map(|field| quote(&field)).collect();
        let _ = writeln!(text, "{}", fields.join(","));
    }
    text
}

fn row(entry: &Entry) -> [String; 20] {
    let (min_db, max_db) = entry.sampling.interval_db;
    let model = entry.model;
    [
        entry.name.clone(),
        entry.method.clone(),
        entry.views.map_or(String::new(), |views| views.to_string()),
        figure(Some(entry.cpu_seconds), 4),
        figure(Some(entry.seconds), 4),
        entry.runs.len().to_string(),
        figure(entry.sampling.psnr_db, 3),
        figure(Some(min_db), 3),
        figure(max_db, 3),
        figure(model.map(|score| score.psnr_db), 3),
        figure(model.and_then(|score| score.ssim), 5),
        figure(model.map(|score| score.flip), 5),
        entry.on_front.to_string(),
        figure(Some(entry.whole.cpu_seconds), 4),
        figure(Some(entry.whole.seconds), 4),
        figure(entry.predicted.map(|predicted| predicted.cpu_seconds), 4),
        figure(entry.predicted.map(|predicted| predicted.seconds), 4),
        entry.picture.clone().unwrap_or_default(),
        entry.map.clone().unwrap_or_default(),
        entry.command.clone(),
    ]
}

/// A figure with `digits` decimals; empty for `None`.
pub(super) fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or(String::new(), |value| format!("{value:.digits$}"))
}

fn quote(field: &str) -> String {
    let special = |c: char| matches!(c, ',' | '"' | '\n' | '\r');
    if field.contains(special) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{entry, results};
    use super::*;

    #[test]
    fn every_line_has_a_field_for_every_column() {
        let text = csv(&results(vec![entry(1.0, 30.0), entry(2.0, 40.0)]));
        let counts: Vec<usize> = text.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(counts, [20; 3], "{text}");
        let first = text.lines().nth(1).unwrap();
        assert!(first.starts_with("shear,shear,,1.0000,1.0000,1,30.000,30.000,,"), "{first}");
    }

    #[test]
    fn commas_and_quotes_do_not_end_a_field() {
        let command = "thinlens render 'a, \"b\".exr'".to_owned();
        let text = csv(&results(vec![Entry { command, ..entry(1.0, 30.0) }]));
        assert!(text.ends_with(",\"thinlens render 'a, \"\"b\"\".exr'\"\n"), "{text}");
    }

    #[test]
    fn a_prediction_is_in_its_columns() {
        let predicted = crate::cost::Prediction { cpu_seconds: 0.5, seconds: 0.25 };
        let text = csv(&results(vec![Entry { predicted: Some(predicted), ..entry(1.0, 30.0) }]));
        let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let values: Vec<&str> = text.lines().nth(1).unwrap().split(',').collect();
        let value = |name| values[names.iter().position(|&found| found == name).unwrap()];
        assert_eq!((value("predicted_cpu_seconds"), value("predicted_seconds")), ("0.5000", "0.2500"));
    }
}
