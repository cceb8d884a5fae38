//! One band of rows: the stack brought up and put in order, then painted view by view.

use super::{BLOCK, LAYERS_PER_TEXEL, PLANES, Params, SHADER, SQUARE, SUMS, TEXEL, TILE, Work};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Kernel, MOST_ROUNDS, Resource, Texels, Texture, tiles};
use crate::methods::Progress;
use crate::methods::shear::paint::Shear;
use crate::scene::{EffectKind, Layer, OPAQUE_ALPHA};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Views that are painted at once: a go stays short, and its sums exact.
const VIEWS_IN_A_GO: usize = 64;

/// The shader's `shifts`: what may be uniform everywhere.
const SHIFTS: usize = 8192;

/// Most bytes of lists.
const LISTS_BYTES: u64 = 256 << 20;

/// One band of a scene on its way through a GPU.
pub(super) struct BandWork<'a> {
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
    pub(super) fn new(work: &'a Work<'a>, Band { rows, source }: &Band) -> Result<Self, Error> {
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
    pub(super) fn picture(mut self, progress: &Progress<'_>) -> Result<Buffer, Error> {
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
