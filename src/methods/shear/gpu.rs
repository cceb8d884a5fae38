//! `shear` on a GPU: `shaders/methods/shear.wgsl`.
//!
//! What is made once (bins, shifts of views, what the rim hides) the CPU makes as for itself, and it draws the few discs of
//! highlights while the GPU paints. Bands read as far as views and the prefilter reach.
//!
//! Memory: 26 bytes a fragment, 100 a pixel.

use super::bins::Bins;
use super::bokeh::Bokeh;
use super::highlights::{self, Highlight, Occluders};
use super::paint::{LEAST_HIT, STOPPED_BELOW, Shear};
use super::prefilter::{self, SURFACE_PX};
use super::resolve;
use super::runs::{self, JOIN_PX};
use super::sampler::{ShearSet, bins, rim_softness, shears};
use crate::error::Error;
use crate::gpu::{
    Band, Buffer, Gpu, Kernel, Mirrored, ROW_ALIGNMENT, Resource, Shader, Texels, Texture, bands, mirrored,
    tiles,
};
use crate::image::{Image, Plane};
use crate::methods::{Progress, Twin};
use crate::scene::{EffectKind, Layer, OPAQUE_ALPHA, PREFILTER_LEAST_VARIANCE, Plan, Scene};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

static SHADER: Shader = Shader {
    name: "shear",
    constants: &[
        ("OPAQUE_ALPHA", OPAQUE_ALPHA),
        ("JOIN_PX", JOIN_PX),
        ("SURFACE_PX", SURFACE_PX),
        ("LEAST_VARIANCE", PREFILTER_LEAST_VARIANCE),
        ("STOPPED_BELOW", STOPPED_BELOW),
        ("LEAST_HIT", LEAST_HIT),
    ],
    parts: &[include_str!("../../../shaders/methods/shear.wgsl")],
    structs: &[Params::LAYOUT],
};

/// Sides of the shader's tiles and blocks.
const TILE: usize = 16;
const BLOCK: usize = 4;

/// Views that are painted at once: a go stays short, and its sums exact.
const VIEWS_IN_A_GO: usize = 64;

/// The shader's `shifts`: what may be uniform everywhere.
const SHIFTS: usize = 8192;

/// Entries that lists of groups have room for at first: more than enough where surfaces are large.
const ENTRIES: usize = 8;

/// Most bytes of lists.
const LISTS_BYTES: u64 = 256 << 20;

/// Rounds of all loops of a thread together, past which Mesa's software driver ends them without a word.
const MOST_ROUNDS: usize = 60_000;

/// Tiles along one of the shader's squares.
const SQUARE: usize = 4;

/// Bytes of a colour.
const TEXEL: usize = size_of::<[f32; 4]>();

/// Layers whose keys share a texel.
const LAYERS_PER_TEXEL: usize = 4;

/// Past so many radii of the prefilter's box what it brings is below a millionth: `e^(−√6 · 6)`.
const SMOOTHING_RADII: f32 = 6.0;

/// Planes of a picture in the making: red, green, blue, alpha, and the share of rays that met something in focus.
const PLANES: usize = 5;

/// Planes of sums: colour, what of it was in focus, what was missed, what was hidden.
const SUMS: usize = 6;

/// Bytes of a fragment in colours, bins and keys; of a pixel in sums, the picture and its readback, the lists of its tile, and the layer
/// that is on its way, twice.
const FRAGMENT_BYTES: usize = 26;
const PIXEL_BYTES: usize = size_of::<f32>() * (2 * PLANES + SUMS) + 16 + 40;

mirrored! {
    /// What all kernels read: see the shader.
    struct Params {
        width: u32,
        height: u32,
        stride: u32,
        source_start: u32,
        source_rows: u32,
        band_start: u32,
        band_rows: u32,
        layers: u32,
        layer: u32,
        bins: u32,
        words: u32,
        entries: u32,
        focused_start: u32,
        focused_end: u32,
        cells: u32,
        start_px: f32,
        cells_per_px: f32,
        radius_per_coc: f32,
        views: u32,
        views_before: u32,
        views_in_go: u32,
        open_background: u32,
        channels: u32,
        cats_eye: f32,
        axis_x_px: f32,
        axis_y_px: f32,
        half_diagonal_px: f32,
        softness: f32,
    }
}

