//! Texts of files and file names as they may be shown: on one line, without characters that control a terminal, and of bounded length.

use std::borrow::Cow;

/// Characters of a word that are shown at most; of longer words the ends.
const MAX_WORD: usize = 200;

/// Characters that are shown of the start and the end of a longer word.
const WORD_ENDS: [usize; 2] = [120, 40];

/// Characters that are shown at most of a text.
const MAX_TEXT: usize = 8000;

/// `text` with every control character as an escape, so that it is one line and changes nothing but its own place on a terminal.
pub fn escaped(text: &str) -> Cow<'_, str> {
    if !text.contains(is_control) {
        return Cow::Borrowed(text);
    }
    let escape = |c: char| if is_control(c) { c.escape_default().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(escape).collect())
}

/// [`escaped`] of `text`, with the middle of very long words left out, and the end of a very long text.
pub fn shown(text: &str) -> Cow<'_, str> {
    let text = escaped(text);
    // A character has at least one byte.
    if text.len() <= MAX_WORD {
        return text;
    }
    let words: Vec<Cow<'_, str>> = text.split(' ').map(cut_word).collect();
    let joined = if words.iter().all(|word| matches!(word, Cow::Borrowed(_))) {
        text.into_owned()
    } else {
        words.join(" ")
    };
    match joined.char_indices().nth(MAX_TEXT) {
        Some((end, _)) => {
            let more = joined[end..].chars().count();
            Cow::Owned(format!("{}… and {more} more characters", &joined[..end]))
        }
        None => Cow::Owned(joined),
    }
}

/// Whether `c` is a control character of a terminal, ends a line, or changes the direction of what is written around it.
fn is_control(c: char) -> bool {
    let changes_direction =
        matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || changes_direction || matches!(c, '\u{2028}' | '\u{2029}')
}

fn cut_word(word: &str) -> Cow<'_, str> {
    let count = word.chars().count();
    if count <= MAX_WORD {
        return Cow::Borrowed(word);
    }
    let [first, last] = WORD_ENDS;
    let start: String = word.chars().take(first).collect();
    let end: String = word.chars().skip(count - last).collect();
    Cow::Owned(format!("{start}…{end}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escapes_and_other_texts_are_unchanged() {
        assert_eq!(shown("a\u{1b}]0;x\u{7}\nb\r\t\u{9b}2J"), "a\\u{1b}]0;x\\u{7}\\nb\\r\\t\\u{9b}2J");
        assert_eq!(shown("gpj.\u{202e}exr"), "gpj.\\u{202e}exr");
        for text in ["", "Kamera_Ü 4×4 µm 深度", "C:\\a\\b.exr"] {
            assert!(matches!(shown(text), Cow::Borrowed(same) if same == text), "{text}");
        }
    }

    #[test]
    fn long_words_keep_their_ends_and_long_texts_their_start() {
        let name = format!("peel {}Z end", "ü".repeat(100_000));
        let cut = shown(&name);
        assert!(cut.starts_with("peel üü") && cut.ends_with("üZ end") && cut.contains('…'), "{cut}");
        assert_eq!(cut.chars().count(), "peel ".len() + 120 + 1 + 40 + " end".len());
        let list = "name ".repeat(4000);
        let cut = shown(&list);
        assert!(cut.ends_with("… and 12000 more characters") && cut.len() < 8100, "{}", cut.len());
    }
}
