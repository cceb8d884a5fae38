//! Reading: from input files to a [`Stack`].

use super::convention::{self, Evidence};
use super::header::ExrFile;
use super::input::Opened;
use super::kind::Announced;
use super::layers::{self, Beauty, Layer, Layers};
use super::options::{Carry, ReadOptions};
use super::plausible::{self, Depths, Known};
use super::windows::{self, place_depth};
use super::{
    Antialiasing, Carried, CarriedChannel, CheckedPicture, ColorRange, Cryptomatte, Frame, FramedImage, Peel,
    Shading, Source, Stack, StackKind, Window, alpha, background_share, beauty, camera, carried, cryptomatte,
    filtered_depth, guard, holdout, join, kind, light, merge_files, names, no_peel, order, picture,
    rim_depth, shading, views, writer,
};
use crate::error::Error;
use crate::finding::Finding;
use crate::image::Image;
use crate::settings::{DepthConvention, Values};
use exr::meta::attribute::{AttributeValue, Text};
use std::path::Path;

/// Number of peels that are listed; of more, the last stands for the rest.
const LISTED: usize = 12;

/// Reads one stack from `sources`: one multi-layer or multi-part EXR, one file per peel nearest first, or one picture with
/// its depth.
///
/// Blocks are decompressed in the rayon pool of the caller.
///
/// # Errors
/// Missing or invalid input, with the file and the setting that helps.
pub fn read(sources: &[Source], options: &ReadOptions) -> Result<Stack, Error> {
    let Some((first, others)) = sources.split_first() else {
        return Err(Error::settings("there is no input file").help("name a picture file"));
    };
    views::check_files(sources)?;
    let is_merged = merge_files::are_elements(sources, options)?;
    if is_merged && let Some(path) = &options.depth_file {
        return Err(Error::settings("merged elements have their own depth")
            .with("found", format!("the depth file {}", path.display()))
            .help("leave `depth_file` out"));
    }
    if !is_merged && options.depth_file.is_none() {
        no_peel::check_names(sources)?;
    }
    let mut stack = if is_merged {
        merge_files::read_merged(sources, options, &read_layers)?
    } else {
        read_layers(first, options)?
    };
    stack.is_numbered = !is_merged && no_peel::are_numbered(sources);
    match (others, &options.depth_file) {
        _ if is_merged => {}
        ([], None) => {}
        ([], Some(path)) => add_depth(&mut stack, &options.held.source(path), options)?,
        ([depth], None) if stack.lacks_depth() && !has_color(depth)? => {
            add_depth(&mut stack, depth, options)?;
        }
        ([depth], None) if stack.lacks_depth() && is_grey_picture(depth, options)? => {
            add_depth(&mut stack, depth, options)?;
        }
        (peels, None) => {
            for source in peels {
                let options = within_rest(options, &stack);
                add_peels(&mut stack, source, &options)?;
            }
        }
        (_, Some(path)) => {
            return Err(Error::settings("a depth file requires a single colour picture")
                .with("found", format!("{} pictures and the depth file {}", sources.len(), path.display())));
        }
    }
    if let Some(path) = &options.beauty {
        let (beauty, findings) = read_beauty(&options.held.source(path), &within_rest(options, &stack))
            .map_err(|error| error.with("used as", "`beauty`"))?;
        stack.beauty = Some(beauty);
        stack.findings.extend(findings);
    }
    let stack = finish(stack, options)?;
    match &options.holdout {
        Some(path) => holdout::apply(stack, &options.held.source(path), options, &read),
        None => Ok(stack),
    }
}

/// `options` with the memory that `stack`, which is decoded, leaves of their limit.
fn within_rest(options: &ReadOptions, stack: &Layers) -> ReadOptions {
    let limit = options.max_bytes.unwrap_or_else(guard::default_max_bytes);
    ReadOptions { max_bytes: Some(limit.saturating_sub(stack.decoded_bytes())), ..options.clone() }
}

/// Reads the main picture of a file of any supported format, scene-linear, as `score` compares it.
///
/// In an EXR this is `R G B A` at the root, else `Combined`, else the only group with `R G B`.
///
/// # Errors
/// As [`read`].
pub fn read_picture(path: &Path) -> Result<Image, Error> {
    read_framed_picture(path).map(|picture| picture.image)
}

/// [`read_picture`], with the picture's windows.
///
/// # Errors
/// As [`read`].
pub fn read_framed_picture(path: &Path) -> Result<FramedImage, Error> {
    read_framed(&Source::file(path), &ReadOptions::default())
}

