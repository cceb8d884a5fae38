//! `point-splat` on a GPU: each pixel gathers what the CPU scatters over it.
//!
//! Points are made as on the CPU, which takes little of the time, and packed into [`blocks`]; sprites become a table of
//! [`weights`]. A thread then walks the points that may reach its pixels and keeps their layers to itself, so that no sum
//! depends on the order of threads. Rows go in strips, and the points of each in goes, lest one pass should take long.
//!
//! Cost: as on the CPU, but for the blocks that a tile looks at in vain. Memory: 32 bytes a point and 24 a pixel, in
//! bands of rows where that is too much; and for each radius that points have a table of the square around its sprite, so with
//! all radii up to C some 1000 C² bytes, which is what limits C.

mod blocks;
mod weights;

use super::layers::bounds;
use super::parameters::PointSplatParameters;
use super::splat::{Grid, Point};
use super::sprites::Centre;
use super::{PointSplat, Prepared};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, MAX_ROUNDS, Mirrored, Shader, bands, mirrored, tiles};
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::methods::shared::{peels, picture};
use crate::scene::{EffectKind, Scene};
use blocks::{BLOCK, Blocks, REGION, count_in_row};
use rayon::prelude::*;
use std::ops::Range;
use weights::Table;

/// Pixels along the side of what a workgroup makes.
const TILE: usize = 8;

/// Bytes a point takes in either of its buffers, and a pixel of the result.
const BYTES_A_POINT: usize = 16;

/// What two neighbouring pixels' layers take.
const BYTES_A_PAIR: usize = 2 * 3 * 5 * size_of::<f32>();

/// Points looked at by all pixels of a pass together: some tenths of a second of a slow card.
const MAX_VISITS: usize = 4_000_000_000;

/// Layers of a strip take no more: they are read and written in every go.
const MAX_SUM_BYTES: usize = 1 << 26;

