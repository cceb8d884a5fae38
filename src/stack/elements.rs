//! Elements of one picture, before they are merged: deep files, and stacks or pictures with depth that were rendered apart.

use super::convention::{self, Conclusion, Evidence};
use super::deep::{DeepElement, DeepFile, Sample};
use super::depth::FarDepth;
use super::kind::Announced;
use super::layers::Layers;
use super::options::ReadOptions;
use super::plausible::{self, Known};
use super::sanitise::Replaced;
use super::{
    ColorRange, Peel, Precision, StackKind, Window, camera, filtered_depth, join, rim_depth, windows,
};
use crate::error::Error;
use crate::finding::Finding;
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
    /// Peels, all of one window.
    Flat {
        /// The peels.
        peels: Vec<Peel>,
        /// Their window.
        window: Window,
    },
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
fn conclusion(
    attributes: &Attributes,
    (depth_channel, depths): (&str, &[f32]),
    options: &ReadOptions,
) -> Conclusion {
    let (camera, _) = camera::values(attributes);
    let (chosen, header) = (options.convention, camera.convention);
    convention::conclude(Evidence { chosen, header, attributes, depth_channel, depths }).0
}

/// The elements of a deep file.
///
/// # Errors
/// Normalised depth with 1 near.
pub(super) fn of_deep(file: DeepFile, options: &ReadOptions) -> Result<Elements, Error> {
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
    let convention = conclusion(&about.attributes, (&depth_channel, &[]), options).convention;
    let elements = elements.into_iter().map(|element| Element::Deep(Box::new(element))).collect();
    let (camera, _) = camera::values(&about.attributes);
    if plausible::near_is_one(convention, Known { options, camera: &camera, has_8_bits: false }) {
        return Err(Error::unsupported("deep samples with 1 near cannot be read")
            .in_file(&about.name)
            .help("write depth that grows with the distance"));
    }
    Ok(Elements { elements, about, convention, names: Vec::new(), depth_channel })
}

/// The element of a file without deep parts: its peels in one window, with depth that is corrected and completed before it is merged with
/// what is behind it.
///
/// # Errors
/// A peel without depth; depth that cannot be any; peels too far apart.
pub(super) fn of_flat(layers: Layers, options: &ReadOptions) -> Result<Elements, Error> {
    let (camera, _) = camera::values(&layers.attributes);
    let mut about = join::join(layers, (options, camera.supersample))?;
    let in_file = |error: Error| error.in_file(&about.name);
    let (window, layers) = (about.frame.data, std::mem::take(&mut about.peels));
    let depth_channel = layers.first().map_or_else(String::new, |layer| layer.depth_channel.clone());
    // What surfaces reflect is not merged.
    let peel = |(i, layer)| join::placed(i, layer, window).map(|(peel, _)| peel);
    let placed = layers.into_iter().enumerate().map(peel);
    let mut peels = placed.collect::<Result<Vec<Peel>, Error>>().map_err(in_file)?;
    let depths = peels.first().map_or(&[][..], |peel| peel.depth.values());
    let conclusion = conclusion(&about.attributes, (&depth_channel, depths), options);
    let convention = conclusion.convention;
    let known = Known { options, camera: &camera, has_8_bits: false };
    let mut findings = plausible::correct_values(&mut peels, conclusion, known).map_err(in_file)?;
    let supersample = options.supersample.or(camera.supersample).unwrap_or(1);
    let announced = Announced { kind: options.kind.or(camera.kind), supersample };
    if let [picture] = peels.as_mut_slice()
        && announced.is_beauty()
    {
        findings.extend(filtered_depth::unblend(picture, convention));
    }
    if announced.kind != Some(StackKind::Coverage) {
        findings.extend(rim_depth::complete(&mut peels, convention));
    }
    findings.splice(0..0, std::mem::take(&mut about.findings));
    let about = Layers { is_merged: true, beauty: None, findings, ..about };
    let elements = vec![Element::Flat { peels, window }];
    Ok(Elements { elements, about, convention, names: Vec::new(), depth_channel })
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
        let windows = self.elements.iter().map(Element::window).filter(|window| window.height > 0);
        windows.reduce(windows::joined).unwrap_or(self.about.frame.data)
    }
}

impl Element {
    /// The window of its pixels, whatever rows are read.
    pub(super) fn window(&self) -> Window {
        match self {
            Self::Deep(element) => element.window(),
            Self::Flat { window, .. } => *window,
        }
    }

    /// What was replaced in the rows that were loaded so far.
    pub(super) fn replaced(&self) -> Replaced {
        match self {
            Self::Deep(element) => element.replaced(),
            Self::Flat { .. } => Replaced::default(),
        }
    }

    /// Makes the rows of `strip` available within `max_bytes`.
    ///
    /// # Errors
    /// Those of [`DeepElement::load`].
    pub(super) fn load(&mut self, strip: Window, max_bytes: u64) -> Result<(), Error> {
        match self {
            Self::Deep(element) => element.load(strip.y..strip.y + strip.height as i32, max_bytes),
            Self::Flat { .. } => Ok(()),
        }
    }

    /// Appends the samples of pixel `x`, `y`.
    pub(super) fn append(&self, x: i32, y: i32, far: &FarDepth, samples: &mut Vec<Sample>) {
        match self {
            Self::Deep(element) => element.append(x, y, far, samples),
            Self::Flat { peels, window } => {
                let Some(at) = place_in(*window, x, y) else { return };
                samples.extend(peels.iter().filter_map(|peel| sample_of(peel, at, far)));
            }
        }
    }
}

/// Column and row of pixel `x`, `y` in `window`.
fn place_in(window: Window, x: i32, y: i32) -> Option<(usize, usize)> {
    let column = usize::try_from(x - window.x).ok().filter(|&column| column < window.width)?;
    let row = usize::try_from(y - window.y).ok().filter(|&row| row < window.height)?;
    Some((column, row))
}

/// What a peel has at a column and row; `None` where it is empty.
fn sample_of(peel: &Peel, (column, row): (usize, usize), far: &FarDepth) -> Option<Sample> {
    let distance = far.of(peel.depth.get(column, row));
    let color = peel.color.each_ref().map(|plane| plane.get(column, row));
    let sample = Sample { front: distance, back: distance, color, alpha: peel.alpha.get(column, row) };
    (!sample.is_empty()).then_some(sample)
}
