//! Flags that several subcommands share, and their conversion to the library's types.

use super::flags::SettingFlags;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use thinlens::error::Error;
use thinlens::gpu::DeviceChoice;
use thinlens::memory::{memory_limit_bytes, parse_bytes};
use thinlens::render::{Job, NamedPreset};
use thinlens::settings::{Effort, Preset, Quality, Switches, Values};
use thinlens::stack::{Carry, CheckedPicture, Held, ReadOptions, Source, read_checked};

/// Default number of pixels at which the sampling error is measured.
pub(super) const DEFAULT_PROBES: &str = "400";

/// Every flag that affects the picture.
#[derive(Debug, Args)]
pub(super) struct JobArgs {
    #[command(flatten)]
    pub(super) input: InputArgs,
    #[command(flatten)]
    lens: LensArgs,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    effects: EffectArgs,
}

/// The input files and how to read them.
#[derive(Debug, Args)]
#[command(next_help_heading = "Input")]
pub(super) struct InputArgs {
    /// An EXR; a file a peel, nearest first; deep files; -: stdin
    #[arg(required = true, value_name = "INPUT")]
    pub(super) inputs: Vec<PathBuf>,
    /// File with the depth of a colour picture
    #[arg(long, value_name = "FILE")]
    pub(super) depth_file: Option<PathBuf>,
    /// Merge the files by depth: elements, not peels
    ///
    /// Each file is an element of one picture: a stack, or a picture with depth, of the objects that were rendered into it. Files with deep
    /// samples are merged without this flag.
    #[arg(long)]
    merge: bool,
    /// Name of the colour channels, if it is not recognised
    #[arg(long, value_name = "GROUP")]
    color_channel: Option<String>,
    /// Name of the depth channel, if it is not recognised
    #[arg(long, value_name = "CHANNEL")]
    depth_channel: Option<String>,
    /// View of a stereo file: left, right, or its own name
    ///
    /// `render --view all` renders each, in files of their own, with the focus of the first. In the names of outputs, %V stands for the name
    /// of the view and %v for its first letter; without either, each name gets the view before its extension: out.left.exr.
    #[arg(long, value_name = "NAME")]
    pub(super) view: Option<String>,
    /// Frame number, for a preset's keys
    ///
    /// Default: the last number of the input's file name before the extension; shot.0042.exr is frame 42, shot.-0005.exr frame -5.
    /// Versions (v003), sizes (4k, 1920x1080), dates, f-numbers and the numbers of scenes, cameras and peels are skipped. With
    /// several inputs, all file names must contain the number.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    frame: Option<i64>,
    /// Memory that the run may use; default: 3/4 of what there is
    ///
    /// 4GiB, 800MB, or a number of bytes. What there is: the memory of the machine, or less where the control group of the process or its
    /// shell (`ulimit -v`) allows less. A frame that does not fit is rendered in bands of rows, if input and output are OpenEXR and the
    /// method is shear or accumulate; otherwise it is refused, and the error says how much memory is enough. Of a sequence, as many
    /// frames are in flight as fit.
    #[arg(long, visible_alias = "max-memory", value_name = "SIZE", value_parser = parse_bytes)]
    pub(super) memory: Option<u64>,
}

/// The lens and the depth convention. Every flag overrides the preset.
#[derive(Debug, Args)]
#[command(next_help_heading = "Lens")]
pub(super) struct LensArgs {
    /// Name or TOML file of a preset (see `thinlens presets`)
    #[arg(long, value_name = "NAME|FILE")]
    preset: Option<String>,
    #[command(flatten)]
    settings: SettingFlags,
}

/// The method, its effort and the device.
#[derive(Debug, Args)]
#[command(next_help_heading = "Method")]
struct MethodArgs {
    /// Blur method (see `thinlens methods`)
    #[arg(long, value_name = "METHOD")]
    method: Option<String>,
    #[command(flatten)]
    effort: EffortArgs,
    /// Set a parameter of the method; repeatable
    ///
    /// `thinlens methods NAME` lists the parameters of a method with their ranges.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Device that computes the blur
    ///
    /// auto: a graphics card if there is one and the method has a GPU backend, else the CPU. gpu: any graphics adapter, software
    /// adapters included; an error if there is none. `thinlens devices` lists the devices, `thinlens methods` the devices of each
    /// method.
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: DeviceArg,
}

