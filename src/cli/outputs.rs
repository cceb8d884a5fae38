//! The output files of a render: their flags, the checks before any work starts, and writing them.

use super::checks;
use super::console::print_json;
use super::failure::{Failure, usage_error};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::finding::Finding;
use thinlens::image::{Image, Plane};
use thinlens::output::Encoding;
use thinlens::output::displayed::Displayed;
use thinlens::output::exr::Codec;
use thinlens::output::report::{Confidence, Report};
use thinlens::output::{atomic, exr, png, report};
use thinlens::render::{Job, Rendered};
use thinlens::sequence::Pattern;
use thinlens::stack::{Carried, Carry, Frame, Precision};
use thinlens::usage::Stage;

/// The output files.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Output")]
pub(super) struct OutputArgs {
    /// The picture: .exr, .png, or - for an EXR on stdout
    #[arg(long, short, value_name = "FILE")]
    pub(super) output: PathBuf,
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
    /// Also write a report; without a pattern, of the whole shot
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
    ///
    /// Of a sequence, it is a line of JSON for each frame, and one for the shot at the end.
    #[arg(long)]
    pub(super) json: bool,
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

impl OutputArgs {
    /// Whether the names of output files differ from frame to frame.
    ///
    /// # Errors
    /// A pattern that cannot be read.
    pub(super) fn varies(&self) -> Result<bool, Error> {
        Ok(Pattern::parse(&self.output)?.is_some())
    }

    /// These files of frame `number`. A report whose name does not vary is that of the shot, and not of a frame.
    ///
    /// # Errors
    /// A pattern that cannot be read.
    pub(super) fn at(&self, number: i64) -> Result<Self, Error> {
        let named =
            |path: &Option<PathBuf>| path.as_ref().map(|path| Pattern::file_at(path, number)).transpose();
        let report = named(&self.report)?.filter(|report| Some(report) != self.report.as_ref());
        Ok(Self {
            output: Pattern::file_at(&self.output, number)?,
            preview: named(&self.preview)?,
            confidence: named(&self.confidence)?,
            report,
            json: false,
            ..self.clone()
        })
    }

    /// These files with the name of `view` where they have a place for it.
    pub(super) fn naming_view(&self, view: &str) -> Self {
        let placed = |path: &PathBuf| with_placeholders(path, view).unwrap_or_else(|| path.clone());
        let named = |path: &Option<PathBuf>| path.as_ref().map(placed);
        Self {
            output: placed(&self.output),
            preview: named(&self.preview),
            confidence: named(&self.confidence),
            report: named(&self.report),
            ..self.clone()
        }
    }

    /// These files for one view: its name in the place of `%V`, its first letter in that of `%v`, or its name before the extension.
    ///
    /// # Errors
    /// A picture on standard output, which has room for one view.
    pub(super) fn of_view(&self, view: &str) -> Result<Self, Error> {
        if target(&self.output)? == Target::Stdout {
            return Err(Error::settings("standard output has room for one view")
                .help("name a file, or one view with `view`"));
        }
        let named = |path: &Option<PathBuf>| path.as_ref().map(|path| with_view(path, view));
        Ok(Self {
            output: with_view(&self.output, view),
            preview: named(&self.preview),
            confidence: named(&self.confidence),
            report: named(&self.report),
            ..self.clone()
        })
    }

    /// The report of the whole shot, if one is requested: the one whose name does not vary.
    ///
    /// # Errors
    /// A pattern that cannot be read.
    pub(super) fn report_of_shot(&self) -> Result<Option<&Path>, Error> {
        let report = self.report.as_deref();
        Ok(report.filter(|report| Pattern::parse(report).is_ok_and(|pattern| pattern.is_none())))
    }

