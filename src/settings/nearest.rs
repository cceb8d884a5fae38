//! Corrections of misspelt words.

/// The candidate that `word` most likely stands for; `None` if none is similar.
pub fn nearest<'a>(word: &str, candidates: &'a [impl AsRef<str>]) -> Option<&'a str> {
    /// Jaro-Winkler similarity from which a word counts as a misspelling of another.
    const MIN_SIMILARITY: f64 = 0.8;
    let similarity = |candidate: &str| strsim::jaro_winkler(&word.to_lowercase(), &candidate.to_lowercase());
    candidates
        .iter()
        .map(|candidate| (similarity(candidate.as_ref()), candidate.as_ref()))
        .filter(|(similarity, _)| *similarity >= MIN_SIMILARITY)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
