//! One band of rows: the stack brought up and put in order, then painted view by view.

use super::{BLOCK, LAYERS_PER_TEXEL, PLANES, Params, SHADER, SQUARE, SUMS, TILE, Work};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Kernel, MAX_ROUNDS, Resource, Texels, Texture, tiles};
use crate::methods::Progress;
use crate::methods::shear::canvas::Shear;
use crate::methods::shear::keys::{Key, KeyRow, NO_KEY};
use crate::methods::shear::prefilter::{Surface, smooth_surface};
use crate::scene::{Layer, OPAQUE_ALPHA};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Views that are painted at once: a go stays short, and its sums exact.
const VIEWS_IN_A_GO: usize = 64;

/// The shader's `shifts`: what may be uniform everywhere.
const SHIFTS: usize = 16384;

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
    walls: Buffer,
    /// Of the views so far, where they are not painted all at once.
    sums: Option<Buffer>,
    picture: Buffer,
}

/// What each of some views can show to each tile: see the shader.
struct Lists {
    groups: Buffer,
    turns: Buffer,
    turns_of_walls: Buffer,
}

impl<'a> BandWork<'a> {
    /// The band's rows on the GPU, prefiltered and in bins.
    pub(super) fn new(work: &'a Work<'a>, Band { rows, source }: &Band) -> Result<Self, Error> {
        let (gpu, (width, _), layers) = (work.gpu, work.size, work.layers.len());
        let params = Params {
            source_start: source.start as u32,
            source_rows: source.len() as u32,
            band_start: rows.start as u32,
            band_rows: rows.len() as u32,
            ..work.params
        };
        let blocks = width.div_ceil(BLOCK) * source.len().div_ceil(BLOCK);
        let words = blocks * params.words as usize;
        let size = (width, source.len());
        let mut band = Self {
            work,
            rows: rows.len(),
            params,
            veiled: false,
            colors: gpu.texture("colours", Texels::FourFloats, size, layers)?,
            keys: gpu.texture("keys", Texels::TwoWords, size, layers.div_ceil(LAYERS_PER_TEXEL))?,
            windows: gpu.zeros::<u32>("windows", words)?,
            far_windows: gpu.zeros::<u32>("windows", words)?,
            walls: gpu.zeros::<u32>("walls", blocks)?,
            sums: None,
            picture: gpu.zeros::<f32>("the picture", PLANES * width * rows.len())?,
        };
        band.fill_keys(source)?;
        band.mark()?;
        band.fill_colors(source)?;
        Ok(band)
    }

    /// The keys of rows `source`, of four layers a texel.
    fn fill_keys(&self, source: &Range<usize>) -> Result<(), Error> {
        let Work { gpu, keys, layers, size: (width, _), .. } = self.work;
        for first in (0..layers.len()).step_by(LAYERS_PER_TEXEL) {
            gpu.fill(&self.keys, first / LAYERS_PER_TEXEL, |y, texels: &mut [[Key; LAYERS_PER_TEXEL]]| {
                let mut row = KeyRow::new(*width);
                texels.fill([NO_KEY; LAYERS_PER_TEXEL]);
                for layer in first..layers.len().min(first + LAYERS_PER_TEXEL) {
                    keys.fill((layer, source.start + y), &mut row);
                    texels.iter_mut().zip(&row.keys).for_each(|(texel, &key)| texel[layer - first] = key);
                }
            })?;
        }
        Ok(())
    }

    /// The colours of rows `source`, smoothed where the plan asks for it; notes whether any lets light through.
    fn fill_colors(&mut self, source: &Range<usize>) -> Result<(), Error> {
        let Work { gpu, layers, radius_per_coc, size: (width, _), .. } = self.work;
        let values = source.start * width..source.end * width;
        let mut smoothed = [const { Vec::new() }; 3];
        for (i, Layer { color, alpha, coc_px }) in layers.iter().enumerate() {
            let (alpha, coc_px) = (&alpha.values()[values.clone()], &coc_px.values()[values.clone()]);
            let mut color = color.each_ref().map(|plane| &plane.values()[values.clone()]);
            if let Some(radius_per_coc) = radius_per_coc {
                smoothed.iter_mut().zip(color).for_each(|(copy, plane)| copy_to(copy, plane));
                let surface = Surface { width: *width, alpha, coc_px };
                smooth_surface(smoothed.each_mut().map(Vec::as_mut_slice), &surface, *radius_per_coc);
                color = smoothed.each_ref().map(Vec::as_slice);
            }
            let veiled = AtomicBool::new(self.veiled);
            gpu.fill(&self.colors, i, |y, texels: &mut [[f32; 4]]| {
                let row = y * width..(y + 1) * width;
                let [red, green, blue] = color.map(|plane| &plane[row.clone()]);
                let alpha = &alpha[row];
                let pixels = red.iter().zip(green).zip(blue).zip(alpha);
                for (texel, (((&r, &g), &b), &a)) in texels.iter_mut().zip(pixels) {
                    *texel = [r, g, b, a];
                }
                if alpha.iter().fold(false, |veiled, &a| veiled | ((a > 0.0) & (a < OPAQUE_ALPHA))) {
                    veiled.store(true, Ordering::Relaxed);
                }
            })?;
            self.veiled = veiled.into_inner();
        }
        Ok(())
    }

