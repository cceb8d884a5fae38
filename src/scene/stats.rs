//! ANALYZE: the statistics of a scene, taken in one parallel pass.
//!
//! Cost: one read of the scene. How far fragments spread is in [`super::spread`], the statistics of single peels are in
//! [`super::peel_stats`].

use super::bright::{
    BARELY_BLURRED_PX, BRIGHT_STEPS, BrightStep, bright_step, bright_step_floor, brightness, isolation,
    share_of_disc, share_of_its_light, share_of_light,
};
use super::layer::divisor;
use super::light::{LIGHT_STEPS, LightStep, light_step, luminance, share_of_gain};
use super::peel_stats::{Neighbours, PeelStats};
use super::spread::{Blocks, RowSpread, Spread};
use super::{Background, EnvironmentStats, Layer, OPAQUE_ALPHA, ReflectionStats, Scene};
use crate::lens::Field;
use crate::parallel;
use crate::stack::ColorRange;
use pulp::{Arch, NullaryFnOnce};

/// The statistics of a scene: all that a plan is decided from, apart from the settings.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct SceneStats {
    /// Width and height of the picture in pixels.
    pub picture_size: (usize, usize),
    /// Number of layers.
    pub layers: usize,
    /// Mean of [`Scene::antialiasing`]: 0 for point samples everywhere, 1 for averages over the pixel.
    pub antialiased: f64,
    /// Samples per picture pixel along each axis.
    pub supersample: usize,
    /// Smallest and largest signed CoC radius of any fragment in picture pixels; `0, 0` without fragments.
    pub coc_range_px: [f32; 2],
    /// Number of fragments.
    pub fragments: usize,
    /// Number of translucent fragments.
    pub translucent_fragments: usize,
    /// Number of fragments with a CoC radius below one pixel.
    pub focused_fragments: usize,
    /// Number of pixels that show the background, at least in part.
    #[serde(rename = "open_samples")]
    pub background_pixels: usize,
    /// Lights ([`share_of_light`]) that are blurred, but not enough for a disc ([`share_of_disc`]), in picture pixels: each by the share of
    /// its light that no disc can carry; behind other fragments by what they let pass.
    pub(crate) barely_blurred_lights: f64,
    /// Fragments with a CoC radius over one pixel, by brightness (largest of r, g, b), in half stops.
    pub(crate) bright: [BrightStep; BRIGHT_STEPS],
    /// Range of the source's colours.
    pub color_range: ColorRange,
    /// For a source that ends at white: fragments with a CoC radius over one pixel, by scene-linear luminance in the source;
    /// otherwise empty.
    pub(crate) light: Vec<LightStep>,
    /// See [`Scene::limited_fragments`].
    pub limited_fragments: usize,
    /// What the surfaces reflect, where the stack says so and they do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reflections: Option<ReflectionStats>,
    /// What reflects the environment, where the user gives it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<EnvironmentStats>,
    /// How far fragments spread, and where.
    pub(crate) spread: Spread,
    /// Position of the picture in the lens's field.
    #[serde(skip)]
    pub field: Field,
    /// Statistics of each peel, nearest first.
    pub peels: Vec<PeelStats>,
}

/// Statistics of one row of one layer, or the sum over several rows.
#[derive(Debug, Clone)]
struct Tally {
    coc_range_px: [f32; 2],
    fragments: usize,
    translucent: usize,
    focused: usize,
    bright: [BrightStep; BRIGHT_STEPS],
    /// See [`SceneStats::barely_blurred_lights`]; in samples.
    barely_blurred_lights: f64,
    /// Sum of the brightness of the fragments in [`Tally::bright`], in scene-linear units.
    highlight_light: f64,
    neighbours: Neighbours,
    light: Vec<LightStep>,
}