/// `shear` on a GPU.
#[derive(Debug)]
pub(super) struct ShearTwin;

impl Twin for ShearTwin {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let (layers, highlights) = load(scene, plan);
        let work = Work::new(gpu, scene, &layers, plan)?;
        let (painted, discs) = rayon::join(|| work.paint(progress), || work.discs(scene, &highlights));
        let (mut image, focused_share) = painted?;
        if let Some(discs) = discs {
            add_light(&mut image, &discs);
        }
        if plan.does(EffectKind::Resolve) {
            resolve::soften(&mut image, &focused_share, plan.parameters.shear.resolve);
        }
        Ok(image)
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// [`super::load`], of a scene that stays as it is.
fn load<'a>(scene: &'a Scene, plan: &Plan) -> (Cow<'a, [Layer]>, Vec<Highlight>) {
    let changes = plan.does(EffectKind::Highlights) || plan.does(EffectKind::Fill) || scene.supersample > 1;
    if !changes {
        return (Cow::Borrowed(&scene.layers), Vec::new());
    }
    let (layers, highlights) = super::load(scene.clone(), plan);
    (Cow::Owned(layers), highlights)
}

fn add_light(image: &mut Image, light: &Image) {
    for (plane, light) in image.planes.iter_mut().zip(&light.planes).take(3) {
        plane.values_mut().iter_mut().zip(light.values()).for_each(|(value, light)| *value += light);
    }
}

/// A scene on its way through a GPU.
struct Work<'a> {
    gpu: &'a Gpu,
    plan: &'a Plan,
    layers: &'a [Layer],
    size: (usize, usize),
    views: usize,
    bins: Bins,
    sets: Vec<ShearSet>,
    /// Of the whole picture.
    params: Params,
    bin_ends_px: Buffer,
    first_in_cell: Buffer,
}

impl<'a> Work<'a> {
    fn new(gpu: &'a Gpu, scene: &Scene, layers: &'a [Layer], plan: &'a Plan) -> Result<Self, Error> {
        let (size, views) = (scene.picture_size(), plan.lens_samples());
        let bins = bins(plan, views);
        let sets = shears(plan, &bins, views);
        let (ends_px, first_in_cell, ..) = bins.table();
        let ends_px: Vec<f32> = ends_px.iter().map(|end| end.min(f32::MAX)).collect();
        let first_in_cell: Vec<u32> = first_in_cell.iter().map(|&bin| u32::from(bin)).collect();
        let params = params(scene, layers.len(), plan, (&bins, &sets));
        Ok(Self {
            gpu,
            plan,
            layers,
            size,
            views,
            sets,
            params,
            bin_ends_px: gpu.upload("ends of bins", &ends_px)?,
            first_in_cell: gpu.upload("bins by radius", &first_in_cell)?,
            bins,
        })
    }

    /// How many rows away what a pixel shows may lie.
    fn reach(&self) -> usize {
        let coc = self.bins.centers_px().iter().fold(0.0, |most: f32, coc| most.max(coc.abs()));
        let smoothed = if self.plan.does(EffectKind::Prefilter) {
            SMOOTHING_RADII * self.params.radius_per_coc * coc
        } else {
            0.0
        };
        // Half a pixel of jitter, a neighbour that is joined.
        (coc + self.plan.optics.longest_shift_px() + smoothed + 0.5).ceil() as usize + 2
    }

    /// Rows that can be read at once.
    fn most_rows(&self) -> usize {
        let (stride, layers) = (self.params.stride as usize, self.layers.len());
        let largest = stride * TEXEL.max(SUMS * size_of::<f32>());
        let together = stride * (FRAGMENT_BYTES * layers + PIXEL_BYTES);
        let rows = |bytes: u64, of_a_row: usize| bytes as usize / of_a_row;
        rows(self.gpu.most_binding_bytes(), largest).min(rows(self.gpu.most_working_bytes(), together))
    }

