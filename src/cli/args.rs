//! Flags that several subcommands share, and what they mean to the library.

use super::flags::SettingFlags;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use std::fmt::Display;
use std::path::PathBuf;
use thinlens::error::Error;
use thinlens::gpu::DeviceChoice;
use thinlens::render::{Job, NamedPreset};
use thinlens::settings::{Effort, Preset, Quality, Switches, Values};
use thinlens::stack::{Carry, ReadOptions, Source};

/// Pixels at which a sampling error is measured unless the user says how many.
pub(super) const DEFAULT_PROBES: &str = "400";

/// Everything that decides a picture.
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

/// What to read, and how.
#[derive(Debug, Args)]
#[command(next_help_heading = "Input")]
pub(super) struct InputArgs {
    /// The stack: one EXR, or one file a peel nearest first
    #[arg(required = true, value_name = "INPUT")]
    pub(super) inputs: Vec<PathBuf>,
    /// The file that holds the depth of a colour picture
    #[arg(long, value_name = "FILE")]
    pub(super) depth_file: Option<PathBuf>,
    /// Name of the colour channels, if it is not known
    #[arg(long, value_name = "GROUP")]
    color_channel: Option<String>,
    /// Name of the depth channel, if it is not known
    #[arg(long, value_name = "CHANNEL")]
    depth_channel: Option<String>,
    /// Which frame this is, for a preset's focus keys
    ///
    /// By default the last digits of the first input's name before its extension: shot.0042.exr is frame 42. Digits after a v are a
    /// version and no frame; of several inputs, all must have the number.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    frame: Option<i64>,
}

/// The lens and how depth is written; every flag outranks the preset.
#[derive(Debug, Args)]
#[command(next_help_heading = "Lens")]
pub(super) struct LensArgs {
    /// A preset's name or TOML file (see `thinlens presets`)
    #[arg(long, value_name = "NAME|FILE")]
    preset: Option<String>,
    #[command(flatten)]
    settings: SettingFlags,
}

/// How to compute.
#[derive(Debug, Args)]
#[command(next_help_heading = "Method")]
struct MethodArgs {
    /// The method (see `thinlens methods`)
    #[arg(long, value_name = "METHOD")]
    method: Option<String>,
    #[command(flatten)]
    effort: EffortArgs,
    /// A parameter of the method; may be given again
    ///
    /// `thinlens methods NAME` shows the parameters of a method, each with its range.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Where to compute
    ///
    /// auto is a graphics card where there is one and the method runs on it, and the CPU elsewhere; gpu is any graphics adapter, be
    /// it a program on the processor, or an error. `thinlens devices` lists what there is, `thinlens methods` what runs where.
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: DeviceArg,
}

/// Effects switched against the plan.
#[derive(Debug, Args)]
#[command(next_help_heading = "Method")]
pub(super) struct EffectArgs {
    /// Simulate this effect, whatever the plan says
    ///
    /// The names are those of `thinlens plan`; several are joined by commas or given one by one. What it means to force one, or to
    /// leave it out with --without:
    ///
    /// blur: forced, a scene within half a pixel of focus is blurred all the same; without it, the picture is the input.
    ///
    /// merge: a fact of the stack. Supersampled stacks are always merged, others never.
    ///
    /// highlight-extrapolation: forced, blurred highlights of a scene-linear source are made brighter too, although nothing of them was
    /// clipped; without it, those of a PNG, TIFF or JPEG stay as they were clipped, and their discs are grey.
    ///
    /// highlights: forced, every blurred fragment above their threshold is drawn as an exact disc, whatever it costs; without
    /// it, the lens samples show them as dots.
    ///
    /// fill: forced, a surface is guessed behind any stack, also a complete one; without it, rays that pass what the stack
    /// knows are left out of the mean, or stay transparent before an open background.
    ///
    /// translucency: a fact of the stack. The alpha of fragments always counts.
    ///
    /// open-background: forced, rays that find nothing make the picture transparent; without it, they are left out of the mean.
    /// Methods take it from a part of their rays or layers, each as far as it has such.
    ///
    /// prefilter, resolve: forced, they run with their own strengths, or with the defaults of those where the strength is 0.
    ///
    /// blade-curvature, squeeze, aperture-image, cats-eye: forced, the aperture has them even where they are too small to show; without
    /// them its sides are straight, it is as wide as high, it has blades, or it is whole in the corners too.
    ///
    /// spherical-aberration, axial-color: forced, rays follow them even where they are too small to show; without them all of the
    /// aperture and all colours focus in one place.
    ///
    /// lateral-color, vignetting: done to the picture of any method; without them all colours are one size, and the corners as bright as
    /// the middle.
    ///
    /// Where nothing is blurred no other step is taken, and nothing extrapolated, asked for or not: force blur as well to have it.
    ///
    /// A method without a step cannot be forced to take it: `thinlens methods NAME` shows what each has.
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    force: Vec<String>,
    /// Leave this effect out, whatever the plan says
    #[arg(long, value_name = "EFFECT", value_delimiter = ',')]
    without: Vec<String>,
}

