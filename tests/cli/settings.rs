//! Settings as flags: the command line has exactly what the table of settings declares.

use super::program::{STACK, run, stderr};
use super::stdout;
use thinlens::settings::{CommandLine, Kind, SETTINGS, Setting};

/// The flag of `setting` with the name of its value.
fn flag(setting: &Setting) -> Option<(&'static str, &'static str)> {
    match setting.command_line {
        CommandLine::Flag { name, value_name } => Some((name, value_name)),
        CommandLine::Never(_) => None,
    }
}

#[test]
fn help_shows_every_setting_with_what_it_does_its_default_and_its_range() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["render", "inspect", "plan", "compare"] {
        let help = stdout(&run(folder.path(), &[command, "--help"]));
        for setting in SETTINGS {
            let Some((name, value_name)) = flag(setting) else { continue };
            let (_, rest) = help.split_once(&format!("      --{name} <{value_name}>\n")).unwrap();
            let entry = rest.split("\n      --").next().unwrap();
            let entry = entry.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(entry.starts_with(&setting.summary()), "{command} --{name}: {entry}");
            let default = setting.default_in_words().replace('_', "-");
            assert!(entry.contains(&format!("[default: {default}]")), "{command} --{name}: {entry}");
            match setting.kind {
                Kind::Name | Kind::File => {}
                Kind::Word(words) => {
                    for word in words {
                        assert!(entry.contains(&word.name.replace('_', "-")), "{command} --{name}: {entry}");
                    }
                }
                kind => {
                    let range = format!("[range: {}]", kind.range().unwrap());
                    assert!(entry.contains(&range), "{command} --{name}: {entry}");
                }
            }
            assert!(
                !entry.contains('`') || entry.contains("`thinlens "),
                "keys are printed as flags: {entry}"
            );
        }
    }
}

#[test]
fn a_flag_out_of_its_range_is_refused_as_in_a_preset_before_anything_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let mut refused = 0;
    for setting in SETTINGS {
        let Some((name, _)) = flag(setting) else { continue };
        let value = match setting.kind {
            Kind::Number(_) => "nan",
            Kind::RedBlue(_) => "0,1e9",
            Kind::Count { .. } | Kind::Whole(..) => "1000",
            // These are refused by their syntax; every text is a valid name.
            Kind::Pixel | Kind::Word(_) | Kind::Name | Kind::File => continue,
        };
        let output = run(folder.path(), &["plan", "no-such.exr", &format!("--{name}"), value]);
        let text = stderr(&output);
        assert!(text.contains(&format!("must be {}", setting.expected())), "--{name} {value}: {text}");
        assert!(text.contains(&format!("--{name}")), "the flag is named: {text}");
        assert!(!text.contains("no-such.exr"), "{text}");
        refused += 1;
    }
    assert!(refused > 15, "{refused}");
}

#[test]
fn a_value_that_the_flag_or_the_lens_cannot_have_is_a_wrong_call() {
    let folder = tempfile::tempdir().unwrap();
    let code = |flag: &str, value: &str| {
        let output = run(folder.path(), &["plan", STACK, flag, value]);
        assert!(!stderr(&output).contains('`'), "{}", stderr(&output));
        output.status.code()
    };
    for (flag, value) in [
        ("--focal-length", "long"),
        ("--blades", "2"),
        ("--blades", "six"),
        ("--near-clip", "-1"),
        ("--near", "inf"),
        ("--supersample", "0"),
        ("--focus-at", "960"),
        ("--border", "wrap"),
        ("--sensor-distance", "thin_lens"),
        ("--focal-length", "-1"),
        ("--f-number", "0"),
        ("--focus", "0.01"),
        ("--cats-eye", "2"),
        ("--squeeze", "0.5"),
    ] {
        assert_eq!(code(flag, value), Some(2), "{flag} {value}");
    }
}

#[test]
fn lens_values_with_units_give_the_picture_of_the_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let render = |name: &str, lens: &str| {
        let lens = lens.split(' ');
        let arguments: Vec<&str> =
            ["render", STACK, "--views", "4", "-o", name].into_iter().chain(lens).collect();
        let output = run(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(0), "{lens:?}: {}", stderr(&output), lens = arguments);
        (thinlens::stack::read_picture(&folder.path().join(name)).unwrap(), stderr(&output))
    };
    let (numbers, _) = render(
        "a.exr",
        "--focal-length 85 --f-number 1.4 --sensor-width 36 --focus 600 --metres-per-unit 0.01",
    );
    let written = "--focal-length 85mm --f-number f/1.4 --sensor-width 3.6cm --focus 6m --metres-per-unit cm";
    let (units, said) = render("b.exr", written);
    assert_eq!(numbers.planes, units.planes);
    assert!(said.contains("focus distance of 6 m: 600 depth units of 0.01 m"), "{said}");
    let preset = "[lens]\nfocal_length_mm = '8.5cm'\nf_number = 'f/1.4'\nsensor_width_mm = 36\nfocus_distance = '600 cm'\n\
                  [depth]\nmetres_per_unit = '1cm'\n";
    std::fs::write(folder.path().join("my.toml"), preset).unwrap();
    assert_eq!(numbers.planes, render("c.exr", "--preset my.toml").0.planes);
}

#[test]
fn a_distance_behind_the_camera_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    for value in ["-4", "-4m"] {
        let output = run(folder.path(), &["render", STACK, "-o", "out.exr", "--focus", value]);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        let said = stderr(&output);
        assert!(
            said.contains("--focus must be a positive number") && said.contains("from the camera"),
            "{said}"
        );
    }
}
