//! Lists, descriptions, completions and manual pages.

use super::program::{STACK, run, stderr, thinlens};
use super::stdout;
use std::fs;
#[cfg(unix)]
use std::path::Path;
#[cfg(unix)]
use std::process::Command;
use thinlens::methods::METHODS;
use thinlens::scene::EffectKind;
use thinlens::settings::{BUILT_IN, Parameter, Preset};

#[test]
fn help_lists_every_subcommand() {
    let folder = tempfile::tempdir().unwrap();
    let help = stdout(&run(folder.path(), &["--help"]));
    for command in [
        "render",
        "inspect",
        "plan",
        "compare",
        "score",
        "methods",
        "presets",
        "devices",
        "demo",
        "export",
        "completions",
        "man",
    ] {
        assert!(help.contains(&format!("\n  {command} ")), "{command}: {help}");
    }
}

#[test]
fn a_wrong_call_exits_with_2_and_a_missing_input_with_4() {
    let folder = tempfile::tempdir().unwrap();
    let code = |arguments: &[&str]| run(folder.path(), arguments).status.code();
    assert_eq!(code(&[]), Some(2));
    assert_eq!(code(&["blur"]), Some(2));
    assert_eq!(code(&["render", STACK]), Some(2), "no output named");
    assert_eq!(code(&["render", STACK, "-o", "a.exr", "--method", "no-such"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "a.exr", "--focus", "1", "--focus-at", "1,1"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "-", "--json"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "a.png", "--preview", "a.png"]), Some(2));
    assert_eq!(code(&["render", STACK, "-o", "a.exr", "--exposure", "1"]), Some(2), "nothing to brighten");
    assert_eq!(code(&["render", STACK, "-o", "a.png", "--codec", "piz"]), Some(2), "nothing to compress");
    assert_eq!(code(&["render", "no-such.exr", "-o", "a.exr"]), Some(4));
    assert_eq!(code(&["presets", "show", "no-such"]), Some(2));
    assert_eq!(code(&["methods", "no-such"]), Some(2));
    assert_eq!(code(&["man", "no-such"]), Some(2));
    assert_eq!(code(&["--version"]), Some(0));
}

#[test]
fn devices_lists_the_processor_and_which_device_auto_chooses_and_why() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&run(folder.path(), &["devices"]));
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&run(folder.path(), &["devices", "--json"]))).unwrap();
    let processor = json["processor"].as_str().unwrap();
    assert!(text.starts_with(&format!("cpu   {processor}, ")), "{text}");
    let [auto, reason] = ["auto", "auto_reason"].map(|key| json[key].as_str().unwrap());
    assert_eq!(text.lines().last().unwrap(), format!("auto  {auto}: {reason}"));
    for adapter in json["adapters"].as_array().unwrap() {
        assert!(text.contains(adapter["name"].as_str().unwrap()), "{text}");
    }
}

#[test]
fn methods_lists_every_method() {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&run(folder.path(), &["methods"]));
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&run(folder.path(), &["methods", "--json"]))).unwrap();
    assert_eq!(text.lines().count(), METHODS.len());
    for (i, method) in METHODS.iter().enumerate() {
        let name = method.info().name;
        assert!(text.lines().any(|line| line.starts_with(name)), "{name}");
        assert_eq!(json[i]["name"], name);
    }
}

#[test]
fn methods_describes_one_method_as_a_preset_of_its_defaults() {
    let folder = tempfile::tempdir().unwrap();
    for method in METHODS {
        let info = method.info();
        let text = stdout(&run(folder.path(), &["methods", info.name]));
        assert!(text.contains(info.source), "{text}");
        let preset = Preset::parse(&text, info.name).unwrap();
        assert_eq!(preset.values.method.as_deref(), Some(info.name));
        let parameters = method.parameters();
        let read = parameters.read(info.name, &preset.parameters).unwrap();
        assert_eq!(read, parameters.defaults(), "{}", info.name);
        for Parameter { name, description, .. } in parameters.declarations() {
            assert!(text.contains(&format!("\n# {description}")), "{name}: {text}");
            assert!(text.contains(&format!("\n{name} = ")), "{name}: {text}");
        }
        for deviation in info.deviations {
            assert!(text.contains(deviation.reason), "{}: {text}", deviation.reason);
        }
    }
    let unknown = run(folder.path(), &["methods", "sheer"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("did you mean 'shear'?"), "{}", stderr(&unknown));
}

#[test]
fn a_parameter_out_of_its_range_is_refused_with_key_value_range_and_default() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("lens.toml"), "[method.accumulate]\nrays = 0\n").unwrap();
    let output = run(folder.path(), &["render", STACK, "--preset", "lens.toml", "-o", "a.exr"]);
    assert_eq!(output.status.code(), Some(2));
    let text = stderr(&output);
    assert!(
        text.contains("'rays' of accumulate must be a whole number from 1 to 65536 (the default is 1024)"),
        "{text}"
    );
    assert!(text.contains("2 | rays = 0"), "{text}");
    assert!(!folder.path().join("a.exr").exists(), "nothing written");
}

