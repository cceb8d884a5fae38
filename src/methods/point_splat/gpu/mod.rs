//! `point-splat` on a GPU: each pixel gathers what the CPU scatters over it.
//!
//! Points are made as on the CPU, which takes little of the time, and packed into [`blocks`]; sprites become a table of
//! [`weights`]. A thread then walks the points that may reach its pixels and keeps their layers to itself, so that no sum
//! depends on the order of threads. Rows go in strips, lest one submission should take long.
//!
//! Cost: as on the CPU, but for the blocks that a tile looks at in vain. Memory: 32 bytes a point and 24 a pixel, in
//! bands of rows where that is too much; and for each radius that points have a table of the square around its sprite, so with
//! all radii up to C some 1000 C² bytes, which is what limits C.

mod blocks;
mod weights;

use super::layers::bounds;
use super::splat::Grid;
use super::{PointSplat, Prepared};
use crate::error::Error;
use crate::gpu::{Band, Gpu, Mirrored, Shader, bands, mirrored, tiles};
use crate::image::{Image, Plane};
use crate::methods::shared::{peels, picture};
use crate::methods::{Progress, Twin};
use crate::scene::{EffectKind, Plan, Scene};
use blocks::{BLOCK, Blocks, REGION};
use std::ops::Range;
use weights::Table;

/// Pixels along the side of what a workgroup makes.
const TILE: usize = 8;

/// Bytes a point takes in either of its buffers, and a pixel of the result.
const BYTES_A_POINT: usize = 16;

/// Points looked at by all pixels of a submission together: some tenths of a second of a slow card.
const MOST_VISITS: f64 = 2e9;

mirrored! {
    /// What a strip of the picture is made of.
    struct Params {
        /// Of the picture, in pixels.
        width: i32,
        height: i32,
        /// Picture row of the first row of blocks.
        source_row: i32,
        /// Picture rows that the band makes: the first, and how many.
        band_row: i32,
        band_rows: i32,
        /// First row of the strip, from the band's first.
        strip_row: i32,
        /// Blocks and regions beside one another.
        blocks_across: u32,
        regions_across: i32,
        /// Planes of content.
        channels: u32,
        /// Pixels along the sides of a block and of a region.
        block: i32,
        region: i32,
    }
}

static SHADER: Shader = Shader {
    name: "point_splat",
    parts: &[include_str!("../../../../shaders/methods/point_splat.wgsl")],
    structs: &[Params::LAYOUT],
};

impl Twin for PointSplat {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let content = if plan.does(EffectKind::OpenBackground) {
            gathered::<4>(gpu, scene, plan, progress)?
        } else {
            gathered::<3>(gpu, scene, plan, progress)?
        };
        Ok(picture(content))
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// Content planes of the picture.
fn gathered<const N: usize>(
    gpu: &Gpu,
    scene: &Scene,
    plan: &Plan,
    progress: &Progress<'_>,
) -> Result<Vec<Plane>, Error> {
    let size = scene.picture_size();
    let prepared = Prepared::<N>::new(peels(scene.clone(), plan), size, plan);
    let splatting = Splatting { gpu, prepared, size, delta: plan.parameters.point_splat.delta };
    let mut planes = vec![Plane::zeros(size.0, size.1); N];
    for band in splatting.bands()? {
        let pixels = band.rows.start * size.0..band.rows.end * size.0;
        let mut parts: Vec<&mut [f32]> =
            planes.iter_mut().map(|plane| &mut plane.values_mut()[pixels.clone()]).collect();
        splatting.make(&band, &mut parts, progress)?;
    }
    Ok(planes)
}

impl<const N: usize> Grid<N> {
    /// The points whose first picture row is `y`.
    fn row(&self, y: usize) -> &[super::Point<N>] {
        let spacing = self.centre.spacing();
        let row = if y.is_multiple_of(spacing) { self.rows.get(y / spacing) } else { None };
        row.map_or(&[], |row| &row[..])
    }
}

/// Points on their way into a picture.
struct Splatting<'a, const N: usize> {
    gpu: &'a Gpu,
    prepared: Prepared<N>,
    size: (usize, usize),
    delta: f32,
}