    fn paint(&self, progress: &Progress<'_>) -> Result<(Image, Plane), Error> {
        let (width, height) = self.size;
        let mut planes: [Plane; PLANES] = std::array::from_fn(|_| Plane::zeros(width, height));
        let bands = bands(height, self.reach(), self.most_rows())?;
        for (i, band) in bands.iter().enumerate() {
            let share = |done: f32| progress((i as f32 + done) / bands.len() as f32);
            let picture = BandWork::new(self, band)?.picture(&share)?;
            let values = band.rows.start * width..band.rows.end * width;
            let mut parts = planes.each_mut().map(|plane| &mut plane.values_mut()[values.clone()]);
            self.gpu.read_into(&picture, &mut parts)?;
        }
        let [red, green, blue, alpha, focused_share] = planes;
        Ok((Image { planes: [red, green, blue, alpha] }, focused_share))
    }

    /// The discs of `highlights` over nothing, if there are any.
    fn discs(&self, scene: &Scene, highlights: &[Highlight]) -> Option<Image> {
        if highlights.is_empty() {
            return None;
        }
        let (bins, layers, (width, height)) = (&self.bins, self.layers, self.size);
        let runs = runs::find(layers, bins);
        let mut discs = Image::from_fn(width, height, |_, _| [0.0; 4]);
        let bokeh = Bokeh::new(&self.plan.optics, scene.field, self.plan.fragment_px);
        highlights::draw(&mut discs, highlights, &bokeh, &Occluders { width, runs: &runs, bins, layers });
        Some(discs)
    }
}

/// What is the same for all bands.
fn params(scene: &Scene, layers: usize, plan: &Plan, (bins, sets): (&Bins, &[ShearSet])) -> Params {
    let (width, height) = scene.picture_size();
    let views = plan.lens_samples();
    let (_, cells, start_px, cells_per_px) = bins.table();
    let focused = focused_bins(sets);
    let (field, optics) = (&scene.field, &plan.optics);
    Params {
        width: width as u32,
        height: height as u32,
        stride: (width * TEXEL).next_multiple_of(ROW_ALIGNMENT) as u32 / TEXEL as u32,
        source_start: 0,
        source_rows: height as u32,
        band_start: 0,
        band_rows: height as u32,
        layers: layers as u32,
        layer: 0,
        bins: bins.count() as u32,
        words: bins.count().div_ceil(32) as u32,
        entries: ENTRIES as u32,
        focused_start: focused.start as u32,
        focused_end: focused.end as u32,
        cells: cells.len() as u32,
        start_px,
        cells_per_px,
        radius_per_coc: prefilter::radius_per_coc(views, plan.parameters.shear.prefilter),
        views: views as u32,
        views_before: 0,
        views_in_go: 0,
        open_background: u32::from(plan.does(EffectKind::OpenBackground)),
        channels: 0,
        cats_eye: optics.cats_eye,
        axis_x_px: field.axis_px.x,
        axis_y_px: field.axis_px.y,
        half_diagonal_px: field.half_diagonal_px,
        softness: rim_softness(views),
    }
}

/// The bins that count as in focus: neighbours, since bins rise.
fn focused_bins(sets: &[ShearSet]) -> Range<usize> {
    let shifts = sets.first().and_then(|(shears, _)| shears.first()).map_or(&[][..], |shear| &shear.shifts);
    let first = shifts.iter().position(|shift| shift.focused).unwrap_or(0);
    first..shifts.iter().rposition(|shift| shift.focused).map_or(first, |last| last + 1)
}

/// One band of it.
struct BandWork<'a> {
    work: &'a Work<'a>,
    rows: usize,
    params: Params,
    /// Whether some fragment lets light through.
    veiled: bool,
    colors: Texture,
    keys: Texture,
    windows: Buffer,
    far_windows: Buffer,
    sums: Buffer,
    picture: Buffer,
}

