//! `thinlens export`.

use super::console::{Console, print};
use super::failure::Failure;
use clap::Args;
use clap::builder::PossibleValuesParser;
use std::io::Write;
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::exporters::{EXPORTERS, Exporter};
use thinlens::output::atomic;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const EXAMPLES: &str = "\
Examples:
  thinlens export blender -o exporters
  thinlens export mitsuba -o exporters

Between them, the renderer makes the stack:
  blender -b shot.blend -P exporters/blender/cli.py -- -o stack.exr
  python exporters/mitsuba/export.py scene.xml -o stack.exr

A shot on a farm; docs/farms.md has the parameters:
  thinlens export slurm -o farm
  bash farm/slurm/submit.sh --input 'shots/shot.####.exr' --output 'out/shot.####.exr' --frames 1-100";

/// The archive that Blender installs as an extension.
const EXTENSION: &str = "thinlens-blender.zip";

/// Write what a renderer or a render farm needs
///
/// For a renderer, writes the folder DIR/blender or DIR/mitsuba with an exporter of stacks, and for Blender also DIR/thinlens-blender.zip,
/// which Blender installs as an extension: Preferences, Get Extensions, Install from Disk. For a farm, writes DIR/openjd or DIR/slurm with the
/// templates of a job that renders a sequence in chunks of frames. Files that are there already are left as they are; if one differs,
/// nothing is written.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ExportArgs {
    /// The renderer or farm
    #[arg(value_name = "PROGRAM", value_parser = PossibleValuesParser::new(EXPORTERS.map(|exporter| exporter.name)))]
    program: String,
    /// Output folder; created if it does not exist
    #[arg(long, short, value_name = "DIR", help_heading = "Output")]
    output: PathBuf,
}

pub(super) fn run(args: &ExportArgs, console: &Console) -> Result<(), Failure> {
    for exporter in EXPORTERS.iter().filter(|exporter| exporter.name == args.program) {
        let mut files = exporter_files(exporter, &args.output);
        if exporter.name == "blender" {
            files.push((args.output.join(EXTENSION), extension(exporter)?));
        }
        let new = new_files(files)?;
        for (path, bytes) in &new {
            write(path, bytes)?;
        }
        print(&format!("{}\n", args.output.join(exporter.name).display()))?;
        console.note(format_args!("wrote {} files for {}", new.len(), exporter.program));
    }
    Ok(())
}

impl ExportArgs {
    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        let exporters = EXPORTERS.iter().filter(|exporter| exporter.name == self.program);
        let files = exporters.flat_map(|exporter| exporter_files(exporter, &self.output));
        let below = files.filter_map(|(file, _)| file.parent().map(Path::to_owned));
        std::iter::once(self.output.clone()).chain(below).collect()
    }
}

/// The files of `exporter` below `folder`, with their bytes.
fn exporter_files(exporter: &Exporter, folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let path = |below: &str| below.split('/').fold(folder.join(exporter.name), |path, part| path.join(part));
    exporter.files().map(|(below, text)| (path(below), text.as_bytes().to_vec())).collect()
}

/// Those of `files` that do not exist.
///
/// # Errors
/// A file that exists and differs: it may hold somebody's changes.
fn new_files(files: Vec<(PathBuf, Vec<u8>)>) -> Result<Vec<(PathBuf, Vec<u8>)>, Error> {
    let differs = |(path, bytes): &&(PathBuf, Vec<u8>)| {
        path.exists() && std::fs::read(path).ok().as_ref() != Some(bytes)
    };
    if let Some((path, _)) = files.iter().find(differs) {
        return Err(Error::settings("a file of the exporter is there already, and is another")
            .in_file(path)
            .with("expected", "no file, or that of this version".to_owned())
            .help("choose a new folder with --output, or remove the old exporter"));
    }
    Ok(files.into_iter().filter(|(path, _)| !path.exists()).collect())
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    if let Some(folder) = path.parent() {
        atomic::create_folder(folder)?;
    }
    atomic::write(path, |target| target.write_all(bytes).map_err(|cause| atomic::failed(path, cause)))
}

/// The files of `exporter` as an archive, the same bytes at any time.
fn extension(exporter: &Exporter) -> Result<Vec<u8>, Error> {
    let failed = |cause| Error::output("the extension cannot be packed").caused_by(cause);
    let mut archive = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (path, text) in exporter.files() {
        archive.start_file(path, SimpleFileOptions::default()).map_err(failed)?;
        archive.write_all(text.as_bytes()).map_err(|cause| failed(cause.into()))?;
    }
    archive.finish().map(std::io::Cursor::into_inner).map_err(failed)
}
