//! The table of allowed edges in ARCHITECTURE.md holds in the code, and files do not use one another in circles.
//!
//! Reads the paths that start at the crate's root (`crate::…`, and `thinlens::…` in the program). Tests inside the modules
//! are free to use what they like.

#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

mod circles;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

type Edges = BTreeMap<String, BTreeSet<String>>;

const HEADING: &str = "## Allowed edges";

#[test]
fn modules_use_only_what_the_architecture_allows() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let allowed = allowed_edges(&text);
    assert!(!allowed.is_empty(), "ARCHITECTURE.md has no table under '{HEADING}'");
    let mut wrong = Vec::new();
    for file in rust_files(&root.join("src")) {
        let name = file.strip_prefix(root).unwrap().display().to_string();
        let Some(module) = module_of(file.strip_prefix(root.join("src")).unwrap()) else { continue };
        let Some(may_use) = allowed.get(&module) else {
            wrong.push(format!("{name}: the module '{module}' is missing from the table in ARCHITECTURE.md"));
            continue;
        };
        for used in used_modules(&fs::read_to_string(&file).unwrap(), module == "cli") {
            if used != module && !may_use.contains(&used) {
                wrong.push(format!("{name}: '{module}' uses '{used}', which ARCHITECTURE.md does not allow"));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn every_module_of_the_table_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    for (module, may_use) in allowed_edges(&text) {
        for name in may_use.iter().chain([&module]) {
            let source = root.join("src").join(name);
            let exists = source.is_dir() || source.with_extension("rs").is_file();
            assert!(exists, "ARCHITECTURE.md's table names '{name}', and src/ has no such module");
        }
    }
}

#[test]
fn loops_run_in_parallel_by_one_function_but_for_those_that_the_architecture_names() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let invariant =
        text.split("- **Architecture Invariant:**").find(|invariant| invariant.contains("`parallel`"));
    let invariant = invariant.unwrap();
    for file in rust_files(&root.join("src")) {
        let folders = file.strip_prefix(root.join("src")).unwrap().iter();
        let name = folders.map(|name| name.to_str().unwrap()).collect::<Vec<_>>().join("/");
        let has_loops = code_of(&fs::read_to_string(&file).unwrap()).contains("rayon::prelude");
        assert_eq!(has_loops, name == "parallel.rs" || invariant.contains(&format!("`{name}`")), "{name}");
    }
}

#[test]
fn paths_are_found_in_groups_and_in_the_middle_of_a_line_and_not_in_comments() {
    let text = "use crate::{error::Error, image::{Image, Plane},\n    lens};\nlet x = crate::stack::read();\n// crate::gpu\n";
    let expected = ["error", "image", "lens", "stack"].map(str::to_owned);
    assert_eq!(used_modules(text, false), BTreeSet::from(expected));
    assert_eq!(used_modules("use thinlens::scene::Plan;", true), BTreeSet::from(["scene".to_owned()]));
}

/// The rows `| module | a, b |` under [`HEADING`].
fn allowed_edges(text: &str) -> Edges {
    let section = text.split_once(HEADING).map_or("", |(_, rest)| rest);
    let section = section.split("\n## ").next().unwrap_or_default();
    let rows = section.lines().filter(|line| line.starts_with('|')).skip(2);
    let cells = rows.filter_map(|row| row.trim_matches('|').split_once('|'));
    cells
        .map(|(module, uses)| {
            let names = uses.split(',').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty());
            (module.trim().to_owned(), names.collect())
        })
        .collect()
}

/// The top-level module that a file belongs to; `None` for the crate's root, which only lists them.
fn module_of(file: &Path) -> Option<String> {
    let first = Path::new(file.components().next()?.as_os_str()).file_stem()?.to_str()?;
    match first {
        "lib" => None,
        "main" => Some("cli".to_owned()),
        module => Some(module.to_owned()),
    }
}

/// The top-level modules that a file names. The program reaches the library by its name, the library itself by `crate`.
fn used_modules(text: &str, of_program: bool) -> BTreeSet<String> {
    let code = code_of(text);
    let prefix = if of_program { "thinlens::" } else { "crate::" };
    let mut used = BTreeSet::new();
    for (at, _) in code.match_indices(prefix) {
        let path = &code[at + prefix.len()..];
        match path.strip_prefix('{') {
            Some(group) => used.extend(heads_of_group(group)),
            None => used.extend(head(path)),
        }
    }
    used
}

/// `text` without its comments and without its tests.
fn code_of(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let code: Vec<_> = code.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
    code.join("\n")
}

/// The first word of each path of `a::b, c::{d, e}} …`, up to the closing brace.
fn heads_of_group(group: &str) -> Vec<String> {
    let mut heads = Vec::new();
    let mut depth = 0;
    let mut start = 0;
    for (at, character) in group.char_indices() {
        match character {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                heads.extend(head(group[start..at].trim()));
                start = at + 1;
            }
            _ => {}
        }
        if character == '}' && start == at + 1 {
            break;
        }
    }
    heads
}

/// The word that `path` starts with, if it names a module and no macro.
fn head(path: &str) -> Option<String> {
    let end = path.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(path.len());
    let word = &path[..end];
    let is_module = word.starts_with(char::is_lowercase) && !path[end..].starts_with('!');
    is_module.then(|| word.to_owned())
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}