impl<'a> BandWork<'a> {
    /// The band's rows on the GPU, in bins and prefiltered.
    fn new(work: &'a Work<'a>, Band { rows, source }: &Band) -> Result<Self, Error> {
        let (gpu, (width, _), layers) = (work.gpu, work.size, work.layers.len());
        let params = Params {
            source_start: source.start as u32,
            source_rows: source.len() as u32,
            band_start: rows.start as u32,
            band_rows: rows.len() as u32,
            ..work.params
        };
        let blocks = width.div_ceil(BLOCK) * source.len().div_ceil(BLOCK) * params.words as usize;
        let size = (width, source.len());
        let mut band = Self {
            work,
            rows: rows.len(),
            params,
            veiled: false,
            colors: gpu.texture("colours", Texels::FourFloats, size, layers)?,
            keys: gpu.texture("keys", Texels::TwoWords, size, layers.div_ceil(LAYERS_PER_TEXEL))?,
            windows: gpu.zeros::<u32>("windows", blocks)?,
            far_windows: gpu.zeros::<u32>("windows", blocks)?,
            sums: gpu.zeros::<f32>("sums", SUMS * width * rows.len())?,
            picture: gpu.zeros::<f32>("the picture", PLANES * width * rows.len())?,
        };
        let fragments = gpu.texture("bins", Texels::TwoWords, size, layers)?;
        for (i, layer) in work.layers.iter().enumerate() {
            let colors = band.upload(layer, source)?;
            let coc_px = &layer.coc_px.values()[source.start * width..source.end * width];
            band.take(i, &colors, &gpu.upload("CoC radii", coc_px)?, &fragments)?;
        }
        band.mark(&fragments)?;
        Ok(band)
    }

    /// The colours of `layer`; notes whether it lets light through.
    fn upload(&mut self, layer: &Layer, source: &Range<usize>) -> Result<Buffer, Error> {
        let veiled = AtomicBool::new(self.veiled);
        let size = (self.params.stride as usize, source.len());
        let colors = self.work.gpu.upload_rows("colours", size, |i, row| {
            let Layer { color: [red, green, blue], alpha, .. } = layer;
            let [red, green, blue, alpha] =
                [red, green, blue, alpha].map(|plane| plane.row(source.start + i));
            let pixels = red.iter().zip(green).zip(blue).zip(alpha);
            for (texel, (((&r, &g), &b), &a)) in row.iter_mut().zip(pixels) {
                *texel = [r, g, b, a];
            }
            if alpha.iter().fold(false, |veiled, &a| veiled | ((a > 0.0) & (a < OPAQUE_ALPHA))) {
                veiled.store(true, Ordering::Relaxed);
            }
        })?;
        self.veiled = veiled.into_inner();
        Ok(colors)
    }

    /// Puts the fragments of layer `layer` into bins, and smooths them where the plan asks for it.
    fn take(&self, layer: usize, colors: &Buffer, coc_px: &Buffer, bins: &Texture) -> Result<(), Error> {
        let Work { gpu, plan, size: (width, _), .. } = *self.work;
        let rows = self.params.source_rows as usize;
        let kernel = |name| gpu.kernel(&SHADER, name);
        let params = &gpu.uniform(&Params { layer: layer as u32, ..self.params })?;
        gpu.submit(|work| {
            let fragments = [(0, params), (2, colors), (3, coc_px)];
            let tables = [(4, &self.work.bin_ends_px), (5, &self.work.first_in_cell)];
            let read = [&fragments[..], &tables].concat();
            let read = read.into_iter().map(|(binding, buffer)| (binding, Resource::from(buffer)));
            let bindings: Vec<_> = read.chain([(6, bins.into())]).collect();
            work.pass(&kernel("find_bins")?, &bindings, tiles(width, rows, TILE))?;
            if plan.does(EffectKind::Prefilter) {
                let lines = |count: usize| [count.div_ceil(64) as u32, 1, 1];
                work.pass(&kernel("smooth_rows")?, &fragments, lines(rows))?;
                work.pass(&kernel("smooth_columns")?, &fragments, lines(width))?;
            }
            work.copy(colors, &self.colors, layer, self.params.stride as usize * TEXEL);
            Ok(())
        })
    }

