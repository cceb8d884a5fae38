//! What thinlens brings for other programs: for renderers, programs in Python that make them write stacks; for render farms, templates of
//! jobs. They are part of the program, so that each copy of it can write those that belong to it.
//!
//! `exporters/` holds a folder for each of these programs and what those for renderers share. Written out, each of them has a copy of that.

/// The files for one renderer or render farm.
#[derive(Debug, Clone, Copy)]
pub struct Exporter {
    /// Name on the command line.
    pub name: &'static str,
    /// The renderer or farm, as its users call it.
    pub program: &'static str,
    /// Its files, as `exporters/` has them.
    own: Files,
    /// Files of others that it needs too.
    shared: Files,
}

/// Paths below `exporters/`, with `/`, and their text.
type Files = &'static [(&'static str, &'static str)];

macro_rules! files {
    ($($path:literal,)*) => { &[$(($path, include_str!(concat!("../exporters/", $path)))),*] };
}

/// What the exporters of renderers share.
const SHARED: Files = files![
    "common/thinlens_stack/__init__.py",
    "common/thinlens_stack/closed.py",
    "common/thinlens_stack/errors.py",
    "common/thinlens_stack/exr.py",
    "common/thinlens_stack/frames.py",
    "common/thinlens_stack/lens.py",
    "common/thinlens_stack/merge.py",
    "common/thinlens_stack/shading.py",
    "common/thinlens_stack/stack.py",
];

/// All exporters.
pub const EXPORTERS: [Exporter; 4] = [
    Exporter {
        name: "blender",
        program: "Blender",
        own: files![
            "blender/LICENSE",
            "blender/__init__.py",
            "blender/blender_manifest.toml",
            "blender/camera.py",
            "blender/child.py",
            "blender/cli.py",
            "blender/cli_run.py",
            "blender/closed_objects.py",
            "blender/cryptomatte.py",
            "blender/denoise.py",
            "blender/export.py",
            "blender/export_job.py",
            "blender/journal.py",
            "blender/lens_job.py",
            "blender/live.py",
            "blender/materials.py",
            "blender/operators.py",
            "blender/outcome.py",
            "blender/overscan.py",
            "blender/panel.py",
            "blender/passes.py",
            "blender/peel_nodes.py",
            "blender/peels.py",
            "blender/post_step.py",
            "blender/preferences.py",
            "blender/present.py",
            "blender/program.py",
            "blender/properties.py",
            "blender/reflectance.py",
            "blender/registration.py",
            "blender/relens.py",
            "blender/result_image.py",
            "blender/settings.py",
            "blender/shading.py",
            "blender/shared.py",
            "blender/view_layer.py",
            "blender/volumes.py",
        ],
        shared: SHARED,
    },
    Exporter {
        name: "mitsuba",
        program: "Mitsuba 3",
        own: files![
            "mitsuba/export.py",
            "mitsuba/thinlens_mitsuba/__init__.py",
            "mitsuba/thinlens_mitsuba/camera.py",
            "mitsuba/thinlens_mitsuba/cli.py",
            "mitsuba/thinlens_mitsuba/export.py",
            "mitsuba/thinlens_mitsuba/lanes.py",
            "mitsuba/thinlens_mitsuba/peel_integrator.py",
            "mitsuba/thinlens_mitsuba/shading.py",
            "mitsuba/thinlens_mitsuba/shapes.py",
            "mitsuba/thinlens_mitsuba/walk.py",
        ],
        shared: SHARED,
    },
    Exporter {
        name: "openjd",
        program: "Open Job Description",
        own: files!["openjd/template.yaml",],
        shared: &[],
    },
    Exporter {
        name: "slurm",
        program: "SLURM",
        own: files!["slurm/render.sbatch", "slurm/submit.sh",],
        shared: &[],
    },
];

impl Exporter {
    /// Its files when written out: paths below its folder, with `/`, and their text.
    pub fn files(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let below = |&(path, text): &(&'static str, &'static str)| {
            (path.split_once('/').map_or(path, |(_, below)| below), text)
        };
        self.own.iter().chain(self.shared).map(below)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::path::{Path, PathBuf};

    /// The files below `folder`, but for what Python compiles.
    fn files_below(folder: &Path) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let of_project = entries.filter(|path| !path.ends_with("__pycache__"));
        of_project.flat_map(|path| if path.is_dir() { files_below(&path) } else { vec![path] }).collect()
    }

    #[test]
    fn the_program_has_every_file_of_the_exporters_as_it_is() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("exporters");
        let folders = EXPORTERS.map(|exporter| exporter.name).into_iter().chain(["common"]);
        let found: BTreeSet<PathBuf> = folders.flat_map(|folder| files_below(&root.join(folder))).collect();
        let embedded = EXPORTERS.iter().flat_map(|exporter| exporter.own).chain(SHARED);
        let embedded: BTreeSet<PathBuf> = embedded.map(|(path, _)| root.join(path)).collect();
        assert_eq!(embedded, found);
    }

    #[test]
    fn those_of_renderers_are_written_out_with_what_they_share_and_none_has_a_path_twice() {
        for exporter in EXPORTERS {
            let paths: Vec<&str> = exporter.files().map(|(path, _)| path).collect();
            assert_eq!(paths.iter().collect::<BTreeSet<_>>().len(), paths.len(), "{paths:?}");
            let for_renderer = ["blender", "mitsuba"].contains(&exporter.name);
            assert_eq!(paths.contains(&"thinlens_stack/exr.py"), for_renderer, "{paths:?}");
            assert!(paths.iter().all(|path| !path.starts_with(&format!("{}/", exporter.name))), "{paths:?}");
        }
    }
}