    /// Checks that no two frames of a sequence write the same file.
    ///
    /// # Errors
    /// A picture, preview or mask without a pattern in its name.
    pub(super) fn check_varies(&self) -> Result<(), Failure> {
        for file in
            [Some(&self.output), self.preview.as_ref(), self.confidence.as_ref()].into_iter().flatten()
        {
            if Pattern::parse(file)?.is_none() {
                return Err(Error::settings("all frames of the sequence would have the same file")
                    .in_file(file)
                    .with("expected", "a pattern for the frame number, such as ####")
                    .help(format!("name it {}", with_pattern(file).display()))
                    .into());
            }
        }
        self.report_of_shot()?.map_or(Ok(()), |report| Ok(atomic::check_writable(report)?))
    }

    /// Whether a confidence mask is requested.
    pub(super) fn has_mask(&self) -> bool {
        self.confidence.is_some()
    }

    /// Checks every output file of `job` before any work starts.
    ///
    /// # Errors
    /// Names that cannot be written, or exclude each other, and flags without effect.
    pub(super) fn check(&self, job: &Job) -> Result<(), Failure> {
        let target = target(&self.output)?;
        let mask = self.confidence.as_deref().map(mask_target).transpose()?;
        self.check_unused_flags(target, mask)?;
        if target == Target::Stdout {
            self.check_stdout()?;
        }
        let mut seen: Vec<&PathBuf> = Vec::new();
        for path in self.files()? {
            if seen.contains(&path) {
                let message = format!("two outputs have the same file name: {}", path.display());
                return Err(usage_error("render", clap::error::ErrorKind::ArgumentConflict, &message));
            }
            seen.push(path);
            checks::output(path, job.files())?;
        }
        Ok(())
    }

