//! Elements of one picture, before they are merged: deep files, and stacks or pictures with depth that were rendered apart.

use super::convention::{self, Evidence};
use super::deep::{DeepElement, DeepFile, Sample};
use super::depth::FarDepth;
use super::depth_values::DepthValues;
use super::kind::Announced;
use super::layers::{Layer, Layers};
use super::options::ReadOptions;
use super::sanitise::Replaced;
use super::{ColorRange, Peel, Precision, StackKind, Window, camera, filtered_depth, rim_depth, windows};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Plane;
use crate::settings::DepthConvention;
use exr::meta::attribute::{AttributeValue, Text};

/// Most peels of a merged stack. Fragments of a pixel beyond them are merged with those beside them in depth.
pub(super) const MOST_PEELS: usize = 16;
/// Rows that are in memory at a time.
pub(super) const STRIP_ROWS: usize = 32;

/// Attributes of a header.
type Attributes = Vec<(Text, AttributeValue)>;

/// Fragments that are in one place of the picture.
#[derive(Debug)]
pub(super) enum Element {
    /// Deep samples.
    Deep(Box<DeepElement>),
    /// The peels of a file, all with depth.
    Flat(Vec<Layer>),
}

/// What the stack of `sources` will be at most.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    /// The pixels of all elements.
    pub(super) window: Window,
    /// Most peels.
    pub(super) peels: usize,
    /// Bytes of the samples of the rows that are in memory at a time.
    pub(super) strip_bytes: u64,
}

impl Extent {
    /// The extent of a deep file, from its tables, and the attributes of its header.
    ///
    /// # Errors
    /// Damaged tables.
    pub(super) fn of_deep(file: DeepFile) -> Result<(Self, Attributes), Error> {
        let windows = file.elements.iter().map(DeepElement::window);
        let window = windows.reduce(windows::joined).unwrap_or(file.frame.data);
        let (mut peels, mut strip_bytes) = (0_u64, 0);
        for mut element in file.elements {
            let most = element.most_samples()?;
            // A volume may be cut into any number of slices.
            peels += if most > 0 && element.has_volumes() { MOST_PEELS as u64 } else { u64::from(most) };
            strip_bytes += element.largest_strip_bytes(STRIP_ROWS);
        }
        let peels = peels.clamp(1, MOST_PEELS as u64) as usize;
        Ok((Self { window, peels, strip_bytes }, file.attributes))
    }

    /// That of two elements together.
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            window: windows::joined(self.window, other.window),
            peels: (self.peels + other.peels).min(MOST_PEELS),
            strip_bytes: self.strip_bytes.saturating_add(other.strip_bytes),
        }
    }
}

/// The elements of one file, or of several.
#[derive(Debug)]
pub(super) struct Elements {
    /// The elements.
    pub(super) elements: Vec<Element>,
    /// What is known of the first file, without its peels; the findings and counts of all.
    pub(super) about: Layers,
    /// How depth is written.
    pub(super) convention: DepthConvention,
    /// Base names of the files.
    pub(super) names: Vec<String>,
    /// Full name of the first depth channel.
    pub(super) depth_channel: String,
}

/// How depth is written in a file with these attributes and these values, if they are known, in the channel `depth_channel`.
fn convention_of(
    about: &Layers,
    (depth_channel, depths): (&str, &[f32]),
    options: &ReadOptions,
) -> DepthConvention {
    let (camera, _) = camera::values(&about.attributes);
    let attributes = &about.attributes;
    let (chosen, header) = (options.convention, camera.convention);
    convention::conclude(Evidence { chosen, header, attributes, depth_channel, depths }).0.convention
}

/// The elements of a deep file.
pub(super) fn of_deep(file: DeepFile, options: &ReadOptions) -> Elements {
    let DeepFile { name, elements, frame, attributes, depth_channel, findings } = file;
    let is_half = elements.iter().all(|element| element.precision() == Precision::Half);
    let about = Layers {
        name,
        peels: Vec::new(),
        is_merged: true,
        is_numbered: false,
        beauty: None,
        frame,
        precision: if is_half { Precision::Half } else { Precision::Float },
        color_range: ColorRange::Unbounded,
        attributes,
        channels: Vec::new(),
        cryptomattes: Vec::new(),
        findings,
        replaced: Replaced::default(),
    };
    let convention = convention_of(&about, (&depth_channel, &[]), options);
    let elements = elements.into_iter().map(|element| Element::Deep(Box::new(element))).collect();
    Elements { elements, about, convention, names: Vec::new(), depth_channel }
}

/// The element of a file without deep parts. What its edges lack of depth is completed before it is merged with what is behind it.
///
/// # Errors
/// A peel without depth.
pub(super) fn of_flat(layers: Layers, options: &ReadOptions) -> Result<Elements, Error> {
    let mut about = layers;
    let peels = std::mem::take(&mut about.peels);
    if let Some(peel) = peels.iter().find(|peel| peel.depth.is_none()) {
        return Err(Error::input("an element has no depth channel, so that it cannot be merged")
            .in_file(&about.name)
            .with("found", peel.found.clone())
            .help("render it with its depth, or name that with `depth_channel`"));
    }
    let depth_channel = peels.first().map_or_else(String::new, |peel| peel.depth_channel.clone());
    let depths = peels.first().and_then(|peel| peel.depth.as_ref()).map_or(&[][..], Plane::values);
    let convention = convention_of(&about, (&depth_channel, depths), options);
    let (camera, _) = camera::values(&about.attributes);
    let supersample = options.supersample.or(camera.supersample).unwrap_or(1);
    let announced = Announced { kind: options.kind.or(camera.kind), supersample };
    let (peels, completed) = completed(peels, convention, announced);
    about.findings.extend(completed);
    let about = Layers { is_merged: true, beauty: None, ..about };
    Ok(Elements { elements: vec![Element::Flat(peels)], about, convention, names: Vec::new(), depth_channel })
}