impl<const N: usize> Splatting<'_, N> {
    /// The bands that the adapter has room for.
    fn bands(&self) -> Result<Vec<Band>, Error> {
        let (width, height) = self.size;
        let points = |y| self.prepared.grids.iter().map(|grid| grid.row(y).len()).sum::<usize>();
        let most_points = (0..height).map(points).max().unwrap_or(0);
        let binding = self.gpu.most_binding_bytes() as usize / (BYTES_A_POINT * most_points.max(width));
        let together = 2 * BYTES_A_POINT * most_points + (BYTES_A_POINT + size_of::<[f32; 2]>()) * width;
        let working = self.gpu.most_working_bytes() as usize / together;
        bands(height, self.reach(0..height), binding.min(working))
    }

    /// How far the points of the picture rows `rows` reach.
    fn reach(&self, rows: Range<usize>) -> usize {
        let reach = |grid: &Grid<N>| {
            let points = rows.clone().flat_map(|y| grid.row(y));
            points.map(|point| point.reach(grid.centre)).max().unwrap_or(0)
        };
        self.prepared.grids.iter().map(reach).max().unwrap_or(0) as usize
    }

    /// Weights of the sprites of the picture rows `rows`.
    fn table(&self, rows: Range<usize>) -> Result<Table, Error> {
        let grids = self.prepared.grids.iter();
        let points =
            grids.flat_map(|grid| rows.clone().flat_map(|y| grid.row(y)).map(|point| (point, grid.centre)));
        let table = Table::new(points, self.size);
        let (bytes, most_bytes) = (size_of::<f32>() * table.count, self.gpu.most_binding_bytes());
        if bytes as u64 > most_bytes {
            return Err(Error::device("the sprites are too large for the GPU")
                .with("found", format!("{bytes} bytes"))
                .with("wanted", format!("{most_bytes} bytes at most"))
                .help("use --device cpu"));
        }
        Ok(table)
    }

    /// Makes the rows of a band, `parts` being those of each plane.
    fn make(&self, band: &Band, parts: &mut [&mut [f32]], progress: &Progress<'_>) -> Result<(), Error> {
        let (gpu, (width, height)) = (self.gpu, self.size);
        let Band { rows, source } = band.clone();
        let table = self.table(source.clone())?;
        let blocks = Blocks::new(&self.prepared.grids, source.clone(), width, &table);
        let windows = blocks.windows(source.start, rows.clone(), width);
        let visible_px = &self.prepared.visible_px.values()[rows.start * width..rows.end * width];
        let bounds: Vec<[f32; 2]> = visible_px.iter().map(|&coc_px| bounds(coc_px, self.delta)).collect();
        let target = gpu.zeros::<f32>("the picture", N * width * rows.len())?;
        let read = [
            gpu.upload("points", &blocks.lights)?,
            gpu.upload("points", &blocks.shapes)?,
            gpu.upload("blocks of points", &blocks.blocks)?,
            gpu.upload("regions", &windows)?,
            gpu.upload("sprites", &table.weights(&self.prepared.sprites))?,
            gpu.upload("the bounds of layers", &bounds)?,
        ];
        let kernel = gpu.kernel(&SHADER, "splat")?;
        for strip in self.strips(&rows, self.reach(source.clone())) {
            let params = gpu.uniform(&Params {
                width: width as i32,
                height: height as i32,
                source_row: source.start as i32,
                band_row: rows.start as i32,
                band_rows: rows.len() as i32,
                strip_row: strip.start as i32,
                blocks_across: blocks.across as u32,
                regions_across: width.div_ceil(REGION) as i32,
                channels: N as u32,
                block: BLOCK as i32,
                region: REGION as i32,
            })?;
            let [lights, shapes, blocks, windows, weights, bounds] = &read;
            let bindings = [
                (0, &params),
                (1, lights),
                (2, shapes),
                (3, blocks),
                (4, windows),
                (5, weights),
                (6, bounds),
                (7, &target),
            ];
            gpu.submit(|work| work.pass(&kernel, &bindings, tiles(width, strip.len(), TILE)))?;
            progress((rows.start + strip.end) as f32 / height as f32);
        }
        gpu.read_into(&target, parts)
    }

    /// The rows of a band, from its first, in strips whose pixels look at [`MOST_VISITS`] points when all reach as far as `reach`.
    fn strips(&self, rows: &Range<usize>, reach: usize) -> impl Iterator<Item = Range<usize>> + use<N> {
        let (width, height) = self.size;
        let [across, down] = [width, height].map(|side| (2 * reach + TILE + BLOCK).min(side) as f64);
        let fit = (MOST_VISITS / (across * down * width as f64)) as usize;
        let (count, lines) = (rows.len(), (fit / TILE).max(1) * TILE);
        (0..count).step_by(lines).map(move |start| start..(start + lines).min(count))
    }
}
