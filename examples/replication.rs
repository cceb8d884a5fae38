//! Claims of the papers about their methods, and the results of this implementation, as Markdown.
//!
//! `cargo run --release --example replication -- samples`
//!
//! A scene is a folder with a `stack.exr`, a `preset.toml` and a `reference.exr` rendered with the lens on. Pictures are
//! compared as a whole, sRGB-encoded and clipped; times are CPU seconds of the blur, the smallest of three runs. A claim holds on a
//! scene if the difference has the sign that the paper states.

#![expect(clippy::print_stdout, reason = "the table is the result")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::metrics::score;
use thinlens::render::{Job, NamedPreset, prepare};
use thinlens::settings::{Effort, ParameterValues, Preset, Values};
use thinlens::stack::{Source, read_picture};

/// Runs of a setting. The fastest counts, since other load can only slow a run down.
const RUNS: usize = 3;

/// A method with some of its parameters set.
struct Setting {
    name: &'static str,
    method: &'static str,
    views: Option<usize>,
    change: fn(&mut ParameterValues),
}

const SETTINGS: [Setting; 14] = [
    setting("cascaded", "recursive-gaussian", None, |_| {}),
    setting("not cascaded", "recursive-gaussian", None, |p| p.set("recursive-gaussian", "cascaded", false)),
    setting("peel rays", "peel-rays", Some(32), |_| {}),
    setting("splat", "point-splat", None, |_| {}),
    setting("splat without H", "point-splat", None, |p| p.set("point-splat", "hidden", false)),
    setting("splat in full", "point-splat", None, |p| p.set("point-splat", "accelerated", false)),
    setting("gather", "gather", None, |_| {}),
    setting("multilayer", "pyramid-disocclusion", None, |_| {}),
    setting("opaque blur", "opaque-blur", None, |_| {}),
    setting("layer rays", "layer-rays", Some(32), |_| {}),
    setting("plain", "layer-rays", Some(32), plain_rays),
    setting("with cones", "layer-rays", Some(32), |p| p.set("layer-rays", "jitter", false)),
    setting("with jitter", "layer-rays", Some(32), |p| p.set("layer-rays", "cones", false)),
    setting("plain, 1024", "layer-rays", Some(1024), plain_rays),
];

const fn setting(
    name: &'static str,
    method: &'static str,
    views: Option<usize>,
    change: fn(&mut ParameterValues),
) -> Setting {
    Setting { name, method, views, change }
}

fn plain_rays(parameters: &mut ParameterValues) {
    parameters.set("layer-rays", "cones", false);
    parameters.set("layer-rays", "jitter", false);
}

/// A picture and what it cost.
struct Run {
    image: Image,
    cpu_seconds: f64,
}

/// The measurements of one scene.
struct Scene {
    name: String,
    reference: Image,
    runs: BTreeMap<&'static str, Run>,
}

/// A claim of a paper, and how it is tested.
struct Claim {
    paper: &'static str,
    says: &'static str,
    figure: &'static str,
    unit: &'static str,
    /// The figure measured on a scene. The claim holds if it is over 0, or over 1 for "times".
    find: fn(&Scene) -> Result<f64, Error>,
}

const CLAIMS: [Claim; 13] = [
    Claim {
        paper: "Schedl & Wimmer 2012, table 1",
        says: "the cascade is quicker than a blur of its own for each layer",
        figure: "1.7–1.9 (blur alone)",
        unit: "times",
        find: |s| Ok(s.seconds("not cascaded") / s.seconds("cascaded")),
    },
    Claim {
        paper: "Schedl & Wimmer 2012, section 5",
        says: "the cascade alters the picture slightly: PSNR between the two over 30 dB",
        figure: "\"slightly\"",
        unit: "dB over 30",
        find: |s| Ok(s.apart("cascaded", "not cascaded")? - 30.0),
    },
    Claim {
        paper: "Schedl & Wimmer 2012, table 1",
        says: "it is quicker than ray traversal of the peels at 32 rays",
        figure: "2.5–2.6 (blur alone)",
        unit: "times",
        find: |s| Ok(s.seconds("peel rays") / s.seconds("cascaded")),
    },
    Claim {
        paper: "Lee, Kim & Choi 2008, section 6",
        says: "the hidden image H makes the picture better",
        figure: "+3.49",
        unit: "dB",
        find: |s| Ok(s.db("splat")? - s.db("splat without H")?),
    },
    Claim {
        paper: "Lee, Kim & Choi 2008, section 6",
        says: "splatting without H is better than gathering",
        figure: "+3.44",
        unit: "dB",
        find: |s| Ok(s.db("splat without H")? - s.db("gather")?),
    },
    Claim {
        paper: "Lee, Kim & Choi 2008, table 1",
        says: "a reduced resolution away from edges and focus is quicker",
        figure: "4–31",
        unit: "times",
        find: |s| Ok(s.seconds("splat in full") / s.seconds("splat")),
    },
    Claim {
        paper: "Lee, Eisemann & Seidel 2009, figure 8",
        says: "layer rays have a higher PSNR than multilayer blurring",
        figure: "+8.56",
        unit: "dB",
        find: |s| Ok(s.db("layer rays")? - s.db("multilayer")?),
    },
    Claim {
        paper: "Lee, Eisemann & Seidel 2009, figure 8",
        says: "and than gathering",
        figure: "+11.31",
        unit: "dB",
        find: |s| Ok(s.db("layer rays")? - s.db("gather")?),
    },
    Claim {
        paper: "Lee, Eisemann & Seidel 2009, figure 8",
        says: "and a higher SSIM than both",
        figure: "+0.06, +0.09",
        unit: "SSIM",
        find: |s| Ok(s.ssim("layer rays")? - s.ssim("multilayer")?.max(s.ssim("gather")?)),
    },
    Claim {
        paper: "Lee, Eisemann & Seidel 2009, figure 6",
        says: "cones bring 32 rays nearer to what many rays give",
        figure: "seen, not measured",
        unit: "dB",
        find: |s| Ok(s.apart("with cones", "plain, 1024")? - s.apart("plain", "plain, 1024")?),
    },
    Claim {
        paper: "Lee, Eisemann & Seidel 2009, figure 7",
        says: "and so does jitter",
        figure: "seen, not measured",
        unit: "dB",
        find: |s| Ok(s.apart("with jitter", "plain, 1024")? - s.apart("plain", "plain, 1024")?),
    },
    Claim {
        paper: "Kraus 2011, section 5",
        says: "the opaque blur is quicker than disocclusion",
        figure: "1.9",
        unit: "times",
        find: |s| Ok(s.seconds("multilayer") / s.seconds("opaque blur")),
    },
    Claim {
        paper: "Kraus 2011, sections 5 and 6",
        says: "and disocclusion gives the better picture: the opaque blur's silhouettes are too opaque",
        figure: "seen, not measured",
        unit: "dB",
        find: |s| Ok(s.db("multilayer")? - s.db("opaque blur")?),
    },
];

