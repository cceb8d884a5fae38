//! Several elements of one picture, merged by depth: deep files, and stacks or pictures with depth that were rendered apart.
//!
//! Every pixel's samples of all elements are put in order together, so that volumes of several files mix where they overlap. Some rows
//! are in memory at a time; the peels grow with the pixel that has the most fragments, up to [`MOST_PEELS`].

use super::convention::{self, Evidence};
use super::deep::{self, DeepElement, DeepFile, Sample, Tidier};
use super::depth::FarDepth;
use super::layers::{Layer, Layers};
use super::merged_peels::{Peels, Row};
use super::options::{Carry, ReadOptions, Source};
use super::sanitise::Replaced;
use super::{ColorRange, Frame, Peel, Precision, Window, camera, guard};
use crate::error::Error;
use crate::finding::Finding;
use crate::settings::DepthConvention;
use exr::meta::attribute::{AttributeValue, Text};
use rayon::prelude::*;
use std::ops::Range;

/// Most peels of a merged stack. Fragments of a pixel beyond them are merged with those beside them in depth.
pub(super) const MOST_PEELS: usize = 16;
/// Rows that are in memory at a time.
const STRIP_ROWS: usize = 32;
/// Most names of files in a finding.
const LISTED: usize = 8;

/// Attributes of a header.
type Attributes = Vec<(Text, AttributeValue)>;

/// A reader of files without deep parts.
type ReadFlat<'a> = &'a dyn Fn(&Source, &ReadOptions) -> Result<Layers, Error>;

/// Fragments that are in one place of the picture.
#[derive(Debug)]
enum Element {
    /// Deep samples.
    Deep(DeepElement),
    /// The peels of a file, all with depth.
    Flat(Vec<Layer>),
}

/// The elements of a picture.
#[derive(Debug)]
struct Shot {
    elements: Vec<Element>,
    /// Base names of the files.
    names: Vec<String>,
    /// What is known of the first file, without its peels; the findings and counts of all.
    about: Layers,
    convention: DepthConvention,
    /// Full name of the first depth channel.
    depth_channel: String,
}

/// What merging did, in numbers.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    samples: u64,
    /// Samples that are volumes.
    volumes: u64,
    /// Most samples of a pixel.
    most: usize,
    /// Pixels with more fragments than a stack has peels.
    reduced: u64,
}

/// Whether `sources` are elements of one picture, to be merged by depth: as `options` say, and where one of them is deep.
///
/// # Errors
/// A file that cannot be opened or read.
pub(super) fn are_elements(sources: &[Source], options: &ReadOptions) -> Result<bool, Error> {
    if options.merge {
        return Ok(true);
    }
    for source in sources {
        if deep::is_deep(source)? {
            return Ok(true);
        }
    }
    Ok(false)
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
    /// The extent of the deep file `source`, from its tables, and the attributes of its header.
    ///
    /// # Errors
    /// Those of opening it, and damaged tables.
    pub(super) fn of_deep(source: &Source, options: &ReadOptions) -> Result<(Self, Attributes), Error> {
        let mut shot = of_deep(deep::open(source, options)?, options);
        let window = shot.window(None);
        let (mut peels, mut strip_bytes) = (0_u64, 0);
        for element in &mut shot.elements {
            let Element::Deep(element) = element else { continue };
            let most = element.most_samples()?;
            // A volume may be cut into any number of slices.
            peels += if most > 0 && element.has_volumes() { MOST_PEELS as u64 } else { u64::from(most) };
            strip_bytes += element.largest_strip_bytes(STRIP_ROWS);
        }
        let peels = peels.clamp(1, MOST_PEELS as u64) as usize;
        Ok((Self { window, peels, strip_bytes }, shot.about.attributes))
    }

    /// That of two elements together.
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            window: united(self.window, other.window),
            peels: (self.peels + other.peels).min(MOST_PEELS),
            strip_bytes: self.strip_bytes.saturating_add(other.strip_bytes),
        }
    }
}

/// The stack of the fragments of all `sources`, sorted by depth.
///
/// # Errors
/// Those of reading, elements of different frames or depth conventions, more memory than allowed.
pub(super) fn read_merged(
    sources: &[Source],
    options: &ReadOptions,
    read_flat: ReadFlat<'_>,
) -> Result<Layers, Error> {
    // Channels beside the peels belong to one element, not to the picture.
    let of_element = ReadOptions { carry: Carry::None, objects: false, ..options.clone() };
    let mut shot = open(sources, &of_element, read_flat)?;
    let data = shot.window(options.rows.as_ref());
    let limit = options.max_bytes.unwrap_or_else(guard::default_max_bytes);
    let (peels, counts) = merge(&mut shot.elements, data, shot.convention, limit)
        .map_err(|error| error.in_file(&shot.about.name))?;
    Ok(shot.into_layers(peels, counts, data))
}

