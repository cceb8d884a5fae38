//! Several elements of one picture, merged by depth: deep files, and stacks or pictures with depth that were rendered apart.
//!
//! Every pixel's samples of all elements are put in order together, so that volumes of several files mix where they overlap. Some rows
//! are in memory at a time; the peels grow with the pixel that has the most fragments, up to [`MOST_PEELS`].

use super::deep::{self, Tidier};
use super::depth::FarDepth;
use super::elements::{self, Element, Elements, MOST_PEELS, STRIP_ROWS};
use super::layers::Layers;
use super::merged_peels::{Peels, Row};
use super::options::{Carry, ReadOptions};
use super::{Frame, Peel, Source, Window, guard, windows};
use crate::error::Error;
use crate::finding::Finding;
use crate::parallel;
use crate::settings::DepthConvention;
use std::ops::Range;

/// Most names of files in a finding.
const LISTED: usize = 8;

/// A reader of files without deep parts.
type ReadFlat<'a> = &'a dyn Fn(&Source, &ReadOptions) -> Result<Layers, Error>;

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
    let mut all = open(sources, &of_element, read_flat)?;
    let data = cropped(all.window(), options.rows.as_ref());
    let limit = options.max_bytes.unwrap_or_else(guard::default_max_bytes);
    let (peels, counts) = merge((&mut all.elements, all.convention), data, limit)
        .map_err(|error| error.in_file(&all.about.name))?;
    let Elements { elements, names, about, depth_channel, .. } = all;
    let mut replaced = about.replaced;
    elements.iter().for_each(|element| replaced.add(element.replaced()));
    let findings = [about.findings, vec![counts.finding(&names)]].concat();
    let frame = Frame { data, ..about.frame };
    Ok(Layers { peels: peels.into_layers(&depth_channel), frame, findings, replaced, ..about })
}

/// The fragments of two lots of peels, each with its window, sorted by depth, and their data window.
///
/// # Errors
/// More memory than allowed.
pub(super) fn merge_peels(
    elements: [(Vec<Peel>, Window); 2],
    convention: DepthConvention,
    max_bytes: u64,
) -> Result<(Vec<Peel>, Window), Error> {
    let [one, other] = elements.each_ref().map(|(_, window)| *window);
    let data = windows::joined(one, other);
    let mut elements = elements.map(|(peels, window)| Element::Flat { peels, window });
    merge((&mut elements, convention), data, max_bytes).map(|(peels, _)| (peels.into_peels(), data))
}

/// The peels of the fragments of elements, with their depth convention, in the window `data`, and what merging did.
fn merge(
    (elements, convention): (&mut [Element], DepthConvention),
    data: Window,
    max_bytes: u64,
) -> Result<(Peels, Counts), Error> {
    let mut peels = Peels::new(data, convention, max_bytes);
    let mut counts = Counts::default();
    for top in (0..data.height).step_by(STRIP_ROWS) {
        let height = STRIP_ROWS.min(data.height - top);
        let strip = Window { y: data.y + top as i32, height, ..data };
        let rest = max_bytes.saturating_sub(peels.bytes());
        let (rows, of_strip) = merged_rows((&mut *elements, convention), strip, rest)?;
        counts.add(of_strip);
        peels.put(top, &rows)?;
    }
    Ok((peels, counts))
}

/// Opens all elements, and checks that they are of one picture.
fn open(sources: &[Source], options: &ReadOptions, read_flat: ReadFlat<'_>) -> Result<Elements, Error> {
    let mut all: Option<Elements> = None;
    for source in sources {
        let more = if deep::is_deep(source)? {
            elements::of_deep(deep::open(source, options)?, options)?
        } else {
            elements::of_flat(read_flat(source, options)?, options)?
        };
        let more = Elements { names: vec![source.base_name()], ..more };
        match &mut all {
            None => all = Some(more),
            Some(all) => all.add(more)?,
        }
    }
    all.ok_or_else(|| Error::settings("there is no input file").help("name a picture file"))
}

/// The rows `rows` of a window, by their `y`; all if `None`.
fn cropped(whole: Window, rows: Option<&Range<i32>>) -> Window {
    let Some(rows) = rows else { return whole };
    let end = whole.y + whole.height as i32;
    let y = rows.start.clamp(whole.y, end);
    Window { y, height: (rows.end.clamp(y, end) - y) as usize, ..whole }
}

/// The fragments of the rows of `strip`.
fn merged_rows(
    (elements, convention): (&mut [Element], DepthConvention),
    strip: Window,
    max_bytes: u64,
) -> Result<(Vec<Row>, Counts), Error> {
    elements.iter_mut().try_for_each(|element| element.load(strip, max_bytes))?;
    let (elements, far) = (&*elements, FarDepth::new(convention));
    let of_row = |y: usize| merged_row(elements, Window { y: strip.y + y as i32, height: 1, ..strip }, &far);
    let rows: Vec<(Row, Counts)> = parallel::map(strip.height, &of_row);
    let mut counts = Counts::default();
    rows.iter().for_each(|(_, of_row)| counts.add(*of_row));
    Ok((rows.into_iter().map(|(row, _)| row).collect(), counts))
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