    /// Notes where each bin is, and where the first layer hides all others.
    fn mark(&self) -> Result<(), Error> {
        let (gpu, (width, _)) = (self.work.gpu, self.work.size);
        let Params { words, source_rows, .. } = self.params;
        let kernel = |name| gpu.kernel(&SHADER, name);
        let params = &gpu.uniform(&self.params)?;
        let blocks = &gpu.zeros::<u32>("blocks", (self.windows.bytes() / 4) as usize)?;
        let block_walls = &gpu.zeros::<u32>("walls of blocks", (self.walls.bytes() / 4) as usize)?;
        let [across, down, _] = tiles(width.div_ceil(BLOCK), (source_rows as usize).div_ceil(BLOCK), 8);
        gpu.submit(|work| {
            let marked = [(0, params.into()), (2, Resource::from(&self.keys)), (3, blocks.into())];
            work.pass(&kernel("mark_blocks")?, &marked, [across, down, words])?;
            let marked = [(0, params), (3, blocks), (4, &self.windows)];
            work.pass(&kernel("mark_windows")?, &marked, [across, down, words])?;
            let marked = [(0, params), (4, &self.windows), (5, &self.far_windows)];
            work.pass(&kernel("mark_far")?, &marked, [across, down, words])?;
            let marked = [(0, params.into()), (2, Resource::from(&self.keys)), (6, block_walls.into())];
            work.pass(&kernel("mark_block_walls")?, &marked, [across, down, 1])?;
            let marked = [(0, params), (6, block_walls), (7, &self.walls)];
            work.pass(&kernel("mark_walls")?, &marked, [across, down, 1])
        })
    }

