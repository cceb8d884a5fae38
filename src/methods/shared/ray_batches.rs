//! Batches of views for methods that trace rays on a GPU: sums over the rays of each pixel, and the picture from these sums.
//!
//! A batch traces some of the views for all pixels, and its sum is added to that of the batches before it. This keeps submissions
//! short and limits each sum to a few hundred terms, for which single precision suffices. The shader part is
//! `shaders/shared/ray_sums.wgsl`.
//!
//! Memory: 36 bytes per pixel; 16 more where the background is visible or rays start from different parts of pixels, and 4 more for the
//! background.

use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, MAX_ROUNDS, Shader, Work, bands, mirrored};
use crate::image::Image;
use crate::methods::contract::{LostRays, Progress};
use crate::methods::shared::{MIN_HIT, RayJitter};
use crate::scene::Background;
use std::ops::Range;

/// Constant that [`RAY_SUMS`] needs.
pub(in crate::methods) const RAY_SUMS_CONSTANT: (&str, Constant) =
    ("MIN_HIT", Constant::Float(MIN_HIT as f32));

/// Text of `shaders/shared/ray_sums.wgsl`: bindings of sums and picture, and functions on them. It precedes a method's own text.
pub(in crate::methods) const RAY_SUMS: &str = include_str!("../../../shaders/shared/ray_sums.wgsl");

/// Binding of what each pixel shows in [`RAY_SUMS`].
const PIXELS_BINDING: u32 = 14;

/// Bytes of the picture per pixel.
const PIXEL_BYTES: usize = size_of::<[f32; 4]>();

/// Minimum and maximum number of views per batch: smaller batches do not occupy a GPU fully, larger ones block it for other
/// programs.
const BATCH_VIEWS: [usize; 2] = [16, 64];

mirrored! {
    /// A batch: some of the views of one set, and where the rays of a pixel begin and end.
    pub(in crate::methods) struct Batch {
        /// First view.
        first_view: u32,
        /// End of the range of views (exclusive).
        end_view: u32,
        /// Whether this is the first batch: it overwrites the sums.
        begins: u32,
        /// Bit `k` is set where these views render channel `k` of the picture.
        channels: u32,
        /// Number of pixels of the band.
        pixels: u32,
        /// Whether the background is visible.
        shows_background: u32,
        /// Whether lost rays count as opaque black; otherwise they are left out of the mean.
        lost_are_black: u32,
        /// Whether rays start from different parts of different pixels.
        jitter_by_pixel: u32,
        /// Extent of the rays' origins in a pixel, as a fraction of its width, if that is the same in all.
        jitter: f32,
        /// Width of the picture.
        columns: i32,
        /// First row of the picture's pixels that is uploaded.
        top: i32,
        /// Last row of the picture's pixels that is uploaded.
        bottom: i32,
        /// CoC radius at infinity in pixels.
        coc_infinity_px: f32,
    }
}

/// Both ends of rays: where they begin in their pixel, and what becomes of those that have passed all fragments, see [`Background`].
#[derive(Debug, Clone, Copy)]
pub(in crate::methods) struct RayEnds<'a> {
    /// The part of each pixel in which its rays begin.
    pub jitter: &'a RayJitter,
    /// The background, where it is visible.
    pub background: Option<&'a Background>,
    /// What rays count as that end neither in a fragment nor in the background.
    pub lost_rays: LostRays,
}

impl RayEnds<'_> {
    /// Number of sums per pixel.
    fn sums(self) -> usize {
        if self.background.is_some() { 6 } else { 5 }
    }

    /// Whether pixels differ in where their rays begin, or end.
    fn differ(self) -> bool {
        self.background.is_some() || self.jitter.everywhere().is_none()
    }

    /// Bytes of what is uploaded per pixel.
    fn pixel_bytes(self) -> usize {
        if self.differ() { size_of::<[f32; 4]>() } else { 0 }
    }

    /// The CoC radii at which rays read the stack or the background, if those of the fragments are `fragments_px`.
    pub(in crate::methods) fn range_px(self, [near, far]: [f32; 2]) -> [f32; 2] {
        let ends_px = self.background.map(Background::coc_infinity_px);
        ends_px.map_or([near, far], |ends_px| [near.min(ends_px), far.max(ends_px)])
    }

    /// For each pixel in the rows that `band` of a picture of `width` columns reads: share and last CoC radius of the background, extent
    /// of the rays' origins, and share of the background beside; one texel without meaning if all pixels are alike.
    fn upload(self, gpu: &Gpu, (width, band): (usize, &Band)) -> Result<Buffer, Error> {
        let pixel = |x, y| {
            let [share, beside, last_coc_px] = self.background.map_or([0.0; 3], |background| {
                [background.share(), background.beside(), background.last_coc_px()]
                    .map(|plane| plane.get(x, y))
            });
            [share, last_coc_px, self.jitter.at(x, y), beside]
        };
        let pixels: Vec<[f32; 4]> = if self.differ() {
            band.source.clone().flat_map(|y| (0..width).map(move |x| pixel(x, y))).collect()
        } else {
            vec![[0.0; 4]]
        };
        gpu.upload("the picture's pixels", &pixels)
    }
}

