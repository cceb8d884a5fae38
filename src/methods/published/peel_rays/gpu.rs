//! `peel-rays` on a GPU: one thread per pixel traces all rays of a batch in sequence.
//!
//! Fragments and N-buffers are the CPU's tables; the shader marches rays through them.
//!
//! Memory: 20 bytes per fragment; 36 per pixel, and 12 more where the background is visible; two N-buffers of at most
//! 65536 blocks per level, which must fit into one buffer.

use super::{Marcher, PeelRays, STEPS_PER_SAMPLE};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored, tiles};
use crate::image::Image;
use crate::methods::contract::{GpuBackend, Plan, Progress};
use crate::methods::shared::{
    Batch, Batches, RAY_STACK, RAY_STACK_CONSTANTS, RAY_SUMS, RAY_SUMS_CONSTANT, RayBindings, RayEnds,
    RayStack, RayViews, Stack, Tracer, View, nbuffer_words, picture_of_batches,
};
use crate::scene::Scene;
use crate::scene::surface::JOIN_PX;

/// Side of a workgroup, in pixels.
const SIDE: usize = 8;

static SHADER: Shader = Shader {
    name: "peel-rays",
    constants: &[
        RAY_SUMS_CONSTANT,
        RAY_STACK_CONSTANTS[0],
        RAY_STACK_CONSTANTS[1],
        RAY_STACK_CONSTANTS[2],
        ("JOIN_PX", Constant::Float(JOIN_PX)),
        ("STEPS_PER_SAMPLE", Constant::Float(STEPS_PER_SAMPLE)),
    ],
    parts: &[RAY_SUMS, RAY_STACK, include_str!("../../../../shaders/methods/peel_rays.wgsl")],
    structs: &[Batch::LAYOUT, Stack::LAYOUT, View::LAYOUT, March::LAYOUT],
};

mirrored! {
    /// CoC range of the stack, and numbers of search steps.
    struct March {
        /// Smallest CoC radius of all fragments.
        nearest: f32,
        /// Largest CoC radius of all fragments.
        farthest: f32,
        /// Maximum number of steps of the linear search.
        linear_steps: u32,
        /// Steps of the binary search.
        binary_steps: u32,
    }
}

impl Marcher {
    /// The stack that rays are marched through.
    fn stack(&self) -> RayStack<'_> {
        RayStack {
            fragments: &self.fragments,
            blocks: self.range.blocks,
            supersample: self.supersample as usize,
        }
    }

    /// What becomes of rays that have passed all fragments.
    fn ends(&self) -> RayEnds<'_> {
        RayEnds { background: self.background.as_deref(), lost_rays: self.lost_rays }
    }

    fn march_uniform(&self) -> March {
        let [nearest, farthest] = self.range.full_px;
        March {
            nearest,
            farthest,
            linear_steps: self.linear_steps as u32,
            binary_steps: self.binary_steps as u32,
        }
    }

    /// Maximum loop iterations per ray, for a ray that searches in every step. Few rays do; this leaves room for the
    /// neighbouring rays of a SIMD group, which a processor takes through the same loops.
    fn rounds(&self) -> usize {
        let [near, far] = self.range.full_px;
        let max_step = self.samples.iter().map(|view| view.lens.abs().max_element()).fold(0.0, f32::max);
        let passed = max_step * self.supersample * (far - near);
        let steps = ((passed * STEPS_PER_SAMPLE).ceil() as usize).clamp(1, self.linear_steps);
        // Sample lists of both ends; in a search, those of each step, of the end and of the crossing.
        let per_list = 1 + self.fragments.depth();
        let per_step = 1 + 2 * per_list + (self.binary_steps + 2) * (1 + per_list);
        // Both N-buffers, once for the ray and twice for its bundle, in up to two rows of windows.
        let max_width = 2.0 * self.supersample * (near.abs().max(far.abs()) + 0.5);
        let in_nbuffers = 3 * 2 * 2 * (2 + (max_width.max(passed) / self.range.blocks.side as f32) as usize);
        steps * per_step + in_nbuffers
    }
}

/// Tables shared by all bands.
struct Tables<'g> {
    gpu: &'g Gpu,
    marcher: &'g Marcher,
    march: Buffer,
    views: RayViews,
    nbuffers: Buffer,
    follow: Kernel,
}

impl<'g> Tables<'g> {
    fn new(gpu: &'g Gpu, marcher: &'g Marcher) -> Result<Self, Error> {
        let range = &marcher.range;
        let in_pixel = (marcher.jitter, marcher.supersample);
        let range_px = marcher.ends().range_px(range.full_px);
        let nbuffers = nbuffer_words(&[Some(&range.nearest), Some(&range.farthest)], Vec::new());
        Ok(Self {
            gpu,
            marcher,
            march: gpu.uniform(&marcher.march_uniform())?,
            views: RayViews::new(gpu, marcher.samples.iter(), in_pixel, range_px)?,
            nbuffers: gpu.upload("N-buffers", &nbuffers)?,
            follow: gpu.kernel(&SHADER, "follow")?,
        })
    }

    /// Renders the rows of `band`.
    fn render(&self, band: &Band, progress: &dyn Fn(f32)) -> Result<Batches<'g>, Error> {
        let stack = self.marcher.stack();
        let rows = stack.rows(self.gpu, band)?;
        let (width, height) = (stack.picture_size().0, band.rows.len());
        let batches = Batches::new(self.gpu, &SHADER, (width, band), self.marcher.ends())?;
        let own = [(4, &self.views.buffer), (8, &self.nbuffers), (9, &self.march)];
        let follow = |work: &mut Work<'_>, rays: RayBindings<'_>| {
            let bindings: Vec<_> = rays.into_iter().chain(rows.bindings()).chain(own).collect();
            work.pass(&self.follow, &bindings, tiles(width, height, SIDE))
        };
        let count = self.marcher.samples.len();
        let done = std::cell::Cell::new(0);
        batches.follow((0..count, self.marcher.rounds()), follow, |views| {
            done.set(done.get() + views);
            progress(done.get() as f32 / count as f32);
        })?;
        batches.resolve(&[0, 1, 2, 3], |_, _| Ok(()))?;
        Ok(batches)
    }
}

impl GpuBackend for PeelRays {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let marcher = Marcher::new(scene.clone(), plan, plan.lens_samples());
        let tables = Tables::new(gpu, &marcher)?;
        let rows = [tables.views.reach_rows, marcher.stack().max_rows(gpu, 0, marcher.ends())];
        picture_of_batches(scene.picture_size(), rows, progress, |band, progress| {
            tables.render(band, progress)
        })
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}