/// The peels of the fragments of two elements without deep samples, sorted by depth, and their data window.
///
/// # Errors
/// More memory than allowed.
pub(super) fn merge_layers(
    elements: [Vec<Layer>; 2],
    convention: DepthConvention,
    max_bytes: u64,
) -> Result<(Vec<Peel>, Window), Error> {
    let mut elements = elements.map(Element::Flat);
    let windows = elements.iter().flat_map(Element::windows).filter(|window| window.height > 0);
    let data = windows.reduce(united).unwrap_or(Window { x: 0, y: 0, width: 0, height: 0 });
    merge(&mut elements, data, convention, max_bytes).map(|(peels, _)| (peels.into_peels(), data))
}

/// The peels of the fragments of `elements` in the window `data`, and what merging did.
fn merge(
    elements: &mut [Element],
    data: Window,
    convention: DepthConvention,
    max_bytes: u64,
) -> Result<(Peels, Counts), Error> {
    let mut peels = Peels::new(data, convention, max_bytes);
    let mut counts = Counts::default();
    for top in (0..data.height).step_by(STRIP_ROWS) {
        let height = STRIP_ROWS.min(data.height - top);
        let strip = Window { y: data.y + top as i32, height, ..data };
        let (rows, of_strip) = rows_of(elements, strip, convention, max_bytes.saturating_sub(peels.bytes()))?;
        counts.add(of_strip);
        peels.put(top, &rows)?;
    }
    Ok((peels, counts))
}

/// The fragments of the rows of `strip`.
fn rows_of(
    elements: &mut [Element],
    strip: Window,
    convention: DepthConvention,
    max_bytes: u64,
) -> Result<(Vec<Row>, Counts), Error> {
    elements.iter_mut().try_for_each(|element| element.load(strip, max_bytes))?;
    let (elements, far) = (&*elements, FarDepth::new(convention));
    let of_row = |y: usize| merged_row(elements, Window { y: strip.y + y as i32, height: 1, ..strip }, &far);
    let rows: Vec<(Row, Counts)> = (0..strip.height).into_par_iter().map(of_row).collect();
    let mut counts = Counts::default();
    rows.iter().for_each(|(_, of_row)| counts.add(*of_row));
    Ok((rows.into_iter().map(|(row, _)| row).collect(), counts))
}

/// Opens all elements, and checks that they are of one picture.
fn open(sources: &[Source], options: &ReadOptions, read_flat: ReadFlat<'_>) -> Result<Shot, Error> {
    let mut shot: Option<Shot> = None;
    for source in sources {
        let more = if deep::is_deep(source)? {
            of_deep(deep::open(source, options)?, options)
        } else {
            of_flat(read_flat(source, options)?, options)?
        };
        let more = Shot { names: vec![source.base_name()], ..more };
        match &mut shot {
            None => shot = Some(more),
            Some(shot) => shot.add(more)?,
        }
    }
    shot.ok_or_else(|| Error::settings("there is no input file").help("name a picture file"))
}

/// How depth is written in a file with these attributes.
fn convention_of(about: &Layers, depth_channel: &str, options: &ReadOptions) -> DepthConvention {
    let (camera, _) = camera::values(&about.attributes);
    let attributes = &about.attributes;
    let (chosen, header) = (options.convention, camera.convention);
    convention::conclude(Evidence { chosen, header, attributes, depth_channel }).0.convention
}

fn of_deep(file: DeepFile, options: &ReadOptions) -> Shot {
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
    let convention = convention_of(&about, &depth_channel, options);
    let elements = elements.into_iter().map(Element::Deep).collect();
    Shot { elements, names: Vec::new(), about, convention, depth_channel }
}

fn of_flat(layers: Layers, options: &ReadOptions) -> Result<Shot, Error> {
    let mut about = layers;
    let peels = std::mem::take(&mut about.peels);
    if let Some(peel) = peels.iter().find(|peel| peel.depth.is_none()) {
        return Err(Error::input("an element has no depth channel, so that it cannot be merged")
            .in_file(&about.name)
            .with("found", peel.found.clone())
            .help("render it with its depth, or name that with `depth_channel`"));
    }
    let depth_channel = peels.first().map_or_else(String::new, |peel| peel.depth_channel.clone());
    let convention = convention_of(&about, &depth_channel, options);
    let about = Layers { is_merged: true, beauty: None, ..about };
    Ok(Shot { elements: vec![Element::Flat(peels)], names: Vec::new(), about, convention, depth_channel })
}

impl Element {
    /// The windows of its pixels, whatever rows are read.
    fn windows(&self) -> Vec<Window> {
        match self {
            Self::Deep(element) => vec![element.window()],
            Self::Flat(peels) => peels.iter().map(|peel| peel.window).collect(),
        }
    }