/// The peels of a file with the depths that their edges lack, if all have one window, and what was done.
fn completed(
    layers: Vec<Layer>,
    convention: DepthConvention,
    announced: Announced,
) -> (Vec<Layer>, Vec<Finding>) {
    if layers.windows(2).any(|pair| pair[0].window != pair[1].window) {
        return (layers, Vec::new());
    }
    let mut findings = Vec::new();
    let mut others = Vec::new();
    let mut peels: Vec<Peel> = Vec::new();
    for layer in layers {
        let Layer { color, alpha, depth, .. } = layer;
        peels.push(Peel { color, alpha, depth: depth.unwrap_or_default() });
        others.push((layer.window, layer.prefix, layer.depth_channel, layer.found));
    }
    findings.extend(DepthValues::of(&peels).turn_around(&mut peels, convention));
    if let [picture] = peels.as_mut_slice()
        && announced.is_beauty()
    {
        findings.extend(filtered_depth::unblend(picture, convention));
    }
    if announced.kind != Some(StackKind::Coverage) {
        findings.extend(rim_depth::complete(&mut peels, convention));
    }
    let layers = peels.into_iter().zip(others).map(|(peel, (window, prefix, depth_channel, found))| {
        let Peel { color, alpha, depth } = peel;
        Layer { color, alpha, depth: Some(depth), window, prefix, depth_channel, found }
    });
    (layers.collect(), findings)
}

impl Elements {
    /// Adds the elements of another file.
    ///
    /// # Errors
    /// Elements of another frame, or with depth in another convention.
    pub(super) fn add(&mut self, more: Self) -> Result<(), Error> {
        let (own, other) = (self.about.frame.display, more.about.frame.display);
        if own != other {
            return Err(Error::input("the elements are of different frames")
                .with("found", format!("display window {own} in {}", self.about.name.display()))
                .with("found", format!("display window {other} in {}", more.about.name.display()))
                .help("render all elements of a picture with one display window"));
        }
        if self.convention != more.convention {
            return Err(Error::input("the elements have depth of different conventions")
                .with("found", format!("{:?} in {}", self.convention, self.about.name.display()))
                .with("found", format!("{:?} in {}", more.convention, more.about.name.display()))
                .help("write depth of all elements alike, or set `convention`"));
        }
        let about = more.about;
        self.about.replaced.add(about.replaced);
        let new: Vec<Finding> =
            about.findings.into_iter().filter(|finding| !self.about.findings.contains(finding)).collect();
        self.about.findings.extend(new);
        if about.precision == Precision::Float {
            self.about.precision = Precision::Float;
        }
        if about.color_range == ColorRange::Unbounded {
            self.about.color_range = ColorRange::Unbounded;
        }
        self.elements.extend(more.elements);
        self.names.extend(more.names);
        Ok(())
    }

    /// The smallest window around all elements, whatever rows are read.
    pub(super) fn window(&self) -> Window {
        let windows = self.elements.iter().flat_map(Element::windows).filter(|window| window.height > 0);
        windows.reduce(windows::joined).unwrap_or(self.about.frame.data)
    }
}

impl Element {
    /// The windows of its pixels, whatever rows are read.
    pub(super) fn windows(&self) -> Vec<Window> {
        match self {
            Self::Deep(element) => vec![element.window()],
            Self::Flat(peels) => peels.iter().map(|peel| peel.window).collect(),
        }
    }

    /// What was replaced in the rows that were loaded so far.
    pub(super) fn replaced(&self) -> Replaced {
        match self {
            Self::Deep(element) => element.replaced(),
            Self::Flat(_) => Replaced::default(),
        }
    }

    /// Makes the rows of `strip` available within `max_bytes`.
    ///
    /// # Errors
    /// Those of [`DeepElement::load`].
    pub(super) fn load(&mut self, strip: Window, max_bytes: u64) -> Result<(), Error> {
        match self {
            Self::Deep(element) => element.load(strip.y..strip.y + strip.height as i32, max_bytes),
            Self::Flat(_) => Ok(()),
        }
    }

    /// Appends the samples of pixel `x`, `y`.
    pub(super) fn append(&self, x: i32, y: i32, far: &FarDepth, samples: &mut Vec<Sample>) {
        match self {
            Self::Deep(element) => element.append(x, y, far, samples),
            Self::Flat(peels) => samples.extend(peels.iter().filter_map(|peel| sample_of(peel, x, y, far))),
        }
    }
}

/// What a peel has at pixel `x`, `y`; `None` where it is empty.
fn sample_of(peel: &Layer, x: i32, y: i32, far: &FarDepth) -> Option<Sample> {
    let Window { width, height, .. } = peel.window;
    let column = usize::try_from(x - peel.window.x).ok().filter(|&column| column < width)?;
    let row = usize::try_from(y - peel.window.y).ok().filter(|&row| row < height)?;
    let distance = far.of(peel.depth.as_ref()?.get(column, row));
    let color = peel.color.each_ref().map(|plane| plane.get(column, row));
    let sample = Sample { front: distance, back: distance, color, alpha: peel.alpha.get(column, row) };
    (!sample.is_empty()).then_some(sample)
}
