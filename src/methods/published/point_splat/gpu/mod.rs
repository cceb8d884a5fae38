//! `point-splat` on a GPU: each pixel gathers the points that the CPU splats over it.
//!
//! Points are computed as on the CPU, which takes little of the time, and packed into [`blocks`]; sprites become a
//! table of [`weights`]. A thread then visits the points that may reach its pixels and keeps their layers to itself,
//! so that no sum depends on the order of threads. Rows are rendered in strips, and the points of a strip in several
//! dispatches, to limit the time of a pass.
//!
//! Cost: as on the CPU, plus the blocks that a tile visits in vain. Memory: 32 bytes per point and 28 per pixel, in
//! bands of rows where that is too much; and for each radius in use a table of the square around its sprite. With all
//! radii up to C these take about 1000 C² bytes, which is what limits C.

mod blocks;
mod weights;

use super::layers::bounds;
use super::parameters::PointSplatParameters;
use super::splat::{Grid, Point};
use super::sprites::Centre;
use super::{PointSplat, SplatInputs};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, MAX_ROUNDS, Mirrored, Shader, bands, mirrored, tiles};
use crate::image::{Image, Plane};
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{Backdrop, before, picture};
use crate::parallel;
use crate::scene::Scene;
use blocks::{BLOCK, Blocks, REGION, count_in_row};
use std::ops::Range;
use weights::WeightTable;

/// Side of a workgroup's tile, in pixels.
const TILE: usize = 8;

/// Bytes per point in either of its buffers.
const BYTES_PER_POINT: usize = 16;

/// Maximum bytes per pixel of the result.
const BYTES_PER_PIXEL: usize = 20;

/// Bytes of the layers of two neighbouring pixels.
const BYTES_PER_PAIR: usize = 2 * 3 * 5 * size_of::<f32>();

/// Maximum visits of points by all pixels of a pass: some tenths of a second on a slow card.
const MAX_VISITS: usize = 4_000_000_000;

/// Maximum bytes of a strip's layers: they are read and written in every dispatch.
const MAX_SUM_BYTES: usize = 1 << 26;

mirrored! {
    /// Parameters of a dispatch for a strip of the picture.
    struct Params {
        /// Size of the picture, in pixels.
        width: i32,
        height: i32,
        /// Pixel at the upper left corner of the first block.
        source_column: i32,
        source_row: i32,
        /// Picture rows of the band: first row, and number.
        band_row: i32,
        band_rows: i32,
        /// First row of the strip, relative to the band.
        strip_row: i32,
        /// Rows of blocks to add: first row, and end.
        first_blocks: u32,
        last_blocks: u32,
        /// Whether the sums start at zero.
        is_first: u32,
        /// Blocks per row, and regions per row.
        blocks_across: u32,
        regions_across: i32,
        /// Number of planes of the picture: content and, where it has alpha, coverage.
        planes: u32,
    }
}

static SHADER: Shader = Shader {
    name: "point_splat",
    constants: &[("BLOCK", Constant::Int(BLOCK as i32)), ("REGION", Constant::Int(REGION as i32))],
    parts: &[include_str!("../../../../../shaders/methods/point_splat.wgsl")],
    structs: &[Params::LAYOUT],
};

impl GpuBackend for PointSplat {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let Some(backdrop) = Backdrop::new(scene, plan) else {
            return Ok(picture(GpuSplat::<3>::new(gpu, scene, plan).picture(progress)?));
        };
        let mut planes = GpuSplat::<4>::new(gpu, scene, plan).picture(progress)?;
        let coverage = planes.pop().unwrap_or_default();
        Ok(before(picture(planes), &coverage, Some(&backdrop)))
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// Maximum reach of the points, in rows.
fn reach<const N: usize>(grids: &[Grid<N>]) -> usize {
    let of_row = |(row, centre): (&Vec<Point<N>>, Centre)| row.iter().map(|point| point.reach(centre)).max();
    let rows = grids.iter().flat_map(|grid| grid.rows.iter().map(|row| (row, grid.centre)));
    rows.filter_map(of_row).max().unwrap_or(0) as usize
}

/// State of the splat of one scene.
struct GpuSplat<'a, const N: usize> {
    gpu: &'a Gpu,
    inputs: SplatInputs<N>,
    size: (usize, usize),
    delta: f32,
    /// Maximum reach of the points, in rows.
    reach: usize,
    /// [`MAX_VISITS`], or less in tests.
    max_visits: usize,
}