/// Batch, sums and pixels, with their binding numbers in [`RAY_SUMS`].
pub(in crate::methods) type RayBindings<'a> = [(u32, &'a Buffer); 3];

/// Sums over the rays of a band's pixels, and the picture made from them.
#[derive(Debug)]
pub(in crate::methods) struct Batches<'g> {
    gpu: &'g Gpu,
    resolve: Kernel,
    sums: Buffer,
    pixels: Buffer,
    picture: Buffer,
    /// What all batches have in common.
    batch: Batch,
}

impl<'g> Batches<'g> {
    /// Allocates sums and picture for `band` of a picture of `width` columns; `shader` begins with [`RAY_SUMS`].
    pub(in crate::methods) fn new(
        gpu: &'g Gpu,
        shader: &'static Shader,
        (width, band): (usize, &Band),
        ends: RayEnds<'_>,
    ) -> Result<Self, Error> {
        let pixels = width * band.rows.len();
        Ok(Self {
            gpu,
            resolve: gpu.kernel(shader, "resolve")?,
            sums: gpu.zeros::<f32>("sums", ends.sums() * pixels)?,
            pixels: ends.upload(gpu, (width, band))?,
            picture: gpu.zeros::<[f32; 4]>("the picture", pixels)?,
            batch: Batch {
                first_view: 0,
                end_view: 0,
                begins: 0,
                channels: 0,
                pixels: pixels as u32,
                shows_background: ends.background.is_some().into(),
                lost_are_black: (ends.lost_rays == LostRays::Black).into(),
                jitter_by_pixel: ends.jitter.everywhere().is_none().into(),
                jitter: ends.jitter.everywhere().unwrap_or(1.0),
                columns: width as i32,
                top: band.source.start as i32,
                bottom: band.source.end as i32 - 1,
                coc_infinity_px: ends.background.map_or(0.0, Background::coc_infinity_px),
            },
        })
    }

    /// Maximum number of rows of `width` pixels in a band on `gpu`, if the method's largest buffer takes `largest` bytes per
    /// pixel and all of its buffers together `all`, beside sums, what pixels show and picture.
    pub(in crate::methods) fn max_rows(
        gpu: &Gpu,
        width: usize,
        [largest, all]: [usize; 2],
        ends: RayEnds<'_>,
    ) -> usize {
        let row = |bytes: usize| (bytes * width).max(1) as u64;
        let sum_bytes = size_of::<f32>() * ends.sums();
        let by_buffer = gpu.max_binding_bytes() / row(largest.max(sum_bytes).max(PIXEL_BYTES));
        let by_all = gpu.max_working_bytes() / row(all + sum_bytes + ends.pixel_bytes() + PIXEL_BYTES);
        by_buffer.min(by_all) as usize
    }

    /// Sums the rays of `views`, batch by batch. `add_pass` adds the pass that traces a batch, with the bindings of batch, sums
    /// and pixels; `progress` is called with the number of views of each completed batch. `rounds` is the maximum number of loop
    /// iterations of a thread per view.
    pub(in crate::methods) fn follow(
        &self,
        (views, rounds): (Range<usize>, usize),
        add_pass: impl Fn(&mut Work<'_>, RayBindings<'_>) -> Result<(), Error>,
        progress: impl Fn(usize),
    ) -> Result<(), Error> {
        let max_views = (views.len() as f32).sqrt().ceil() as usize;
        let max_views =
            max_views.clamp(BATCH_VIEWS[0], BATCH_VIEWS[1]).min(MAX_ROUNDS / rounds.max(1)).max(1);
        for first in views.clone().step_by(max_views) {
            let end = (first + max_views).min(views.end);
            let batch = Batch {
                first_view: first as u32,
                end_view: end as u32,
                begins: (first == views.start).into(),
                ..self.batch
            };
            let batch = self.gpu.uniform(&batch)?;
            self.gpu.submit(|work| add_pass(work, self.bindings(&batch)))?;
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
        add_pass: impl Fn(&mut Work<'_>, RayBindings<'_>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let channels = channels.iter().map(|channel| 1 << channel).sum();
        let batch = self.gpu.uniform(&Batch { channels, ..self.batch })?;
        let bindings = self.bindings(&batch);
        self.gpu.submit(|work| {
            add_pass(work, bindings)?;
            let [batch, sums, _] = bindings;
            let groups = groups(self.batch.pixels as usize);
            work.pass(&self.resolve, &[batch, sums, (2, &self.picture)], groups)
        })
    }

    fn bindings<'a>(&'a self, batch: &'a Buffer) -> RayBindings<'a> {
        [(0, batch), (1, &self.sums), (PIXELS_BINDING, &self.pixels)]
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
