//! Samplers that render each pixel independently of all others.

use crate::image::Image;
use crate::methods::contract::{Plan, Progress, Sampler};
use crate::methods::shared::planes_from_rows;
use crate::parallel;
use crate::scene::Scene;

/// A scene prepared for ray tracing, with its rays.
pub(in crate::methods) trait Tracer: Sync + Sized {
    /// Scratch memory of a thread.
    type Scratch: Default;

    /// Prepares to trace `views` rays per pixel through `scene` by `plan`.
    fn new(scene: Scene, plan: &Plan, views: usize) -> Self;

    /// Mean over all rays of picture pixel `x, y`.
    fn pixel(&self, x: usize, y: usize, scratch: &mut Self::Scratch) -> [f32; 4];
}

/// A scene, and the tracer for the number of views that was requested last.
pub(in crate::methods) struct RaySampler<'p, T> {
    scene: Scene,
    plan: &'p Plan,
    cached: Option<(usize, T)>,
}

impl<'p, T> RaySampler<'p, T> {
    pub(in crate::methods) fn new(scene: Scene, plan: &'p Plan) -> Self {
        Self { scene, plan, cached: None }
    }
}

impl<T: Tracer> Sampler for RaySampler<'_, T> {
    fn pixels(&mut self, views: usize, pixels: &[usize]) -> Vec<[f32; 4]> {
        let width = self.scene.picture_size().0;
        let tracer = match self.cached.take() {
            Some((cached, tracer)) if cached == views => tracer,
            _ => T::new(self.scene.clone(), self.plan, views),
        };
        let values = parallel::map_with(pixels.len(), &T::Scratch::default, &|scratch, number| {
            let pixel = pixels[number];
            tracer.pixel(pixel % width, pixel / width, scratch)
        });
        self.cached = Some((views, tracer));
        values
    }

    fn picture(self: Box<Self>, views: usize, progress: &Progress<'_>) -> Image {
        let size = self.scene.picture_size();
        let tracer = match self.cached {
            Some((cached, tracer)) if cached == views => tracer,
            _ => T::new(self.scene, self.plan, views),
        };
        let planes =
            planes_from_rows(size, progress, &T::Scratch::default, &|scratch, y, row: &mut [_; 4]| {
                for x in 0..size.0 {
                    let pixel = tracer.pixel(x, y, scratch);
                    row.iter_mut().zip(pixel).for_each(|(plane, value)| plane[x] = value);
                }
            });
        Image { planes }
    }
}
