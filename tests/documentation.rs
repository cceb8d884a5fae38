//! Every command of the documentation, run as a reader would run it.
//!
//! The pages are README.md, docs/*.md, samples/README.md and samples/*/README.md. A block of indented lines is a script if `thinlens` is one of its
//! words. The scripts of a page run from top to bottom in a folder of the page's own, which holds small files under the names that the
//! pages use. Each must succeed.
//!
//! Two conventions: a script with `--device gpu` runs only where `THINLENS_REQUIRE_GPU` is set, and pages have no fenced blocks, so that no command is
//! overlooked. Commands in running text are parsed but not run, by a test of `src/cli/mod.rs`.

#![cfg(all(unix, feature = "cli"))]
#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

#[expect(dead_code, reason = "other tests use the rest")]
#[path = "fixtures/deep.rs"]
mod deep_fixtures;
#[expect(dead_code, reason = "other tests use the rest")]
mod fixtures;

use deep_fixtures::{DeepPart, deep_bytes, grey};
use exr::meta::attribute::AttributeValue;
use fixtures::{Part, exr_bytes};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use thinlens::output::png;
use thinlens::stack::read_picture;

/// Folder of the project.
const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// A page of the documentation.
struct Page {
    /// Its path in the project.
    name: String,
    text: String,
}

impl Page {
    fn read(file: &Path) -> Self {
        let name = file.strip_prefix(ROOT).unwrap().display().to_string();
        Self { name, text: fs::read_to_string(file).unwrap() }
    }
}

fn pages() -> Vec<Page> {
    let root = Path::new(ROOT);
    let samples = entries(&root.join("samples")).into_iter().map(|folder| folder.join("README.md"));
    let more = [root.join("README.md"), root.join("samples/README.md")];
    let files = entries(&root.join("docs")).into_iter().chain(samples).chain(more);
    let mut pages: Vec<Page> = files
        .filter(|file| file.is_file() && file.extension().is_some_and(|extension| extension == "md"))
        .map(|file| Page::read(&file))
        .collect();
    pages.sort_by(|a, b| a.name.cmp(&b.name));
    pages
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
}

/// The indented blocks of `page`, without their indentation.
fn blocks(page: &str) -> Vec<String> {
    let mut blocks = Vec::new();
    let mut block = String::new();
    for line in page.lines().chain(["end"]) {
        match line.strip_prefix("    ") {
            Some(code) => block += &format!("{code}\n"),
            None if line.trim().is_empty() && !block.is_empty() => block += "\n",
            None if !block.is_empty() => blocks.push(std::mem::take(&mut block)),
            None => {}
        }
    }
    blocks
}

/// The blocks of `page` that are scripts.
fn scripts(page: &str) -> impl Iterator<Item = String> {
    blocks(page).into_iter().filter(|block| block.split_whitespace().any(|word| word == "thinlens"))
}

/// Whether `script` can run on this machine: tests need no renderer.
fn can_run(script: &str, has_gpu: bool) -> bool {
    let has_renderer = ["blender -b", "python "].iter().any(|program| script.contains(program));
    !has_renderer && (has_gpu || !script.contains("--device gpu"))
}

/// The files that the pages name, in `folder`.
fn make_files(folder: &Path) {
    let sample = Path::new(ROOT).join("samples/terrace");
    fs::create_dir(folder.join("shots")).unwrap();
    for (file, names) in [
        ("stack.exr", &["stack.exr", "shot.0042.exr", "shots/shot.0001.exr", "shots/shot.0002.exr"][..]),
        ("pinhole.exr", &["beauty.exr", "depth.exr", "beauty.0001.exr", "depth.0001.exr"]),
        ("reference.exr", &["lens.exr"]),
    ] {
        names.iter().for_each(|name| copy(&sample.join(file), &folder.join(name)));
    }
    png::write(&folder.join("beauty.png"), &read_picture(&sample.join("reference.exr")).unwrap(), 0.0)
        .unwrap();
    // An exporter's stack has the lens.
    fs::create_dir(folder.join("stacks")).unwrap();
    copy(&Path::new(ROOT).join("samples/stall/stack.exr"), &folder.join("stacks/shot.0001.exr"));
    for (peel, depth) in [1, 2, 3].into_iter().enumerate() {
        let part = Part::flat((32, 18), &format!("R=0.5 G=0.5 B=0.5 A=1 Z={depth}"));
        let bytes = exr_bytes(vec![part]);
        for name in [format!("peel{peel}.exr"), format!("peel{peel}.0001.exr")] {
            fs::write(folder.join(name), &bytes).unwrap();
        }
    }
    for (name, depth) in [("near", 1), ("far", 4)] {
        let part = Part::flat((32, 18), &format!("R=0.5 G=0.5 B=0.5 A=0.5 Z={depth}"));
        fs::write(folder.join(format!("{name}.exr")), exr_bytes(vec![part])).unwrap();
    }
    let sky = Part::flat((32, 16), "R=0.2 G=0.4 B=1");
    fs::write(folder.join("sky.exr"), exr_bytes(vec![sky])).unwrap();
    fs::write(folder.join("chrome.exr"), exr_bytes(vec![chrome()])).unwrap();
    for (name, depth) in [("trees", 2.0), ("balls", 3.0)] {
        let part = DeepPart::surfaces(32, 18, move |_, _| vec![grey(depth, 0.25, 0.5)]);
        fs::write(folder.join(format!("{name}.exr")), deep_bytes(&[part])).unwrap();
    }
    let pages = blocks(&Page::read(&Path::new(ROOT).join("docs/focus.md")).text);
    let pull = pages.iter().find(|block| block.starts_with("[[lens.focus_keys]]")).unwrap();
    fs::write(folder.join("pull.toml"), pull).unwrap();
    for scene in entries(&Path::new(ROOT).join("samples")).iter().filter(|scene| scene.is_dir()) {
        let target = folder.join("samples").join(scene.file_name().unwrap());
        fs::create_dir_all(&target).unwrap();
        entries(scene).iter().for_each(|file| copy(file, &target.join(file.file_name().unwrap())));
    }
}

