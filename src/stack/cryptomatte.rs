//! Cryptomattes: which objects each pixel of the picture shows, and how much of each.
//!
//! As specified by Friedman & Jones, "Fully Automatic ID Mattes with Support for Motion Blur and Transparency" (2015), version 1.2: the
//! channels `NAME00.R G B A`, `NAME01.R …` are pairs of an id and its coverage, best first; the header's `cryptomatte/…/name` says
//! NAME, and `cryptomatte/…/manifest` has the ids of all names as JSON. Programs deviate from it, and these variants are
//! read: a view layer before NAME (Blender), `.r` or `.red` for `.R`, parts of their own, channels without a header.
//! An id is the hash of its object's name ([`murmur`]), which is used if the manifest is missing or cannot be read.
//! Ids are compared as bits: they are stored in float channels and may be any float.
//! A manifest in a file of its own (`manif_file`) is read from the picture's folder, where objects are asked for.
//! Limits: only the cryptomattes of the first peel are read, which has what the camera sees. 16-bit channels cannot hold ids.
//! Cost: reading two channels per rank. Memory: one float per sample.

use super::header::{Channel, ExrFile};
use super::{CarriedChannel, Stack, Window, murmur, windows};
use crate::error::Error;
use crate::finding::Finding;
use crate::settings::nearest;
use exr::image::FlatSamples;
use exr::meta::attribute::{AttributeValue, SampleType};
use half::slice::HalfFloatSliceExt;
use serde_json::Value as Json;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Component, Path};

/// Prefix of the attributes of cryptomattes.
const ATTRIBUTES: &str = "cryptomatte/";
/// Usual prefix of the channels of a cryptomatte, which identifies them without a header.
const USUAL_NAME: &str = "crypto";
/// Number of digits of a rank in a channel's name.
const RANK_DIGITS: usize = 2;
/// Maximum number of names in an error; the rest is counted.
const SHOWN_NAMES: usize = 16;
/// Largest manifest in a file of its own that is read.
const MAX_SIDECAR_BYTES: u64 = 64 << 20;
/// Indices in `R G B A` of the ids; the others are coverage.
const ID_CHANNELS: [usize; 2] = [0, 2];
/// The id of pixels without an object.
const NO_OBJECT: u32 = 0;

/// One cryptomatte of a stack.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Cryptomatte {
    /// The name of its channels without their numbers: `ViewLayer.CryptoObject`.
    pub name: String,
    /// Names of the channels with ids and with their coverage, largest coverage first; at least one pair.
    ranks: Vec<[String; 2]>,
    /// The names of its objects.
    manifest: Manifest,
}

/// The names of a cryptomatte's objects and their ids.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
enum Manifest {
    /// Missing.
    #[default]
    Absent,
    /// JSON text, not yet parsed.
    Text(String),
    /// In a file of this name, which is not read yet.
    File(String),
    /// Why it cannot be read.
    Unread(String),
}

/// The header's description of one cryptomatte.
#[derive(Debug, Default)]
struct Described {
    name: String,
    manifest: Manifest,
}

/// The coverage of one object in a picture.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ObjectMatte<'a> {
    /// The cryptomatte that it was found in.
    pub cryptomatte: &'a str,
    /// Coverage of each sample of the data window, 0 … 1, row by row.
    pub coverage: Vec<f32>,
}

/// The objects of one cryptomatte that are visible in a picture.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct Objects {
    /// The name of the cryptomatte.
    pub cryptomatte: String,
    /// The objects' names, the one with the largest area first.
    pub names: Vec<String>,
    /// Number of visible objects without a known name.
    pub unnamed: usize,
    /// Why the manifest cannot be used; `None` if it can.
    pub doubt: Option<String>,
}

/// The cryptomattes of `file` whose channels are within the data window `data`, objects before materials. `deeper` are the prefixes of
/// the peels whose cryptomattes are left out.
pub(super) fn find(file: &ExrFile, data: Window, deeper: &[&str]) -> Vec<Cryptomatte> {
    let described = described(file);
    let mut groups: BTreeMap<&str, BTreeMap<&str, [Option<&str>; 4]>> = BTreeMap::new();
    for channel in &file.channels {
        if let Some((name, rank, role)) = rank_channel(&channel.name)
            && windows::is_within(file.frame(channel.part).data, data)
            && (!ID_CHANNELS.contains(&role) || channel.sample_type == SampleType::F32)
        {
            groups.entry(name).or_default().entry(rank).or_default()[role].get_or_insert(&channel.name);
        }
    }
    let is_deeper = |name: &str| {
        deeper.iter().any(|prefix| !prefix.is_empty() && name.starts_with(&format!("{prefix}.")))
    };
    let mut found: Vec<Cryptomatte> = Vec::new();
    for (name, ranks) in groups.into_iter().filter(|(name, _)| !is_deeper(name)) {
        let exact = described.iter().find(|described| described.name == name);
        let header = exact.or_else(|| described.iter().find(|described| is_same(&described.name, name)));
        let usual = last_part(name).to_ascii_lowercase().starts_with(USUAL_NAME);
        let ranks: Vec<[String; 2]> = ranks.into_values().flat_map(pairs).collect();
        if (header.is_some() || usual) && !ranks.is_empty() {
            let manifest = header.map(|header| header.manifest.clone()).unwrap_or_default();
            found.push(Cryptomatte { name: name.to_owned(), ranks, manifest });
        }
    }
    found.sort_by_key(|matte| order(&matte.name));
    found
}