/// Buffers of a band.
struct BandBuffers {
    /// Blocks per row, and the first block's first pixel.
    blocks_across: usize,
    origin: [i32; 2],
    /// Maximum blocks and points that a thread visits in one row of blocks.
    rounds: usize,
    /// Rows per strip.
    strip_rows: usize,
    /// Points, their shapes, blocks, windows, weights, layer bounds.
    inputs: [Buffer; 6],
    sums: Buffer,
    picture: Buffer,
}

impl<'a, const N: usize> GpuSplat<'a, N> {
    /// Number of planes of the picture.
    const PLANES: usize = if N > 3 { N + 1 } else { N };

    /// Prepares the points of `scene`.
    fn new(gpu: &'a Gpu, scene: &Scene, plan: &Plan) -> Self {
        let size = scene.picture_size();
        let inputs = SplatInputs::<N>::new(scene.clone(), plan);
        let reach = reach(&inputs.grids);
        let delta = plan.parameters.get::<PointSplatParameters>().delta;
        Self { gpu, inputs, size, delta, reach, max_visits: MAX_VISITS }
    }

    /// Renders the planes of the picture: content and, where it has alpha, coverage.
    fn picture(&self, progress: &Progress<'_>) -> Result<Vec<Plane>, Error> {
        let (width, height) = self.size;
        let mut planes = vec![Plane::zeros(width, height); Self::PLANES];
        for band in self.bands()? {
            let pixels = band.rows.start * width..band.rows.end * width;
            let mut parts: Vec<&mut [f32]> =
                planes.iter_mut().map(|plane| &mut plane.values_mut()[pixels.clone()]).collect();
            self.render_band(&band, &mut parts, progress)?;
        }
        Ok(planes)
    }

    /// Distance in rows within which points are visited: beyond one picture height, repeated rows add no new term.
    fn rows_reached(&self) -> usize {
        self.reach.min(self.size.1)
    }

    /// Bands of rows that fit into the adapter's memory.
    fn bands(&self) -> Result<Vec<Band>, Error> {
        let (width, height) = self.size;
        let points = |y| count_in_row(&self.inputs.grids, y, self.size);
        let max_points = parallel::map(height, &points).into_iter().max().unwrap_or(0);
        let rows_by_binding = self.gpu.max_binding_bytes() as usize
            / (BYTES_PER_POINT * max_points).max(BYTES_PER_PIXEL * width);
        let bytes_per_row =
            2 * BYTES_PER_POINT * max_points + (BYTES_PER_PIXEL + size_of::<[f32; 2]>()) * width;
        let rows_by_memory = (self.gpu.max_working_bytes() as usize - MAX_SUM_BYTES) / bytes_per_row;
        let max_rows = rows_by_binding.min(rows_by_memory);
        // The rows above and below the picture need memory too.
        let fits_at_once = height + 2 * self.rows_reached() <= max_rows;
        bands(height, self.rows_reached(), if fits_at_once { height } else { max_rows.min(height - 1) })
    }

    /// Weights of all sprites in the rows that a band reads.
    fn weight_table(&self, source: Range<usize>) -> Result<WeightTable, Error> {
        let points = self.inputs.grids.iter().flat_map(|grid| {
            let spacing = grid.centre.spacing();
            let rows = &grid.rows[(source.start / spacing).min(grid.rows.len())..];
            let count = source.end.div_ceil(spacing) - source.start / spacing;
            rows.iter().take(count).flatten().map(|point| (point, grid.centre))
        });
        let weight_table = WeightTable::new(points, self.size);
        let (bytes, max_bytes) = (size_of::<f32>() * weight_table.count, self.gpu.max_binding_bytes());
        if bytes as u64 > max_bytes {
            return Err(Error::device("the sprites are too large for the GPU")
                .with("found", format!("{bytes} bytes"))
                .with("expected", format!("at most {max_bytes} bytes"))
                .help("use `device = cpu`"));
        }
        Ok(weight_table)
    }

