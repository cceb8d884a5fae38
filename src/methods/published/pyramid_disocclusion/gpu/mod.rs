//! Sub-images with disocclusion on a GPU: for each, a pyramid that fills holes and one that blurs.
//!
//! Level 0 of neither is stored. What a hole is filled with may come from anywhere in the frame, so the coarse levels that fill
//! are those of the whole frame (`holes.rs`), and bands reach no farther than a blur and the finest levels do. Where there are
//! several bands, all of them first bring together what fills the holes of every sub-image; a band that is the whole frame does
//! with one sub-image after the other.
//!
//! Limits: level 3 of the whole frame, or the coarsest where there are fewer, has to fit into one buffer. That is level 1, of a
//! quarter of all samples, where nothing is blurred by more than the first radius.

mod holes;

use super::{BEST_QUARTER, PyramidDisocclusion, sub_images};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work};
use crate::image::{Image, Plane};
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::methods::shared::{
    self, BOX, COVERAGE_PLANES_WGSL, FIRST_LEVEL_WGSL, Frame, Grid, Levels, Matting, PYRAMID_WGSL, Planes,
    RowNeeds, SUB_IMAGES_WGSL, Step, SubImages, VISIBLE_WGSL, Visible, at_pixels, bands_of, corners,
    picture_of_bands,
};
use crate::scene::Scene;
use holes::{Filled, Holes, Means, PART_THREADS, PART_VALUES};

static SHADER: Shader = Shader {
    name: "pyramid_disocclusion",
    constants: &[
        ("BEST_QUARTER", Constant::Float(BEST_QUARTER)),
        ("PART_THREADS", Constant::Uint(PART_THREADS)),
        ("PART_VALUES", Constant::Uint(PART_VALUES)),
    ],
    parts: &[
        COVERAGE_PLANES_WGSL,
        VISIBLE_WGSL,
        PYRAMID_WGSL,
        FIRST_LEVEL_WGSL,
        SUB_IMAGES_WGSL,
        include_str!("../../../../../shaders/methods/pyramid_disocclusion.wgsl"),
    ],
    structs: &[Step::LAYOUT, Frame::LAYOUT, Matting::LAYOUT, Means::LAYOUT],
};

/// Share of the work that goes into what holes are filled with, where that is done before everything else.
const FILLING_SHARE: f32 = 0.3;

impl GpuBackend for PyramidDisocclusion {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let size = scene.picture_size();
        let (images, grid) = sub_images(scene, plan);
        let visible = shared::visible(scene.clone(), plan);
        let channels = visible.content.len();
        let holes = Holes::new(gpu, &images, &grid, channels)?;
        let reach = shared::reach(grid.sizes.len() - 1) + shared::reach(holes.lowest);
        let bands = bands_of(gpu, size, (reach, needs(&grid, size, channels)))?;
        let painter = Painter {
            gpu,
            kernels: Kernels::new(gpu)?,
            images: &images,
            visible: &visible,
            grid: &grid,
            holes,
        };
        let filling_share = if bands.len() > 1 { FILLING_SHARE } else { 0.0 };
        let fill_all = || painter.fill_all(&bands, &|share| progress(filling_share * share));
        let filled = (bands.len() > 1).then(fill_all).transpose()?;
        let progress = |share: f32| progress(filling_share + (1.0 - filling_share) * share);
        picture_of_bands(gpu, (size, channels > 3), &bands, &progress, |band, progress| {
            painter.band(band, filled.as_deref(), progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}

/// What a row of a band needs: source and result, and two pyramids of less than a third of the samples of their level 0.
fn needs(grid: &Grid, (_, height): (usize, usize), channels: usize) -> RowNeeds {
    let (widest, highest) = grid.sizes[0];
    // The other pyramid is counted as planes: the grid is less than twice as wide as the frame.
    let planes = 3 * (channels + 1);
    RowNeeds { planes, values: (channels + 2) * (widest * highest).div_ceil(3 * height) }
}

/// The entry points that paint.
struct Kernels {
    matte: Kernel,
    reduce: Kernel,
    expand: Kernel,
    lay: Kernel,
    lay_sharp: Kernel,
    normalise: Kernel,
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, Error> {
        let kernel = |name| gpu.kernel(&SHADER, name);
        Ok(Self {
            matte: kernel("matte")?,
            reduce: kernel("reduce")?,
            expand: kernel("expand")?,
            lay: kernel("lay")?,
            lay_sharp: kernel("lay_sharp")?,
            normalise: kernel("normalise")?,
        })
    }
}

/// What every band is made from.
struct Painter<'a> {
    gpu: &'a Gpu,
    kernels: Kernels,
    images: &'a SubImages,
    visible: &'a Visible,
    grid: &'a Grid,
    holes: Holes<'a>,
}

/// What the camera sees of a band, and where its pixels are.
struct Source {
    frame: Buffer,
    planes: Planes,
}

/// Some levels, and what they hold.
#[derive(Clone, Copy)]
struct Pyramid<'a> {
    levels: &'a Levels,
    values: &'a Buffer,
}

/// The buffers of a band.
struct Canvas<'a> {
    band: &'a Band,
    source: Source,
    /// The levels of its own that fill holes.
    filling: Buffer,
    /// Those that blur.
    blurring: Buffer,
    result: Planes,
}

