//! A job: everything that determines one picture, and the settings that follow from it.

use crate::error::Error;
use crate::finding::Finding;
use crate::gpu::DeviceChoice;
use crate::image::Image;
use crate::memory::memory_limit_bytes;
use crate::methods::{self, Registry};
use crate::scene::{self, FrameNumber};
use crate::settings::{
    Focus, KEYED, Mask, Origin, Preset, Setting, Settings, Surroundings, Switches, Value, Values,
};
use crate::stack::{self, ReadOptions, Source};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A preset and the name it was requested by.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPreset {
    /// Name or path, as origins show it.
    pub name: String,
    /// What it sets.
    pub preset: Preset,
}

/// Everything that determines one picture.
///
/// Fields are added with new settings: make one by [`Job::new`], or end its expression with `..Job::default()`.
#[derive(Debug, Clone, Default)]
pub struct Job {
    /// The stack's files.
    pub sources: Vec<Source>,
    /// Frame number, for keys; taken from the first file's name if `None`.
    pub frame: Option<i64>,
    /// How to read them; what the preset or `flags` say about depth is added.
    pub read_options: ReadOptions,
    /// The methods to choose from.
    pub methods: Registry,
    /// The preset, if any.
    pub preset: Option<NamedPreset>,
    /// Values that outrank the preset.
    pub flags: Values,
    /// Parameters of the method that outrank the preset's, `KEY=VALUE` each.
    pub parameters: Vec<String>,
    /// Effects that are forced on, or left out, whatever the preset says of them.
    pub switches: Switches,
    /// Device that carries out the plan.
    pub device: DeviceChoice,
    /// Number of pixels at which the sampling error is measured, if any.
    pub verify: Option<usize>,
    /// Whether to compute the confidence mask.
    pub confidence: bool,
    /// Memory that the run may use, in bytes: of the decoded stack, and where it is rendered in bands ([`super::in_bands`]) of all of it. If
    /// `None`, a part of what the machine has and the process's control group allows.
    pub memory: Option<u64>,
}

impl Job {
    /// The stack in the files `sources`, with the default lens.
    pub fn new(sources: impl IntoIterator<Item = Source>) -> Self {
        Self { sources: sources.into_iter().collect(), ..Self::default() }
    }

    /// Every file that the job names and reads: the stack, its depth, its beauty, its holdout.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let sources = self.sources.iter().filter_map(|source| match source {
            Source::File(path) => Some(path.as_path()),
            Source::Memory { .. } => None,
        });
        sources.chain(self.beside())
    }

    /// The job with the contents of inputs that can be read only once: standard input (`-`), pipes and devices. They may take half of the
    /// memory that the run may use.
    ///
    /// # Errors
    /// Those of [`stack::Held::hold`].
    pub fn held(mut self) -> Result<Self, Error> {
        let (max_bytes, mut held) = (limit_bytes(&self) / 2, stack::Held::default());
        let aperture = user_layers(&self).filter_map(|(_, values)| values.aperture_image.as_deref()).last();
        let environment = user_layers(&self).filter_map(|(_, values)| values.environment.as_deref()).last();
        for path in self.files().chain(aperture).chain(environment) {
            held.hold(path, max_bytes.saturating_sub(held.bytes()))?;
        }
        for source in &mut self.sources {
            if let Source::File(path) = source {
                *source = held.source(path);
            }
        }
        self.read_options.held = held;
        Ok(self)
    }

    /// The names of all inputs: the stack, its depth, its beauty, its holdout.
    pub fn input_names(&self) -> Vec<String> {
        let sources = self.sources.iter().map(Source::shown);
        let beside = self.beside().map(|path| self.read_options.held.source(path).shown());
        sources.chain(beside).collect()
    }

    /// The files of depth, beauty and holdout.
    fn beside(&self) -> impl Iterator<Item = &Path> {
        let last = |pick: fn(&Values) -> Option<&PathBuf>| {
            user_layers(self).filter_map(|(_, values)| pick(values)).last().map(PathBuf::as_path)
        };
        let beauty = last(|values| values.beauty.as_ref()).or(self.read_options.beauty.as_deref());
        let holdout = last(|values| values.holdout.as_ref()).or(self.read_options.holdout.as_deref());
        self.read_options.depth_file.as_deref().into_iter().chain(beauty).chain(holdout)
    }

    /// The job with `preset`, called `name` where origins are shown.
    #[must_use]
    pub fn with_preset(self, name: impl Into<String>, preset: Preset) -> Self {
        Self { preset: Some(NamedPreset { name: name.into(), preset }), ..self }
    }

    /// The job with `values`, which outrank the preset.
    #[must_use]
    pub fn with_values(self, values: Values) -> Self {
        Self { flags: values, ..self }
    }

    /// The job with `methods` to choose from.
    #[must_use]
    pub fn with_methods(self, methods: Registry) -> Self {
        Self { methods, ..self }
    }
}

