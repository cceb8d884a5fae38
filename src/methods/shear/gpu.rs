//! `shear` on a GPU: `shaders/methods/shear.wgsl`.
//!
//! What is made once (bins, shifts of views, what the rim hides) the CPU makes as for itself, and it draws the few discs of
//! highlights while the GPU paints. Bands read as far as views and the prefilter reach.
//!
//! Memory: 26 bytes a fragment, 44 a pixel, and for each tile of 256 pixels and view a bit a bin.

use super::bins::Bins;
use super::bokeh::Bokeh;
use super::highlights::{self, Highlight, Occluders};
use super::paint::{LEAST_HIT, STOPPED_BELOW, Shear};
use super::prefilter::{self, SURFACE_PX};
use super::resolve;
use super::runs::{self, JOIN_PX};
use super::sampler::{ShearSet, bins, rim_softness, shears};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Gpu, Mirrored, Shader, bands, mirrored, tiles};
use crate::image::{Image, Plane};
use crate::methods::{Progress, Twin};
use crate::scene::{EffectKind, Layer, OPAQUE_ALPHA, PREFILTER_LEAST_VARIANCE, Plan, Scene};
use std::borrow::Cow;
use std::ops::Range;

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

/// Past so many radii of the prefilter's box what it brings is below a millionth: `e^(−√6 · 6)`.
const SMOOTHING_RADII: f32 = 6.0;

/// Planes of a picture in the making: red, green, blue, alpha, and the share of rays that met something in focus.
const PLANES: usize = 5;

/// Planes of sums: the shader's `Seen`.
const SUMS: usize = 6;