/// The main picture of `source`, as [`read_framed_picture`] reads it, within the limits of `options`.
///
/// # Errors
/// As [`read`].
pub fn read_framed(source: &Source, options: &ReadOptions) -> Result<FramedImage, Error> {
    read_main_layer(source, options).map(framed)
}

/// [`read_framed`], with what was replaced in the picture.
///
/// # Errors
/// As [`read`].
pub fn read_checked(source: &Source, options: &ReadOptions) -> Result<CheckedPicture, Error> {
    let (layer, layers) = read_main_layer(source, options)?;
    let replaced = layers.replaced;
    let mut broken = Vec::new();
    if replaced.nan + replaced.infinite > 0 {
        let mut opened = Opened::open(source)?;
        if opened.is_exr()? {
            broken = layers::broken_pixels(ExrFile::open(opened)?, options)?;
        }
    }
    Ok(CheckedPicture { picture: framed((layer, layers)), replaced: replaced.finding(), broken })
}

/// The main layer of a file as a picture with its windows.
fn framed((layer, Layers { frame, .. }): (Layer, Layers)) -> FramedImage {
    let Layer { color: [red, green, blue], alpha, window, .. } = layer;
    let image = Image { planes: [red, green, blue, alpha] };
    FramedImage { image, frame: Frame { data: window, ..frame } }
}

/// Reads the main picture of a file as the beauty of a stack, with what was found of it.
fn read_beauty(source: &Source, options: &ReadOptions) -> Result<(Beauty, Vec<Finding>), Error> {
    let (layer, Layers { frame, findings, replaced, .. }) = read_main_layer(source, options)?;
    let name = source.name().display().to_string();
    let of_beauty = |finding: Finding| {
        let text = format!("{name}: {}: {}", finding.about, finding.text);
        Finding { about: "beauty", text, ..finding }
    };
    let findings = findings.into_iter().chain(replaced.finding()).map(of_beauty).collect();
    Ok((Beauty { name, is_requested: true, ..layer.into_beauty(frame) }, findings))
}

/// The main picture of a file, of its hero view or of the one that `options` request, or the rows of it, and what else is known of it.
pub(super) fn read_main_layer(source: &Source, options: &ReadOptions) -> Result<(Layer, Layers), Error> {
    let mut opened = Opened::open(source)?;
    let mut layers = if opened.is_exr()? {
        let file = ExrFile::open(opened)?;
        let view = options.view.as_deref().filter(|_| !file.views().is_empty());
        let file = if view.is_some() { file.of_view(view)? } else { file.of_hero() };
        layers::read_exr_picture(file.cropped(options.rows.clone()), options)?
    } else {
        picture::read_color(opened, options)?
    };
    match layers.peels.pop() {
        Some(layer) => Ok((layer, layers)),
        None => Err(Error::input("there are no colour channels").in_file(source.name())),
    }
}

impl Layers {
    /// Bytes of the decoded peels and channels.
    fn decoded_bytes(&self) -> u64 {
        let samples = |window: Window| (window.width as u64).saturating_mul(window.height as u64);
        let peels: u64 = self.peels.iter().map(|peel| 20 * samples(peel.window)).sum();
        peels.saturating_add(4 * self.channels.len() as u64 * samples(self.frame.data))
    }

    fn lacks_depth(&self) -> bool {
        self.peels.len() == 1 && self.peels[0].depth.is_none()
    }

    /// Names a file's only peel after the file: view layers have the same name in all files.
    fn name_after_file(&mut self) {
        if let [peel] = self.peels.as_mut_slice() {
            peel.prefix = self.name.file_name().unwrap_or_default().to_string_lossy().into_owned();
        }
    }
}

fn read_layers(source: &Source, options: &ReadOptions) -> Result<Layers, Error> {
    let mut opened = Opened::open(source)?;
    if opened.is_exr()? {
        let file = ExrFile::open(opened)?.of_requested_view(options)?;
        layers::read_exr(file.cropped(options.rows.clone()), options)
    } else {
        picture::read_color(opened, options)
    }
}

fn has_color(source: &Source) -> Result<bool, Error> {
    let mut opened = Opened::open(source)?;
    // A second picture that is not OpenEXR can only be depth.
    Ok(opened.is_exr()? && names::has_color(&ExrFile::open(opened)?.of_hero().names()))
}

