//! Flags that several subcommands share, and what they mean to the library.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use std::fmt::Display;
use std::path::PathBuf;
use thinlens::error::Error;
use thinlens::gpu::DeviceChoice;
use thinlens::render::{Job, NamedPreset};
use thinlens::settings::{
    Border, DepthConvention, Effort, Focus, Preset, Quality, SensorDistance, Switches, Values,
};
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
    /// How depth is written
    #[arg(long, value_name = "CONVENTION")]
    depth_convention: Option<ConventionArg>,
    /// Depth at which the renderer starts to count (ray depth)
    #[arg(long, value_name = "DISTANCE", value_parser = parse_not_negative, allow_negative_numbers = true)]
    near_clip: Option<f32>,
    /// Planar distance of depth 0 (normalised depth)
    #[arg(long, value_name = "DISTANCE", value_parser = parse_not_negative, allow_negative_numbers = true)]
    near: Option<f32>,
    /// Planar distance of depth 1 (normalised depth)
    #[arg(long, value_name = "DISTANCE", value_parser = parse_not_negative, allow_negative_numbers = true)]
    far: Option<f32>,
    /// Length of one depth unit
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    metres_per_unit: Option<f32>,
    /// Samples a picture pixel along each axis
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u16).range(1..=64))]
    supersample: Option<u16>,
    /// Which frame this is, for a preset's focus keys
    ///
    /// By default the last digits of the first input's name before its extension: shot.0042.exr is frame 42. Digits after a v are a
    /// version and no frame; of several inputs, all must have the number.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    frame: Option<i64>,
    /// What lies beyond the frame; clamp by default
    ///
    /// What is blurred at the frame's edge is blurred with what lies beyond it. Overscan is the true answer: what the data window holds is
    /// used, and this is about what lies beyond that.
    #[arg(long, value_name = "BORDER")]
    border: Option<BorderArg>,
}

/// The lens; every flag outranks the preset.
#[derive(Debug, Args)]
#[command(next_help_heading = "Lens")]
pub(super) struct LensArgs {
    /// A preset's name or TOML file (see `thinlens presets`)
    #[arg(long, value_name = "NAME|FILE")]
    preset: Option<String>,
    /// Focal length
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    focal_length: Option<f32>,
    /// Focal length over aperture diameter; inf is a pinhole
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    f_number: Option<f32>,
    /// Distance in focus, in the stack's depth units
    #[arg(long, value_name = "DISTANCE", conflicts_with_all = ["focus_at", "focus_on"], allow_negative_numbers = true)]
    focus: Option<f32>,
    /// Focus on what this pixel shows; the centre by default
    #[arg(long, value_name = "X,Y", conflicts_with = "focus_on", value_parser = parse_point)]
    focus_at: Option<[f32; 2]>,
    /// Focus on this object, by the file's cryptomatte
    ///
    /// Its distance is the median of what the picture shows of it. `thinlens inspect` lists the objects of a file.
    #[arg(long, value_name = "NAME")]
    focus_on: Option<String>,
    /// Width of the sensor
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    sensor_width: Option<f32>,
    /// How far behind the lens the sensor stands
    ///
    /// focal-length: as Blender and Mitsuba have it. thin-lens: at the image distance, as in a real camera; blurs more
    /// in close-ups.
    #[arg(long, value_name = "WHERE")]
    sensor_distance: Option<SensorDistanceArg>,
    /// Number of aperture blades, 0 for a disc
    #[arg(long, value_name = "N", value_parser = parse_blades)]
    blades: Option<u32>,
    /// Rotation of the aperture, anticlockwise
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    rotation: Option<f32>,
    /// Curvature of the blades, 0 (straight) to 1 (round)
    #[arg(long, value_name = "CURVATURE", allow_negative_numbers = true)]
    blade_curvature: Option<f32>,
    /// Height of the aperture over its width (anamorphic)
    ///
    /// What a blurred point looks like through an anamorphic lens: 2 makes it twice as high as wide. Its height is that of the disc
    /// of the f-number. From 1 to 4.
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true)]
    squeeze: Option<f32>,
    /// Picture of the aperture, in place of blades
    ///
    /// White lets light through. The circle that touches the sides of the picture is the aperture's, read upright as a point behind
    /// focus shows it.
    #[arg(long, value_name = "FILE")]
    aperture_image: Option<PathBuf>,
    /// The cat's eye of the corners: how far the rim cuts in
    ///
    /// Optical vignetting: a rim as wide as the aperture stands this many aperture radii aside of it, seen from the
    /// frame's corners, and in proportion less towards the middle. From 0 to 1.2.
    #[arg(long, value_name = "RADII", allow_negative_numbers = true)]
    cats_eye: Option<f32>,
    /// How much of the falloff of brightness shows, 0 to 1
    ///
    /// The falloff is the fourth power of the cosine of the field angle, times what --cats-eye leaves of the aperture; it is raised to
    /// this power.
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    vignetting: Option<f32>,
    /// Spherical aberration, in micrometres
    ///
    /// How much nearer to the lens the aperture's edge focuses than its middle, along the axis at the sensor. Positive: soft discs
    /// behind focus, hard rings in front of it; negative: soap bubbles behind it.
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    spherical: Option<f32>,
    /// Axial colour error of red and blue, in micrometres
    ///
    /// How much farther from the lens than green they focus, along the axis at the sensor. Both positive: green fringes behind focus,
    /// magenta ones in front of it.
    #[arg(long, value_name = "RED,BLUE", value_parser = parse_pair, allow_hyphen_values = true)]
    axial_color: Option<[f32; 2]>,
    /// Lateral colour error of red and blue, in micrometres
    ///
    /// How much farther from the axis than green they show what is in the frame's corners, at the sensor.
    #[arg(long, value_name = "RED,BLUE", value_parser = parse_pair, allow_hyphen_values = true)]
    lateral_color: Option<[f32; 2]>,
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
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    time_budget: Option<f64>,
    /// Lens samples a pixel
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    views: Option<u32>,
}

