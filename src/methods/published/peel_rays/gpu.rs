//! Peel rays on a GPU: one thread a pixel, all rays of a go one after the other.
//!
//! Fragments and N-buffers are the CPU's own tables; the march is the shader's.
//!
//! Memory: 20 bytes a fragment, 36 a pixel; two N-buffers of at most 65536 blocks a level, which must fit into one buffer.

use super::{Marcher, PeelRays, STEPS_PER_SAMPLE};
use crate::error::Error;
use crate::gpu::{Band, Buffer, Constant, Gpu, Kernel, Mirrored, Shader, Work, mirrored, tiles};
use crate::image::Image;
use crate::methods::contract::Plan;
use crate::methods::contract::{GpuBackend, Progress};
use crate::methods::shared::{
    Batch, Batches, RAY_STACK, RAY_STACK_CONSTANTS, RAY_SUMS, RAY_SUMS_CONSTANT, RayStack, RayViews, Stack,
    Tracer, View, nbuffer_words, picture_of_batches,
};
use crate::scene::Scene;
use crate::scene::surface::JOIN_PX;

/// Side of a workgroup.
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
    /// Between which CoC radii anything lies, and in how many steps it is searched for.
    struct March {
        /// No fragment has less CoC radius.
        nearest: f32,
        /// No fragment has more.
        farthest: f32,
        /// Of the linear search.
        linear_steps: u32,
        /// Of the binary search.
        binary_steps: u32,
    }
}

impl Marcher {
    /// The stack that rays go through.
    fn stack(&self) -> RayStack<'_> {
        RayStack {
            fragments: &self.fragments,
            blocks: self.range.blocks,
            supersample: self.supersample as usize,
        }
    }

    fn whole(&self) -> March {
        let [nearest, farthest] = self.range.whole;
        March {
            nearest,
            farthest,
            linear_steps: self.linear_steps as u32,
            binary_steps: self.binary_steps as u32,
        }
    }

    /// Rounds of loops for a ray that searches in every step, as few do: enough for those beside it too, which a processor takes through
    /// the same loops.
    fn rounds(&self) -> usize {
        let [near, far] = self.range.whole;
        let fastest = self.samples.iter().map(|view| view.lens.abs().max_element()).fold(0.0, f32::max);
        let passed = fastest * self.supersample * (far - near);
        let steps = ((passed * STEPS_PER_SAMPLE).ceil() as usize).clamp(1, self.linear_steps);
        // The lists of both ends, and in a search those of each step, of the end and of the crossing.
        let list = 1 + self.fragments.depth();
        let in_step = 1 + 2 * list + (self.binary_steps + 2) * (1 + list);
        // Both N-buffers, for the ray and twice for its bundle, in up to two rows of windows.
        let widest = 2.0 * self.supersample * (near.abs().max(far.abs()) + 0.5);
        let in_nbuffers = 3 * 2 * 2 * (2 + (widest.max(passed) / self.range.blocks.side as f32) as usize);
        steps * in_step + in_nbuffers
    }
}

/// What is the same for all bands.
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
        let nbuffers = nbuffer_words(&[Some(&range.nearest), Some(&range.farthest)], Vec::new());
        Ok(Self {
            gpu,
            marcher,
            march: gpu.uniform(&marcher.whole())?,
            views: RayViews::new(gpu, marcher.samples.iter(), in_pixel, range.whole)?,
            nbuffers: gpu.upload("N-buffers", &nbuffers)?,
            follow: gpu.kernel(&SHADER, "follow")?,
        })
    }

    /// Makes the rows of `band`.
    fn make(&self, band: &Band, progress: &dyn Fn(f32)) -> Result<Batches<'g>, Error> {
        let stack = self.marcher.stack();
        let rows = stack.rows(self.gpu, band)?;
        let (width, height) = (stack.picture_size().0, band.rows.len());
        let goes = Batches::new(self.gpu, &SHADER, width * height, self.marcher.transparent_background)?;
        let own = [(4, &self.views.buffer), (8, &self.nbuffers), (9, &self.march)];
        let follow = |work: &mut Work<'_>, sums: [(u32, &Buffer); 2]| {
            let bindings: Vec<_> = sums.into_iter().chain(rows.bindings()).chain(own).collect();
            work.pass(&self.follow, &bindings, tiles(width, height, SIDE))
        };
        let count = self.marcher.samples.len();
        let done = std::cell::Cell::new(0);
        goes.follow((0..count, self.marcher.rounds()), follow, |views| {
            done.set(done.get() + views);
            progress(done.get() as f32 / count as f32);
        })?;
        goes.resolve(&[0, 1, 2, 3], |_, _| Ok(()))?;
        Ok(goes)
    }
}

impl GpuBackend for PeelRays {
    fn blur(&self, gpu: &Gpu, scene: &Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error> {
        let marcher = Marcher::new(scene.clone(), plan, plan.lens_samples());
        let tables = Tables::new(gpu, &marcher)?;
        let rows = [tables.views.reach_rows, marcher.stack().max_rows(gpu, 0)];
        picture_of_batches(scene.picture_size(), rows, progress, |band, progress| tables.make(band, progress))
    }

    fn shader(&self) -> &'static Shader {
        &SHADER
    }
}
