//! `thinlens render`.

use super::args::{DEFAULT_PROBES, JobArgs};
use super::checks;
use super::console::{Console, print_json};
use super::drivers::prepare;
use super::failure::{Failure, usage_error};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::finding::Finding;
use thinlens::image::{Image, Plane};
use thinlens::methods::Registry;
use thinlens::output::exr::{Codec, ExrOptions};
use thinlens::output::report::{Confidence, Report};
use thinlens::output::{exr, png, report};
use thinlens::probes::MIN_PROBES;
use thinlens::render::{Job, Rendered};
use thinlens::stack::{Carried, Carry, Precision};
use thinlens::usage::Stage;

const EXAMPLES: &str = "\
Examples:
  thinlens render stack.exr -o out.exr --focal-length 85 --f-number 1.4 --focus 6
  thinlens render beauty.exr --depth-file depth.exr -o out.png --preset portrait --focus-at 960,540
  thinlens render peel0.exr peel1.exr peel2.exr -o out.exr --preset my-lens.toml --report out.json";

/// Render a stack with depth of field
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RenderArgs {
    #[command(flatten)]
    job: JobArgs,
    #[command(flatten)]
    output: OutputArgs,
    /// Measure the sampling error at this many pixels
    ///
    /// Compares the picture, at randomly chosen pixels, with the mean of very many lens rays through the stack, and reports the
    /// estimated PSNR of the whole picture with its 95 % interval. Errors of the stack itself, such as missing surfaces, are not
    /// included.
    #[arg(
        long,
        value_name = "PIXELS",
        num_args = 0..=1,
        default_missing_value = DEFAULT_PROBES,
        value_parser = clap::value_parser!(u32).range(MIN_PROBES as i64..),
        help_heading = "Output"
    )]
    verify: Option<u32>,
}

/// The output files.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
struct OutputArgs {
    /// The picture: .exr, .png, or - for an EXR on stdout
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Also write a PNG for viewing
    #[arg(long, value_name = "FILE.png")]
    preview: Option<PathBuf>,
    /// Exposure of the PNGs in stops
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    exposure: Option<f32>,
    /// Also write a confidence mask, 0 … 1
    ///
    /// The mask is the share of each pixel's light that comes from surfaces in the stack, and not from estimated surfaces or from
    /// lens rays that hit nothing. Takes about as long as the blur. Only for methods that sample the lens with rays.
    #[arg(long, value_name = "FILE.png|exr")]
    confidence: Option<PathBuf>,
    /// Also write a report of the render
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Numeric type of the EXR; default: that of the input
    #[arg(long, value_name = "TYPE")]
    precision: Option<PrecisionArg>,
    /// Compression of the EXR; default: zip
    #[arg(long, value_name = "CODEC", value_parser = codecs())]
    codec: Option<Codec>,
    /// Input channels copied to the EXR; default: unused
    #[arg(long, value_name = "CHANNELS")]
    carry: Option<CarryArg>,
    /// Print the report on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PrecisionArg {
    /// 16-bit floating point
    Half,
    /// 32-bit floating point
    Float,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum CarryArg {
    /// Channels that no peel uses
    Unused,
    /// All channels, those of the peels included
    All,
    /// No channels
    None,
}

/// The format and destination of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Exr,
    Png,
    Stdout,
}

pub(super) fn run(args: &RenderArgs, console: &Console, methods: &Registry) -> Result<(), Failure> {
    let target = args.output.check(args.job.files().iter())?;
    let verify = args.verify.map(|pixels| pixels as usize);
    let confidence = args.output.confidence.is_some();
    let methods = methods.clone();
    let job = Job { verify, confidence, methods, ..args.job.job(args.output.carry())? };

    let prepared = prepare(&job)?;
    console.findings(&prepared.stack.findings);
    console.plan(&prepared.plan);
    console.device(&prepared.device);
    let printed = prepared.stack.findings.len();
    let bar = console.progress("blurring");
    let mut rendered = prepared.blur(&|share| bar.set(share))?;
    drop(bar);
    console.findings(&rendered.stack.findings[printed..]);
    if let Some(estimate) = &rendered.probe {
        console.estimate(estimate);
    }

    rendered.clock.skip();
    let findings = args.output.write(target, &rendered)?;
    rendered.clock.lap(Stage::Write);
    console.findings(&findings);
    rendered.stack.findings.extend(findings);
    args.output.report(&args.job, &rendered)?;
    for file in args.output.files(target) {
        console.wrote(file);
    }
    Ok(())
}