/// Bytes of memory that `job` may use: [`Job::memory`], or three quarters of what the process has, without the inputs that
/// are held in memory.
pub fn limit_bytes(job: &Job) -> u64 {
    let limit = job.memory.unwrap_or_else(|| memory_limit_bytes() / 4 * 3);
    limit.saturating_sub(job.read_options.held.bytes())
}

/// Layers of values, lowest first.
type Layers = Vec<(Origin, Values)>;

/// The layers of values that the user set, lowest first.
pub(super) fn user_layers(job: &Job) -> impl Iterator<Item = (Origin, &Values)> {
    let preset = job.preset.iter().map(|p| (Origin::Preset(p.name.clone()), &p.preset.values));
    preset.chain([(Origin::Flag, &job.flags)])
}

/// Every value with its origin, over the camera data `camera` of the header, and how those with keys were found.
///
/// # Errors
/// An unknown method, a parameter that its method does not accept, an aperture image that cannot be read, and keys without a frame
/// number.
pub(super) fn resolve(job: &Job, camera: &Values) -> Result<(Settings, Vec<Finding>), Error> {
    let (mut user, mut findings) = user_layers_at_frame(job)?;
    findings.extend(metres_to_units(&mut user, camera));
    let user = user.iter().map(|(origin, values)| (origin.clone(), values));
    let layers: Vec<_> = [(Origin::Header, camera)].into_iter().chain(user).collect();
    let parameters = job.preset.as_ref().map(|p| p.preset.parameters.clone()).unwrap_or_default();
    let settings = Settings::resolve(&layers, parameters);
    let switches = methods::joined(&settings.switches, &job.switches);
    let mut settings = Settings { switches, ..settings };
    let method = job.methods.chosen(&settings)?;
    for setting in &job.parameters {
        settings.parameters.push(method.parameters().parse(method.name(), setting)?);
    }
    settings.mask =
        settings.lens.aperture_image.value.as_deref().map(|path| mask(job, path)).transpose()?.map(Arc::new);
    settings.surroundings =
        settings.picture.environment.value.as_deref().map(|path| surroundings(job, path)).transpose()?;
    Ok((settings, findings))
}

/// Converts distances in metres to depth units in `layers`, over the camera data `camera` of the header; notes about the results.
fn metres_to_units(layers: &mut Layers, camera: &Values) -> Vec<Finding> {
    let set = layers.iter().rev().find_map(|(_, values)| values.metres_per_unit);
    let metres_per_unit = set.or(camera.metres_per_unit).unwrap_or(1.0);
    let converted = layers.iter_mut().flat_map(|(_, values)| values.metres_to_units(metres_per_unit));
    let note = |(setting, [metres, units]): (&Setting, [f32; 2])| {
        let text = format!("{} of {metres} m: {units} depth units of {metres_per_unit} m", setting.name);
        Finding::note("units", text)
    };
    converted.filter(|_| metres_per_unit != 1.0).map(note).collect()
}

/// The layers of values that the user set, lowest first, with the numbers that their keys give at the job's frame in place of the
/// keys; and how these were found. Keys that a higher layer overrules have no effect and need no frame number.
fn user_layers_at_frame(job: &Job) -> Result<(Layers, Vec<Finding>), Error> {
    let mut layers: Layers = user_layers(job).map(|(origin, values)| (origin, values.clone())).collect();
    let mut findings = Vec::new();
    for keyed in &KEYED {
        let sets = |values: &Values| (keyed.keys)(values).is_some() || keyed.setting().get(values).is_some();
        let Some((_, values)) = layers.iter_mut().rev().find(|(_, values)| sets(values)) else { continue };
        if let Some((number, reason)) = scene::number_at(keyed, values, frame_number(job))? {
            keyed.setting().set(values, &Value::Number(number));
            findings.push(Finding::note(keyed.name, reason));
        }
    }
    Ok((layers, findings))
}

/// The most memory in bytes that reading an aperture image may take; no aperture needs so many pixels.
const MAX_APERTURE_BYTES: u64 = 1 << 30;

/// The aperture image at `path`: transmittance by pixel, 0 where the image is transparent.
fn mask(job: &Job, path: &Path) -> Result<Mask, Error> {
    let limit = limit_bytes(job).min(MAX_APERTURE_BYTES);
    let options = ReadOptions { max_bytes: Some(limit), ..ReadOptions::default() };
    let read = stack::read_framed(&job.read_options.held.source(path), &options);
    let Image { planes: [red, green, blue, _] } = read
        .map_err(|error| error.with("used as", "`aperture_image`, for which 1000 pixels across are plenty"))?
        .image;
    let light = red.values().iter().zip(green.values()).zip(blue.values());
    Ok(Mask {
        name: path.display().to_string(),
        width: red.width(),
        height: red.height(),
        values: light.map(|((red, green), blue)| (red + green + blue) / 3.0).collect(),
    })
}