impl Scene {
    /// The scene's statistics, from one read of every fragment.
    pub fn analyze(&self) -> SceneStats {
        let rows = self.layers.len() * self.height();
        let arch = Arch::new();
        let (block_side, supersample) =
            (Blocks::side(self.picture_size(), self.supersample), self.supersample);
        // Summed in row order, so that the result does not depend on the distribution of rows among threads.
        let color_range = self.color_range;
        let analyze = |row: usize| {
            let (layer, y) = (row / self.height(), row % self.height());
            let (layer, in_front) = (&self.layers[layer], &self.layers[..layer]);
            // Boxed, since it has some kilobytes.
            Box::new(arch.dispatch(AnalyzeRow { layer, in_front, y, supersample, block_side, color_range }))
        };
        let row_stats: Vec<Box<(Tally, RowSpread)>> = parallel::map(rows, &analyze);
        let mut spread = Spread::empty(self.picture_size(), self.coc_infinity_px);
        for (number, of_row) in row_stats.iter().enumerate() {
            let (_, row) = &**of_row;
            let is_front = number < self.height();
            spread.add(row, number % self.height(), is_front, self.supersample);
        }
        let layer_tallies: Vec<Tally> = row_stats
            .chunks(self.height().max(1))
            .map(|rows| rows.iter().fold(Tally::default(), |sum, of_row| sum.add(&of_row.0)))
            .collect();
        let samples = self.width() * self.height();
        let peels = layer_tallies.iter().map(|tally| tally.peel_stats(samples, self.supersample)).collect();
        let tally = layer_tallies.iter().fold(Tally::default(), Tally::add);
        SceneStats {
            picture_size: self.picture_size(),
            layers: self.layers.len(),
            antialiased: self.antialiasing.mean(),
            supersample: self.supersample,
            coc_range_px: tally.coc_range_px(),
            fragments: tally.fragments,
            translucent_fragments: tally.translucent,
            focused_fragments: tally.focused,
            background_pixels: self.background.as_deref().map_or(0, Background::pixels),
            barely_blurred_lights: tally.barely_blurred_lights / (self.supersample * self.supersample) as f64,
            bright: tally.bright,
            color_range: self.color_range,
            light: tally.light,
            limited_fragments: self.limited_fragments,
            environment: self.environment.as_ref().map(|shading| shading.stats()),
            reflections: self.reflections.as_ref().map(|reflections| reflections.stats),
            spread,
            field: self.field,
            peels,
        }
    }
}

/// Takes the statistics of row `y` of `layer`; compiled for each instruction set.
struct AnalyzeRow<'a> {
    layer: &'a Layer,
    /// The layers before it.
    in_front: &'a [Layer],
    y: usize,
    supersample: usize,
    /// Side of a block of [`Spread::blocks`] in samples.
    block_side: usize,
    color_range: ColorRange,
}

impl NullaryFnOnce for AnalyzeRow<'_> {
    type Output = (Tally, RowSpread);

    #[inline(always)]
    fn call(self) -> (Tally, RowSpread) {
        let Self { layer, in_front, y, supersample, block_side, color_range } = self;
        let (alpha, coc) = (layer.alpha.row(y), layer.coc_px.row(y));
        let [red, green, blue] = &layer.color;
        let (red, green, blue) = (red.row(y), green.row(y), blue.row(y));
        let [mut near, mut far] = [f32::INFINITY, f32::NEG_INFINITY];
        let (mut fragments, mut translucent, mut focused, mut bright) = (0u32, 0u32, 0u32, false);
        for (&alpha, &coc) in alpha.iter().zip(coc) {
            let present = alpha > 0.0;
            near = if present & (coc < near) { coc } else { near };
            far = if present & (coc > far) { coc } else { far };
            fragments += u32::from(present);
            translucent += u32::from(present & (alpha < OPAQUE_ALPHA));
            focused += u32::from(present & (coc.abs() < 1.0));
        }
        for ((&red, &green), &blue) in red.iter().zip(green).zip(blue) {
            let floor = bright_step_floor(0);
            bright |= (red >= floor) | (green >= floor) | (blue >= floor);
        }
        let mut tally = Tally {
            coc_range_px: [near, far],
            fragments: fragments as usize,
            translucent: translucent as usize,
            focused: focused as usize,
            neighbours: Neighbours::from_row(alpha, coc),
            ..Tally::default()
        };
        if bright {
            let passing = |x: usize| {
                in_front
                    .iter()
                    .fold(1.0, |passing: f32, layer| passing * (1.0 - layer.alpha.get(x, y)).max(0.0))
            };
            tally.count_bright((layer, y, supersample), passing);
        }
        if color_range == ColorRange::UpToWhite {
            tally.count_light([red, green, blue], alpha, coc);
        }
        let spread = RowSpread::is_sampled(y).then(|| RowSpread::from_samples(alpha, coc, block_side));
        (tally, spread.unwrap_or_default())
    }
}