/// Whether `source` has one picture, without depth, whose three channels are equal everywhere: depth that was written as colour.
fn is_grey_picture(source: &Source, options: &ReadOptions) -> Result<bool, Error> {
    let options = ReadOptions { carry: Carry::None, objects: false, ..options.clone() };
    let layers = read_layers(source, &options)?;
    let [Layer { color: [red, green, blue], depth: None, .. }] = layers.peels.as_slice() else {
        return Ok(false);
    };
    Ok(red == green && green == blue)
}

/// Adds the depth in `source` to the one picture of `stack`.
fn add_depth(stack: &mut Layers, source: &Source, options: &ReadOptions) -> Result<(), Error> {
    let mut opened = Opened::open(source)?;
    let name = opened.name.clone();
    let (depth, channel, frame) = if opened.is_exr()? {
        let file = ExrFile::open(opened)?.of_requested_view_if_any(options)?.cropped(options.rows.clone());
        // The program that wrote the depth determines its convention, so the attributes of its header replace those of the colour.
        let identifying = identifying_attributes(file.attributes());
        stack.attributes.retain(|(name, _)| !identifying.iter().any(|(other, _)| other == name));
        stack.attributes.extend(identifying);
        layers::read_exr_depth(file, options)?
    } else {
        let (depth, findings) = picture::read_depth(opened, options)?;
        stack.findings.extend(findings);
        let frame = Frame::from_size(depth.width(), depth.height());
        (depth, String::new(), frame)
    };
    let [layer] = stack.peels.as_mut_slice() else {
        return Err(Error::settings("a depth file requires a single colour picture")
            .in_file(&stack.name)
            .with("found", format!("{} peels", stack.peels.len())));
    };
    let Some(window) = placed(frame, stack.frame, options) else {
        let shown = |Frame { data, display, .. }: Frame, file: &Path| {
            let Window { x, y, width, height } = data;
            format!("{width}×{height} pixels at ({x}, {y}), display window {display}, in {}", file.display())
        };
        return Err(Error::input("depth and colour differ in size")
            .with("colour", shown(stack.frame, &stack.name))
            .with("depth", shown(frame, &name))
            .help("render both at the same size, or with one display window"));
    };
    let shown = if channel.is_empty() { String::new() } else { format!("channel {channel} of ") };
    let shown = format!("{shown}{}", name.display());
    if options.rows.is_none() && windows::overlap(window, layer.window).is_none() {
        return Err(Error::input("depth and colour have no pixel in common")
            .with("colour", format!("{} in {}", layer.window, stack.name.display()))
            .with("depth", format!("{window} in {shown}"))
            .help("render both with one data window"));
    }
    stack.findings.extend(windows::depth_beyond(&shown, window, (layer.window, &layer.alpha)));
    stack.findings.push(Finding::note("depth", format!("taken from {shown}")));
    layer.depth = Some(place_depth(depth, window, layer.window));
    layer.depth_channel = channel;
    Ok(())
}

/// The data window of a picture with windows `own` in the coordinates of a stack with windows `other`; `None` if it shows another frame.
fn placed(own: Frame, other: Frame, options: &ReadOptions) -> Option<Window> {
    // Rows are cut by the coordinates of each file: these are the same in all files that are read in rows (see `footprint`).
    let offset = if options.rows.is_some() { [0, 0] } else { windows::offset(own, other)? };
    Some(windows::moved(own.data, offset))
}

/// The attributes of a depth file's header that identify the program that wrote it, and those of thinlens.
fn identifying_attributes(attributes: Vec<(Text, AttributeValue)>) -> Vec<(Text, AttributeValue)> {
    let identifies = |name: &Text| writer::identifies(name) || name.to_string().starts_with("thinlens.");
    attributes.into_iter().filter(|(name, _)| identifies(name)).collect()
}

/// Adds the peels in `source` behind those of `stack`.
fn add_peels(stack: &mut Layers, source: &Source, options: &ReadOptions) -> Result<(), Error> {
    let options = ReadOptions { carry: Carry::None, objects: false, ..options.clone() };
    let mut more = read_layers(source, &options)?;
    stack.name_after_file();
    more.name_after_file();
    stack.replaced.add(more.replaced);
    stack.findings.extend(
        more.findings.into_iter().filter(|finding| !stack.findings.contains(finding)).collect::<Vec<_>>(),
    );
    if more.precision == super::Precision::Float {
        stack.precision = more.precision;
    }
    if more.color_range == ColorRange::Unbounded {
        stack.color_range = more.color_range;
    }
    let to = placed(more.frame, stack.frame, &options);
    if to.is_none() {
        stack.findings.push(other_frame(&stack.name, stack.frame, (&more.name, more.frame)));
    }
    // All of a file moves as its first peel does.
    let offset = to.map_or([0, 0], |to| [to.x - more.frame.data.x, to.y - more.frame.data.y]);
    for layer in more.peels {
        let window = windows::moved(layer.window, offset);
        let found = format!("{} in {}", layer.found, more.name.display());
        stack.peels.push(Layer { window, found, ..layer });
    }
    Ok(())
}