/// A peel that reflects the sky.
fn chrome() -> Part {
    let ahead = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
    let colors = "Combined.R=0.2 Combined.G=0.4 Combined.B=1 Combined.A=1 Depth.Z=3 Diffuse.R=0 Diffuse.G=0 Diffuse.B=0";
    let gloss =
        "Normal.X=0 Normal.Y=0 Normal.Z=1 Specular.R=1 Specular.G=1 Specular.B=1 ReflectedDistance.V=1e10";
    let channels: Vec<String> =
        colors.split(' ').chain(gloss.split(' ')).map(|channel| format!("Peel0.{channel}")).collect();
    Part::flat((32, 18), &channels.join(" ")).attribute("worldToCamera", AttributeValue::Matrix4x4(ahead))
}

fn copy(from: &Path, to: &Path) {
    fs::copy(from, to).unwrap();
}

/// Runs `script` in `folder` by a shell that finds the program and stops at the first command that fails.
fn run(script: &str, folder: &Path) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_thinlens")).parent().unwrap().to_owned();
    let others = std::env::var_os("PATH").unwrap_or_default();
    let path = std::env::join_paths([program].into_iter().chain(std::env::split_paths(&others))).unwrap();
    let mut shell = Command::new("sh");
    shell.args(["-e", "-c", script]).current_dir(folder).env("PATH", path);
    shell.env("THINLENS_CACHE_DIR", concat!(env!("CARGO_TARGET_TMPDIR"), "/calibration"));
    shell.output().unwrap()
}

#[test]
fn every_script_of_the_documentation_succeeds() {
    let has_gpu = cfg!(feature = "gpu") && std::env::var_os("THINLENS_REQUIRE_GPU").is_some();
    for page in pages() {
        let folder = tempfile::tempdir().unwrap();
        make_files(folder.path());
        for script in scripts(&page.text).filter(|script| can_run(script, has_gpu)) {
            let output = run(&script, folder.path());
            let errors = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(0), "{}:\n{script}\n{errors}", page.name);
        }
    }
}

/// The anchors of the headings of `page`, as GitHub makes them: lower case, spaces as hyphens, no punctuation.
fn anchors(page: &str) -> Vec<String> {
    let headings = page.lines().filter(|line| line.starts_with('#'));
    let words = headings.map(|line| line.trim_start_matches('#').trim().to_lowercase().replace(' ', "-"));
    words.map(|words| words.chars().filter(|&c| c.is_alphanumeric() || c == '-').collect()).collect()
}

#[test]
fn every_link_between_pages_leads_to_a_file_and_a_heading() {
    for page in pages() {
        let folder = Path::new(ROOT).join(&page.name).parent().unwrap().to_owned();
        let links = page.text.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
        for link in links.map(|(link, _)| link).filter(|link| !link.starts_with("https://")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let file = if file.is_empty() { Path::new(ROOT).join(&page.name) } else { folder.join(file) };
            assert!(file.exists(), "{}: there is no {link}", page.name);
            let found = anchor.is_empty()
                || anchors(&fs::read_to_string(&file).unwrap()).contains(&anchor.to_owned());
            assert!(found, "{}: {link} is no heading", page.name);
        }
    }
}

#[test]
fn pages_have_no_fenced_blocks_whose_commands_would_be_overlooked() {
    for page in pages() {
        assert!(!page.text.contains("```"), "{}: indent code by four spaces instead", page.name);
    }
}

#[test]
fn a_script_is_an_indented_block_with_the_program_in_it_and_no_other() {
    let page = "\
Text

    thinlens a
    thinlens b

thinlens c

    cargo test      # writes thinlens-demo

Text

    for file in *; do
        thinlens d

        thinlens e
    done
";
    let found: Vec<_> = scripts(page).collect();
    assert_eq!(
        found,
        ["thinlens a\nthinlens b\n\n", "for file in *; do\n    thinlens d\n\n    thinlens e\ndone\n"]
    );
}

#[test]
fn only_a_script_for_a_gpu_needs_one() {
    assert!(can_run("thinlens devices", false) && can_run("thinlens render a.exr --device gpu", true));
    assert!(!can_run("thinlens render a.exr --device gpu", false));
}
