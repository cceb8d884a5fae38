//! BLUR: one trait, one registry, one file a method.
//!
//! A method reads a [`Scene`] and a [`Plan`] and returns a picture. It does no I/O, prints nothing, and decides nothing
//! that the plan could have decided.

mod accumulate;
mod shear;

use crate::error::Error;
use crate::image::{Image, Plane};
use crate::scene::{Plan, Scene};
use rayon::prelude::*;
use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What a method is, for `thinlens methods`, the README and the laws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct MethodInfo {
    /// The name of `--method`.
    pub name: &'static str,
    /// Where it comes from.
    pub source: &'static str,
    /// Default, reference, paper or baseline.
    pub role: &'static str,
    /// One sentence.
    pub summary: &'static str,
}

/// Called now and then with the share of the work that is done, 0 … 1, from any thread.
pub type Progress<'a> = dyn Fn(f32) + Sync + 'a;

/// A way to put a lens on a stack.
pub trait Method: fmt::Debug + Sync {
    /// What it is.
    fn info(&self) -> MethodInfo;

    /// The picture of `scene` as `plan` asks for it, of the scene's picture size. The scene is given away: it is the larger
    /// part of all memory, and a method may work in it.
    ///
    /// # Errors
    /// When a device fails; on the CPU a method that has a plan succeeds.
    fn blur(&self, scene: Scene, plan: &Plan, progress: &Progress<'_>) -> Result<Image, Error>;
}

/// Every method, in the order they are listed.
pub static METHODS: [&dyn Method; 2] = [&shear::Shear, &accumulate::Accumulate];

/// The method called `name`.
pub fn by_name(name: &str) -> Option<&'static dyn Method> {
    METHODS.into_iter().find(|method| method.info().name == name)
}

/// Makes `N` planes of one size row by row, rows in parallel, reporting progress. `row(scratch, y, planes)` writes row `y`
/// of each plane; `scratch` makes what a thread keeps from row to row.
fn planes_from_rows<const N: usize, T>(
    (width, height): (usize, usize),
    progress: &Progress<'_>,
    scratch: impl Fn() -> T + Sync + Send,
    row: impl Fn(&mut T, usize, &mut [&mut [f32]; N]) + Sync + Send,
) -> [Plane; N] {
    let mut planes: [Plane; N] = std::array::from_fn(|_| Plane::zeros(width, height));
    let mut rests = planes.each_mut().map(Plane::values_mut);
    let rows: Vec<[&mut [f32]; N]> = (0..height)
        .map(|_| {
            rests.each_mut().map(|rest| {
                let (first, others) = std::mem::take(rest).split_at_mut(width);
                *rest = others;
                first
            })
        })
        .collect();
    let done = AtomicUsize::new(0);
    rows.into_par_iter().enumerate().for_each_init(scratch, |scratch, (y, mut planes)| {
        row(scratch, y, &mut planes);
        progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f32 / height as f32);
    });
    planes
}

/// What the rays of one pixel bring home, summed in double precision: thousands of samples would drift in single.
#[derive(Debug, Clone, Copy, Default)]
struct RaySum {
    color: [f64; 3],
    missed: f64,
}

impl RaySum {
    /// Adds premultiplied `color` seen through `transmitted`.
    fn add(&mut self, color: [f32; 3], transmitted: f32) {
        self.color.iter_mut().zip(color).for_each(|(sum, value)| *sum += f64::from(value * transmitted));
    }

    /// The pixel after `rays` rays: light that found nothing is transparent where the background is open, and left out of
    /// the mean where it is closed.
    fn mean(&self, rays: usize, open_background: bool) -> [f32; 4] {
        let hit = rays as f64 - self.missed;
        let weight = if open_background { rays as f64 } else { hit };
        if hit <= 1e-9 * rays as f64 {
            return [0.0; 4];
        }
        let [r, g, b] = self.color.map(|sum| (sum / weight) as f32);
        [r, g, b, (hit / weight) as f32]
    }
}
