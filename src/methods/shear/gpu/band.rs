//! One band of rows: the stack is uploaded and indexed, then its views are painted in batches.

use super::frame::Frame;
use super::kernels::{BLOCK, LAYERS_PER_TEXEL, Params, SHADER, SQUARE, TILE, View};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Kernel, MAX_ROUNDS, Mirrored, Resource, Texels, Texture, tiles};
use crate::lens;
use crate::methods::contract::Progress;
use crate::methods::shear::bins::Bins;
use crate::methods::shear::canvas::{Shear, Step};
use crate::methods::shear::keys::{Key, NO_KEY};
use crate::methods::shear::picture::near_share_plane;
use crate::methods::shear::prefilter::{Surface, smooth_surface};
use crate::methods::shear::row_views::Turns;
use crate::scene::{Background, Layer};
use glam::IVec2;
use std::ops::Range;

/// Most views of a batch. Short batches limit the time of one dispatch and the rounding error of its sums.
const MAX_BATCH_VIEWS: usize = 64;

/// Largest size of the lists of groups, in bytes.
const MAX_LISTS_BYTES: u64 = 256 << 20;

/// The textures and buffers of one band.
pub(super) struct BandBuffers<'a> {
    frame: &'a Frame<'a>,
    rows: usize,
    params: Params,
    colors: Texture,
    keys: Texture,
    /// What pixels show beside their fragments.
    pixels: Texture,
    bin_table: Buffer,
    window_bins: Buffer,
    square_window_bins: Buffer,
    window_occluders: Buffer,
    /// Sums over the batches so far; `None` before a second batch is needed.
    sums: Option<Buffer>,
    picture: Buffer,
}

/// For each tile, turn and view of a batch the groups of bins that may be visible, and the order of the views: see the shader.
struct Lists {
    groups: Buffer,
    ordered_views: Buffer,
    covered_views: Buffer,
}

impl<'a> BandBuffers<'a> {
    /// Uploads the rows that the band reads, prefiltered and sorted into bins.
    pub(super) fn new(frame: &'a Frame<'a>, Band { rows, source }: &Band) -> Result<Self, Error> {
        let (gpu, (width, _), layers) = (frame.gpu, frame.picture.size, frame.layers.len());
        let params = Params {
            source_start: source.start as u32,
            source_rows: source.len() as u32,
            band_start: rows.start as u32,
            band_rows: rows.len() as u32,
            ..frame.params
        };
        let blocks = width.div_ceil(BLOCK) * source.len().div_ceil(BLOCK);
        let words = blocks * params.words as usize;
        let size = (width, source.len());
        let no_pixels = (1, 1);
        let band = Self {
            frame,
            rows: rows.len(),
            params,
            colors: gpu.texture("colours", Texels::FourFloats, size, layers)?,
            keys: gpu.texture("keys", Texels::FourWords, size, layers.div_ceil(LAYERS_PER_TEXEL))?,
            pixels: gpu.texture(
                "pixels",
                Texels::FourFloats,
                if frame.has_pixels() { size } else { no_pixels },
                1,
            )?,
            bin_table: gpu.uniform_of(&frame.bin_table())?,
            window_bins: gpu.zeros::<u32>("bins of windows", words)?,
            square_window_bins: gpu.zeros::<u32>("bins of windows of squares", words)?,
            window_occluders: gpu.zeros::<u32>("occluders of windows", blocks)?,
            sums: None,
            picture: gpu.zeros::<f32>("the picture", frame.planes() * width * rows.len())?,
        };
        band.fill_keys(source)?;
        band.index()?;
        band.fill_colors(source)?;
        if frame.has_pixels() {
            gpu.fill(&band.pixels, 0, &|y, texels| frame.pixel_row(source.start + y, texels))?;
        }
        Ok(band)
    }

    /// Uploads the keys of rows `source`, four layers to a texel.
    fn fill_keys(&self, source: &Range<usize>) -> Result<(), Error> {
        let Frame { gpu, keys, layers, picture, .. } = self.frame;
        let width = picture.size.0;
        for first in (0..layers.len()).step_by(LAYERS_PER_TEXEL) {
            gpu.fill(&self.keys, first / LAYERS_PER_TEXEL, &|y, texels: &mut [[Key; LAYERS_PER_TEXEL]]| {
                let mut row = Vec::new();
                texels.fill([NO_KEY; LAYERS_PER_TEXEL]);
                for layer in first..layers.len().min(first + LAYERS_PER_TEXEL) {
                    keys.fill((layer, source.start + y), 0..width, &mut row);
                    texels.iter_mut().zip(&row).for_each(|(texel, &key)| texel[layer - first] = key);
                }
            })?;
        }
        Ok(())
    }