    /// Joins the fragments' bins, and notes where each bin is.
    fn mark(&self, bins: &Texture) -> Result<(), Error> {
        let (gpu, (width, _)) = (self.work.gpu, self.work.size);
        let Params { layers, words, source_rows, .. } = self.params;
        let kernel = |name| gpu.kernel(&SHADER, name);
        let params = &gpu.uniform(&self.params)?;
        let blocks = &gpu.zeros::<u32>("blocks", (self.windows.bytes() / 4) as usize)?;
        let [x, y, _] = tiles(width, source_rows as usize, TILE);
        let [across, down, _] = tiles(width.div_ceil(BLOCK), (source_rows as usize).div_ceil(BLOCK), 8);
        gpu.submit(|work| {
            let joined = [(0, params.into()), (7, Resource::from(bins)), (8, (&self.keys).into())];
            work.pass(&kernel("join_bins")?, &joined, [x, y, layers.div_ceil(LAYERS_PER_TEXEL as u32)])?;
            let marked = [(0, params.into()), (9, Resource::from(&self.keys)), (10, blocks.into())];
            work.pass(&kernel("mark_blocks")?, &marked, [across, down, words])?;
            let marked = [(0, params), (10, blocks), (11, &self.windows)];
            work.pass(&kernel("mark_windows")?, &marked, [across, down, words])?;
            let marked = [(0, params), (11, &self.windows), (19, &self.far_windows)];
            work.pass(&kernel("mark_far")?, &marked, [across, down, words])
        })
    }

    /// Paints all views of all sets.
    fn picture(mut self, progress: &Progress<'_>) -> Result<Buffer, Error> {
        let gpu = self.work.gpu;
        let finish = gpu.kernel(&SHADER, "finish")?;
        let total = (self.work.sets.len() * self.work.views) as f32;
        for (set, (shears, channels)) in self.work.sets.iter().enumerate() {
            let mut before = 0;
            while before < shears.len() {
                let go = &shears[before..];
                before += self.paint(&go[..go.len().min(self.views_in_a_go()?)], before)?;
                progress((set * self.work.views + before) as f32 / total);
            }
            let channels = channels.iter().fold(0, |bits, channel| bits | 1 << channel);
            let params = gpu.uniform(&Params { channels, ..self.params })?;
            let bindings = [(0, &params), (14, &self.sums), (15, &self.picture)];
            gpu.submit(|work| work.pass(&finish, &bindings, tiles(self.work.size.0, self.rows, TILE)))?;
        }
        Ok(self.picture)
    }

    fn tiles(&self) -> [u32; 3] {
        tiles(self.work.size.0, self.rows, TILE)
    }

    /// Views whose lists and shifts fit into a buffer.
    fn views_in_a_go(&self) -> Result<usize, Error> {
        let [columns, rows, _] = self.tiles();
        let lists = (columns * rows * self.params.entries) as usize * size_of::<[u32; 2]>();
        let room = self.work.gpu.most_binding_bytes().min(LISTS_BYTES) as usize;
        // For each entry the four pixels of a thread look through all texels of keys, and so they do for each fragment of a veil.
        let texels = self.work.layers.len().div_ceil(LAYERS_PER_TEXEL);
        let rounds = self.params.entries as usize * (1 + 8 * texels);
        let most = (room / lists).min(SHIFTS / self.params.bins as usize).min(MOST_ROUNDS / rounds);
        if most == 0 {
            return Err(Error::device("the bins of one view are too large for the GPU")
                .with("found", format!("{} bins, {columns} × {rows} tiles", self.params.bins))
                .help("use --device cpu"));
        }
        Ok(most.min(VIEWS_IN_A_GO))
    }

