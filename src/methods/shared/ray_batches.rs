//! Methods that follow rays, on a GPU: the views in goes, the sums of each pixel's rays, and how they become a picture.
//!
//! A go takes some of the views through all pixels, and its sum is added to those before: no submission is long, and no sum has more
//! than a few hundred terms, which single precision bears. `shaders/shared/ray_sums.wgsl` is the other half.
//!
//! Memory: 36 bytes a pixel.

use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, MAX_ROUNDS, Shader, Work, bands, mirrored};
use crate::image::Image;
use crate::methods::contract::Progress;
use crate::methods::shared::MIN_HIT;
use std::ops::Range;

/// What [`RAY_SUMS`] reads of the program.
pub(in crate::methods) const RAY_SUMS_CONSTANT: (&str, Constant) =
    ("MIN_HIT", Constant::Float(MIN_HIT as f32));

/// What sums and picture are bound to, and the shader's text that knows them: before a method's own.
pub(in crate::methods) const RAY_SUMS: &str = include_str!("../../../shaders/shared/ray_sums.wgsl");

/// Bytes of the sums of a pixel.
const SUM_BYTES: usize = size_of::<[f32; 5]>();

/// Bytes of a pixel of the picture.
const PIXEL_BYTES: usize = size_of::<[f32; 4]>();

/// Views of a go: fewer would not keep a card at work, more would keep it from others for long.
const VIEWS: [usize; 2] = [16, 64];

mirrored! {
    /// Some of the views of one set.
    pub(in crate::methods) struct Batch {
        /// From which view.
        first_view: u32,
        /// Before which view.
        end_view: u32,
        /// Whether sums begin with this go.
        begins: u32,
        /// Bit `k` is set where these views make channel `k` of the picture.
        channels: u32,
        /// Whether light that finds nothing is transparent, and not left out of the mean.
        transparent_background: u32,
        /// Pixels that are made.
        pixels: u32,
    }
}

/// What the rays of a band's pixels bring home.
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
    /// For the rays of `pixels` pixels, by a shader that begins with [`RAY_SUMS`].
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

    /// Rows of `width` pixels that `gpu` holds at once, if beside what rays bring home the largest buffer takes `largest` bytes a pixel,
    /// and all of them `all`.
    pub(in crate::methods) fn max_rows(gpu: &Gpu, width: usize, [largest, all]: [usize; 2]) -> usize {
        let row = |bytes: usize| (bytes * width).max(1) as u64;
        let by_buffer = gpu.max_binding_bytes() / row(largest.max(SUM_BYTES).max(PIXEL_BYTES));
        let by_all = gpu.max_working_bytes() / row(all + SUM_BYTES + PIXEL_BYTES);
        by_buffer.min(by_all) as usize
    }

    /// Sums the rays of `views`: `ask` asks for what follows those of a go, with the bindings of go and sums; `progress` is told
    /// how many views are done. A view takes a thread `rounds` rounds of its loops at most.
    pub(in crate::methods) fn follow(
        &self,
        (views, rounds): (Range<usize>, usize),
        ask: impl Fn(&mut Work<'_>, [(u32, &Buffer); 2]) -> Result<(), Error>,
        progress: impl Fn(usize),
    ) -> Result<(), Error> {
        let most = (views.len() as f32).sqrt().ceil() as usize;
        let most = most.clamp(VIEWS[0], VIEWS[1]).min(MAX_ROUNDS / rounds.max(1)).max(1);
        for first in views.clone().step_by(most) {
            let end = (first + most).min(views.end);
            let go = self.gpu.uniform(&self.go(first..end, first == views.start, &[]))?;
            self.gpu.submit(|work| ask(work, [(0, &go), (1, &self.sums)]))?;
            // Else all would be asked for at once, and nobody would know how much of it is done.
            self.gpu.finish()?;
            progress(end - first);
        }
        Ok(())
    }

    /// Makes `channels` of the picture from the sums, after what `ask` asks for with the same bindings.
    pub(in crate::methods) fn resolve(
        &self,
        channels: &[usize],
        ask: impl Fn(&mut Work<'_>, [(u32, &Buffer); 2]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let go = self.gpu.uniform(&self.go(0..0, false, channels))?;
        let bindings = [(0, &go), (1, &self.sums)];
        self.gpu.submit(|work| {
            ask(work, bindings)?;
            let [go, sums] = bindings;
            work.pass(&self.resolve, &[go, sums, (2, &self.picture)], groups(self.pixels))
        })
    }

    fn go(&self, views: Range<usize>, begins: bool, channels: &[usize]) -> Batch {
        Batch {
            first_view: views.start as u32,
            end_view: views.end as u32,
            begins: begins.into(),
            channels: channels.iter().map(|channel| 1 << channel).sum(),
            transparent_background: self.transparent_background.into(),
            pixels: self.pixels as u32,
        }
    }

    /// Puts the rows that were made into `image`.
    fn read_into(&self, image: &mut Image, band: &Band) -> Result<(), Error> {
        let row = image.width();
        let rows = band.rows.start * row..band.rows.end * row;
        let [red, green, blue, alpha] =
            image.planes.each_mut().map(|plane| &mut plane.values_mut()[rows.clone()]);
        self.gpu.read_into(&self.picture, &mut [red, green, blue, alpha])
    }
}

/// A picture of `width × height` pixels, `max_rows` of whose rows can be held at once, by rays that look at `reach_rows` more either way:
/// `make(band, progress)` makes a band.
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

/// Workgroups of 64 threads for `pixels`, in as many rows as it takes.
fn groups(pixels: usize) -> [u32; 3] {
    const ROW: usize = 1 << 15;
    let groups = pixels.div_ceil(64);
    [groups.min(ROW) as u32, groups.div_ceil(ROW) as u32, 1]
}
