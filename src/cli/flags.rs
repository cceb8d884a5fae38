//! Flags of the settings, generated from the library's table of settings, and the replacement of keys by flags in messages.
//!
//! The library names a setting by its key in backquotes, as in `` `near_clip` `` or `` `f_number = inf` ``. Before such a text reaches the
//! terminal, the key is replaced by the flag: `--near-clip`.

use clap::builder::{PathBufValueParser, PossibleValue, PossibleValuesParser, TypedValueParser, ValueParser};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use thinlens::settings::{CommandLine, Kind, SETTINGS, Setting, Value, Values, Word, Written};

/// Settings whose range is checked while the command line is parsed: a value outside it is a usage error. All others are
/// checked with the presets, before any file is read.
const USAGE: [&str; 5] = ["blades", "near_clip", "near", "far", "supersample"];

/// The flags of all settings that have one.
#[derive(Debug, Default)]
pub(super) struct SettingFlags {
    /// The settings on the command line, with their values.
    values: Vec<(&'static Setting, Written)>,
}

impl SettingFlags {
    /// The values as a layer of the library's settings.
    pub(super) fn values(&self) -> Values {
        let mut values = Values::default();
        for (setting, written) in &self.values {
            values.set_written(setting, written);
        }
        values
    }

    /// The same flags as words of a command line.
    pub(super) fn words(&self) -> Vec<String> {
        let words = |(setting, written): &(&Setting, Written)| {
            let unit = if written.in_metres { "m" } else { "" };
            let value = match &written.value {
                Value::Word(word) => kebab(word),
                value => format!("{value}{unit}"),
            };
            flag_of(setting).map(|name| [format!("--{name}"), value])
        };
        self.values.iter().filter_map(words).flatten().collect()
    }
}

impl Args for SettingFlags {
    fn augment_args(command: Command) -> Command {
        command.args(SETTINGS.iter().filter_map(argument))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for SettingFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let with_flag = SETTINGS.iter().filter(|setting| flag_of(setting).is_some());
        let values =
            with_flag.filter_map(|setting| Some((setting, matches.get_one::<Written>(setting.key)?.clone())));
        Ok(Self { values: values.collect() })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The flag of `setting` without its dashes.
fn flag_of(setting: &Setting) -> Option<&'static str> {
    match setting.command_line {
        CommandLine::Flag { name, .. } => Some(name),
        CommandLine::Never(_) => None,
    }
}

/// The clap argument of `setting`, if it has a flag.
fn argument(setting: &'static Setting) -> Option<Arg> {
    let CommandLine::Flag { name, value_name } = setting.command_line else { return None };
    let heading = if matches!(setting.table, "depth" | "picture") { "Input" } else { "Lens" };
    let others = SETTINGS.iter().filter(|other| other.field == setting.field && other.key != setting.key);
    let argument = Arg::new(setting.key)
        .long(name)
        .value_name(value_name)
        .help_heading(heading)
        .help(setting_keys_to_flags(&setting.summary()))
        .long_help(long_help(setting))
        .conflicts_with_all(others.map(|other| other.key))
        .value_parser(parser(setting));
    Some(match setting.kind {
        // With units, negative numbers are no numbers to clap.
        Kind::Number(_) | Kind::RedBlue(_) => argument.allow_hyphen_values(true),
        _ => argument,
    })
}

/// What the setting does, its default and its range. clap itself lists the words that a setting allows.
fn long_help(setting: &Setting) -> String {
    let range = setting.kind.range().filter(|_| !matches!(setting.kind, Kind::Word(_)));
    let range = range.map(|range| format!(" [range: {range}]")).unwrap_or_default();
    let default = match setting.default_value() {
        Some(Value::Word(word)) => kebab(word),
        _ => setting.default_in_words(),
    };
    let mut paragraphs = vec![setting.summary()];
    paragraphs.extend(setting.details());
    paragraphs.push(format!("[default: {default}]{range}"));
    setting_keys_to_flags(&paragraphs.join("\n\n"))
}

/// Parses the text of a flag to the setting's value.
fn parser(setting: &'static Setting) -> ValueParser {
    let expected = move || format!("it must be {}", setting.expected());
    let checked = move |written: Written| {
        let refused = USAGE.contains(&setting.key) && !setting.kind.allows(&written.value);
        let remedy = || setting.remedy(&written.value).map(|help| format!("; {help}")).unwrap_or_default();
        if refused { Err(keys_to_flags(&(expected() + &remedy()))) } else { Ok(written) }
    };
    match setting.kind {
        Kind::Number(_) => ValueParser::from(move |text: &str| {
            checked(setting.parse_number(text).map_err(|error| keys_to_flags(&error.on_one_line()))?)
        }),
        Kind::Whole(..) | Kind::Count { .. } => ValueParser::from(move |text: &str| {
            let number = text.trim().parse().map_err(|_| expected())?;
            checked(plain(Value::Whole(number)))
        }),
        Kind::RedBlue(_) => {
            let expected = "expected two numbers separated by a comma, such as 30,45";
            ValueParser::from(move |text: &str| pair(text).map(Value::Pair).map(plain).ok_or(expected))
        }
        Kind::Pixel => {
            let expected = "expected a pixel: two numbers separated by a comma, such as 960,540";
            ValueParser::from(move |text: &str| pair(text).map(Value::Pair).map(plain).ok_or(expected))
        }
        Kind::Word(words) => PossibleValuesParser::new(words.iter().map(possible_value))
            .map(|name| {
                let word = words.iter().find(|word| kebab(word.name) == name);
                plain(Value::Word(word.expect("the parser accepts only names of these words").name))
            })
            .into(),
        Kind::Name => ValueParser::from(|text: &str| Ok::<_, String>(plain(Value::Name(text.to_owned())))),
        Kind::File => PathBufValueParser::new().map(|path| plain(Value::File(path))).into(),
    }
}

/// A value without a unit.
fn plain(value: Value) -> Written {
    Written { value, in_metres: false }
}

/// Two finite numbers separated by a comma, or by an x as in `960x540`.
fn pair(text: &str) -> Option<[f32; 2]> {
    let number = |text: &str| text.trim().parse::<f32>().ok().filter(|x| x.is_finite());
    let (first, second) = text.split_once([',', 'x'])?;
    Some([number(first)?, number(second)?])
}

fn possible_value(word: &Word) -> PossibleValue {
    let value = PossibleValue::new(kebab(word.name));
    if word.meaning.is_empty() { value } else { value.help(setting_keys_to_flags(word.meaning)) }
}

/// A word of a preset in the spelling of flags: hyphens instead of underscores.
fn kebab(word: &str) -> String {
    word.replace('_', "-")
}

/// Keys of the library that are no setting, with their flags: fields of a job and of how its files are read.
pub(super) const OTHER_FLAGS: [(&str, &str); 17] = [
    ("color_channel", "color-channel"),
    ("confidence", "confidence"),
    ("depth_channel", "depth-channel"),
    ("depth_file", "depth-file"),
    ("device", "device"),
    ("force", "force"),
    ("frame", "frame"),
    ("memory", "memory"),
    ("method", "method"),
    ("quality", "quality"),
    ("set", "set"),
    ("target_db", "target-db"),
    ("time_budget_s", "time-budget"),
    ("verify", "verify"),
    ("view", "view"),
    ("views", "views"),
    ("without", "without"),
];

/// A text of the library with every key replaced by its flag: keys of settings, and those of [`OTHER_FLAGS`].
pub(super) fn keys_to_flags(text: &str) -> String {
    replace_keys(text, |key| {
        let other = || OTHER_FLAGS.iter().find(|(other, _)| *other == key);
        setting_on_command_line(key).or_else(|| other().map(|(_, name)| format!("--{name}")))
    })
}

/// [`keys_to_flags`] for texts of the table of settings, which name settings only.
fn setting_keys_to_flags(text: &str) -> String {
    replace_keys(text, setting_on_command_line)
}

/// How the command line sets the setting `key`: by its flag, else in a preset.
fn setting_on_command_line(key: &str) -> Option<String> {
    let setting = Setting::by_key(key)?;
    Some(match flag_of(setting) {
        Some(name) => format!("--{name}"),
        None => format!("{} of the preset's [{}]", setting.preset_key, setting.table),
    })
}

/// `text` with each `` `key` `` and `` `key = value` `` replaced by what `flag_of_key` returns for the key. A value follows its flag
/// without brackets and quotes. Keys for which it returns `None` stay as they are.
fn replace_keys(text: &str, flag_of_key: impl Fn(&str) -> Option<String>) -> String {
    let mut replaced = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, quoted)) = rest.split_once('`') {
        replaced.push_str(before);
        let Some((quote, after)) = quoted.split_once('`') else {
            replaced.push('`');
            rest = quoted;
            break;
        };
        let (key, value) = match quote.split_once(" = ") {
            Some((key, value)) => (key, Some(value)),
            None => (quote, None),
        };
        match flag_of_key(key) {
            Some(flag) => {
                replaced.push_str(&flag);
                if let Some(value) = value {
                    let bare = value.trim_matches(['[', ']', '"']).replace(", ", ",");
                    replaced.extend([" ", &bare]);
                }
                rest = after;
            }
            None => {
                // The closing backquote may open the next quote.
                replaced.extend(["`", quote]);
                rest = &quoted[quote.len()..];
                if let Some(after) = rest.strip_prefix('`') {
                    replaced.push('`');
                    rest = after;
                }
            }
        }
    }
    replaced + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_of_the_library_are_flags_on_the_command_line() {
        for (text, expected) in [
            ("raise `focus_distance` or lower `focal_length_mm`", "raise --focus or lower --focal-length"),
            ("for a pinhole, `f_number = inf`", "for a pinhole, --f-number inf"),
            ("pick a point with `focus_point = [X, Y]`", "pick a point with --focus-at X,Y"),
            ("`quality = \"draft\"`", "--quality draft"),
            ("name it with `depth_channel`", "name it with --depth-channel"),
            ("`time_budget_s = 4` requested", "--time-budget 4 requested"),
            ("use `device = cpu`", "use --device cpu"),
            (
                "`extrapolation_gain` must be high",
                "gain of the preset's [highlight-extrapolation] must be high",
            ),
            ("`thinlens presets` lists them", "`thinlens presets` lists them"),
            ("`thinlens devices` and `near`", "`thinlens devices` and --near"),
            ("one ` alone", "one ` alone"),
        ] {
            assert_eq!(keys_to_flags(text), expected);
        }
    }

    #[test]
    fn a_pair_is_two_numbers_with_a_comma() {
        assert_eq!(pair("960, 540.5"), Some([960.0, 540.5]));
        assert_eq!(pair("960x540"), Some([960.0, 540.0]));
        for text in ["960", "960,", "a,b", "1,2,3", "nan,1"] {
            assert_eq!(pair(text), None, "{text}");
        }
    }
}