/// Effects switched on or off against the plan.
#[derive(Debug, Args)]
#[command(next_help_heading = "Method")]
pub(super) struct EffectArgs {
    /// Force an effect on, whatever the plan decides
    ///
    /// `thinlens plan` lists the effects. Several names are joined by commas, or the flag is repeated. What --force and --without
    /// do to each effect:
    ///
    /// blur: forced, the scene is blurred even if every CoC radius is at most half a pixel; without it, the output is the input.
    ///
    /// merge: cannot be switched. Supersampled stacks are always merged, other stacks never.
    ///
    /// highlight-extrapolation: forced, blurred highlights of scene-linear input are brightened too, although none of them was
    /// clipped; without it, clipped highlights of PNG, TIFF or JPEG input stay clipped and their discs are grey.
    ///
    /// highlights: forced, every blurred fragment above the threshold is drawn as an exact disc, at any cost; without it, the lens
    /// samples render it as separate dots.
    ///
    /// fill: disocclusion fill. Forced, a surface is estimated behind every stack, complete ones included; without it, rays that
    /// meet neither a surface nor the background are left out of the mean.
    ///
    /// translucency: cannot be switched. The alpha of fragments always counts.
    ///
    /// open-background: transparent background; transparent-background is another name of it. The picture is transparent where lens
    /// rays end in the background, which is behind pixels that let light through all peels. Forced, nothing changes where no pixel
    /// does; without it, such rays are left out of the mean.
    ///
    /// reflections: without it, mirrors are blurred with their surface instead of focused at what they show.
    ///
    /// environment: without it, surfaces show every lens ray the part of the environment that the centre of the lens sees.
    ///
    /// prefilter, resolve: forced, they run with their strength from the preset or --set, or with the default strength if that is 0.
    ///
    /// blade-curvature, squeeze, aperture-image, cats-eye: forced, the aperture has them even if their effect is too small to be
    /// visible; without them, in this order: the aperture's sides are straight, it is not squeezed, it has blades, it is not clipped
    /// towards the corners of the frame.
    ///
    /// spherical-aberration, axial-color: forced, rays follow them even if their effect is too small to be visible; without them, the
    /// whole aperture and all colours focus at one distance.
    ///
    /// lateral-color, vignetting: applied to the picture of every method; without them, all colours have the same magnification, and
    /// the corners are not darkened.
    ///
    /// Where nothing is blurred, no other pass runs and no highlight is extrapolated, forced or not: force blur as well.
    ///
    /// Forcing a pass that the method does not have is an error: `thinlens plan` shows which passes the method has.
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    force: Vec<String>,
    /// Leave an effect out, whatever the plan decides
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    without: Vec<String>,
}

impl EffectArgs {
    /// The switches of the library.
    pub(super) fn switches(&self) -> Switches {
        Switches { force: self.force.clone(), without: self.without.clone() }
    }

    /// The same flags as words of a command line.
    pub(super) fn words(&self) -> Vec<String> {
        let Self { force, without } = self;
        let joined = |names: &[String]| (!names.is_empty()).then(|| names.join(","));
        [flag("--force", joined(force)), flag("--without", joined(without))].concat()
    }
}

/// The number of lens samples, or its target: at most one of these flags.
#[derive(Debug, Args)]
#[group(multiple = false)]
#[command(next_help_heading = "Method")]
struct EffortArgs {
    /// Quality level; --method auto uses final
    ///
    /// A target for the sampling error, as with --target-db, and a maximum number of lens samples: draft 35 dB and 64, preview 40 dB
    /// and 128, final 45 dB and 256; reference uses the method accumulate, 55 dB and 4096. Final has no fewer than 64. For small pictures
    /// the number is the one that is expected to be enough; it is not measured.
    #[arg(long, value_name = "QUALITY", value_parser = qualities())]
    quality: Option<Quality>,
    /// Target for the sampling error: PSNR in dB
    ///
    /// The number of lens samples, 64 or more, is searched for before the picture is rendered, at a few hundred pixels, against many
    /// lens rays through the stack. The report says which error was reached, and which can be reached if the target cannot.
    #[arg(long, value_name = "DB", value_parser = parse_target_db)]
    target_db: Option<f64>,
    /// Target for the wall time of the blur in seconds
    #[arg(long = "time-budget", value_name = "SECONDS", value_parser = parse_seconds)]
    time_budget_s: Option<f64>,
    /// Lens samples per pixel
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    views: Option<u32>,
}

