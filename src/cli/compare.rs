//! `thinlens compare`.

use super::args::{DEFAULT_PROBES, EffectArgs, InputArgs, LensArgs, read_input, stack_job};
use super::checks;
use super::console::{Console, print, print_json};
use super::drivers::prepare;
use super::failure::Failure;
use clap::Args;
use std::path::{Path, PathBuf};
use thinlens::compare::{Candidate, Comparison, Gallery, Results, folder, shell, table};
use thinlens::error::Error;
use thinlens::image::Image;
use thinlens::methods::Registry;
use thinlens::metrics::check_size;
use thinlens::output::png;
use thinlens::probes::{MIN_PROBES, ProbeSet};
use thinlens::render::{Job, Prepared};
use thinlens::stack::Carry;

const EXAMPLES: &str = "\
Examples:
  thinlens compare stack.exr --preset portrait --focus 6
  thinlens compare stack.exr --preset my-lens.toml --methods shear:16,shear:64,gather -o comparison
  thinlens compare stack.exr --preset my-lens.toml --reference lens.exr -o comparison";

/// Compare methods by time and error
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct CompareArgs {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    lens: LensArgs,
    #[command(flatten)]
    effects: EffectArgs,
    /// NAME, NAME:VIEWS or NAME:KEY=VALUE each; default: all
    ///
    /// A name alone is the method with its own settings; several settings are joined by +. "all" runs every method at its quality
    /// levels from coarse to fine, except the reference method accumulate, which the sampling error is measured against; name it to
    /// measure it too. The sampling error compares with the stack alone: surfaces that a method estimates behind a stack of one or
    /// two peels count as error.
    #[arg(long, value_name = "A,B:64,C:KEY=VALUE,…", value_delimiter = ',', help_heading = "Method")]
    methods: Vec<String>,
    /// Runs of each candidate; its time is the median
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = "Method",
          value_parser = clap::value_parser!(u16).range(1..))]
    repeats: u16,
    /// Pixels at which the sampling error is measured
    #[arg(long, value_name = "PIXELS", default_value = DEFAULT_PROBES, help_heading = "Method",
          value_parser = clap::value_parser!(u32).range(MIN_PROBES as i64..))]
    probes: u32,
    /// Render with the lens on, for the model error
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    reference: Option<PathBuf>,
    /// Folder for report.html, pictures, maps, JSON and CSV
    #[arg(long, short, value_name = "FOLDER", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
}

pub(super) fn run(args: &CompareArgs, console: &Console, methods: &Registry) -> Result<(), Failure> {
    let candidates = args.candidates(methods)?;
    if let Some(folder) = &args.output {
        args.check_files(folder, &candidates)?;
    }
    let job = stack_job(&args.input, &args.lens, &args.effects, Carry::None)?;
    let reference = args.reference.as_deref().map(|path| read_input(path, args.input.memory)).transpose()?;
    let prepared = prepare(&Job { methods: methods.clone(), ..job }.held()?)?;
    console.findings(&prepared.stack.findings);
    let frame = prepared.stack.picture_frame();
    let (part, reference) = match reference {
        Some(reference) => {
            if let Some(file) = &args.reference {
                console.replaced(file, reference.replaced);
            }
            let reference = reference.picture;
            let parts = frame.shared_with(&reference.frame)?;
            console.compared(parts, [&frame, &reference.frame]);
            (parts[0], Some(reference.part(parts[1])))
        }
        None => {
            let parts = frame.shared_with(&frame)?;
            console.compared(parts, [&frame; 2]);
            (parts[0], None)
        }
    };
    if let Some(reference) = &reference {
        check_size((part.width, part.height), reference)?;
    }
    let calibration = console.calibration(false)?;
    let Prepared { scene, plan, .. } = &prepared;
    let probes = ProbeSet::new(scene, plan, args.probes as usize);
    let comparison = Comparison {
        prepared: &prepared,
        part,
        reference: reference.as_ref(),
        repeats: usize::from(args.repeats),
        probes: &probes,
        calibration: Some(&calibration),
        words: &[args.input.words(), args.lens.words(), args.effects.words()].concat(),
    };
    // Before the first candidate runs, so that an effect that one of them cannot switch does not end the comparison halfway.
    candidates.iter().try_for_each(|candidate| comparison.plan(candidate).map(drop))?;
    let results = args.compare(&comparison, &candidates, console)?;
    if args.json {
        print_json(&results)?;
    } else {
        print(&table(&results))?;
    }
    Ok(())
}

impl CompareArgs {
    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        self.output.iter().cloned().collect()
    }

    /// The candidates to compare.
    fn candidates(&self, methods: &Registry) -> Result<Vec<Candidate>, Error> {
        match self.methods.as_slice() {
            [] => Candidate::all(methods),
            [all_of_them] if all_of_them == "all" => Candidate::all(methods),
            named => named.iter().map(|text| Candidate::parse(text, methods)).collect(),
        }
    }

    /// Checks every file that will be written; creates the folder if it does not exist.
    fn check_files(&self, folder: &Path, candidates: &[Candidate]) -> Result<(), Error> {
        checks::folder(folder)?;
        let pictures = candidates.iter().flat_map(folder::files);
        let files = pictures.chain(folder::FILES.map(str::to_owned));
        for file in files {
            checks::output(&folder.join(file), self.input.files().chain(&self.reference))?;
        }
        Ok(())
    }

    /// Runs every candidate, and writes the folder if one is requested.
    fn compare(
        &self,
        comparison: &Comparison<'_>,
        candidates: &[Candidate],
        console: &Console,
    ) -> Result<Results, Error> {
        let path = |path: &PathBuf| path.display().to_string();
        let mut results = comparison.results(
            command_line(),
            self.input.files().map(path).collect(),
            self.reference.as_ref().map(path),
        );
        let scene = &comparison.prepared.scene;
        let pinhole = comparison.compared(scene.pinhole().trimmed(scene.outside_px));
        let mut gallery = Gallery::new(&pinhole, comparison.reference);
        for (i, candidate) in candidates.iter().enumerate() {
            console.note(format_args!("{candidate} ({} of {})", i + 1, candidates.len()));
            let (mut entry, image) = comparison.run(candidate)?;
            if let Some(folder) = &self.output {
                let [picture, map] = write_picture(folder, candidate, &image)?;
                (entry.picture, entry.map) = (Some(picture), Some(map));
                gallery.add(&image);
            }
            results.entries.push(entry);
        }
        results.mark_front();
        if let Some(folder) = &self.output {
            folder::write(folder, &mut results, &gallery)?;
            console.wrote(&folder.join(folder::REPORT));
        }
        Ok(results)
    }
}

/// Writes the picture of `candidate` into `folder`; returns the file names of picture and error map.
fn write_picture(folder: &Path, candidate: &Candidate, image: &Image) -> Result<[String; 2], Error> {
    let files = folder::files(candidate);
    png::write(&folder.join(&files[0]), image, 0.0)?;
    Ok(files)
}

/// This process's command line, quoted for a shell.
fn command_line() -> String {
    let words = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
    shell::line(std::iter::once("thinlens".to_owned()).chain(words))
}