impl Default for Tally {
    fn default() -> Self {
        Self {
            coc_range_px: [f32::INFINITY, f32::NEG_INFINITY],
            fragments: 0,
            translucent: 0,
            focused: 0,
            bright: [BrightStep::default(); BRIGHT_STEPS],
            barely_blurred_lights: 0.0,
            highlight_light: 0.0,
            neighbours: Neighbours::default(),
            light: Vec::new(),
        }
    }
}

impl Tally {
    /// Smallest and largest signed CoC radius in picture pixels; `0, 0` without fragments.
    fn coc_range_px(&self) -> [f32; 2] {
        if self.fragments > 0 { self.coc_range_px } else { [0.0; 2] }
    }

    /// The statistics of a peel of `samples` samples, `supersample` per picture pixel along each axis.
    fn peel_stats(&self, samples: usize, supersample: usize) -> PeelStats {
        let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
        PeelStats {
            coc_range_px: self.coc_range_px(),
            covered: share(self.fragments, samples),
            translucent: share(self.translucent, self.fragments),
            in_focus: share(self.focused, self.fragments),
            highlight_light: self.highlight_light / (supersample * supersample) as f64,
            jumps: share(self.neighbours.jumps, self.neighbours.pairs),
        }
    }

    /// Counts the bright fragments of row `y`, of whose light the layers in front let the share `passing(x)` pass.
    fn count_bright(
        &mut self,
        (layer, y, supersample): (&Layer, usize, usize),
        passing: impl Fn(usize) -> f32,
    ) {
        let (alpha, coc) = (layer.alpha.row(y), layer.coc_px.row(y));
        let brightness_at = |x: usize| brightness(layer.color_at(x, y));
        for x in 0..alpha.len() {
            let brightness = brightness_at(x);
            if brightness < bright_step_floor(0) || alpha[x] <= 0.0 {
                continue;
            }
            let Some(step) = bright_step(brightness) else { continue };
            let share = f64::from(share_of_disc(coc[x]));
            if share < 1.0 {
                let around = [x.saturating_sub(1), (x + 1).min(alpha.len() - 1)].map(brightness_at);
                let blur = (coc[x].abs() / BARELY_BLURRED_PX).min(1.0);
                let light = f64::from(share_of_light(brightness * passing(x), around) * blur);
                self.barely_blurred_lights += (1.0 - share) * light;
            }
            if coc[x].abs() > 1.0 {
                let isolated = share * f64::from(isolation(layer, [x, y], supersample));
                let discs = if isolated > 0.0 {
                    isolated * f64::from(share_of_its_light(layer, [x, y], supersample))
                } else {
                    0.0
                };
                self.bright[step].fragments += 1;
                self.bright[step].discs += discs;
                self.bright[step].disc_area_px += discs * std::f64::consts::PI * f64::from(coc[x]).powi(2);
                self.highlight_light += f64::from(brightness);
            }
        }
    }

    fn count_light(&mut self, [red, green, blue]: [&[f32]; 3], alpha: &[f32], coc: &[f32]) {
        self.light = vec![LightStep::default(); LIGHT_STEPS];
        for (x, (&alpha, &coc)) in alpha.iter().zip(coc).enumerate() {
            if alpha > 0.0 && coc.abs() > 1.0 {
                let light = luminance([red[x], green[x], blue[x]]);
                let step = &mut self.light[light_step(light / divisor(alpha))];
                step.fragments += 1;
                step.light += f64::from(light);
                step.gaining_light += f64::from(share_of_gain(coc) * light);
            }
        }
    }

    fn add(mut self, other: &Self) -> Self {
        self.coc_range_px[0] = self.coc_range_px[0].min(other.coc_range_px[0]);
        self.coc_range_px[1] = self.coc_range_px[1].max(other.coc_range_px[1]);
        self.fragments += other.fragments;
        self.translucent += other.translucent;
        self.focused += other.focused;
        self.barely_blurred_lights += other.barely_blurred_lights;
        self.highlight_light += other.highlight_light;
        self.neighbours.add(other.neighbours);
        for (sum, step) in self.bright.iter_mut().zip(&other.bright) {
            sum.fragments += step.fragments;
            sum.discs += step.discs;
            sum.disc_area_px += step.disc_area_px;
        }
        self.light.resize(self.light.len().max(other.light.len()), LightStep::default());
        for (sum, step) in self.light.iter_mut().zip(&other.light) {
            sum.fragments += step.fragments;
            sum.light += step.light;
            sum.gaining_light += step.gaining_light;
        }
        self
    }
}