/// The warning about peels of a file whose windows do not fit those of the first.
fn other_frame(name: &Path, frame: Frame, (other, windows): (&Path, Frame)) -> Finding {
    let text = format!(
        "the display windows of {} and {} differ in size, {} and {}: peels are placed by the coordinates of their pixels",
        name.display(),
        other.display(),
        frame.display,
        windows.display
    );
    Finding::warning("frame", text)
}

/// The stack of all layers: one data window, one convention.
pub(super) fn finish(layers: Layers, options: &ReadOptions) -> Result<Stack, Error> {
    let (camera, doubts) = camera::values(&layers.attributes);
    let layers = join::join(layers, (options, camera.supersample))?;
    let Layers { name, frame, precision, color_range, attributes, channels, cryptomattes, .. } = layers;
    let Layers { peels: layers, beauty, mut findings, replaced, is_merged, is_numbered, .. } = layers;
    let in_file = |error: Error| error.in_file(&name);
    findings.insert(0, if is_merged { merged_finding(layers.len()) } else { peels_finding(&layers) });
    findings.extend(doubts);
    findings.extend(replaced.finding());
    findings.extend(aspect_finding(frame));
    let names: Vec<String> = layers.iter().map(|layer| layer.prefix.clone()).collect();
    let named = layers.iter().find(|layer| layer.depth.is_some());
    let depth_channel = named.map_or_else(String::new, |layer| layer.depth_channel.clone());
    let (mut peels, mut shading) = placed_peels(layers, frame.data).map_err(in_file)?;

    let evidence = Evidence {
        chosen: options.convention,
        header: camera.convention,
        attributes: &attributes,
        depth_channel: &depth_channel,
        depths: peels.first().map_or(&[], |peel| peel.depth.values()),
    };
    let concluded = convention::conclude(evidence);
    let has_8_bits = findings.iter().any(|finding| finding.text == picture::EIGHT_BITS);
    let known = Known { options, camera: &camera, has_8_bits };
    let Depths { convention, near_is_one, findings: of_depth } =
        plausible::correct(&mut peels, concluded, (known, is_merged)).map_err(in_file)?;
    findings.extend(of_depth);
    if options.alpha.is_none() {
        findings.extend(alpha::doubt(&peels));
    }
    let supersample = supersample(options, &camera, frame).map_err(in_file)?;
    let announced = Announced { kind: options.kind.or(camera.kind), supersample };
    // Elements were completed before they were merged.
    if !is_merged {
        findings.extend(completed(&mut peels, convention, announced));
        if options.rows.is_none() {
            findings.extend(no_peel::check(&peels, &names, convention, is_numbered).map_err(in_file)?);
        }
    }
    let (finding, reordered) = order::sort(&mut peels, convention);
    findings.extend(finding.into_iter().chain(shading::unordered(&mut shading, &reordered)));
    let (mut kind, mut antialiasing, finding) =
        kind::conclude(&peels, convention, announced).map_err(in_file)?;
    findings.push(finding);
    if supersample == 1 {
        findings.extend(background_share::complete(&mut peels, convention, &antialiasing));
    }
    if let Some(beauty) = beauty {
        let (replaced, found) = beauty::apply(beauty, &mut peels, frame, supersample).map_err(in_file)?;
        if let Some(replaced) = replaced {
            antialiasing = antialiasing.with_averages(&replaced);
            kind = kind.filter(|kind| Antialiasing::from(*kind) == antialiasing);
        }
        findings.extend(found);
    }
    let (of_light, may_be_disordered) = light::complete(&mut peels, convention);
    findings.extend(of_light);
    if may_be_disordered {
        let (_, reordered) = order::sort(&mut peels, convention);
        findings.extend(shading::unordered(&mut shading, &reordered));
    }
    let mut carried = Carried { channels, attributes: carried::attributes(&attributes) };
    let (mattes, finding) = split_mattes(&mut carried, kind, options, &cryptomattes);
    findings.extend(finding);
    Ok(Stack {
        peels,
        frame,
        convention,
        near_is_one,
        kind,
        antialiasing,
        supersample,
        shown: Vec::new(),
        shading,
        precision,
        color_range,
        camera,
        carried,
        cryptomattes,
        mattes,
        findings,
    })
}