impl OutputArgs {
    /// Checks every output file before any work starts.
    fn check<'a>(&self, inputs: impl Iterator<Item = &'a PathBuf> + Clone) -> Result<Target, Failure> {
        let target = target(&self.output)?;
        let mask = self.confidence.as_deref().map(mask_target).transpose()?;
        self.check_unused_flags(target, mask)?;
        if target == Target::Stdout {
            self.check_stdout()?;
        }
        let mut seen: Vec<&PathBuf> = Vec::new();
        for path in self.files(target) {
            if seen.contains(&path) {
                let message = format!("two outputs have the same file name: {}", path.display());
                return Err(usage_error("render", clap::error::ErrorKind::ArgumentConflict, &message));
            }
            seen.push(path);
            checks::output(path, inputs.clone())?;
        }
        Ok(target)
    }

    /// Refuses flags without effect, so that a mistake is noticed.
    fn check_unused_flags(&self, target: Target, mask: Option<Target>) -> Result<(), Failure> {
        let picture_is_exr = target != Target::Png;
        let writes_exr = picture_is_exr || mask == Some(Target::Exr);
        let writes_png = target == Target::Png || self.preview.is_some();
        let flags = [
            ("--exposure", self.exposure.is_some(), writes_png, "PNG"),
            ("--precision", self.precision.is_some(), writes_exr, "EXR"),
            ("--codec", self.codec.is_some(), writes_exr, "EXR"),
            ("--carry", self.carry.is_some(), picture_is_exr, "EXR"),
        ];
        match flags.into_iter().find(|(_, is_set, is_used, _)| *is_set && !is_used) {
            None => Ok(()),
            Some((flag, _, _, format)) => {
                let message = format!("{flag} has no effect: no {format} is written");
                Err(usage_error("render", clap::error::ErrorKind::ArgumentConflict, &message))
            }
        }
    }

    fn check_stdout(&self) -> Result<(), Failure> {
        if self.json {
            let message = "--json and -o - would both write to standard output; use --report FILE.json";
            return Err(usage_error("render", clap::error::ErrorKind::ArgumentConflict, message));
        }
        if io::stdout().is_terminal() {
            return Err(Error::settings("an EXR cannot be written to a terminal")
                .help("redirect standard output, or name a file with --output")
                .into());
        }
        Ok(())
    }

    fn carry(&self) -> Carry {
        match self.carry {
            None | Some(CarryArg::Unused) => Carry::Unused,
            Some(CarryArg::All) => Carry::All,
            Some(CarryArg::None) => Carry::None,
        }
    }

    /// Every file that is written.
    fn files(&self, target: Target) -> impl Iterator<Item = &PathBuf> {
        let picture = (target != Target::Stdout).then_some(&self.output);
        picture.into_iter().chain(&self.preview).chain(&self.confidence).chain(&self.report)
    }

    /// Writes the pictures; returns findings about what could not be written.
    fn write(&self, target: Target, rendered: &Rendered) -> Result<Vec<Finding>, Error> {
        let Rendered { image, frame, stack, .. } = rendered;
        let precision = match self.precision {
            None => stack.precision,
            Some(PrecisionArg::Half) => Precision::Half,
            Some(PrecisionArg::Float) => Precision::Float,
        };
        let options = ExrOptions { precision, codec: self.codec.unwrap_or_default() };
        let exposure = self.exposure.unwrap_or(0.0);
        let mut findings = Vec::new();
        match target {
            Target::Exr | Target::Stdout => {
                findings = exr::write(&self.output, image, frame, &stack.carried, &options)?;
            }
            Target::Png => png::write(&self.output, image, exposure)?,
        }
        if let Some(preview) = &self.preview {
            png::write(preview, image, exposure)?;
        }
        if let Some((path, known)) = self.mask(rendered) {
            match mask_target(path)? {
                Target::Png => png::write_mask(path, known)?,
                Target::Exr | Target::Stdout => {
                    // The same in every channel, so that any of them can be used as the mask.
                    let mask = Image { planes: std::array::from_fn(|_| known.clone()) };
                    exr::write(path, &mask, frame, &Carried::default(), &options)?;
                }
            }
        }
        Ok(findings)
    }

    /// The confidence mask and its file, if requested.
    fn mask<'a>(&'a self, rendered: &'a Rendered) -> Option<(&'a Path, &'a Plane)> {
        self.confidence.as_deref().zip(rendered.confidence.as_ref())
    }

    /// Writes and prints the report, if requested.
    fn report(&self, job: &JobArgs, rendered: &Rendered) -> Result<(), Failure> {
        let inputs = job.input.files().map(|input| input.display().to_string()).collect();
        let report = rendered.report(inputs, self.output.display().to_string());
        let confidence = self.mask(rendered).map(|(path, known)| Confidence::new(path, known));
        let content = Report { confidence, ..report };
        if let Some(path) = &self.report {
            report::write_json(path, &content)?;
        }
        if self.json {
            print_json(&content)?;
        }
        Ok(())
    }
}

fn codecs() -> impl TypedValueParser<Value = Codec> {
    PossibleValuesParser::new(Codec::ALL.map(Codec::name)).try_map(|name| name.parse::<Codec>())
}

/// The format and destination of `output`, from its extension.
fn target(output: &Path) -> Result<Target, Error> {
    let extension = output.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        _ if output == Path::new("-") => Ok(Target::Stdout),
        Some("exr") => Ok(Target::Exr),
        Some("png") => Ok(Target::Png),
        // The checks that follow have a better error for a folder.
        _ if output.is_dir() => Ok(Target::Exr),
        _ => Err(Error::settings("the output's file extension is not supported")
            .in_file(output)
            .with("expected", ".exr, .png")
            .help("name the output out.exr or out.png, or - for an EXR on standard output")),
    }
}

/// The format of a mask's file.
fn mask_target(path: &Path) -> Result<Target, Error> {
    if path != Path::new("-") {
        return target(path);
    }
    Err(Error::settings("the confidence mask cannot be written to standard output")
        .help("name a file: --confidence known.png"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_decides_the_format() {
        let target = |name| target(Path::new(name)).ok();
        assert_eq!(target("a/out.exr"), Some(Target::Exr));
        assert_eq!(target("out.PNG"), Some(Target::Png));
        assert_eq!(target("-"), Some(Target::Stdout));
        assert_eq!(target("out.jpg"), None);
        assert_eq!(target("out"), None);
    }
}