    /// Adds the views of `go`, which `before` views went before, and returns how many there are; none where lists turn out to need
    /// more room, which they have from then on.
    fn paint(&mut self, go: &[Shear], before: usize) -> Result<usize, Error> {
        let (gpu, views) = (self.work.gpu, go.len());
        let params = Params { views_before: before as u32, views_in_go: views as u32, ..self.params };
        let params = &gpu.uniform(&params)?;
        let shifts = &gpu.uniform_of(&shifts(go))?;
        let (groups, longest) = self.lists(params, shifts, views)?;
        if longest > self.params.entries {
            self.params.entries = longest;
            return Ok(0);
        }
        let lens: Vec<[f32; 2]> = go.iter().map(|shear| shear.lens.to_array()).collect();
        let lens = &gpu.upload("lens samples", &lens)?;
        let paint = self.paint_kernel()?;
        let [columns, rows, _] = self.tiles();
        gpu.submit(|work| {
            let scene = [(9, (&self.keys).into()), (16, (&self.colors).into())];
            let sums = [(0, Resource::from(params)), (12, (&groups).into()), (14, (&self.sums).into())];
            let rim = [(13, lens.into())];
            work.pass(&paint, &[&sums[..], &scene, &rim].concat(), [columns, rows, 1])
        })?;
        Ok(views)
    }

    /// The groups of bins that each view shows to each tile, and how many entries the longest list has.
    fn lists(&self, params: &Buffer, shifts: &Buffer, views: usize) -> Result<(Buffer, u32), Error> {
        let gpu = self.work.gpu;
        let [columns, rows, _] = self.tiles().map(|tiles| tiles as usize);
        let (far_columns, far_rows) = (columns.div_ceil(SQUARE), rows.div_ceil(SQUARE));
        let far = &gpu.zeros::<u32>("bins", far_columns * far_rows * views * self.params.words as usize)?;
        let entries = columns * rows * views * self.params.entries as usize;
        let groups = gpu.zeros::<[u32; 2]>("groups of bins", entries)?;
        let longest = &gpu.zeros::<u32>("the longest list", 1)?;
        let (find_far, find) = (gpu.kernel(&SHADER, "find_far")?, gpu.kernel(&SHADER, "find_groups")?);
        gpu.submit(|work| {
            let lists = [(0, params), (1, shifts), (18, far)];
            let groups_of =
                |tiles: (usize, usize)| [tiles.0.div_ceil(64) as u32, tiles.1 as u32, views as u32];
            let seen = [(19, &self.far_windows)];
            work.pass(&find_far, &[&lists[..], &seen].concat(), groups_of((far_columns, far_rows)))?;
            let seen = [(11, &self.windows), (12, &groups), (17, longest)];
            work.pass(&find, &[&lists[..], &seen].concat(), groups_of((columns, rows)))
        })?;
        let longest = gpu.read::<u32>(longest)?;
        Ok((groups, longest.first().copied().unwrap_or(0)))
    }

    /// What paints this scene: what it has not need not be asked for ray by ray.
    fn paint_kernel(&self) -> Result<Kernel, Error> {
        let name = if self.veiled { "paint_veils" } else { "paint" };
        let constants = [
            ("MANY_LAYERS", f64::from(self.params.layers > LAYERS_PER_TEXEL as u32)),
            ("RIM", f64::from(self.params.cats_eye > 0.0)),
        ];
        self.work.gpu.kernel_with(&SHADER, name, &constants)
    }
}

/// Columns and rows that each of `shears` moves each bin by, as the shader has them: past the border all samples are the border's, so
/// that no more than 16 bits are needed.
fn shifts(shears: &[Shear]) -> Vec<[i32; 2]> {
    let most = i32::from(i16::MAX);
    let moved = |by: i32| by.clamp(-most, most);
    let of_view = |shear: &Shear| shear.shifts.iter().map(|s| [moved(s.columns), moved(s.rows)]).collect();
    let mut shifts: Vec<[i32; 2]> = shears.iter().flat_map::<Vec<_>, _>(of_view).collect();
    shifts.resize(SHIFTS, [0; 2]);
    shifts
}