    /// Uploads the inputs of a band.
    fn upload(&self, Band { rows, source }: &Band) -> Result<BandBuffers, Error> {
        let (gpu, (width, _)) = (self.gpu, self.size);
        let weight_table = self.weight_table(source.clone())?;
        let reach = self.rows_reached() as i32;
        let reached = rows.start as i32 - reach..rows.end as i32 + reach;
        let blocks = Blocks::new(&self.inputs.grids, reached, self.size, &weight_table);
        let windows = blocks.windows(rows.clone(), width);
        let visible_px = &self.inputs.visible_px.values()[rows.start * width..rows.end * width];
        let bounds: Vec<[f32; 2]> = visible_px.iter().map(|&coc_px| bounds(coc_px, self.delta)).collect();
        let rounds = 1
            + blocks.blocks_across
            + self.max_blocks_in_reach(TILE).min(blocks.blocks_across) * blocks.max_points();
        let strip_rows = self.strip_rows(rows.len(), rounds);
        Ok(BandBuffers {
            blocks_across: blocks.blocks_across,
            origin: blocks.origin,
            rounds,
            strip_rows,
            inputs: [
                gpu.upload("points", &blocks.lights)?,
                gpu.upload("points", &blocks.shapes)?,
                gpu.upload("blocks of points", &blocks.blocks)?,
                gpu.upload("regions", &windows)?,
                gpu.upload("sprites", &weight_table.weights(&self.inputs.sprites))?,
                gpu.upload("the bounds of layers", &bounds)?,
            ],
            sums: gpu.zeros::<u8>("layers", strip_rows * width.div_ceil(2) * BYTES_PER_PAIR)?,
            picture: gpu.zeros::<f32>("the picture", Self::PLANES * width * rows.len())?,
        })
    }

    /// Renders the rows of a band into `parts`, the rows of each plane.
    fn render_band(
        &self,
        band: &Band,
        parts: &mut [&mut [f32]],
        progress: &Progress<'_>,
    ) -> Result<(), Error> {
        let buffers = self.upload(band)?;
        let (start, count) = (band.rows.start, band.rows.len());
        for first in (0..count).step_by(buffers.strip_rows) {
            let strip = first..(first + buffers.strip_rows).min(count);
            self.render_strip(&buffers, &band.rows, strip.clone())?;
            progress((start + strip.end) as f32 / self.size.1 as f32);
        }
        self.gpu.read_into(&buffers.picture, parts)
    }

    /// Maximum number of blocks along an axis that can reach `pixels` adjacent pixels.
    fn max_blocks_in_reach(&self, pixels: usize) -> usize {
        (pixels + 2 * self.reach).div_ceil(BLOCK) + 1
    }

    /// Rows per strip in a band of `count` rows: whole tiles, at least one.
    fn strip_rows(&self, count: usize, rounds: usize) -> usize {
        let width = self.size.0;
        let max_bytes = MAX_SUM_BYTES.min(self.gpu.max_binding_bytes() as usize);
        let rows_by_memory = max_bytes / (width.div_ceil(2) * BYTES_PER_PAIR);
        let rows_by_visits = self.max_visits / (width * rounds * self.max_blocks_in_reach(TILE));
        (rows_by_memory.min(rows_by_visits).min(count.next_multiple_of(TILE)) / TILE).max(1) * TILE
    }

