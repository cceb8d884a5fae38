//! Planes of a band on a GPU: colour in one buffer, all other planes in a second one, so that no buffer has more than three
//! planes.

use super::backdrop::{Backdrop, before};
use super::content::CoveragePlanes;
use crate::error::Error;
use crate::gpu::{Band, Buffer, Gpu, Kernel, Work, bands, mirrored, tiles};
use crate::image::{Image, Plane};
use crate::methods::Progress;
use std::ops::Range;

/// Text of `shaders/shared/coverage_planes.wgsl`.
pub(in crate::methods) const COVERAGE_PLANES_WGSL: &str =
    include_str!("../../../shaders/shared/coverage_planes.wgsl");

/// Text of `shaders/shared/other_coverage_planes.wgsl`.
pub(in crate::methods) const OTHER_COVERAGE_PLANES_WGSL: &str =
    include_str!("../../../shaders/shared/other_coverage_planes.wgsl");

/// Text of `shaders/shared/visible.wgsl`.
pub(in crate::methods) const VISIBLE_WGSL: &str = include_str!("../../../shaders/shared/visible.wgsl");

mirrored! {
    /// Position of a band in the frame, and of the frame in level 0 of a pyramid.
    pub(in crate::methods) struct Frame {
        /// Size of the frame.
        width: i32,
        height: i32,
        /// The rows that the band reads.
        source_first: i32,
        source_rows: i32,
        /// The rows that the band makes.
        made_first: i32,
        made_rows: i32,
        /// Column and row of level 0 where the frame begins.
        origin_x: i32,
        origin_y: i32,
        /// Number of content planes.
        channels: i32,
    }
}

impl Frame {
    /// The position of a band in a frame of `width × height` pixels.
    pub(in crate::methods) fn new(
        (width, height): (usize, usize),
        Band { rows, source }: &Band,
        channels: usize,
    ) -> Self {
        Self {
            width: width as i32,
            height: height as i32,
            source_first: source.start as i32,
            source_rows: source.len() as i32,
            made_first: rows.start as i32,
            made_rows: rows.len() as i32,
            origin_x: 0,
            origin_y: 0,
            channels: channels as i32,
        }
    }
}

/// Number of planes in the first buffer, and maximum number in the second.
const PLANES_PER_BUFFER: usize = 3;

/// Side of the workgroups for planes and levels, in threads.
pub(super) const TILE: usize = 16;

/// Planes of one size.
#[derive(Debug)]
pub(in crate::methods) struct Planes {
    /// Red, green and blue.
    pub colors: Buffer,
    /// All other planes, in the method's order.
    pub rest: Buffer,
}

impl Planes {
    /// Uploads these rows of `planes`.
    ///
    /// # Errors
    /// When they do not fit, or the device fails.
    pub(in crate::methods) fn upload(
        gpu: &Gpu,
        planes: &[&Plane],
        rows: &Range<usize>,
    ) -> Result<Self, Error> {
        let upload = |planes: &[&Plane]| {
            let range = |plane: &&Plane| plane.width() * rows.start..plane.width() * rows.end;
            let parts: Vec<&[f32]> = planes.iter().map(|plane| &plane.values()[range(plane)]).collect();
            gpu.upload_all("the frame's planes", &parts)
        };
        let (colors, rest) = planes.split_at(planes.len().min(PLANES_PER_BUFFER));
        Ok(Self { colors: upload(colors)?, rest: upload(rest)? })
    }

    /// Uploads colour, coverage and CoC radius (or the method's equivalent of it) of these rows of a peel.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(in crate::methods) fn from_peel(
        gpu: &Gpu,
        peel: &CoveragePlanes,
        coc_px: &Plane,
        rows: &Range<usize>,
    ) -> Result<Self, Error> {
        let planes: Vec<&Plane> = peel.content.iter().chain([&peel.coverage, coc_px]).collect();
        Self::upload(gpu, &planes, rows)
    }

    /// `count` planes of `values` zeros each.
    ///
    /// # Errors
    /// As [`Self::upload`].
    pub(in crate::methods) fn zeros(gpu: &Gpu, count: usize, values: usize) -> Result<Self, Error> {
        let zeros = |count: usize| gpu.zeros::<f32>("the frame's planes", count * values);
        Ok(Self {
            colors: zeros(count.min(PLANES_PER_BUFFER))?,
            rest: zeros(count.saturating_sub(PLANES_PER_BUFFER))?,
        })
    }

    /// Copies red, green and blue to these rows of `image`; alpha is the first of the other planes if `transparent`, otherwise 1.
    ///
    /// # Errors
    /// When the device fails.
    fn read_into(
        &self,
        gpu: &Gpu,
        image: &mut Image,
        rows: &Range<usize>,
        transparent: bool,
    ) -> Result<(), Error> {
        let [red, green, blue, alpha] = image.planes.each_mut().map(|plane| {
            let width = plane.width();
            &mut plane.values_mut()[width * rows.start..width * rows.end]
        });
        gpu.read_into(&self.colors, &mut [red, green, blue])?;
        if transparent {
            return gpu.read_into(&self.rest, &mut [alpha]);
        }
        alpha.fill(1.0);
        Ok(())
    }
}