impl EffectArgs {
    /// What they mean to the library.
    pub(super) fn switches(&self) -> Switches {
        Switches { force: self.force.clone(), without: self.without.clone() }
    }

    /// The words of a command line that say the same.
    pub(super) fn words(&self) -> Vec<String> {
        let Self { force, without } = self;
        let joined = |names: &[String]| (!names.is_empty()).then(|| names.join(","));
        [flag("--force", joined(force)), flag("--without", joined(without))].concat()
    }
}

/// What decides the number of lens samples: at most one of these.
#[derive(Debug, Args)]
#[group(multiple = false)]
#[command(next_help_heading = "Method")]
struct EffortArgs {
    /// How wrong the picture may be; auto is final
    ///
    /// A sampling error as --target-db has it, and the most lens samples that it is worth: draft 35 dB and 64, preview 40 dB and
    /// 128, final 45 dB and 256; reference is accumulate, 55 dB and 4096.
    #[arg(long, value_name = "QUALITY", value_parser = qualities())]
    quality: Option<Quality>,
    /// As many lens samples as reach this sampling error
    ///
    /// PSNR in dB against the stack's own truth, found at a few hundred pixels before the picture is painted. What was reached is
    /// reported, and where it cannot be, what could.
    #[arg(long, value_name = "DB", value_parser = parse_target_db)]
    target_db: Option<f64>,
    /// As many lens samples as the blur has time for
    #[arg(long = "time-budget", value_name = "SECONDS", value_parser = parse_seconds)]
    time_budget_s: Option<f64>,
    /// Lens samples a pixel
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
    /// The job these flags describe.
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

/// The job that `input`, `lens` and `effects` describe, its method left open, on the CPU.
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
        ..Job::default()
    })
}

impl InputArgs {
    fn read_options(&self, carry: Carry) -> ReadOptions {
        ReadOptions {
            color_channel: self.color_channel.clone(),
            depth_channel: self.depth_channel.clone(),
            depth_file: self.depth_file.clone(),
            carry,
            ..ReadOptions::default()
        }
    }

    /// The words of a command line that say the same.
    pub(super) fn words(&self) -> Vec<String> {
        let Self { inputs, depth_file, color_channel, depth_channel, frame } = self;
        let inputs = inputs.iter().map(|input| input.display().to_string());
        let flags = [
            flag("--depth-file", depth_file.as_ref().map(|file| file.display())),
            flag("--color-channel", color_channel.as_ref()),
            flag("--depth-channel", depth_channel.as_ref()),
            flag("--frame", frame.as_ref()),
        ];
        inputs.chain(flags.into_iter().flatten()).collect()
    }

    /// Every file that is read.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> + Clone {
        self.inputs.iter().chain(&self.depth_file)
    }
}

impl LensArgs {
    /// The words of a command line that say the same.
    pub(super) fn words(&self) -> Vec<String> {
        let Self { preset, settings } = self;
        [flag("--preset", preset.as_ref()), settings.words()].concat()
    }
}

/// A flag and its value as the words of a command line; nothing for a flag that was not given.
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
    let [least, most] = Effort::TARGETS_DB;
    let number = text.parse().ok().filter(|db| (least..=most).contains(db));
    number.ok_or_else(|| format!("a target is a number of decibels from {least} to {most}"))
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|seconds: &f64| *seconds > 0.0 && seconds.is_finite());
    number.ok_or_else(|| "a time is a positive number of seconds".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use thinlens::settings::{CommandLine, Kind, SETTINGS, Setting, Value};

    /// A stack, its lens and its effects, as any subcommand takes them.
    #[derive(Debug, clap::Parser)]
    struct StackAndLens {
        #[command(flatten)]
        input: InputArgs,
        #[command(flatten)]
        lens: LensArgs,
        #[command(flatten)]
        effects: EffectArgs,
    }

    /// A value of `setting` as a command line has it.
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
    fn the_words_of_flags_are_read_back_as_the_same_flags() {
        use clap::{CommandFactory, Parser};
        let own = "x a.exr b.exr --depth-file d.exr --color-channel C --depth-channel Z --frame -42 --preset p \
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
                "every flag, but of ways to focus only one: {line:?}"
            );
            let given = StackAndLens::parse_from(&line);
            let words = [given.input.words(), given.lens.words(), given.effects.words()].concat();
            let again = StackAndLens::parse_from(std::iter::once("x".to_owned()).chain(words));
            assert_eq!(format!("{again:?}"), format!("{given:?}"));
        }
    }
}