    /// Checks that no output of `job` is one of its inputs.
    ///
    /// # Errors
    /// An output that is one.
    pub(super) fn check_inputs(&self, job: &Job) -> Result<(), Error> {
        self.files()?.try_for_each(|path| checks::not_an_input(path, job.files()))
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

    /// The channels to copy.
    pub(super) fn carry(&self) -> Carry {
        match self.carry {
            None | Some(CarryArg::Unused) => Carry::Unused,
            Some(CarryArg::All) => Carry::All,
            Some(CarryArg::None) => Carry::None,
        }
    }

    /// Every file that is written.
    ///
    /// # Errors
    /// A name whose extension is not known.
    pub(super) fn files(&self) -> Result<impl Iterator<Item = &PathBuf>, Error> {
        let picture = (target(&self.output)? != Target::Stdout).then_some(&self.output);
        Ok(picture.into_iter().chain(&self.preview).chain(&self.confidence).chain(&self.report))
    }

    /// Refuses outputs that need the whole picture, for a frame that does not fit into memory.
    ///
    /// # Errors
    /// A PNG, a preview, or an EXR on standard output.
    pub(super) fn check_bands(&self) -> Result<(), Error> {
        let (what, help) = match target(&self.output)? {
            Target::Png => ("a PNG is written from the whole picture", "name the output out.exr"),
            Target::Stdout => ("standard output gets the whole picture at once", "name a file"),
            Target::Exr if self.preview.is_some() => {
                ("a preview is written from the whole picture", "leave --preview out")
            }
            Target::Exr => return Ok(()),
        };
        let help = format!("{help}, or allow more memory with --memory");
        Err(Error::limits(format!("{what}, and the frame does not fit into memory")).help(help))
    }

    /// Creates the folders of these files whose names vary with the frame, as they do in `patterns`.
    ///
    /// # Errors
    /// A folder that cannot be created.
    pub(super) fn create_folders(&self, patterns: &Self) -> Result<(), Error> {
        let of = |all: &Self| {
            let files =
                [Some(&all.output), all.preview.as_ref(), all.confidence.as_ref(), all.report.as_ref()];
            files.map(|file| file.and_then(|file| file.parent()).map(Path::to_owned))
        };
        for (folder, pattern) in of(self).into_iter().zip(of(patterns)) {
            if let (Some(folder), true) = (folder.as_ref(), folder != pattern) {
                atomic::create_folder(folder)?;
            }
        }
        Ok(())
    }

    /// The folders that temporary files are made in.
    pub(super) fn folders(&self) -> Vec<PathBuf> {
        let files =
            [Some(&self.output), self.preview.as_ref(), self.confidence.as_ref(), self.report.as_ref()];
        files.into_iter().flatten().filter_map(|file| atomic::temporary_folder(file)).collect()
    }

    /// Writes the pictures; returns findings about what could not be written. The picture comes last: where it is there, all are.
    ///
    /// # Errors
    /// Those of the files.
    pub(super) fn write(&self, rendered: &mut Rendered) -> Result<Vec<Finding>, Error> {
        rendered.clock.skip();
        let findings = self.write_pictures(rendered)?;
        rendered.clock.lap(Stage::Write);
        rendered.stack.findings.extend(findings.clone());
        Ok(findings)
    }

    /// Writes the report, if one is requested.
    ///
    /// # Errors
    /// Those of the file.
    pub(super) fn write_report(&self, job: &Job, rendered: &Rendered) -> Result<(), Error> {
        match &self.report {
            Some(path) => report::write_json(path, &self.report_of(job, rendered)),
            None => Ok(()),
        }
    }

    /// Writes the pictures; returns findings about what could not be written.
    fn write_pictures(&self, rendered: &Rendered) -> Result<Vec<Finding>, Error> {
        let Rendered { image, frame, stack, made, .. } = rendered;
        let encoding = self.encoding();
        let (options, exposure) = (encoding.exr_options(stack.precision), encoding.exposure_stops);
        let displayed = Displayed::new(frame);
        if let Some(preview) = &self.preview {
            png::write_made(preview, &displayed.image(image), exposure, made)?;
        }
        if let Some((path, known)) = self.mask(rendered) {
            match mask_target(path)? {
                Target::Png => png::write_mask(path, &displayed.plane(known))?,
                Target::Exr | Target::Stdout => {
                    // The same in every channel, so that any of them can be used as the mask.
                    let mask = Image { planes: std::array::from_fn(|_| known.clone()) };
                    exr::write(path, &mask, frame, &Carried::default(), &options)?;
                }
            }
        }
        match target(&self.output)? {
            Target::Exr | Target::Stdout => exr::write(&self.output, image, frame, &stack.carried, &options),
            Target::Png => {
                png::write_made(&self.output, &displayed.image(image), exposure, made)?;
                Ok(shown(&displayed, frame).into_iter().collect())
            }
        }
    }

    /// How the picture is stored.
    pub(super) fn encoding(&self) -> Encoding {
        Encoding {
            precision: self.precision.map(|precision| match precision {
                PrecisionArg::Half => Precision::Half,
                PrecisionArg::Float => Precision::Float,
            }),
            codec: self.codec.unwrap_or_default(),
            exposure_stops: self.exposure.unwrap_or(0.0),
        }
    }

    /// The confidence mask and its file, if requested.
    fn mask<'a>(&'a self, rendered: &'a Rendered) -> Option<(&'a Path, &'a Plane)> {
        self.confidence.as_deref().zip(rendered.confidence.as_ref())
    }

    /// Prints the report, if requested.
    ///
    /// # Errors
    /// Those of standard output.
    pub(super) fn print_report(&self, job: &Job, rendered: &Rendered) -> Result<(), Failure> {
        if self.json {
            print_json(&self.report_of(job, rendered))?;
        }
        Ok(())
    }