/// The peels of `layers` in the data window `window`, and what their surfaces reflect: nothing, if that is not said of any.
fn placed_peels(layers: Vec<Layer>, window: Window) -> Result<(Vec<Peel>, Vec<Option<Shading>>), Error> {
    let placed = layers.into_iter().enumerate().map(|(i, layer)| join::placed(i, layer, window));
    let (peels, mut shading): (Vec<_>, Vec<_>) = placed.collect::<Result<_, Error>>()?;
    if shading.iter().all(Option::is_none) {
        shading.clear();
    }
    Ok((peels, shading))
}

/// Gives fragments of `peels` the depth that a filter took from them, with what was found of it.
fn completed(peels: &mut [Peel], convention: DepthConvention, announced: Announced) -> Vec<Finding> {
    let mut findings = Vec::new();
    if let [picture] = &mut *peels
        && announced.is_beauty()
    {
        findings.extend(filtered_depth::unblend(picture, convention));
    }
    if announced.kind != Some(StackKind::Coverage) {
        findings.extend(rim_depth::complete(peels, convention));
    }
    findings
}

/// Takes the channels out of `carried` that are not copied to the output, and keeps those of requested cryptomattes.
fn split_mattes(
    carried: &mut Carried,
    kind: Option<StackKind>,
    options: &ReadOptions,
    cryptomattes: &[Cryptomatte],
) -> (Vec<CarriedChannel>, Option<Finding>) {
    if options.carry == Carry::None {
        // Nothing is copied to the output: the decoded channels are the requested cryptomattes.
        return (std::mem::take(&mut carried.channels), None);
    }
    if kind != Some(StackKind::Supersampled) {
        return (Vec::new(), None);
    }
    let (dropped, finding) = carried::drop_supersampled(carried);
    let mattes =
        if options.objects { cryptomatte::matte_channels(dropped, cryptomattes) } else { Vec::new() };
    (mattes, finding)
}

fn peels_finding(layers: &[Layer]) -> Finding {
    let named =
        |layer: &Layer| if layer.prefix.is_empty() { "root".to_owned() } else { layer.prefix.clone() };
    let mut list: Vec<String> = layers.iter().take(LISTED).map(named).collect();
    if let Some(last) = layers.get(LISTED..).and_then(<[Layer]>::last) {
        list.extend(["…".to_owned(), named(last)]);
    }
    let list = list.join(", ");
    let (count, s) = (layers.len(), if layers.len() == 1 { "" } else { "s" });
    Finding::note("peels", format!("{count} peel{s}, nearest first: {list}"))
}

fn merged_finding(count: usize) -> Finding {
    let s = if count == 1 { "" } else { "s" };
    Finding::note("peels", format!("{count} peel{s}: the fragments of each pixel, nearest first"))
}

fn aspect_finding(frame: Frame) -> Option<Finding> {
    let (stated, usable) = (frame.pixel_aspect, frame.usable_pixel_aspect());
    let is_square = (stated - 1.0).abs() < 1e-3;
    if usable == 1.0 && !is_square {
        let text = format!("the pixel aspect ratio is {stated}, but pixels are treated as square");
        return Some(Finding::warning("frame", text));
    }
    let text = format!("pixels are {stated} times as wide as high, as the picture is to be shown");
    (usable != 1.0).then(|| Finding::note("frame", text))
}

/// Samples per picture pixel along each axis. Both windows must consist of whole pixels.
fn supersample(options: &ReadOptions, camera: &Values, frame: Frame) -> Result<usize, Error> {
    let samples = options.supersample.or(camera.supersample).unwrap_or(1);
    Values { supersample: Some(samples), ..Values::default() }.check()?;
    let Frame { data, display, .. } = frame;
    let offsets = [data.x.abs_diff(display.x) as usize, data.y.abs_diff(display.y) as usize];
    let sizes = [data.width, data.height, display.width, display.height];
    match sizes.iter().chain(&offsets).find(|size| *size % samples != 0) {
        Some(size) => {
            Err(Error::settings(format!("{samples} samples per pixel do not divide a size of {size}"))
                .with("found", format!("data window {data}, display window {display}"))
                .help("render at an integer multiple of the picture's size, or correct `supersample`"))
        }
        None => Ok(samples),
    }
}
