//! `thinlens export`.

use super::program::{run, stderr};
use super::stdout;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The files below `folder` by their path, with their bytes.
fn files_below(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths
        .flat_map(|path| {
            if path.is_dir() {
                files_below(&path)
            } else {
                BTreeMap::from([(path.clone(), fs::read(&path).unwrap())])
            }
        })
        .collect()
}

#[test]
fn an_exporter_is_written_with_all_it_imports_and_an_archive_of_the_same_files_for_blender() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(stdout(&run(folder.path(), &["export", "blender", "-o", "out"])).trim(), "out/blender");
    let written = files_below(&folder.path().join("out/blender"));
    let archive = fs::File::open(folder.path().join("out/thinlens-blender.zip")).unwrap();
    let mut archive = zip::ZipArchive::new(archive).unwrap();
    assert_eq!(archive.len(), written.len());
    for (path, bytes) in &written {
        let name = path.strip_prefix(folder.path().join("out/blender")).unwrap();
        let mut packed = Vec::new();
        std::io::copy(&mut archive.by_path(name).unwrap(), &mut packed).unwrap();
        assert_eq!(packed, *bytes, "{}", name.display());
    }
    let has = |name: &str| written.contains_key(&folder.path().join("out/blender").join(name));
    assert!(has("blender_manifest.toml") && has("cli.py") && has("thinlens_stack/exr.py"), "{written:?}");
    stdout(&run(folder.path(), &["export", "mitsuba", "-o", "out"]));
    assert!(folder.path().join("out/mitsuba/thinlens_stack/exr.py").is_file());
}

#[test]
fn a_farm_gets_its_templates_alone() {
    let folder = tempfile::tempdir().unwrap();
    for (farm, names) in [("openjd", &["template.yaml"][..]), ("slurm", &["render.sbatch", "submit.sh"])] {
        assert_eq!(
            stdout(&run(folder.path(), &["export", farm, "-o", "farm"])).trim(),
            format!("farm/{farm}")
        );
        let below = folder.path().join("farm").join(farm);
        let paths: Vec<PathBuf> = files_below(&below).into_keys().collect();
        assert_eq!(paths, names.iter().map(|name| below.join(name)).collect::<Vec<_>>());
    }
}

#[test]
fn an_exporter_that_somebody_changed_is_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let export = || run(folder.path(), &["export", "mitsuba", "-o", "."]);
    stdout(&export());
    let script = folder.path().join("mitsuba/export.py");
    let before = files_below(folder.path());
    stdout(&export());
    assert_eq!(files_below(folder.path()), before, "written a second time");
    fs::write(&script, "changed").unwrap();
    fs::remove_file(folder.path().join("mitsuba/thinlens_stack/exr.py")).unwrap();
    let before = files_below(folder.path());
    let refused = export();
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        stderr(&refused).contains("export.py") && stderr(&refused).contains("--output"),
        "{}",
        stderr(&refused)
    );
    assert_eq!(files_below(folder.path()), before, "nothing is written, what is missing neither");
}

#[test]
fn an_unknown_renderer_is_a_usage_error_that_names_those_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["export", "maya", "-o", "."]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("blender") && stderr(&output).contains("mitsuba"),
        "{}",
        stderr(&output)
    );
}