    fn report_of(&self, job: &Job, rendered: &Rendered) -> Report {
        let report = rendered.report(job.input_names(), self.output.display().to_string());
        let confidence = self.mask(rendered).map(|(path, known)| Confidence::new(path, known));
        Report { confidence, ..report }
    }
}

/// Says what of the picture the PNG shows, if it is not all of its pixels as they are.
fn shown(displayed: &Displayed, frame: &Frame) -> Option<Finding> {
    let (width, height) = displayed.size();
    let text = format!(
        "the PNG shows the display window in square pixels, {width}×{height}; the picture is {}, an EXR has all of it",
        frame.data
    );
    (!displayed.is_whole()).then(|| Finding::note("frame", text))
}

fn codecs() -> impl TypedValueParser<Value = Codec> {
    PossibleValuesParser::new(Codec::ALL.map(Codec::name)).try_map(|name| name.parse::<Codec>())
}

/// A name like `file` for every frame of a sequence.
fn with_pattern(file: &Path) -> PathBuf {
    match file.extension() {
        _ if file == Path::new("-") => PathBuf::from("out.####.exr"),
        _ if file.is_dir() => file.join("out.####.exr"),
        Some(extension) => file.with_extension(format!("####.{}", extension.to_string_lossy())),
        None => file.with_extension("####.exr"),
    }
}

/// The format and destination of `output`, from its extension.
fn target(output: &Path) -> Result<Target, Error> {
    let extension = output.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        _ if output == Path::new("-") => Ok(Target::Stdout),
        Some("exr") => Ok(Target::Exr),
        Some("png") => Ok(Target::Png),
        // A pipe or a device gets an EXR, as standard output does.
        _ if is_device(output) => Ok(Target::Exr),
        // The checks that follow have a better error for a folder.
        _ if output.is_dir() => Ok(Target::Exr),
        _ => Err(Error::settings("the output's file extension is not supported")
            .in_file(output)
            .with("expected", ".exr, .png")
            .help("name the output out.exr or out.png, or - for an EXR on standard output")),
    }
}

/// Whether `output` is a pipe or a device, by its name or its type.
fn is_device(output: &Path) -> bool {
    let is_special = output.metadata().is_ok_and(|metadata| !metadata.is_file() && !metadata.is_dir());
    is_special || output.starts_with("/dev/fd") || output == Path::new("/dev/stdout")
}

/// The format of a mask's file.
fn mask_target(path: &Path) -> Result<Target, Error> {
    if path != Path::new("-") {
        return target(path);
    }
    Err(Error::settings("the confidence mask cannot be written to standard output")
        .help("name a file: --confidence known.png"))
}

/// `path` with `view` in the place of `%V`, and its first letter in that of `%v`; `None` without any.
fn with_placeholders(path: &Path, view: &str) -> Option<PathBuf> {
    let name = path.file_name()?.to_string_lossy().into_owned();
    let letter: String = view.chars().take(1).collect();
    let written = name.replace("%V", view).replace("%v", &letter);
    (written != name).then(|| path.with_file_name(written))
}

/// `path` with the name of `view` in it. Names come from files: what could lead to another folder becomes `_`.
fn with_view(path: &Path, view: &str) -> PathBuf {
    let view: String =
        view.chars().map(|c| if c.is_alphanumeric() || matches!(c, '-' | '_') { c } else { '_' }).collect();
    if let Some(written) = with_placeholders(path, &view) {
        return written;
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    match (path.file_stem(), path.extension()) {
        (Some(stem), Some(extension)) => {
            let name = format!("{}.{view}.{}", stem.to_string_lossy(), extension.to_string_lossy());
            path.with_file_name(name)
        }
        _ => path.with_file_name(format!("{name}.{view}")),
    }
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

    #[test]
    fn the_name_that_is_proposed_for_frames_is_a_pattern() {
        let proposed = |name| with_pattern(Path::new(name)).display().to_string();
        assert_eq!(proposed("a/out.exr"), "a/out.####.exr");
        assert_eq!(proposed("out"), "out.####.exr");
        assert_eq!(proposed("-"), "out.####.exr");
        let folder = tempfile::tempdir().unwrap();
        assert!(with_pattern(folder.path()).ends_with("out.####.exr"));
    }
}