    /// Uploads the colours of rows `source`, prefiltered if the plan has a prefilter.
    fn fill_colors(&self, source: &Range<usize>) -> Result<(), Error> {
        let Frame { gpu, layers, radius_per_coc, picture, .. } = self.frame;
        let width = picture.size.0;
        let values = source.start * width..source.end * width;
        let mut filtered = [const { Vec::new() }; 3];
        for (i, Layer { color, alpha, coc_px }) in layers.iter().enumerate() {
            let (alpha, coc_px) = (&alpha.values()[values.clone()], &coc_px.values()[values.clone()]);
            let mut color = color.each_ref().map(|plane| &plane.values()[values.clone()]);
            if let Some(radius_per_coc) = radius_per_coc {
                filtered.iter_mut().zip(color).for_each(|(copy, plane)| copy_to(copy, plane));
                let surface = Surface { width, alpha, coc_px };
                smooth_surface(filtered.each_mut().map(Vec::as_mut_slice), &surface, *radius_per_coc);
                color = filtered.each_ref().map(Vec::as_slice);
            }
            gpu.fill(&self.colors, i, &|y, texels: &mut [[f32; 4]]| {
                let row = y * width..(y + 1) * width;
                let [red, green, blue] = color.map(|plane| &plane[row.clone()]);
                let alpha = &alpha[row];
                let pixels = red.iter().zip(green).zip(blue).zip(alpha);
                for (texel, (((&r, &g), &b), &a)) in texels.iter_mut().zip(pixels) {
                    *texel = [r, g, b, a];
                }
            })?;
        }
        Ok(())
    }

    /// Indexes the bins of each window, and the windows in which the first layer occludes all others.
    fn index(&self) -> Result<(), Error> {
        let (gpu, (width, _)) = (self.frame.gpu, self.frame.picture.size);
        let Params { words, source_rows, .. } = self.params;
        let kernel = |name| gpu.kernel(&SHADER, name);
        let params = &gpu.uniform(&self.params)?;
        let block_bins = &gpu.zeros::<u32>("bins of blocks", (self.window_bins.bytes() / 4) as usize)?;
        let block_occluders =
            &gpu.zeros::<u32>("occluders of blocks", (self.window_occluders.bytes() / 4) as usize)?;
        let [across, down, _] = tiles(width.div_ceil(BLOCK), (source_rows as usize).div_ceil(BLOCK), 8);
        gpu.submit(|work| {
            let bound = [(0, params.into()), (2, Resource::from(&self.keys)), (3, block_bins.into())];
            work.pass(&kernel("find_block_bins")?, &bound, [across, down, words])?;
            let bound = [(0, params), (3, block_bins), (4, &self.window_bins)];
            work.pass(&kernel("find_window_bins")?, &bound, [across, down, words])?;
            let bound = [(0, params), (4, &self.window_bins), (5, &self.square_window_bins)];
            work.pass(&kernel("find_square_window_bins")?, &bound, [across, down, words])?;
            let bound = [(0, params.into()), (2, Resource::from(&self.keys)), (6, block_occluders.into())];
            work.pass(&kernel("find_block_occluders")?, &bound, [across, down, 1])?;
            let bound = [(0, params), (6, block_occluders), (7, &self.window_occluders)];
            work.pass(&kernel("find_window_occluders")?, &bound, [across, down, 1])
        })
    }

    /// Paints all views of all sets.
    pub(super) fn picture(mut self, progress: &Progress<'_>) -> Result<Buffer, Error> {
        let frame = self.frame;
        let paintings = frame.row_views.paintings();
        let total = paintings.iter().map(|turns| turns[0].len() * frame.views).sum::<usize>() as f32;
        let mut painted_before = 0;
        for (i, turns) in paintings.into_iter().enumerate() {
            self.params.blends = u32::from(i > 0);
            self.params.turns = turns.len() as u32;
            for set in 0..turns[0].len() {
                self.paint_set(turns, set, &|painted| progress((painted_before + painted) as f32 / total))?;
                painted_before += frame.views;
            }
        }
        Ok(self.picture)
    }

    /// Paints all views of set `set` of the colours, in turns.
    fn paint_set(&mut self, turns: &Turns, set: usize, progress: &dyn Fn(usize)) -> Result<(), Error> {
        let channels = turns[0][set].1;
        self.params.channels = channels.iter().fold(0, |bits, channel| bits | 1 << channel);
        self.params.near_share_plane = near_share_plane(channels) as u32;
        let turns: Vec<&[Shear]> = turns.iter().map(|sets| sets[set].0.as_slice()).collect();
        let mut painted = 0;
        while painted < self.frame.views {
            let end = self.frame.views.min(painted + self.batch_views()?);
            painted += self.paint(&turns, painted..end)?;
            progress(painted);
        }
        Ok(())
    }