impl EffortArgs {
    fn effort(&self) -> Option<Effort> {
        let views = self.views.map(|views| Effort::Views(views as usize));
        let budget = self.time_budget.map(Effort::TimeBudget);
        let quality = self.quality.map(Effort::Quality);
        views.or(self.target_db.map(Effort::TargetDb)).or(budget).or(quality)
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ConventionArg {
    /// From the file
    Auto,
    /// Along the optical axis (Blender)
    Planar,
    /// Along the ray, from the near clip plane (Mitsuba)
    Ray,
    /// One over planar depth
    Inverse,
    /// 0 at --near to 1 at --far
    Normalised,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BorderArg {
    /// The last pixel, for ever
    Clamp,
    /// The picture, reflected
    Mirror,
    /// Nothing: blurred edges fade out
    Transparent,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SensorDistanceArg {
    FocalLength,
    ThinLens,
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
        flags: values(input, lens),
        switches: effects.switches(),
        device: DeviceChoice::Cpu,
        ..Job::default()
    })
}

fn values(input: &InputArgs, lens: &LensArgs) -> Values {
    let point = lens.focus_at.map(Focus::Point);
    Values {
        focal_length_mm: lens.focal_length,
        f_number: lens.f_number,
        focus: lens.focus.map(Focus::Distance).or(point).or_else(|| lens.focus_on.clone().map(Focus::Object)),
        sensor_width_mm: lens.sensor_width,
        sensor_distance: lens.sensor_distance.map(|distance| match distance {
            SensorDistanceArg::FocalLength => SensorDistance::FocalLength,
            SensorDistanceArg::ThinLens => SensorDistance::ThinLens,
        }),
        blades: lens.blades,
        rotation_deg: lens.rotation,
        blade_curvature: lens.blade_curvature,
        squeeze: lens.squeeze,
        aperture_image: lens.aperture_image.clone(),
        cats_eye: lens.cats_eye,
        vignetting: lens.vignetting,
        spherical_um: lens.spherical,
        axial_color_um: lens.axial_color,
        lateral_color_um: lens.lateral_color,
        convention: input.depth_convention.and_then(ConventionArg::convention),
        metres_per_unit: input.metres_per_unit,
        near_clip: input.near_clip,
        near: input.near,
        far: input.far,
        supersample: input.supersample.map(usize::from),
        border: input.border.map(BorderArg::border),
        ..Values::default()
    }
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
        let Self {
            inputs,
            depth_file,
            color_channel,
            depth_channel,
            depth_convention,
            near_clip,
            near,
            far,
            metres_per_unit,
            supersample,
            frame,
            border,
        } = self;
        let inputs = inputs.iter().map(|input| input.display().to_string());
        let flags = [
            flag("--depth-file", depth_file.as_ref().map(|file| file.display())),
            flag("--color-channel", color_channel.as_ref()),
            flag("--depth-channel", depth_channel.as_ref()),
            flag("--depth-convention", depth_convention.and_then(value_name)),
            flag("--near-clip", near_clip.as_ref()),
            flag("--near", near.as_ref()),
            flag("--far", far.as_ref()),
            flag("--metres-per-unit", metres_per_unit.as_ref()),
            flag("--supersample", supersample.as_ref()),
            flag("--frame", frame.as_ref()),
            flag("--border", border.and_then(value_name)),
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
        let Self {
            preset,
            focal_length,
            f_number,
            focus,
            focus_at,
            focus_on,
            sensor_width,
            sensor_distance,
            blades,
            rotation,
            blade_curvature,
            squeeze,
            aperture_image,
            cats_eye,
            vignetting,
            spherical,
            axial_color,
            lateral_color,
        } = self;
        let pair = |pair: &Option<[f32; 2]>| pair.map(|[first, second]| format!("{first},{second}"));
        let flags = [
            flag("--preset", preset.as_ref()),
            flag("--focal-length", focal_length.as_ref()),
            flag("--f-number", f_number.as_ref()),
            flag("--focus", focus.as_ref()),
            flag("--focus-at", pair(focus_at)),
            flag("--focus-on", focus_on.as_ref()),
            flag("--sensor-width", sensor_width.as_ref()),
            flag("--sensor-distance", sensor_distance.and_then(value_name)),
            flag("--blades", blades.as_ref()),
            flag("--rotation", rotation.as_ref()),
            flag("--blade-curvature", blade_curvature.as_ref()),
            flag("--squeeze", squeeze.as_ref()),
            flag("--aperture-image", aperture_image.as_ref().map(|file| file.display())),
            flag("--cats-eye", cats_eye.as_ref()),
            flag("--vignetting", vignetting.as_ref()),
            flag("--spherical", spherical.as_ref()),
            flag("--axial-color", pair(axial_color)),
            flag("--lateral-color", pair(lateral_color)),
        ];
        flags.into_iter().flatten().collect()
    }
}

/// A flag and its value as the words of a command line; nothing for a flag that was not given.
fn flag(name: &str, value: Option<impl Display>) -> Vec<String> {
    value.map(|value| vec![name.to_owned(), value.to_string()]).unwrap_or_default()
}

/// How a flag's value is written.
fn value_name(value: impl ValueEnum) -> Option<String> {
    value.to_possible_value().map(|value| value.get_name().to_owned())
}

impl ConventionArg {
    fn convention(self) -> Option<DepthConvention> {
        match self {
            Self::Auto => None,
            Self::Planar => Some(DepthConvention::Planar),
            Self::Ray => Some(DepthConvention::Ray),
            Self::Inverse => Some(DepthConvention::Inverse),
            Self::Normalised => Some(DepthConvention::Normalised),
        }
    }
}

impl BorderArg {
    fn border(self) -> Border {
        match self {
            Self::Clamp => Border::Clamp,
            Self::Mirror => Border::Mirror,
            Self::Transparent => Border::Transparent,
        }
    }
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

fn parse_point(text: &str) -> Result<[f32; 2], String> {
    parse_pair(text)
        .map_err(|_| "a pixel is two numbers with a comma between them, such as 960,540".to_owned())
}

fn parse_pair(text: &str) -> Result<[f32; 2], String> {
    let number = |text: &str| text.trim().parse::<f32>().ok().filter(|x| x.is_finite());
    let pair = text.split_once(',').and_then(|(first, second)| Some([number(first)?, number(second)?]));
    pair.ok_or_else(|| "two numbers with a comma between them are wanted, such as 30,45".to_owned())
}

fn parse_not_negative(text: &str) -> Result<f32, String> {
    let number = text.parse::<f32>().ok().filter(|x| *x >= 0.0 && x.is_finite());
    number.ok_or_else(|| "a distance from the lens is a number, 0 or more".to_owned())
}

fn parse_blades(text: &str) -> Result<u32, String> {
    let blades = text.parse().ok().filter(|blades| !matches!(blades, 1 | 2));
    blades.ok_or_else(|| "an aperture has 0 blades, which makes it a disc, or at least 3".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn the_words_of_flags_are_read_back_as_the_same_flags() {
        use clap::{CommandFactory, Parser};
        let text = "x a.exr b.exr --depth-file d.exr --color-channel C --depth-channel Z --depth-convention ray --near-clip 0.1 \
                    --near 0.2 --far 1e-7 --metres-per-unit 0.01 --supersample 2 --frame -42 --border mirror --preset p --focal-length 85.5 --f-number inf \
                    --focus 3.3 --sensor-width 36 --sensor-distance thin-lens --blades 5 --rotation -7.25 \
                    --blade-curvature 0.5 --squeeze 1.33 --aperture-image heart.png --cats-eye 0.8 --vignetting 0.5 \
                    --spherical -40 --axial-color -30,45.5 --lateral-color 4,-6 --force fill,resolve --without highlights";
        let all =
            StackAndLens::command().get_arguments().filter(|argument| argument.get_long().is_some()).count();
        // All flags, but for --focus-at and --focus-on, which have no place beside --focus.
        assert_eq!(text.matches("--").count() + 2, all);
        for text in [text, "x a.exr --focus-at 10.5,20", "x a.exr --focus-on cow"] {
            let given = StackAndLens::parse_from(text.split_whitespace());
            let words = [given.input.words(), given.lens.words(), given.effects.words()].concat();
            let again = StackAndLens::parse_from(std::iter::once("x".to_owned()).chain(words));
            assert_eq!(format!("{again:?}"), format!("{given:?}"));
        }
    }

    #[test]
    fn a_point_is_two_numbers_with_a_comma() {
        assert_eq!(parse_point("960, 540.5"), Ok([960.0, 540.5]));
        for text in ["960", "960,", "a,b", "1,2,3", "nan,1"] {
            assert!(parse_point(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_distance_from_the_lens_is_0_or_more() {
        assert_eq!(parse_not_negative("0.01"), Ok(0.01));
        for text in ["-1", "nan", "inf", "near"] {
            assert!(parse_not_negative(text).is_err(), "{text}");
        }
    }

    #[test]
    fn an_aperture_has_no_blades_or_at_least_three() {
        assert_eq!(parse_blades("0"), Ok(0));
        assert_eq!(parse_blades("3"), Ok(3));
        for text in ["1", "2", "-3", "six"] {
            assert!(parse_blades(text).is_err(), "{text}");
        }
    }
}