/// Reads the manifests of `mattes` that are in files beside `picture`.
pub(super) fn read_sidecars(mattes: &mut [Cryptomatte], picture: &Path) {
    for matte in mattes {
        if let Manifest::File(name) = &matte.manifest {
            matte.manifest = match sidecar(picture, name) {
                Ok(text) => Manifest::Text(text),
                Err(reason) => Manifest::Unread(format!("its manifest {name} cannot be read: {reason}")),
            };
        }
    }
}

/// The text of the file `name`, which the header of `picture` states relative to its own folder.
fn sidecar(picture: &Path, name: &str) -> Result<String, String> {
    let relative = Path::new(name);
    if !relative.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
        return Err("it is not in the folder of the picture".to_owned());
    }
    let path = picture.parent().unwrap_or(Path::new("")).join(relative);
    let metadata = std::fs::metadata(&path).map_err(|error| error.to_string())?;
    if !metadata.is_file() || metadata.len() > MAX_SIDECAR_BYTES {
        return Err(format!("it is no file of at most {} MiB", MAX_SIDECAR_BYTES >> 20));
    }
    let bytes = std::fs::read(&path).map_err(|error| error.to_string())?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// A finding about cryptomattes whose ids are 16-bit floats, which cannot hold them.
pub(super) fn half_ids(file: &ExrFile) -> Option<Finding> {
    let described = described(file);
    let is_half = |channel: &&Channel| {
        channel.sample_type == SampleType::F16
            && rank_channel(&channel.name).is_some_and(|(name, _, role)| {
                let is_described = || described.iter().any(|described| is_same(&described.name, name));
                ID_CHANNELS.contains(&role)
                    && (last_part(name).to_ascii_lowercase().starts_with(USUAL_NAME) || is_described())
            })
    };
    let channel = file.channels.iter().find(is_half)?;
    let text = format!(
        "the ids in {} are 16-bit floats, which cannot hold them: objects are not found by name; write cryptomattes with 32 bits",
        channel.name
    );
    Some(Finding::note("cryptomatte", text))
}

/// The descriptions of cryptomattes in the headers of all parts.
fn described(file: &ExrFile) -> Vec<Described> {
    let mut described: BTreeMap<String, Described> = BTreeMap::new();
    for (name, value) in file.attributes_of_all_parts() {
        let name = name.to_string();
        let key = name.strip_prefix(ATTRIBUTES).and_then(|rest| rest.rsplit_once('/'));
        if let (Some((id, key)), AttributeValue::Text(text)) = (key, value) {
            let matte = described.entry(id.to_owned()).or_default();
            // The EXR library decodes text as one byte per character; names of objects are UTF-8.
            let utf8 = || String::from_utf8_lossy(text.as_slice()).into_owned();
            match key {
                "name" => matte.name = text.to_string(),
                "manifest" => matte.manifest = Manifest::Text(utf8()),
                "manif_file" if matte.manifest == Manifest::Absent => {
                    matte.manifest = Manifest::File(utf8());
                }
                _ => {}
            }
        }
    }
    described.into_values().filter(|matte| !matte.name.is_empty()).collect()
}

/// The parts of a channel name `NAME00.R`: NAME, the rank, and the index in `R G B A`.
fn rank_channel(channel: &str) -> Option<(&str, &str, usize)> {
    const ROLES: [[&str; 2]; 4] = [["r", "red"], ["g", "green"], ["b", "blue"], ["a", "alpha"]];
    let (head, ending) = channel.rsplit_once('.')?;
    let role = ROLES.iter().position(|names| names.iter().any(|name| name.eq_ignore_ascii_case(ending)))?;
    let (name, rank) = head.split_at_checked(head.len().checked_sub(RANK_DIGITS)?)?;
    let is_rank = rank.bytes().all(|byte| byte.is_ascii_digit());
    (is_rank && !name.is_empty()).then_some((name, rank, role))
}