    fn tiles(&self) -> [u32; 3] {
        tiles(self.frame.picture.size.0, self.rows, TILE)
    }

    /// Number of views of the next batch: its lists and its shifts fit into a buffer each, and a thread's loops below the driver's limit.
    ///
    /// # Errors
    /// [`crate::error::ErrorKind::Device`] if not even one view fits.
    fn batch_views(&self) -> Result<usize, Error> {
        let Params { entries, bins, turns, .. } = self.params;
        let [columns, rows, _] = self.tiles();
        let list_bytes = (columns * rows * turns * entries) as usize * size_of::<[u32; 2]>();
        let shifts_bytes = (turns * bins) as usize * size_of::<[u32; 2]>();
        let max_bytes = self.frame.gpu.max_binding_bytes().min(MAX_LISTS_BYTES) as usize;
        // For each entry, and for each translucent fragment, the four pixels of a thread read all texels of keys.
        let texels = self.frame.layers.len().div_ceil(LAYERS_PER_TEXEL);
        let rounds = entries as usize * (1 + 8 * texels);
        let views = (max_bytes / list_bytes.max(shifts_bytes)).min(MAX_ROUNDS / rounds);
        if views == 0 {
            return Err(Error::device("the bins of one view are too large for the GPU")
                .with("found", format!("{bins} bins, {columns} × {rows} tiles"))
                .help("use `device = cpu`"));
        }
        Ok(views.min(MAX_BATCH_VIEWS))
    }

    /// Adds the views `batch` of each of `turns` to those before and returns their number. Returns 0 if a list was too long: the lists
    /// of the next call are larger. The last batch writes the picture.
    fn paint(&mut self, turns: &[&[Shear]], batch: Range<usize>) -> Result<usize, Error> {
        let (gpu, views) = (self.frame.gpu, batch.len());
        let [is_first, is_last] = [batch.start == 0, batch.end == self.frame.views];
        if !is_last && self.sums.is_none() {
            self.sums =
                Some(gpu.zeros::<f32>("sums", self.frame.sums() * self.frame.picture.size.0 * self.rows)?);
        }
        let turns: Vec<&[Shear]> = turns.iter().map(|shears| &shears[batch.clone()]).collect();
        let params = &gpu.uniform(&Params { batch_views: views as u32, ..self.params })?;
        let shifts = &gpu.upload("shifts", &shifts(&turns, &self.frame.bins))?;
        let (lists, longest) = self.lists(params, shifts, views)?;
        if longest > self.params.entries {
            self.params.entries = longest;
            return Ok(0);
        }
        let infinity_px = self.frame.picture.background.as_deref().map_or(0.0, Background::coc_infinity_px);
        let words: Vec<u32> =
            turns.iter().copied().flatten().flat_map(|shear| view(shear, infinity_px).words()).collect();
        let lens = &gpu.upload("lens samples", &words)?;
        let paint = self.paint_kernel(is_first, is_last)?;
        let no_sums = gpu.zeros::<f32>("no sums", 1)?;
        // A thread follows one ray at a time where fragments are translucent, and four otherwise.
        let side = if self.frame.translucent { TILE / 2 } else { TILE };
        let [columns, rows, _] = tiles(self.frame.picture.size.0, self.rows, side);
        gpu.submit(|work| {
            let scene = [(2, (&self.keys).into()), (13, (&self.colors).into()), (18, (&self.pixels).into())];
            let order = [(10, Resource::from(&lists.ordered_views)), (11, (&lists.covered_views).into())];
            let views = [(0, Resource::from(params)), (9, (&lists.groups).into()), (14, lens.into())];
            let sums = self.sums.as_ref().unwrap_or(&no_sums);
            let output = [(15, Resource::from(sums)), (16, (&self.picture).into())];
            let bins = [(17, Resource::from(&self.bin_table))];
            let mirrors = [(23, Resource::from(&self.frame.mirror_weights))];
            let reflecting =
                self.frame.reflecting.bindings().map(|(at, buffer)| (at, Resource::from(buffer)));
            let bound = [&views[..], &scene, &order, &output, &bins, &mirrors, &reflecting].concat();
            work.pass(&paint, &bound, [columns, rows, 1])
        })?;
        Ok(views)
    }