/// Memory that a method needs per row of a band.
#[derive(Debug, Clone, Copy)]
pub(in crate::methods) struct RowNeeds {
    /// Number of planes in total.
    pub planes: usize,
    /// Values in the largest buffer other than those of planes.
    pub values: usize,
}

/// Renders a picture of `size` band by band. `make(band, progress)` returns the planes of one band, content first; `transparent`
/// tells whether content has an alpha plane.
///
/// # Errors
/// When not even a row fits, or the device fails.
pub(in crate::methods) fn picture_in_bands(
    gpu: &Gpu,
    (size, transparent): ((usize, usize), bool),
    (reach, needs): (usize, RowNeeds),
    progress: &Progress<'_>,
    make: impl Fn(&Band, &Progress<'_>) -> Result<Planes, Error>,
) -> Result<Image, Error> {
    let bands = bands_of(gpu, size, (reach, needs))?;
    picture_of_bands(gpu, (size, transparent), &bands, progress, make)
}

/// Renders a picture as [`picture_in_bands`] does, before `backdrop`: of each band red, green, blue, divided by coverage, and coverage.
///
/// # Errors
/// When not even a row fits, or the device fails.
pub(in crate::methods) fn picture_before(
    gpu: &Gpu,
    (size, backdrop): ((usize, usize), Option<&Backdrop>),
    bands: (usize, RowNeeds),
    progress: &Progress<'_>,
    make: impl Fn(&Band, &Progress<'_>) -> Result<Planes, Error>,
) -> Result<Image, Error> {
    let picture = picture_in_bands(gpu, (size, backdrop.is_some()), bands, progress, make)?;
    if backdrop.is_none() {
        return Ok(picture);
    }
    let Image { planes: [red, green, blue, coverage] } = picture;
    let opaque = Plane::filled(size.0, size.1, 1.0);
    Ok(before(Image { planes: [red, green, blue, opaque] }, &coverage, backdrop))
}

/// The bands of a picture of `width × height` pixels, each of which reads up to `reach` more rows on either side.
///
/// # Errors
/// When not even a row fits.
pub(in crate::methods) fn bands_of(
    gpu: &Gpu,
    (width, height): (usize, usize),
    (reach, needs): (usize, RowNeeds),
) -> Result<Vec<Band>, Error> {
    let value_bytes = size_of::<f32>() as u64;
    let row_bytes = value_bytes * needs.values.max(PLANES_PER_BUFFER * width) as u64;
    let working_row_bytes = value_bytes * (needs.planes * width + needs.values) as u64;
    let max_rows = (gpu.max_binding_bytes() / row_bytes).min(gpu.max_working_bytes() / working_row_bytes);
    bands(height, reach, max_rows as usize)
}

/// Renders a picture as [`picture_in_bands`] does, with the given bands.
///
/// # Errors
/// When the device fails.
pub(in crate::methods) fn picture_of_bands(
    gpu: &Gpu,
    (size, transparent): ((usize, usize), bool),
    bands: &[Band],
    progress: &Progress<'_>,
    make: impl Fn(&Band, &Progress<'_>) -> Result<Planes, Error>,
) -> Result<Image, Error> {
    let mut image = Image::transparent(size.0, size.1);
    for (i, band) in bands.iter().enumerate() {
        let share = |share: f32| progress((i as f32 + share) / bands.len() as f32);
        make(band, &share)?.read_into(gpu, &mut image, &band.rows, transparent)?;
        share(1.0);
    }
    Ok(image)
}

/// Adds a pass that runs `kernel` at every pixel of `rows` rows.
///
/// # Errors
/// When the bindings are not the kernel's.
pub(in crate::methods) fn at_pixels(
    work: &mut Work<'_>,
    kernel: &Kernel,
    bindings: &[(u32, &Buffer)],
    (width, rows): (usize, usize),
) -> Result<(), Error> {
    work.pass(kernel, bindings, tiles(width, rows, TILE))
}