/// The two pairs of id and coverage of a rank.
fn pairs([red, green, blue, alpha]: [Option<&str>; 4]) -> impl Iterator<Item = [String; 2]> {
    let pair = |id: Option<&str>, coverage: Option<&str>| Some([id?.to_owned(), coverage?.to_owned()]);
    [pair(red, green), pair(blue, alpha)].into_iter().flatten()
}

/// Whether the names in header and channels are of one cryptomatte: either may have a view layer or part as a prefix.
fn is_same(described: &str, channels: &str) -> bool {
    let has_suffix = |long: &str, short: &str| {
        long.strip_suffix(short).is_some_and(|prefix| prefix.is_empty() || prefix.ends_with('.'))
    };
    has_suffix(described, channels) || has_suffix(channels, described)
}

fn last_part(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// Sort key: objects, then other cryptomattes, then materials.
fn order(name: &str) -> (u8, String) {
    let last = last_part(name).to_ascii_lowercase();
    let rank = match (last.contains("object"), last.contains("material")) {
        (true, _) => 0,
        (_, false) => 1,
        (_, true) => 2,
    };
    (rank, name.to_owned())
}

impl Manifest {
    /// Names with their ids.
    ///
    /// # Errors
    /// The reason why they are not known.
    fn names(&self) -> Result<BTreeMap<String, u32>, String> {
        let text = match self {
            Self::Absent => return Err("no manifest in the file".to_owned()),
            Self::File(name) => return Err(format!("its manifest is in another file, {name}")),
            Self::Unread(reason) => return Err(reason.clone()),
            Self::Text(text) => text,
        };
        let names: BTreeMap<String, Json> =
            serde_json::from_str(text).map_err(|error| format!("its manifest cannot be read: {error}"))?;
        let id = |value: &Json| u32::from_str_radix(value.as_str()?, 16).ok();
        Ok(names.into_iter().filter_map(|(name, value)| Some((name, id(&value)?))).collect())
    }
}

impl Cryptomatte {
    /// Whether `channel` is one of its channels.
    pub(super) fn has(&self, channel: &str) -> bool {
        self.ranks.iter().flatten().any(|name| name == channel)
    }

    /// The id of the object called `name`; `None` if the manifest does not have it.
    fn id(&self, name: &str) -> Option<u32> {
        match self.manifest.names() {
            Ok(names) => names.get(name).copied(),
            Err(_) => Some(murmur::id(name)),
        }
    }
}

impl Stack {
    /// The coverage of the object called `name`. Requires [`super::ReadOptions::objects`].
    ///
    /// # Errors
    /// No cryptomatte; an unknown name, with the nearest known one and a list of the visible objects; a known object that is not
    /// visible.
    pub fn object(&self, name: &str) -> Result<ObjectMatte<'_>, Error> {
        if self.cryptomattes.is_empty() {
            let half = self.findings.iter().find(|finding| finding.about == "cryptomatte");
            return Err(half
                .into_iter()
                .fold(no_cryptomatte(name), |error, half| error.with("found", half.text.clone())));
        }
        let mut unseen = None;
        for matte in &self.cryptomattes {
            let Some(id) = matte.id(name) else { continue };
            let coverage = self.coverage(matte, id);
            if coverage.iter().any(|&share| share > 0.0) {
                return Ok(ObjectMatte { cryptomatte: &matte.name, coverage });
            }
            if matte.manifest.names().is_ok() {
                unseen = unseen.or(Some(matte));
            }
        }
        Err(unseen.map_or_else(|| self.no_such_object(name), |matte| not_seen(name, matte)))
    }

    /// The visible objects of each cryptomatte.
    pub fn objects(&self) -> Vec<Objects> {
        self.cryptomattes.iter().map(|matte| self.objects_of(matte)).collect()
    }

    fn objects_of(&self, matte: &Cryptomatte) -> Objects {
        let (names, doubt) = match matte.manifest.names() {
            Ok(names) => (names, None),
            Err(doubt) => (BTreeMap::new(), Some(doubt)),
        };
        let mut areas = self.areas(matte);
        let mut seen: Vec<(f64, String)> =
            names.into_iter().filter_map(|(name, id)| Some((areas.remove(&id)?, name))).collect();
        seen.sort_by(|a, b| b.0.total_cmp(&a.0));
        let names = seen.into_iter().map(|(_, name)| name).collect();
        Objects { cryptomatte: matte.name.clone(), names, unnamed: areas.len(), doubt }
    }

    /// The ids and coverages of each rank of `matte`.
    fn ranks<'a>(
        &'a self,
        matte: &'a Cryptomatte,
    ) -> impl Iterator<Item = (&'a [f32], Cow<'a, [f32]>)> + use<'a> {
        let samples = |name: &str| {
            let channel =
                self.carried.channels.iter().chain(&self.mattes).find(|channel| channel.name == name);
            channel.map(|channel| &channel.samples)
        };
        matte.ranks.iter().filter_map(move |[id, coverage]| match samples(id)? {
            FlatSamples::F32(ids) => Some((ids.as_slice(), floats(samples(coverage)?))),
            FlatSamples::F16(_) | FlatSamples::U32(_) => None,
        })
    }

    /// The coverage of the object `id` at each sample, 0 … 1.
    fn coverage(&self, matte: &Cryptomatte, id: u32) -> Vec<f32> {
        let mut sum = vec![0.0; self.width() * self.height()];
        for (ids, coverages) in self.ranks(matte) {
            for ((sum, found), &coverage) in sum.iter_mut().zip(ids).zip(coverages.iter()) {
                // NaN and negative coverage are ignored.
                if found.to_bits() == id && coverage > 0.0 {
                    *sum = (*sum + coverage).min(1.0);
                }
            }
        }
        sum
    }

    /// The area of every visible object, in samples.
    fn areas(&self, matte: &Cryptomatte) -> BTreeMap<u32, f64> {
        let mut areas = BTreeMap::new();
        for (ids, coverages) in self.ranks(matte) {
            // Neighbours mostly belong to the same object: one map access per span of equal ids.
            let mut span = (NO_OBJECT, 0.0);
            let mut add = |(id, area): (u32, f64)| {
                if id != NO_OBJECT && area > 0.0 {
                    *areas.entry(id).or_insert(0.0) += area;
                }
            };
            for (id, &coverage) in ids.iter().map(|id| id.to_bits()).zip(coverages.iter()) {
                if id != span.0 {
                    add(std::mem::replace(&mut span, (id, 0.0)));
                }
                span.1 += f64::from(coverage.max(0.0));
            }
            add(span);
        }
        areas
    }

    fn no_such_object(&self, name: &str) -> Error {
        let objects = self.objects();
        let mut error = Error::settings(format!("there is no object called '{name}' in the picture"));
        for Objects { cryptomatte, names, doubt, unnamed } in &objects {
            let found = match doubt {
                None if names.is_empty() => "no object".to_owned(),
                None => listed(names, SHOWN_NAMES),
                Some(doubt) => {
                    format!(
                        "{unnamed} objects without names: {doubt}; objects are found by the hash of their name"
                    )
                }
            };
            error = error.with("found", format!("in {cryptomatte}: {found}"));
        }
        let names: Vec<&String> = objects.iter().flat_map(|objects| &objects.names).collect();
        let containing =
            || names.iter().find(|known| !name.is_empty() && known.contains(name)).map(|name| name.as_str());
        match nearest(name, &names).or_else(containing) {
            Some(near) => error.help(format!("did you mean '{near}'?")),
            None => error
                .help("write the full name as in the scene, or focus on a pixel with `focus_point = [X, Y]`"),
        }
    }
}