    /// Paints all views of all sets.
    pub(super) fn picture(mut self, progress: &Progress<'_>) -> Result<Buffer, Error> {
        let total = (self.work.sets.len() * self.work.views) as f32;
        for (set, (shears, channels)) in self.work.sets.iter().enumerate() {
            self.params.channels = channels.iter().fold(0, |bits, channel| bits | 1 << channel);
            let mut before = 0;
            while before < shears.len() {
                let end = shears.len().min(before + self.views_in_a_go()?);
                before += self.paint(shears, before..end)?;
                progress((set * self.work.views + before) as f32 / total);
            }
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
        let room = self.work.gpu.max_binding_bytes().min(LISTS_BYTES) as usize;
        // For each entry the four pixels of a thread look through all texels of keys, and so they do for each fragment of a veil.
        let texels = self.work.layers.len().div_ceil(LAYERS_PER_TEXEL);
        let rounds = self.params.entries as usize * (1 + 8 * texels);
        let most = (room / lists).min(SHIFTS / self.params.bins as usize).min(MAX_ROUNDS / rounds);
        if most == 0 {
            return Err(Error::device("the bins of one view are too large for the GPU")
                .with("found", format!("{} bins, {columns} × {rows} tiles", self.params.bins))
                .help("use --device cpu"));
        }
        Ok(most.min(VIEWS_IN_A_GO))
    }

    /// Adds the views `go` of `shears` to those before, and returns how many there are; none where lists turn out to need more room,
    /// which they have from then on. The last ones make the picture.
    fn paint(&mut self, shears: &[Shear], go: Range<usize>) -> Result<usize, Error> {
        let (gpu, views, [is_first, is_last]) =
            (self.work.gpu, go.len(), [go.start == 0, go.end == shears.len()]);
        if !is_last && self.sums.is_none() {
            self.sums = Some(gpu.zeros::<f32>("sums", SUMS * self.work.size.0 * self.rows)?);
        }
        let go = &shears[go];
        let params = &gpu.uniform(&Params { views_in_go: views as u32, ..self.params })?;
        let shifts = &gpu.uniform_of(&shifts(go))?;
        let (lists, longest) = self.lists(params, shifts, views)?;
        if longest > self.params.entries {
            self.params.entries = longest;
            return Ok(0);
        }
        let lens: Vec<[f32; 2]> = go.iter().map(|shear| shear.lens.to_array()).collect();
        let lens = &gpu.upload("lens samples", &lens)?;
        let paint = self.paint_kernel(is_first, is_last)?;
        let no_sums = gpu.zeros::<f32>("no sums", 1)?;
        let [columns, rows, _] = self.tiles();
        gpu.submit(|work| {
            let scene = [(2, (&self.keys).into()), (13, (&self.colors).into())];
            let turns = [(10, Resource::from(&lists.turns)), (11, (&lists.turns_of_walls).into())];
            let views = [(0, Resource::from(params)), (9, (&lists.groups).into()), (14, lens.into())];
            let sums = self.sums.as_ref().unwrap_or(&no_sums);
            let made = [(15, Resource::from(sums)), (16, (&self.picture).into())];
            work.pass(&paint, &[&views[..], &scene, &turns, &made].concat(), [columns, rows, 1])
        })?;
        Ok(views)
    }

    /// The groups of bins that each view shows to each tile, and how many entries the longest list has.
    fn lists(&self, params: &Buffer, shifts: &Buffer, views: usize) -> Result<(Lists, u32), Error> {
        let gpu = self.work.gpu;
        let [columns, rows, _] = self.tiles().map(|tiles| tiles as usize);
        let (far_columns, far_rows) = (columns.div_ceil(SQUARE), rows.div_ceil(SQUARE));
        let far = &gpu.zeros::<u32>("bins", far_columns * far_rows * views * self.params.words as usize)?;
        let turns = columns * rows * views;
        let made = Lists {
            groups: gpu.zeros::<[u32; 2]>("groups of bins", turns * self.params.entries as usize)?,
            turns: gpu.zeros::<[u32; 2]>("turns of views", turns)?,
            turns_of_walls: gpu.zeros::<u32>("turns of walls", columns * rows)?,
        };
        let longest = &gpu.zeros::<u32>("the longest list", 1)?;
        let kernel = |name| gpu.kernel(&SHADER, name);
        gpu.submit(|work| {
            let lists = [(0, params), (1, shifts), (8, far)];
            let groups_of =
                |tiles: (usize, usize)| [tiles.0.div_ceil(64) as u32, tiles.1 as u32, views as u32];
            let seen = [(5, &self.far_windows)];
            work.pass(
                &kernel("find_far")?,
                &[&lists[..], &seen].concat(),
                groups_of((far_columns, far_rows)),
            )?;
            let seen = [(4, &self.windows), (7, &self.walls), (9, &made.groups), (12, longest)];
            work.pass(&kernel("find_groups")?, &[&lists[..], &seen].concat(), groups_of((columns, rows)))?;
            let sorted = [(0, params), (9, &made.groups), (10, &made.turns), (11, &made.turns_of_walls)];
            let [across, ..] = groups_of((columns, rows));
            work.pass(&kernel("sort_views")?, &sorted, [across, rows as u32, 1])
        })?;
        let longest = gpu.read::<u32>(longest)?;
        Ok((made, longest.first().copied().unwrap_or(0)))
    }

    /// What paints the first or last views of this scene, or others: what it has not need not be asked for ray by ray.
    fn paint_kernel(&self, is_first: bool, is_last: bool) -> Result<Kernel, Error> {
        let name = if self.veiled { "paint_veils" } else { "paint" };
        let constants = [
            ("MANY_LAYERS", f64::from(self.params.layers > LAYERS_PER_TEXEL as u32)),
            ("RIM", f64::from(self.params.cats_eye > 0.0)),
            ("FIRST", f64::from(is_first)),
            ("FINAL", f64::from(is_last)),
        ];
        self.work.gpu.kernel_with(&SHADER, name, &constants)
    }
}

/// Columns and rows that each of `shears` moves each bin by, as the shader has them: past the border all samples are the border's, so
/// that no more than 16 bits are needed.
fn shifts(shears: &[Shear]) -> Vec<[i16; 2]> {
    let most = i32::from(i16::MAX);
    let moved = |by: i32| by.clamp(-most, most) as i16;
    let shifts = shears.iter().flat_map(|shear| &shear.shifts).map(|s| [moved(s.columns), moved(s.rows)]);
    let mut shifts: Vec<_> = shifts.collect();
    shifts.resize(SHIFTS, [0; 2]);
    shifts
}

/// Makes `copy` the values of `plane`, in the memory that it has.
fn copy_to(copy: &mut Vec<f32>, plane: &[f32]) {
    copy.resize(plane.len(), 0.0);
    copy.copy_from_slice(plane);
}
