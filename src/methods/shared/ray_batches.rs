//! Batches of views for methods that trace rays on a GPU: sums over the rays of each pixel, and the picture from these sums.
//!
//! A batch traces some of the views for all pixels, and its sum is added to that of the batches before it. This keeps submissions
//! short and limits each sum to a few hundred terms, for which single precision suffices. The shader part is
//! `shaders/shared/ray_sums.wgsl`.
//!
//! Memory: 36 bytes per pixel.

use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, MAX_ROUNDS, Shader, Work, bands, mirrored};
use crate::image::Image;
use crate::methods::contract::Progress;
use crate::methods::shared::MIN_HIT;
use std::ops::Range;

/// Constant that [`RAY_SUMS`] needs.
pub(in crate::methods) const RAY_SUMS_CONSTANT: (&str, Constant) =
    ("MIN_HIT", Constant::Float(MIN_HIT as f32));

/// Text of `shaders/shared/ray_sums.wgsl`: bindings of sums and picture, and functions on them. It precedes a method's own text.
pub(in crate::methods) const RAY_SUMS: &str = include_str!("../../../shaders/shared/ray_sums.wgsl");

/// Bytes of sums per pixel.
const SUM_BYTES: usize = size_of::<[f32; 5]>();

/// Bytes of the picture per pixel.
const PIXEL_BYTES: usize = size_of::<[f32; 4]>();

/// Minimum and maximum number of views per batch: smaller batches do not occupy a GPU fully, larger ones block it for other
/// programs.
const BATCH_VIEWS: [usize; 2] = [16, 64];

mirrored! {
    /// A batch: some of the views of one set.
    pub(in crate::methods) struct Batch {
        /// First view.
        first_view: u32,
        /// End of the range of views (exclusive).
        end_view: u32,
        /// Whether this is the first batch: it overwrites the sums.
        begins: u32,
        /// Bit `k` is set where these views render channel `k` of the picture.
        channels: u32,
        /// Whether rays that hit nothing are transparent; otherwise they are left out of the mean.
        transparent_background: u32,
        /// Number of pixels of the band.
        pixels: u32,
    }
}

/// Sums over the rays of a band's pixels, and the picture made from them.
#[derive(Debug)]
pub(in crate::methods) struct Batches<'g> {
    gpu: &'g Gpu,
    resolve: Kernel,
    sums: Buffer,
    picture: Buffer,
    pixels: usize,
    transparent_background: bool,
}

impl<'g> Batches<'g> {
    /// Allocates sums and picture for `pixels` pixels; `shader` begins with [`RAY_SUMS`].
    pub(in crate::methods) fn new(
        gpu: &'g Gpu,
        shader: &'static Shader,
        pixels: usize,
        transparent_background: bool,
    ) -> Result<Self, Error> {
        Ok(Self {
            gpu,
            resolve: gpu.kernel(shader, "resolve")?,
            sums: gpu.zeros::<[f32; 5]>("sums", pixels)?,
            picture: gpu.zeros::<[f32; 4]>("the picture", pixels)?,
            pixels,
            transparent_background,
        })
    }

    /// Maximum number of rows of `width` pixels in a band on `gpu`, if the method's largest buffer takes `largest` bytes per
    /// pixel and all of its buffers together `all`, beside sums and picture.
    pub(in crate::methods) fn max_rows(gpu: &Gpu, width: usize, [largest, all]: [usize; 2]) -> usize {
        let row = |bytes: usize| (bytes * width).max(1) as u64;
        let by_buffer = gpu.max_binding_bytes() / row(largest.max(SUM_BYTES).max(PIXEL_BYTES));
        let by_all = gpu.max_working_bytes() / row(all + SUM_BYTES + PIXEL_BYTES);
        by_buffer.min(by_all) as usize
    }

    /// Sums the rays of `views`, batch by batch. `add_pass` adds the pass that traces a batch, with the bindings of batch and
    /// sums; `progress` is called with the number of views of each completed batch. `rounds` is the maximum number of loop
    /// iterations of a thread per view.
    pub(in crate::methods) fn follow(
        &self,
        (views, rounds): (Range<usize>, usize),
        add_pass: impl Fn(&mut Work<'_>, [(u32, &Buffer); 2]) -> Result<(), Error>,
        progress: impl Fn(usize),
    ) -> Result<(), Error> {
        let max_views = (views.len() as f32).sqrt().ceil() as usize;
        let max_views =
            max_views.clamp(BATCH_VIEWS[0], BATCH_VIEWS[1]).min(MAX_ROUNDS / rounds.max(1)).max(1);
        for first in views.clone().step_by(max_views) {
            let end = (first + max_views).min(views.end);
            let batch = self.gpu.uniform(&self.batch(first..end, first == views.start, &[]))?;
            self.gpu.submit(|work| add_pass(work, [(0, &batch), (1, &self.sums)]))?;
            // Without the wait all batches would be submitted at once, and progress would not be known.
            self.gpu.finish()?;
            progress(end - first);
        }
        Ok(())
    }

    /// Computes `channels` of the picture from the sums, after the passes that `add_pass` adds with the same bindings.
    pub(in crate::methods) fn resolve(
        &self,
        channels: &[usize],
        add_pass: impl Fn(&mut Work<'_>, [(u32, &Buffer); 2]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let batch = self.gpu.uniform(&self.batch(0..0, false, channels))?;
        let bindings = [(0, &batch), (1, &self.sums)];
        self.gpu.submit(|work| {
            add_pass(work, bindings)?;
            let [batch, sums] = bindings;
            work.pass(&self.resolve, &[batch, sums, (2, &self.picture)], groups(self.pixels))
        })
    }

    fn batch(&self, views: Range<usize>, begins: bool, channels: &[usize]) -> Batch {
        Batch {
            first_view: views.start as u32,
            end_view: views.end as u32,
            begins: begins.into(),
            channels: channels.iter().map(|channel| 1 << channel).sum(),
            transparent_background: self.transparent_background.into(),
            pixels: self.pixels as u32,
        }
    }

    /// Copies the band's rows into `image`.
    fn read_into(&self, image: &mut Image, band: &Band) -> Result<(), Error> {
        let row = image.width();
        let rows = band.rows.start * row..band.rows.end * row;
        let [red, green, blue, alpha] =
            image.planes.each_mut().map(|plane| &mut plane.values_mut()[rows.clone()]);
        self.gpu.read_into(&self.picture, &mut [red, green, blue, alpha])
    }
}

/// Renders a picture of `width × height` pixels in bands: at most `max_rows` rows are on the GPU at once, and rays read up to
/// `reach_rows` more rows on either side. `make(band, progress)` renders a band.
pub(in crate::methods) fn picture_of_batches<'g>(
    (width, height): (usize, usize),
    [reach_rows, max_rows]: [usize; 2],
    progress: &Progress<'_>,
    make: impl Fn(&Band, &dyn Fn(f32)) -> Result<Batches<'g>, Error>,
) -> Result<Image, Error> {
    let mut image = Image::transparent(width, height);
    let bands = bands(height, reach_rows, max_rows)?;
    for (i, band) in bands.iter().enumerate() {
        let progress = |share: f32| progress((i as f32 + share) / bands.len() as f32);
        make(band, &progress)?.read_into(&mut image, band)?;
    }
    Ok(image)
}

/// Workgroups of 64 threads for `pixels`, in rows of at most `ROW` workgroups.
fn groups(pixels: usize) -> [u32; 3] {
    const ROW: usize = 1 << 15;
    let groups = pixels.div_ceil(64);
    [groups.min(ROW) as u32, groups.div_ceil(ROW) as u32, 1]
}