/// The samples, converted to floats.
fn floats(samples: &FlatSamples) -> Cow<'_, [f32]> {
    match samples {
        FlatSamples::F32(values) => Cow::Borrowed(values),
        FlatSamples::F16(values) => Cow::Owned(values.to_f32_vec()),
        FlatSamples::U32(values) => Cow::Owned(values.iter().map(|&value| value as f32).collect()),
    }
}

/// The first `max` names of a list, and the number of the others.
pub(crate) fn listed(names: &[String], max: usize) -> String {
    let shown = names.iter().take(max).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(max) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

fn no_cryptomatte(name: &str) -> Error {
    Error::settings(format!("the file has no cryptomatte: the object '{name}' cannot be found"))
        .with("looked for", "32-bit channels such as CryptoObject00.R G B A, with the picture's data window")
        .help("render with a Cryptomatte pass, or focus on a pixel with `focus_point = [X, Y]`")
}

fn not_seen(name: &str, matte: &Cryptomatte) -> Error {
    Error::settings(format!("the object '{name}' is not visible in the picture"))
        .with("found", format!("its name in the manifest of {}, but no pixel with its id", matte.name))
        .help("it may be hidden or outside the frame; focus on a pixel with `focus_point = [X, Y]`, or at a distance with `focus_distance`")
}

/// The channels that belong to `mattes`.
pub(super) fn matte_channels(channels: Vec<CarriedChannel>, mattes: &[Cryptomatte]) -> Vec<CarriedChannel> {
    let is_matte = |channel: &CarriedChannel| mattes.iter().any(|matte| matte.has(&channel.name));
    channels.into_iter().filter(is_matte).collect()
}