    /// Renders the rows `strip` of the band of picture rows `rows`.
    fn render_strip(
        &self,
        buffers: &BandBuffers,
        rows: &Range<usize>,
        strip: Range<usize>,
    ) -> Result<(), Error> {
        let (gpu, (width, _)) = (self.gpu, self.size);
        let BandBuffers { inputs, sums, picture, .. } = buffers;
        let [lights, shapes, blocks, windows, weights, bounds] = inputs;
        let groups = tiles(width, strip.len(), TILE);
        let [splat, blend] = [gpu.kernel(&SHADER, "splat")?, gpu.kernel(&SHADER, "blend")?];
        // Rows of blocks that reach the strip.
        let last = (strip.end + 2 * self.rows_reached()).div_ceil(BLOCK);
        let step = self.block_rows_per_dispatch(buffers);
        for first in (strip.start / BLOCK..last).step_by(step) {
            let params = self.params(buffers, rows, &strip, first..(first + step).min(last));
            let params = gpu.uniform(&params)?;
            let bindings = [
                (0, &params),
                (1, lights),
                (2, shapes),
                (3, blocks),
                (4, windows),
                (5, weights),
                (6, bounds),
                (7, sums),
            ];
            gpu.submit(|work| work.pass(&splat, &bindings, groups))?;
        }
        let params = gpu.uniform(&self.params(buffers, rows, &strip, 0..0))?;
        gpu.submit(|work| work.pass(&blend, &[(0, &params), (7, sums), (8, picture)], groups))
    }

    /// Rows of blocks that one dispatch adds to a strip.
    fn block_rows_per_dispatch(&self, buffers: &BandBuffers) -> usize {
        let visits = buffers.rounds * self.size.0 * buffers.strip_rows;
        (MAX_ROUNDS / buffers.rounds).min(self.max_visits / visits).max(1)
    }

    fn params(
        &self,
        buffers: &BandBuffers,
        rows: &Range<usize>,
        strip: &Range<usize>,
        blocks: Range<usize>,
    ) -> Params {
        let (width, height) = self.size;
        let [source_column, source_row] = buffers.origin;
        Params {
            width: width as i32,
            height: height as i32,
            source_column,
            source_row,
            band_row: rows.start as i32,
            band_rows: rows.len() as i32,
            strip_row: strip.start as i32,
            first_blocks: blocks.start as u32,
            last_blocks: blocks.end as u32,
            is_first: u32::from(blocks.start == strip.start / BLOCK),
            blocks_across: buffers.blocks_across as u32,
            regions_across: width.div_ceil(REGION) as i32,
            planes: Self::PLANES as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::Method;
    use crate::scene::Layer;
    use crate::settings::{Origin, ParameterValues, Settings, Values};
    use crate::stack::StackKind;

    /// A textured wall that fills the frame, behind a bar; the blur of both is wider than the frame.
    fn scene() -> Scene {
        let plane = |value: fn(usize, usize) -> f32| Plane::from_fn(60, 44, value);
        let texture = |x, y| 0.25 + 0.125 * ((3 * x + 5 * y) % 7) as f32;
        let wall = Layer {
            color: std::array::from_fn(|_| plane(texture)),
            alpha: plane(|_, _| 1.0),
            coc_px: plane(|x, _| 60.0 + 0.25 * x as f32),
        };
        let bar = Layer {
            color: std::array::from_fn(|_| plane(|x, _| f32::from(x < 30))),
            alpha: plane(|x, _| f32::from(x < 30)),
            coc_px: plane(|_, y| -80.0 - 0.5 * y as f32),
        };
        Scene::new(vec![bar, wall], StackKind::PointSampled, 1, 140.0)
    }

    #[test]
    fn the_picture_does_not_depend_on_strips_and_dispatches() {
        let Some(gpu) = Gpu::open(true).unwrap() else { return };
        let scene = scene();
        let values = Values { method: Some("point-splat".to_owned()), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        let plan = crate::methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
        let expected = Method::blur(&PointSplat, scene.clone(), &plan, &|_| {}).unwrap();
        for (max_visits, min_passes) in [(MAX_VISITS, 2), (20_000_000, 6), (1_000_000, 60)] {
            let before = gpu.usage().unwrap().passes;
            let splat = GpuSplat { max_visits, ..GpuSplat::<3>::new(&gpu, &scene, &plan) };
            let found = splat.picture(&|_| {}).unwrap();
            let passes = gpu.usage().unwrap().passes - before;
            assert!(passes >= min_passes, "{passes} passes of {max_visits} visits");
            for (found, expected) in found.iter().zip(&expected.planes) {
                for (found, expected) in found.values().iter().zip(expected.values()) {
                    assert!((found - expected).abs() < 1e-5 * (1.0 + expected), "{found}, not {expected}");
                }
            }
        }
    }
}
