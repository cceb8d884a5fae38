//! The entries as a table for a terminal.

use super::csv::figure;
use super::{Entry, Results};
use std::fmt::Write as _;

/// The entries from fastest to slowest; a star marks those on the Pareto front.
pub fn table(results: &Results) -> String {
    let mut sorted: Vec<&Entry> = results.entries.iter().collect();
    sorted.sort_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds));
    let with_model = sorted.iter().any(|entry| entry.model.is_some());
    let with_prediction = sorted.iter().any(|entry| entry.predicted.is_some());
    let width = sorted.iter().map(|entry| entry.name.len()).max().unwrap_or(0).max("method".len());
    let mut text = format!("  {:<width$}{:>9}{:>9}  ", "method", "CPU s", "wall s");
    text += if with_prediction { "predicted: CPU s  wall s  " } else { "" };
    let _ = write!(text, "{:<22}", "sampling error, dB");
    text += if with_model { "model error, dB    SSIM    FLIP\n" } else { "\n" };
    for entry in sorted {
        line(&mut text, entry, width, with_prediction);
    }
    text + "* no other entry is both faster and more accurate\n"
}

fn line(text: &mut String, entry: &Entry, width: usize, with_prediction: bool) {
    let star = if entry.on_front { '*' } else { ' ' };
    let _ = write!(text, "{star} {:<width$}{:>9.3}{:>9.3}  ", entry.name, entry.cpu_seconds, entry.seconds);
    if with_prediction {
        let cpu_seconds = figure(entry.predicted.map(|predicted| predicted.cpu_seconds), 3);
        let seconds = figure(entry.predicted.map(|predicted| predicted.seconds), 3);
        let _ = write!(text, "{cpu_seconds:>16}{seconds:>8}  ");
    }
    let (min_db, max_db) = entry.sampling.interval_db;
    let max_db = max_db.map_or("any".to_owned(), |max_db| format!("{max_db:.1}"));
    let sampling = format!("{:>5} ({min_db:.1} … {max_db})", figure(entry.sampling.psnr_db, 1));
    let _ = write!(text, "{sampling:<22}");
    if let Some(score) = &entry.model {
        let _ = write!(text, "{:>15.2}{:>8}{:>8.4}", score.psnr_db, figure(score.ssim, 4), score.flip);
    }
    text.push('\n');
}

#[cfg(test)]
mod tests {
    use super::super::tests::{entry, results};
    use super::*;
    use crate::cost::Prediction;

    #[test]
    fn the_fastest_entry_comes_first_and_entries_on_the_front_have_stars() {
        let mut results = results(vec![entry(2.0, 40.0), entry(1.0, 30.0), entry(3.0, 35.0)]);
        results.mark_front();
        let text = table(&results);
        let starts: Vec<&str> = text.lines().map(|line| &line[..2]).collect();
        assert_eq!(starts, ["  ", "* ", "* ", "  ", "* "], "{text}");
        assert!(text.lines().nth(1).unwrap().contains("1.000"), "{text}");
    }

    #[test]
    fn a_prediction_is_printed_beside_the_measurement() {
        let predicted = Some(Prediction { cpu_seconds: 1.5, seconds: 0.75 });
        let text = table(&results(vec![Entry { predicted, ..entry(2.0, 40.0) }]));
        let (head, line) = (text.lines().next().unwrap(), text.lines().nth(1).unwrap());
        assert_eq!(head.find("sampling"), line.find(" 40.0"), "{text}");
        assert!(line.contains(" 1.500 ") && line.contains(" 0.750 "), "{text}");
    }
}
