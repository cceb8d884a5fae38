//! Command lines that can be pasted into a shell.

/// `words` as one line for a POSIX shell, quoted where necessary.
pub fn line(words: impl IntoIterator<Item = impl AsRef<str>>) -> String {
    let quoted: Vec<String> = words.into_iter().map(|word| quote(word.as_ref())).collect();
    quoted.join(" ")
}

/// `word`, quoted if a POSIX shell would not read it as it is.
fn quote(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=+,@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_special_characters_are_quoted_and_others_are_not() {
        assert_eq!(line(["render", "a/b.exr", "--set", "k=v"]), "render a/b.exr --set k=v");
        assert_eq!(line(["my shot.exr", "", "$HOME", "~"]), "'my shot.exr' '' '$HOME' '~'");
    }

    #[cfg(unix)]
    #[test]
    fn a_shell_reads_back_what_was_written() {
        let words = ["it's", "a \"b\" \\ `c`", "</script>", "*", "x;y&z|w", "ä\nö"];
        let script = format!("printf '%s\\0' {}", line(words));
        let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert_eq!(text.trim_end_matches('\0').split('\0').collect::<Vec<_>>(), words);
    }
}