mirrored! {
    /// What a strip of the picture is made of.
    struct Params {
        /// Of the picture, in pixels.
        width: i32,
        height: i32,
        /// Pixel of the first block's upper left corner.
        source_column: i32,
        source_row: i32,
        /// Picture rows that the band makes: the first, and how many.
        band_row: i32,
        band_rows: i32,
        /// First row of the strip, from the band's first.
        strip_row: i32,
        /// Rows of blocks to add: the first, and the one past the last.
        first_blocks: u32,
        last_blocks: u32,
        /// Whether nothing was added before.
        is_first: u32,
        /// Blocks and regions beside one another.
        blocks_across: u32,
        regions_across: i32,
        /// Planes of content.
        channels: u32,
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
        let content = if plan.does(EffectKind::TransparentBackground) {
            Splatting::<4>::new(gpu, scene, plan).content(progress)?
        } else {
            Splatting::<3>::new(gpu, scene, plan).content(progress)?
        };
        Ok(picture(content))
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// How many rows away points reach.
fn reach<const N: usize>(grids: &[Grid<N>]) -> usize {
    let of_row = |(row, centre): (&Vec<Point<N>>, Centre)| row.iter().map(|point| point.reach(centre)).max();
    let rows = grids.iter().flat_map(|grid| grid.rows.iter().map(|row| (row, grid.centre)));
    rows.filter_map(of_row).max().unwrap_or(0) as usize
}

/// Points on their way into a picture.
struct Splatting<'a, const N: usize> {
    gpu: &'a Gpu,
    prepared: Prepared<N>,
    size: (usize, usize),
    delta: f32,
    /// How far the points reach.
    reach: usize,
    /// [`MAX_VISITS`], or fewer.
    max_visits: usize,
}

/// What the GPU has of a band.
struct Resident {
    /// Of the blocks: how many lie beside one another, and the first one's first pixel.
    blocks_across: usize,
    origin: [i32; 2],
    /// Blocks and points that a thread may look at in one row of blocks.
    rounds: usize,
    /// Rows of a strip.
    strip_rows: usize,
    /// Points, their shapes, blocks, windows, weights, bounds of layers.
    read: [Buffer; 6],
    sums: Buffer,
    picture: Buffer,
}

impl<'a, const N: usize> Splatting<'a, N> {
    /// The points of `scene`.
    fn new(gpu: &'a Gpu, scene: &Scene, plan: &Plan) -> Self {
        let size = scene.picture_size();
        let prepared = Prepared::<N>::new(peels(scene.clone(), plan), size, plan);
        let reach = reach(&prepared.grids);
        let delta = plan.parameters.get::<PointSplatParameters>().delta;
        Self { gpu, prepared, size, delta, reach, max_visits: MAX_VISITS }
    }

    /// Content planes of the picture.
    fn content(&self, progress: &Progress<'_>) -> Result<Vec<Plane>, Error> {
        let (width, height) = self.size;
        let mut planes = vec![Plane::zeros(width, height); N];
        for band in self.bands()? {
            let pixels = band.rows.start * width..band.rows.end * width;
            let mut parts: Vec<&mut [f32]> =
                planes.iter_mut().map(|plane| &mut plane.values_mut()[pixels.clone()]).collect();
            self.make(&band, &mut parts, progress)?;
        }
        Ok(planes)
    }

    /// How many rows away points are looked at: past one height off, their repetitions tell nothing new.
    fn rows_reached(&self) -> usize {
        self.reach.min(self.size.1)
    }

    /// The bands that the adapter has room for.
    fn bands(&self) -> Result<Vec<Band>, Error> {
        let (width, height) = self.size;
        let points = |y| count_in_row(&self.prepared.grids, y, self.size);
        let max_points = (0..height).into_par_iter().map(points).max().unwrap_or(0);
        let binding = self.gpu.max_binding_bytes() as usize / (BYTES_A_POINT * max_points.max(width));
        let together = 2 * BYTES_A_POINT * max_points + (BYTES_A_POINT + size_of::<[f32; 2]>()) * width;
        let room = (self.gpu.max_working_bytes() as usize - MAX_SUM_BYTES) / together;
        let max_rows = binding.min(room);
        // The rows above and below the picture need room too.
        let is_one = height + 2 * self.rows_reached() <= max_rows;
        bands(height, self.rows_reached(), if is_one { height } else { max_rows.min(height - 1) })
    }

    /// Weights of all sprites of the rows that a band reads.
    fn table(&self, source: Range<usize>) -> Result<Table, Error> {
        let points = self.prepared.grids.iter().flat_map(|grid| {
            let spacing = grid.centre.spacing();
            let rows = &grid.rows[(source.start / spacing).min(grid.rows.len())..];
            let count = source.end.div_ceil(spacing) - source.start / spacing;
            rows.iter().take(count).flatten().map(|point| (point, grid.centre))
        });
        let table = Table::new(points, self.size);
        let (bytes, max_bytes) = (size_of::<f32>() * table.count, self.gpu.max_binding_bytes());
        if bytes as u64 > max_bytes {
            return Err(Error::device("the sprites are too large for the GPU")
                .with("found", format!("{bytes} bytes"))
                .with("wanted", format!("{max_bytes} bytes at most"))
                .help("use --device cpu"));
        }
        Ok(table)
    }

    /// Hands the GPU what it needs for a band.
    fn upload(&self, Band { rows, source }: &Band) -> Result<Resident, Error> {
        let (gpu, (width, _)) = (self.gpu, self.size);
        let table = self.table(source.clone())?;
        let reach = self.rows_reached() as i32;
        let reached = rows.start as i32 - reach..rows.end as i32 + reach;
        let blocks = Blocks::new(&self.prepared.grids, reached, self.size, &table);
        let windows = blocks.windows(rows.clone(), width);
        let visible_px = &self.prepared.visible_px.values()[rows.start * width..rows.end * width];
        let bounds: Vec<[f32; 2]> = visible_px.iter().map(|&coc_px| bounds(coc_px, self.delta)).collect();
        let rounds = 1 + blocks.across + self.touched(TILE).min(blocks.across) * blocks.max_points();
        let strip_rows = self.strip_rows(rows.len(), rounds);
        Ok(Resident {
            blocks_across: blocks.across,
            origin: blocks.origin,
            rounds,
            strip_rows,
            read: [
                gpu.upload("points", &blocks.lights)?,
                gpu.upload("points", &blocks.shapes)?,
                gpu.upload("blocks of points", &blocks.blocks)?,
                gpu.upload("regions", &windows)?,
                gpu.upload("sprites", &table.weights(&self.prepared.sprites))?,
                gpu.upload("the bounds of layers", &bounds)?,
            ],
            sums: gpu.zeros::<u8>("layers", strip_rows * width.div_ceil(2) * BYTES_A_PAIR)?,
            picture: gpu.zeros::<f32>("the picture", N * width * rows.len())?,
        })
    }

    /// Makes the rows of a band, `parts` being those of each plane.
    fn make(&self, band: &Band, parts: &mut [&mut [f32]], progress: &Progress<'_>) -> Result<(), Error> {
        let resident = self.upload(band)?;
        let (start, count) = (band.rows.start, band.rows.len());
        for first in (0..count).step_by(resident.strip_rows) {
            let strip = first..(first + resident.strip_rows).min(count);
            self.draw(&resident, &band.rows, strip.clone())?;
            progress((start + strip.end) as f32 / self.size.1 as f32);
        }
        self.gpu.read_into(&resident.picture, parts)
    }

    /// Most blocks that `pixels` beside one another may be reached by, along an axis.
    fn touched(&self, pixels: usize) -> usize {
        (pixels + 2 * self.reach).div_ceil(BLOCK) + 1
    }

    /// Rows of a strip in a band of `count` rows: whole tiles, one at least.
    fn strip_rows(&self, count: usize, rounds: usize) -> usize {
        let width = self.size.0;
        let max_bytes = MAX_SUM_BYTES.min(self.gpu.max_binding_bytes() as usize);
        let room = max_bytes / (width.div_ceil(2) * BYTES_A_PAIR);
        let quick = self.max_visits / (width * rounds * self.touched(TILE));
        (room.min(quick).min(count.next_multiple_of(TILE)) / TILE).max(1) * TILE
    }

    /// Draws the rows `strip` of the band of the picture rows `rows`.
    fn draw(&self, resident: &Resident, rows: &Range<usize>, strip: Range<usize>) -> Result<(), Error> {
        let (gpu, (width, _)) = (self.gpu, self.size);
        let Resident { read, sums, picture, .. } = resident;
        let [lights, shapes, blocks, windows, weights, bounds] = read;
        let groups = tiles(width, strip.len(), TILE);
        let [splat, blend] = [gpu.kernel(&SHADER, "splat")?, gpu.kernel(&SHADER, "blend")?];
        // Rows of blocks that reach the strip.
        let last = (strip.end + 2 * self.rows_reached()).div_ceil(BLOCK);
        let step = self.rows_a_go(resident);
        for first in (strip.start / BLOCK..last).step_by(step) {
            let params = self.params(resident, rows, &strip, first..(first + step).min(last));
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
        let params = gpu.uniform(&self.params(resident, rows, &strip, 0..0))?;
        gpu.submit(|work| work.pass(&blend, &[(0, &params), (7, sums), (8, picture)], groups))
    }

    /// How many rows of blocks are added at once to a strip.
    fn rows_a_go(&self, resident: &Resident) -> usize {
        let visits = resident.rounds * self.size.0 * resident.strip_rows;
        (MAX_ROUNDS / resident.rounds).min(self.max_visits / visits).max(1)
    }

    fn params(
        &self,
        resident: &Resident,
        rows: &Range<usize>,
        strip: &Range<usize>,
        blocks: Range<usize>,
    ) -> Params {
        let (width, height) = self.size;
        let [source_column, source_row] = resident.origin;
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
            blocks_across: resident.blocks_across as u32,
            regions_across: width.div_ceil(REGION) as i32,
            channels: N as u32,
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

    /// A textured wall that fills the frame behind a bar, both blurred farther than the frame is wide.
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
    fn strips_and_goes_leave_no_trace() {
        let Some(gpu) = Gpu::open(true).unwrap() else { return };
        let scene = scene();
        let values = Values { method: Some("point-splat".to_owned()), ..Values::default() };
        let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        let plan = crate::methods::Registry::default().plan(&scene.analyze(), &settings).unwrap();
        let expected = Method::blur(&PointSplat, scene.clone(), &plan, &|_| {}).unwrap();
        for (max_visits, min_passes) in [(MAX_VISITS, 2), (20_000_000, 6), (1_000_000, 60)] {
            let before = gpu.usage().unwrap().passes;
            let splatting = Splatting { max_visits, ..Splatting::<3>::new(&gpu, &scene, &plan) };
            let found = splatting.content(&|_| {}).unwrap();
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