    /// Makes the rows of `strip` available within `max_bytes`.
    fn load(&mut self, strip: Window, max_bytes: u64) -> Result<(), Error> {
        match self {
            Self::Deep(element) => element.load(strip.y..strip.y + strip.height as i32, max_bytes),
            Self::Flat(_) => Ok(()),
        }
    }

    /// Appends the samples of pixel `x`, `y`.
    fn append(&self, x: i32, y: i32, far: &FarDepth, samples: &mut Vec<Sample>) {
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

impl Shot {
    /// Adds the elements of another file.
    fn add(&mut self, more: Self) -> Result<(), Error> {
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

    /// The smallest window around those of all elements, or its rows `rows`.
    fn window(&self, rows: Option<&Range<i32>>) -> Window {
        let windows = self.elements.iter().flat_map(Element::windows).filter(|window| window.height > 0);
        let whole = windows.reduce(united).unwrap_or(self.about.frame.data);
        let Some(rows) = rows else { return whole };
        let end = whole.y + whole.height as i32;
        let y = rows.start.clamp(whole.y, end);
        Window { y, height: (rows.end.clamp(y, end) - y) as usize, ..whole }
    }

    /// The stack of `peels`, of the pixels in `data`.
    fn into_layers(self, peels: Peels, counts: Counts, data: Window) -> Layers {
        let Self { elements, names, about, depth_channel, .. } = self;
        let (mut findings, mut replaced) = (about.findings, about.replaced);
        for element in &elements {
            if let Element::Deep(element) = element {
                replaced.add(element.replaced());
            }
        }
        findings.push(counts.finding(&names));
        let frame = Frame { data, ..about.frame };
        let peels = peels.into_layers(&depth_channel);
        Layers { peels, frame, findings, replaced, ..about }
    }
}

/// The fragments of one row of pixels.
fn merged_row(elements: &[Element], row: Window, far: &FarDepth) -> (Row, Counts) {
    let (mut merged, mut counts) = (Row::default(), Counts::default());
    let (mut samples, mut tidier) = (Vec::new(), Tidier::default());
    for column in 0..row.width as i32 {
        samples.clear();
        elements.iter().for_each(|element| element.append(row.x + column, row.y, far, &mut samples));
        counts.samples += samples.len() as u64;
        counts.volumes += samples.iter().filter(|sample| sample.is_volume()).count() as u64;
        counts.most = counts.most.max(samples.len());
        let is_reduced = deep::reduce(tidier.tidy(&mut samples), MOST_PEELS, &mut merged.fragments);
        counts.reduced += u64::from(is_reduced);
        merged.ends.push(merged.fragments.len());
    }
    (merged, counts)
}

/// The smallest window around two.
fn united(a: Window, b: Window) -> Window {
    let span = |a: (i32, usize), b: (i32, usize)| {
        let start = a.0.min(b.0);
        // Coordinates are below 2^30 (see `guard`).
        let end = |(start, size): (i32, usize)| start + size as i32;
        (start, (end(a).max(end(b)) - start) as usize)
    };
    let (x, width) = span((a.x, a.width), (b.x, b.width));
    let (y, height) = span((a.y, a.height), (b.y, b.height));
    Window { x, y, width, height }
}

impl Counts {
    fn add(&mut self, other: Self) {
        self.samples += other.samples;
        self.volumes += other.volumes;
        self.most = self.most.max(other.most);
        self.reduced += other.reduced;
    }

    /// What was merged, in words.
    fn finding(self, names: &[String]) -> Finding {
        let Self { samples, volumes, most, reduced } = self;
        let mut text = match names {
            [_] => format!("{samples} samples, at most {most} a pixel"),
            _ => {
                let more = if names.len() > LISTED { ", …" } else { "" };
                let list = names.iter().take(LISTED).cloned().collect::<Vec<_>>().join(", ");
                format!(
                    "{samples} samples of {} files, at most {most} a pixel, merged by depth: {list}{more}",
                    names.len()
                )
            }
        };
        if volumes > 0 {
            text.push_str(&format!("; {volumes} are volumes, split where others begin or end"));
        }
        if reduced > 0 {
            text.push_str(&format!(
                "; in {reduced} pixels those beyond {MOST_PEELS} were merged with their neighbours"
            ));
        }
        Finding::note("merge", text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_of_a_picture_holds_those_of_its_elements() {
        let a = Window { x: -5, y: 2, width: 10, height: 4 };
        let b = Window { x: 20, y: 0, width: 1, height: 1 };
        assert_eq!(united(a, b), Window { x: -5, y: 0, width: 26, height: 6 });
        assert_eq!(united(a, a), a);
    }
}