impl Scene {
    fn seconds(&self, setting: &str) -> f64 {
        self.runs[setting].cpu_seconds
    }

    /// PSNR against the reference.
    fn db(&self, setting: &str) -> Result<f64, Error> {
        Ok(score(&self.runs[setting].image, &self.reference, 0)?.psnr_db)
    }

    fn ssim(&self, setting: &str) -> Result<f64, Error> {
        Ok(score(&self.runs[setting].image, &self.reference, 0)?.ssim.unwrap_or(f64::NAN))
    }

    /// PSNR between two settings.
    fn apart(&self, one: &str, other: &str) -> Result<f64, Error> {
        Ok(score(&self.runs[one].image, &self.runs[other].image, 0)?.psnr_db)
    }
}

fn main() -> Result<(), Error> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "samples".to_owned()));
    let scenes = folders(&folder).iter().map(|path| measure(path)).collect::<Result<Vec<_>, _>>()?;
    let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
    println!("| paper | claim | its figure | found: {} | held on |", names.join(", "));
    println!("| --- | --- | --- | --- | --- |");
    for claim in CLAIMS {
        let Claim { paper, says, figure, unit, find } = claim;
        let found = scenes.iter().map(find).collect::<Result<Vec<f64>, _>>()?;
        let limit = if unit == "times" { 1.0 } else { 0.0 };
        let held = found.iter().filter(|&&figure| figure > limit).count();
        let digits = if unit == "SSIM" { 3 } else { 2 };
        let shown = |figure: &f64| {
            if unit == "times" { format!("{figure:.2}") } else { format!("{figure:+.digits$}") }
        };
        let shown: Vec<String> = found.iter().map(shown).collect();
        println!("| {paper} | {says} | {figure} | {} {unit} | {held} of {} |", shown.join(", "), found.len());
    }
    Ok(())
}

/// The scenes in `folder` that have a stack, sorted by name.
fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_scene = |path: &PathBuf| path.join("reference.exr").is_file() && path.join("stack.exr").is_file();
    let mut scenes: Vec<PathBuf> = entries.filter(is_scene).collect();
    scenes.sort();
    scenes
}

/// Runs every setting on a scene.
fn measure(folder: &Path) -> Result<Scene, Error> {
    let mut runs = BTreeMap::new();
    for setting in &SETTINGS {
        let mut best = run(folder, setting)?;
        for _ in 1..if setting.views == Some(1024) { 1 } else { RUNS } {
            let cpu_seconds = run(folder, setting)?.cpu_seconds;
            best.cpu_seconds = best.cpu_seconds.min(cpu_seconds);
        }
        runs.insert(setting.name, best);
    }
    Ok(Scene {
        name: folder.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        reference: read_picture(&folder.join("reference.exr"))?,
        runs,
    })
}

fn run(folder: &Path, setting: &Setting) -> Result<Run, Error> {
    let name = folder.join("preset.toml").display().to_string();
    let mut preset = Preset::load(&name)?;
    (setting.change)(&mut preset.parameters);
    let job = Job {
        sources: vec![Source::File(folder.join("stack.exr"))],
        preset: Some(NamedPreset { name, preset }),
        flags: Values {
            method: Some(setting.method.to_owned()),
            effort: setting.views.map(Effort::Views),
            ..Values::default()
        },
        ..Job::default()
    };
    let rendered = prepare(&job)?.blur(&|_| {})?;
    Ok(Run { cpu_seconds: rendered.clock.cpu_seconds().blur, image: rendered.image })
}