    /// The lists of a batch of `views` views, and the number of entries that the longest list needs.
    fn lists(&self, params: &Buffer, shifts: &Buffer, views: usize) -> Result<(Lists, u32), Error> {
        let gpu = self.frame.gpu;
        let [columns, rows, _] = self.tiles().map(|tiles| tiles as usize);
        let (square_columns, square_rows) = (columns.div_ceil(SQUARE), rows.div_ceil(SQUARE));
        let turns = self.params.turns as usize;
        let square_words = square_columns * square_rows * turns * views * self.params.words as usize;
        let square_bins = &gpu.zeros::<u32>("bins of squares", square_words)?;
        let tile_views = columns * rows * turns * views;
        let lists = Lists {
            groups: gpu.zeros::<[u32; 2]>("groups of bins", tile_views * self.params.entries as usize)?,
            ordered_views: gpu.zeros::<[u32; 2]>("ordered views", tile_views)?,
            covered_views: gpu.zeros::<u32>("covered views", columns * rows * turns)?,
        };
        let longest = &gpu.zeros::<u32>("the longest list", 1)?;
        let kernel = |name| gpu.kernel(&SHADER, name);
        gpu.submit(|work| {
            let shared = [(0, params), (1, shifts), (8, square_bins)];
            let workgroups =
                |tiles: (usize, usize)| [tiles.0.div_ceil(64) as u32, tiles.1 as u32, (turns * views) as u32];
            let own = [(5, &self.square_window_bins)];
            work.pass(
                &kernel("find_square_bins")?,
                &[&shared[..], &own].concat(),
                workgroups((square_columns, square_rows)),
            )?;
            let own =
                [(4, &self.window_bins), (7, &self.window_occluders), (9, &lists.groups), (12, longest)];
            work.pass(&kernel("find_groups")?, &[&shared[..], &own].concat(), workgroups((columns, rows)))?;
            let bound =
                [(0, params), (9, &lists.groups), (10, &lists.ordered_views), (11, &lists.covered_views)];
            let [across, ..] = workgroups((columns, rows));
            work.pass(&kernel("sort_views")?, &bound, [across, rows as u32, turns as u32])
        })?;
        let longest = gpu.read::<u32>(longest)?;
        Ok((lists, longest.first().copied().unwrap_or(0)))
    }

    /// The kernel that paints a batch, specialised so that rays do not test for what the scene lacks.
    fn paint_kernel(&self, is_first: bool, is_last: bool) -> Result<Kernel, Error> {
        let name = if self.frame.translucent { "paint_translucent" } else { "paint" };
        let constants = [
            ("MANY_LAYERS", f64::from(self.params.layers > LAYERS_PER_TEXEL as u32)),
            ("BARREL", f64::from(self.params.cats_eye > 0.0)),
            ("BACKGROUND", f64::from(self.frame.picture.background.is_some())),
            ("REFLECTS", f64::from(self.frame.reflecting.reflects)),
            ("NEAR", f64::from(self.frame.near.is_some())),
            ("FIRST_BATCH", f64::from(is_first)),
            ("LAST_BATCH", f64::from(is_last)),
        ];
        self.frame.gpu.kernel_with(&SHADER, name, &constants)
    }
}

/// For each turn, view and bin the shift, and the first and the end of the bins that the view moves alike around it, in the shader's
/// layout.
fn shifts(turns: &[&[Shear]], bins: &Bins) -> Vec<[u32; 2]> {
    let block = |step: &Step| bins.blocks()[usize::from(step.block)].bins;
    let alike = |shear: &Shear| -> Vec<[u32; 2]> {
        let runs = shear.steps.chunk_by(|a, b| a.moved_alike_from == b.moved_alike_from);
        let runs = runs.filter_map(|run| Some((run.first()?, run.last()?)));
        runs.flat_map(|(first, last)| {
            let (start, end) = (usize::from(block(first)[0]), usize::from(block(last)[1]) + 1);
            let entry = [packed([first.shift.columns, first.shift.rows]), (start | end << 16) as u32];
            std::iter::repeat_n(entry, end - start)
        })
        .collect()
    };
    turns.iter().copied().flatten().flat_map(alike).collect()
}

/// A shift of columns and rows in the shader's layout. 16 bits are enough, because past the border all samples are those of the border.
fn packed(shift: [i32; 2]) -> u32 {
    let max = i32::from(i16::MAX);
    let [columns, rows] = shift.map(|shift| u32::from(shift.clamp(-max, max) as i16 as u16));
    columns | rows << 16
}

/// The lens sample of `shear`, for a background whose CoC radius at infinity is `infinity_px`.
fn view(shear: &Shear, infinity_px: f32) -> View {
    let lens::View { lens, jitter, shift } = shear.view;
    View {
        lens_x: lens.x,
        lens_y: lens.y,
        jitter_x: jitter.x,
        jitter_y: jitter.y,
        shift_x: shift.x,
        shift_y: shift.y,
        at_infinity: packed(shear.pixel_at(IVec2::ZERO, infinity_px).to_array()),
    }
}

/// Copies the values of `plane` to `copy` and reuses its memory.
fn copy_to(copy: &mut Vec<f32>, plane: &[f32]) {
    copy.resize(plane.len(), 0.0);
    copy.copy_from_slice(plane);
}