/// The environment at `path`.
fn surroundings(job: &Job, path: &Path) -> Result<Surroundings, Error> {
    let options = ReadOptions { max_bytes: Some(limit_bytes(job)), ..ReadOptions::default() };
    let image = stack::read_environment(&job.read_options.held.source(path), &options)
        .map_err(|error| error.with("used as", "`environment`"))?;
    let [red, green, blue, _] = &image.planes;
    let texels = red.values().iter().zip(green.values()).zip(blue.values());
    let texels: Vec<_> = texels.map(|((&red, &green), &blue)| [red, green, blue]).collect();
    Ok(Surroundings { width: image.width(), height: image.height(), texels: texels.into() })
}

/// The job's read options, with what preset and flags set about the file.
pub(super) fn read_options(job: &Job) -> ReadOptions {
    let mut options = job.read_options.clone();
    options.max_bytes = options.max_bytes.or(job.memory);
    for (_, values) in user_layers(job) {
        options.convention = values.convention.or(options.convention);
        options.supersample = values.supersample.or(options.supersample);
        options.kind = values.kind.or(options.kind);
        options.near = values.near.or(options.near);
        options.far = values.far.or(options.far);
        options.alpha = values.alpha.or(options.alpha);
        options.beauty = values.beauty.clone().or(options.beauty);
        options.holdout = values.holdout.clone().or(options.holdout);
    }
    let focus = user_layers(job).filter_map(|(_, values)| values.focus.as_ref()).last();
    options.objects |= focus.is_some_and(Focus::needs_mattes);
    options
}

/// Whether the picture depends on the frame number: whether any layer has keys.
pub(super) fn has_keys(job: &Job) -> bool {
    user_layers(job).any(|(_, values)| values.has_keys())
}

/// What the job sets about the file, as a layer of values.
pub(super) fn reading(job: &Job) -> Values {
    let ReadOptions { convention, supersample, kind, alpha, beauty, holdout, .. } = read_options(job);
    Values { convention, supersample, kind, alpha, beauty, holdout, ..Values::default() }
}

/// The frame number of the job, if it is known.
pub(super) fn frame_number(job: &Job) -> Option<FrameNumber> {
    let given = job.frame.map(|number| FrameNumber { number, from: "`frame`" });
    let named = || stack::frame_number(&job.sources);
    given.or_else(|| named().map(|number| FrameNumber { number, from: "the file's name" }))
}

/// Checks what can be checked without a stack: the range of every setting, the names of methods and effects, parameters of presets.
///
/// # Errors
/// The first value that is out of range, or unknown.
pub(super) fn check(job: &Job) -> Result<(), Error> {
    user_layers(job).try_for_each(|(_, values)| values.check())?;
    user_layers(job)
        .filter_map(|(_, values)| values.method.as_deref())
        .try_for_each(|name| job.methods.by_name(name).map(drop))?;
    job.preset.iter().try_for_each(|named| job.methods.check(&named.preset.parameters))?;
    let switches = user_layers(job).filter_map(|(_, values)| values.switches.as_ref());
    switches.chain([&job.switches]).try_for_each(|switches| methods::requested(switches).map(drop))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::DepthConvention;

    fn preset(values: Values) -> Option<NamedPreset> {
        Some(NamedPreset { name: "p".to_owned(), preset: Preset { values, ..Preset::default() } })
    }

    #[test]
    fn flags_outrank_the_preset_and_the_preset_the_header() {
        let camera = Values { f_number: Some(1.0), focal_length_mm: Some(20.0), ..Values::default() };
        let job = Job {
            preset: preset(Values { f_number: Some(2.0), blades: Some(5), ..Values::default() }),
            flags: Values { f_number: Some(4.0), ..Values::default() },
            ..Job::default()
        };
        let (settings, _) = resolve(&job, &camera).unwrap();
        assert_eq!((settings.lens.f_number.value, settings.lens.f_number.origin), (4.0, Origin::Flag));
        assert_eq!(
            (settings.lens.blades.value, settings.lens.blades.origin),
            (5, Origin::Preset("p".to_owned()))
        );
        assert_eq!(
            (settings.lens.focal_length_mm.value, settings.lens.focal_length_mm.origin),
            (20.0, Origin::Header)
        );
    }

    #[test]
    fn the_depth_convention_of_a_flag_outranks_the_presets() {
        let convention = |convention| Values { convention, ..Values::default() };
        let mut job = Job { preset: preset(convention(Some(DepthConvention::Ray))), ..Job::default() };
        assert_eq!(read_options(&job).convention, Some(DepthConvention::Ray));
        job.flags = convention(Some(DepthConvention::Planar));
        assert_eq!(read_options(&job).convention, Some(DepthConvention::Planar));
    }

    #[test]
    fn an_unknown_method_is_refused_without_a_stack() {
        let job = Job {
            sources: vec![Source::File("no/such.exr".into())],
            preset: preset(Values { method: Some("sheer".to_owned()), ..Values::default() }),
            ..Job::default()
        };
        let message = check(&job).unwrap_err().to_string();
        assert!(message.contains("'sheer'") && message.contains("did you mean 'shear'?"), "{message}");
    }
}