mirrored! {
    /// What all kernels read: see the shader.
    struct Params {
        width: u32,
        height: u32,
        source_start: u32,
        source_rows: u32,
        band_start: u32,
        band_rows: u32,
        layers: u32,
        layer: u32,
        bins: u32,
        words: u32,
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
        let (width, layers) = (self.size.0.max(1), self.layers.len());
        let largest = width * size_of::<f32>() * (4 * layers).max(SUMS);
        let together = width * (26 * layers + size_of::<f32>() * (2 * PLANES + SUMS));
        let rows = |bytes: u64, of_a_row: usize| bytes as usize / of_a_row;
        // A band's tiles must have room for the bins of one view at least.
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
        source_start: 0,
        source_rows: height as u32,
        band_start: 0,
        band_rows: height as u32,
        layers: layers as u32,
        layer: 0,
        bins: bins.count() as u32,
        words: bins.count().div_ceil(32) as u32,
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
    colors: Buffer,
    coc_px: Buffer,
    keys: Buffer,
    windows: Buffer,
    sums: Buffer,
    picture: Buffer,
}

impl<'a> BandWork<'a> {
    /// The band's rows on the GPU, in bins and prefiltered.
    fn new(work: &'a Work<'a>, Band { rows, source }: &Band) -> Result<Self, Error> {
        let (gpu, (width, _)) = (work.gpu, work.size);
        let (layers, samples) = (work.layers.len(), width * source.len());
        let params = Params {
            source_start: source.start as u32,
            source_rows: source.len() as u32,
            band_start: rows.start as u32,
            band_rows: rows.len() as u32,
            ..work.params
        };
        let blocks = width.div_ceil(BLOCK) * source.len().div_ceil(BLOCK) * params.words as usize;
        let band = Self {
            work,
            rows: rows.len(),
            params,
            colors: gpu.zeros::<[f32; 4]>("colours", layers * samples)?,
            coc_px: gpu.zeros::<f32>("CoC radii", layers * samples)?,
            keys: gpu.zeros::<u32>("keys", layers.div_ceil(2) * samples)?,
            windows: gpu.zeros::<u32>("windows", blocks)?,
            sums: gpu.zeros::<f32>("sums", SUMS * width * rows.len())?,
            picture: gpu.zeros::<f32>("the picture", PLANES * width * rows.len())?,
        };
        band.load(source)?;
        band.find_bins(source.len())?;
        Ok(band)
    }

    /// Brings all layers to the GPU, and smooths them where the plan asks for it.
    fn load(&self, source: &Range<usize>) -> Result<(), Error> {
        let (gpu, (width, _)) = (self.work.gpu, self.work.size);
        let values = source.start * width..source.end * width;
        let load = gpu.kernel(&SHADER, "load_layer")?;
        for (i, Layer { color: [red, green, blue], alpha, coc_px }) in self.work.layers.iter().enumerate() {
            let planes = [red, green, blue, alpha, coc_px].map(|plane| &plane.values()[values.clone()]);
            let planes = gpu.upload_all("a layer", &planes)?;
            let params = gpu.uniform(&Params { layer: i as u32, ..self.params })?;
            let bindings = [(0, &params), (1, &planes), (2, &self.colors), (3, &self.coc_px)];
            gpu.submit(|work| work.pass(&load, &bindings, tiles(width, source.len(), TILE)))?;
        }
        Ok(())
    }

    /// Puts the fragments into bins, and smooths them where the plan asks for it.
    fn find_bins(&self, rows: usize) -> Result<(), Error> {
        let Work { gpu, layers, size: (width, _), plan, .. } = *self.work;
        let kernel = |name| gpu.kernel(&SHADER, name);
        let (params, layers, words) = (gpu.uniform(&self.params)?, layers.len() as u32, self.params.words);
        let indices = gpu.zeros::<u32>("bins", layers as usize * width * rows)?;
        let blocks = gpu.zeros::<u32>("blocks", (self.windows.bytes() / 4) as usize)?;
        let (colors, coc_px, keys) = (&self.colors, &self.coc_px, &self.keys);
        let [x, y, _] = tiles(width, rows, TILE);
        let of_blocks = tiles(width.div_ceil(BLOCK), rows.div_ceil(BLOCK), 8);
        let of_blocks = [of_blocks[0], of_blocks[1], words];
        gpu.submit(|work| {
            let tables = [(6, &self.work.bin_ends_px), (7, &self.work.first_in_cell)];
            let layer = [(0, &params), (2, colors), (3, coc_px), (4, &indices)];
            work.pass(&kernel("find_bins")?, &[&layer[..], &tables].concat(), [x, y, layers])?;
            work.pass(
                &kernel("join_bins")?,
                &[&layer[..], &[(5, keys)]].concat(),
                [x, y, layers.div_ceil(2)],
            )?;
            work.pass(&kernel("mark_blocks")?, &[(0, &params), (5, keys), (8, &blocks)], of_blocks)?;
            work.pass(
                &kernel("mark_windows")?,
                &[(0, &params), (8, &blocks), (9, &self.windows)],
                of_blocks,
            )?;
            if plan.does(EffectKind::Prefilter) {
                let lines = |count: usize| [count.div_ceil(64) as u32, layers, 1];
                let bindings = [(0, &params), (2, colors), (3, coc_px)];
                work.pass(&kernel("smooth_rows")?, &bindings, lines(rows))?;
                work.pass(&kernel("smooth_columns")?, &bindings, lines(width))?;
            }
            Ok(())
        })
    }

    /// Paints all views of all sets.
    fn picture(self, progress: &Progress<'_>) -> Result<Buffer, Error> {
        let gpu = self.work.gpu;
        let finish = gpu.kernel(&SHADER, "finish")?;
        let total = (self.work.sets.len() * self.work.views) as f32;
        for (set, (shears, channels)) in self.work.sets.iter().enumerate() {
            let mut before = 0;
            for go in shears.chunks(self.views_in_a_go()?) {
                self.paint(go, before)?;
                before += go.len();
                progress((set * self.work.views + before) as f32 / total);
            }
            let channels = channels.iter().fold(0, |bits, channel| bits | 1 << channel);
            let params = gpu.uniform(&Params { channels, ..self.params })?;
            let bindings = [(0, &params), (13, &self.sums), (14, &self.picture)];
            gpu.submit(|work| work.pass(&finish, &bindings, tiles(self.work.size.0, self.rows, TILE)))?;
        }
        Ok(self.picture)
    }

    fn tiles(&self) -> [u32; 3] {
        tiles(self.work.size.0, self.rows, TILE)
    }

    /// Views whose candidates and shifts fit into a buffer.
    fn views_in_a_go(&self) -> Result<usize, Error> {
        let [columns, rows, _] = self.tiles();
        let of_candidates = (columns * rows * self.params.words) as usize * size_of::<u32>();
        let of_shifts = self.params.bins as usize * size_of::<[i32; 2]>();
        let most = self.work.gpu.most_binding_bytes() as usize / of_candidates.max(of_shifts);
        if most == 0 {
            return Err(Error::device("the bins of one view are too large for the GPU")
                .with("found", format!("{} bins for {columns} × {rows} tiles", self.params.bins))
                .help("use --device cpu"));
        }
        Ok(most.min(VIEWS_IN_A_GO))
    }

    /// Adds the views of `go`, which `before` views went before.
    fn paint(&self, go: &[Shear], before: usize) -> Result<(), Error> {
        let Work { gpu, .. } = *self.work;
        let views = go.len();
        let shifts: Vec<[i32; 2]> = go
            .iter()
            .flat_map(|shear| shear.shifts.iter().map(|shift| [shift.columns, shift.rows]))
            .collect();
        let lens: Vec<[f32; 2]> = go.iter().map(|shear| shear.lens.to_array()).collect();
        let shifts = gpu.upload("shifts", &shifts)?;
        let lens = gpu.upload("lens samples", &lens)?;
        let params = Params { views_before: before as u32, views_in_go: views as u32, ..self.params };
        let params = gpu.uniform(&params)?;
        let [columns, rows, _] = self.tiles();
        let words = columns as usize * rows as usize * views * self.params.words as usize;
        let candidates = gpu.zeros::<u32>("candidates", words)?;
        let find = gpu.kernel(&SHADER, "find_candidates")?;
        let paint = gpu.kernel(&SHADER, "paint")?;
        gpu.submit(|work| {
            work.pass(
                &find,
                &[(0, &params), (9, &self.windows), (10, &candidates), (11, &shifts)],
                [columns.div_ceil(64), rows, views as u32],
            )?;
            let layers = [(2, &self.colors), (5, &self.keys)];
            let views = [(10, &candidates), (11, &shifts), (12, &lens)];
            work.pass(
                &paint,
                &[&[(0, &params)], &layers[..], &views, &[(13, &self.sums)]].concat(),
                [columns, rows, 1],
            )
        })
    }
}