#[test]
fn the_documentation_lists_every_method_as_the_program_does() {
    let page = include_str!("../../docs/methods.md");
    for method in METHODS {
        let info = method.info();
        let row = format!("| `{}` | {} | {} | {} |", info.name, info.role, info.summary, info.source);
        assert!(page.contains(&row), "the table of docs/methods.md lacks: {row}");
    }
}

#[test]
fn presets_are_listed_and_printed_as_files_that_parse() {
    let folder = tempfile::tempdir().unwrap();
    let list = stdout(&run(folder.path(), &["presets"]));
    for preset in BUILT_IN {
        assert!(list.lines().any(|line| line.starts_with(preset.name)), "{}", preset.name);
        let text = stdout(&run(folder.path(), &["presets", "show", preset.name]));
        assert!(Preset::parse(&text, preset.name).is_ok(), "{}", preset.name);
    }
}

#[test]
fn completions_and_manual_pages_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        assert!(stdout(&run(folder.path(), &["completions", shell])).contains("thinlens"), "{shell}");
    }
    assert!(stdout(&run(folder.path(), &["man", "render"])).contains("f\\-number"));
}

#[test]
fn every_manual_page_says_exit_codes_variables_and_other_pages() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["", "render", "inspect", "plan", "compare", "score", "demo", "export", "devices", "man"] {
        let arguments = ["man", command];
        let page = stdout(&run(folder.path(), &arguments[..2 - usize::from(command.is_empty())]));
        let expected = ["EXIT STATUS", "128 + n", "ENVIRONMENT", "THINLENS_CACHE_DIR", "SEE ALSO"];
        for words in expected {
            assert!(page.contains(words), "{command}: {words}");
        }
        let others = page.split("SEE ALSO").last().unwrap();
        assert!(!others.contains(&format!("thinlens\\-{command}\\fR")) || command.is_empty(), "{others}");
        assert!(others.contains("thinlens\\-methods"), "{others}");
    }
}

#[test]
fn presets_methods_and_effects_are_completed_by_name_and_presets_by_file_too() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "fish", "zsh"] {
        let script = stdout(&run(folder.path(), &["completions", shell]));
        let presets = BUILT_IN.iter().map(|preset| preset.name);
        let effects = EffectKind::ALL.map(EffectKind::name);
        for name in presets.chain(METHODS.iter().map(|method| method.info().name)).chain(effects) {
            assert!(script.contains(name), "{shell}: {name}");
        }
    }
}

/// What bash completes the last of `words` with.
#[cfg(unix)]
fn completed_by_bash(folder: &Path, words: &[&str]) -> Option<Vec<String>> {
    let script = stdout(&run(folder, &["completions", "bash"]));
    let last = words.len() - 1;
    let ask = format!(
        "{script}\nCOMP_WORDS=({}); COMP_CWORD={last}; _thinlens thinlens '{}' '{}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        words.join(" "),
        words[last],
        words[last - 1]
    );
    // No bash, nothing to ask.
    let output = Command::new("bash").current_dir(folder).args(["-c", &ask]).output().ok()?;
    Some(String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect())
}

#[cfg(unix)]
#[test]
fn bash_completes_names_and_files() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("portable.toml"), "").unwrap();
    for (words, expected) in [
        (&["thinlens", "render", "--preset", "port"][..], &["portrait", "portable.toml"][..]),
        (&["thinlens", "render", "--without", "highlights"], &["highlights"]),
        (&["thinlens", "compare", "--methods", "sc"], &["scatter"]),
        (&["thinlens", "plan", "--method", "acc"], &["accumulate"]),
        (&["thinlens", "presets", "show", "swi"], &["swirl"]),
        (&["thinlens", "methods", "scat"], &["scatter"]),
    ] {
        let Some(completed) = completed_by_bash(folder.path(), words) else { return };
        assert_eq!(completed, expected, "{words:?}");
    }
}

#[test]
fn a_closed_pipe_is_not_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = thinlens(folder.path(), &["presets"]).stdout(writer).output().unwrap();
    assert_eq!((output.status.code(), stderr(&output)), (Some(0), String::new()));
}