impl EffortArgs {
    fn effort(&self) -> Option<Effort> {
        let views = self.views.map(|views| Effort::Views(views as usize));
        let budget = self.time_budget_s.map(Effort::TimeBudget);
        let quality = self.quality.map(Effort::Quality);
        views.or(self.target_db.map(Effort::TargetDb)).or(budget).or(quality)
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum DeviceArg {
    Auto,
    Cpu,
    Gpu,
}

impl JobArgs {
    /// The job that these flags describe.
    ///
    /// # Errors
    /// A preset that cannot be read.
    pub(super) fn job(&self, carry: Carry) -> Result<Job, Error> {
        let Self { input, lens, method, effects } = self;
        let job = stack_job(input, lens, effects, carry)?;
        Ok(Job {
            flags: Values { method: method.method.clone(), effort: method.effort.effort(), ..job.flags },
            parameters: method.set.clone(),
            device: match method.device {
                DeviceArg::Auto => DeviceChoice::Auto,
                DeviceArg::Cpu => DeviceChoice::Cpu,
                DeviceArg::Gpu => DeviceChoice::Gpu,
            },
            ..job
        })
    }
}

/// The job that `input`, `lens` and `effects` describe, without a method, on the CPU.
///
/// # Errors
/// A preset that cannot be read.
pub(super) fn stack_job(
    input: &InputArgs,
    lens: &LensArgs,
    effects: &EffectArgs,
    carry: Carry,
) -> Result<Job, Error> {
    let preset = lens.preset.as_ref().map(|name| {
        let preset = Preset::load(name)?;
        Ok(NamedPreset { name: name.clone(), preset })
    });
    Ok(Job {
        sources: input.inputs.iter().cloned().map(Source::File).collect(),
        frame: input.frame,
        read_options: input.read_options(carry),
        preset: preset.transpose()?,
        flags: lens.settings.values(),
        switches: effects.switches(),
        device: DeviceChoice::Cpu,
        memory: input.memory,
        ..Job::default()
    })
}

/// The main picture at `path`, which may be `-` for standard input, or a pipe; decoded in at most `memory` bytes.
///
/// # Errors
/// Those of reading.
pub(super) fn read_input(path: &Path, memory: Option<u64>) -> Result<CheckedPicture, Error> {
    let mut held = Held::default();
    held.hold(path, memory.unwrap_or_else(memory_limit_bytes) / 2)?;
    read_checked(&held.source(path), &ReadOptions { max_bytes: memory, ..ReadOptions::default() })
}

impl JobArgs {
    /// The inputs as they were given.
    pub(super) fn inputs(&self) -> &[PathBuf] {
        &self.input.inputs
    }
}

impl InputArgs {
    fn read_options(&self, carry: Carry) -> ReadOptions {
        ReadOptions {
            color_channel: self.color_channel.clone(),
            depth_channel: self.depth_channel.clone(),
            view: self.view.clone(),
            depth_file: self.depth_file.clone(),
            merge: self.merge,
            carry,
            ..ReadOptions::default()
        }
    }

    /// The same flags as words of a command line.
    pub(super) fn words(&self) -> Vec<String> {
        let Self { inputs, depth_file, merge, color_channel, depth_channel, view, frame, memory } = self;
        let inputs = inputs.iter().map(|input| input.display().to_string());
        let flags = [
            flag("--depth-file", depth_file.as_ref().map(|file| file.display())),
            flag("--color-channel", color_channel.as_ref()),
            flag("--depth-channel", depth_channel.as_ref()),
            flag("--view", view.as_ref()),
            flag("--frame", frame.as_ref()),
            flag("--memory", memory.as_ref()),
        ];
        let merge = merge.then(|| "--merge".to_owned());
        inputs.chain(merge).chain(flags.into_iter().flatten()).collect()
    }

    /// Every file that is read.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> + Clone {
        self.inputs.iter().chain(&self.depth_file)
    }
}

impl LensArgs {
    /// The same flags as words of a command line.
    pub(super) fn words(&self) -> Vec<String> {
        let Self { preset, settings } = self;
        [flag("--preset", preset.as_ref()), settings.words()].concat()
    }
}

/// A flag and its value as words of a command line; empty for a flag without a value.
fn flag(name: &str, value: Option<impl Display>) -> Vec<String> {
    value.map(|value| vec![name.to_owned(), value.to_string()]).unwrap_or_default()
}

fn qualities() -> impl TypedValueParser<Value = Quality> {
    PossibleValuesParser::new(Quality::ALL.map(Quality::name)).map(|name| {
        let quality = Quality::ALL.into_iter().find(|quality| quality.name() == name);
        quality.expect("a quality is parsed from the names of all")
    })
}

fn parse_target_db(text: &str) -> Result<f64, String> {
    let [min, max] = Effort::TARGETS_DB;
    let number = text.parse().ok().filter(|db| (min..=max).contains(db));
    number.ok_or_else(|| format!("expected a number of decibels from {min} to {max}"))
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|seconds: &f64| *seconds > 0.0 && seconds.is_finite());
    number.ok_or_else(|| "expected a positive number of seconds".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use thinlens::settings::{CommandLine, Kind, SETTINGS, Setting, Value};

    /// The flags of input, lens and effects that most subcommands have.
    #[derive(Debug, clap::Parser)]
    struct StackAndLens {
        #[command(flatten)]
        input: InputArgs,
        #[command(flatten)]
        lens: LensArgs,
        #[command(flatten)]
        effects: EffectArgs,
    }

    /// A valid value of `setting` in the syntax of its flag.
    fn example(setting: &Setting) -> String {
        let number = |text: &&str| text.parse().is_ok_and(|x| setting.kind.allows(&Value::Number(x)));
        match setting.kind {
            Kind::Number(_) => ["-7.25", "inf", "1e-7", "1.33"].into_iter().find(number).unwrap().to_owned(),
            Kind::RedBlue(_) => "-30,45.5".to_owned(),
            Kind::Pixel => "10.5,20".to_owned(),
            Kind::Count { max, .. } | Kind::Whole(_, max) => max.to_string(),
            Kind::Word(words) => words.last().unwrap().name.replace('_', "-"),
            Kind::Name => "cow".to_owned(),
            Kind::File => "heart.png".to_owned(),
        }
    }

    #[test]
    fn flags_written_as_words_parse_back_to_the_same_flags() {
        use clap::{CommandFactory, Parser};
        let own = "x a.exr b.exr --depth-file d.exr --merge --color-channel C --depth-channel Z --view left --frame -42 --memory 4096 --preset p \
                   --force fill,resolve --without highlights";
        let words_of = |setting: &Setting| match setting.command_line {
            CommandLine::Flag { name, .. } => vec![format!("--{name}"), example(setting)],
            CommandLine::Never(_) => Vec::new(),
        };
        let (ways_to_focus, others): (Vec<_>, Vec<_>) = SETTINGS.iter().partition(|s| s.field != s.key);
        let others: Vec<String> = others.into_iter().flat_map(words_of).collect();
        let own: Vec<String> = own.split_whitespace().map(str::to_owned).collect();
        let all = StackAndLens::command();
        let all = all.get_arguments().filter(|argument| argument.get_long().is_some()).count();
        for focus in ways_to_focus.iter().map(|setting| words_of(setting)) {
            let line = [own.clone(), others.clone(), focus].concat();
            let flags = line.iter().filter(|word| word.starts_with("--")).count();
            assert_eq!(
                flags + ways_to_focus.len() - 1,
                all,
                "every flag once, and one of the focus flags: {line:?}"
            );
            let parsed = StackAndLens::parse_from(&line);
            let words = [parsed.input.words(), parsed.lens.words(), parsed.effects.words()].concat();
            let again = StackAndLens::parse_from(std::iter::once("x".to_owned()).chain(words));
            assert_eq!(format!("{again:?}"), format!("{parsed:?}"));
        }
    }
}