/// A sub-image of a band: the levels of its own that fill its holes, and those that blur it.
struct Part {
    i: i32,
    filling: Levels,
    blurring: Levels,
}

impl Painter<'_> {
    /// What the holes of each sub-image but the nearest, which has none, are filled with, made from all bands.
    fn fill_all(&self, bands: &[Band], progress: &Progress<'_>) -> Result<Vec<Filled>, Error> {
        let holed = || self.images.far_to_near().filter(|&i| !self.images.is_nearest(i));
        let all = holed().map(|_| self.holes.unfilled()).collect::<Result<Vec<_>, _>>()?;
        for (done, band) in bands.iter().enumerate() {
            let source = self.source(band)?;
            let levels = self.holes.levels_of(self.grid.rows_with_border(&band.rows));
            let values = self.gpu.zeros::<f32>("the levels of the pyramid", levels.values())?;
            let own = Pyramid { levels: &levels, values: &values };
            for (i, whole) in holed().zip(&all) {
                self.gpu.submit(|work| {
                    self.holes.pull(work, i, own, &source)?;
                    self.holes.hand_up(work, own, whole)
                })?;
            }
            // Else what all bands read would be there at once.
            self.gpu.finish()?;
            progress((done + 1) as f32 / bands.len() as f32);
        }
        let frame = self.gpu.uniform(&self.frame(&bands[0]))?;
        all.into_iter().map(|whole| self.holes.fill(whole, &frame)).collect()
    }

    /// Content, and then coverage, of a band's rows; `filled` is what holes are filled with, if that is known already.
    fn band(&self, band: &Band, filled: Option<&[Filled]>, progress: &Progress<'_>) -> Result<Planes, Error> {
        let parts: Vec<Part> =
            self.images.far_to_near().map(|i| self.part(i, band, filled.is_none())).collect();
        let canvas = self.canvas(band, &parts)?;
        for (done, part) in parts.iter().enumerate() {
            let own = Pyramid { levels: &part.filling, values: &canvas.filling };
            let filled = filled.and_then(|filled| filled.get(done));
            if self.disocclude(part.i, own, filled, &canvas.source)? {
                self.lay(part, &canvas)?;
            }
            progress((done + 1) as f32 / (parts.len() + 1) as f32);
        }
        let Planes { colors, rest } = &canvas.result;
        let bindings = [(2, &canvas.source.frame), (6, colors), (7, rest)];
        let made = (self.width(), band.rows.len());
        self.gpu.submit(|work| at_pixels(work, &self.kernels.normalise, &bindings, made))?;
        Ok(canvas.result)
    }

    fn width(&self) -> usize {
        self.visible.coc_px.width()
    }

    fn frame(&self, band: &Band) -> Frame {
        self.holes.whole.frame(band, self.visible.content.len())
    }

    fn source(&self, band: &Band) -> Result<Source, Error> {
        let planes: Vec<&Plane> = self.visible.content.iter().chain([&self.visible.coc_px]).collect();
        Ok(Source {
            frame: self.gpu.uniform(&self.frame(band))?,
            planes: Planes::upload(self.gpu, &planes, &band.source)?,
        })
    }

    /// Sub-image `i` of a band that is the whole frame, or is not.
    fn part(&self, i: i32, band: &Band, whole: bool) -> Part {
        let channels = self.visible.content.len() + 1;
        let blurring = Levels::new(self.grid.up_to(i.unsigned_abs() as usize), &band.rows, channels);
        let rows = if whole { self.grid.rows_with_border(&band.rows) } else { blurring.finest_rows() };
        Part { i, filling: self.holes.levels_of(rows), blurring }
    }

    fn canvas<'b>(&self, band: &'b Band, parts: &[Part]) -> Result<Canvas<'b>, Error> {
        let most = |values: fn(&Part) -> usize| parts.iter().map(values).max().unwrap_or(0);
        let levels = |values| self.gpu.zeros::<f32>("the levels of the pyramid", values);
        let made = self.width() * band.rows.len();
        Ok(Canvas {
            band,
            source: self.source(band)?,
            filling: levels(most(|part| part.filling.values()))?,
            blurring: levels(most(|part| part.blurring.values()))?,
            result: Planes::zeros(self.gpu, self.visible.content.len() + 1, made)?,
        })
    }

    /// Fills the holes of sub-image `i` down to level 1; false where everything is nearer.
    fn disocclude(
        &self,
        i: i32,
        own: Pyramid<'_>,
        filled: Option<&Filled>,
        source: &Source,
    ) -> Result<bool, Error> {
        if self.images.is_nearest(i) {
            // It has no holes.
            return Ok(true);
        }
        self.gpu.submit(|work| self.holes.pull(work, i, own, source))?;
        let made;
        let filled = match filled {
            Some(filled) => filled,
            None => {
                let whole = self.holes.unfilled()?;
                self.gpu.submit(|work| self.holes.hand_up(work, own, &whole))?;
                made = self.holes.fill(whole, &source.frame)?;
                &made
            }
        };
        if filled.shows {
            self.gpu.submit(|work| self.holes.hand_down(work, filled, own, &source.frame))?;
        }
        Ok(filled.shows)
    }

    /// Mattes a sub-image of the disoccluded picture, blurs it and lays it over the result.
    fn lay(&self, part: &Part, canvas: &Canvas<'_>) -> Result<(), Error> {
        let Canvas { source: Source { frame, planes }, blurring, result, .. } = canvas;
        let matting = self.gpu.uniform(&self.images.matting(part.i))?;
        let (filled, _) = part.filling.synthesis(self.gpu, 0)?;
        let picture = [
            (2, frame),
            (3, &matting),
            (4, &planes.colors),
            (5, &planes.rest),
            (8, &filled),
            (9, &canvas.filling),
        ];
        let results = [(6, &result.colors), (7, &result.rest)];
        let fours = (corners(self.width()), corners(canvas.band.rows.len()));
        if part.i == 0 {
            let bindings = [&picture[..], &results].concat();
            return self.gpu.submit(|work| at_pixels(work, &self.kernels.lay_sharp, &bindings, fours));
        }
        let (step, [across, down, _]) = part.blurring.analysis(self.gpu, 0, BOX)?;
        let matted = [&[(0, &step), (1, blurring)], &picture[..]].concat();
        let (step, _) = part.blurring.synthesis(self.gpu, 0)?;
        let laid = [&[(0, &step), (1, blurring), (2, frame)], &results[..]].concat();
        self.gpu.submit(|work| {
            work.pass(&self.kernels.matte, &matted, [across, down, 1])?;
            self.blur(work, Pyramid { levels: &part.blurring, values: blurring })?;
            at_pixels(work, &self.kernels.lay, &laid, fours)
        })
    }

    /// Level 1 of the blurred sub-image from the matted level 1.
    fn blur(&self, work: &mut Work<'_>, Pyramid { levels, values }: Pyramid<'_>) -> Result<(), Error> {
        for level in 1..levels.count() {
            let (step, groups) = levels.analysis(self.gpu, level, BOX)?;
            work.pass(&self.kernels.reduce, &[(0, &step), (1, values)], groups)?;
        }
        for level in (1..levels.count()).rev() {
            let (step, groups) = levels.synthesis(self.gpu, level)?;
            work.pass(&self.kernels.expand, &[(0, &step), (1, values)], groups)?;
        }
        Ok(())
    }
}
