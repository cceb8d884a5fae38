//! An effect that a plan switches off is not visible: pictures as planned are compared with pictures with effects forced on, over
//! random stacks.
//!
//! Some effects change a picture by design when they are forced on. [`Case::by_design`] lists them, from the scene alone:
//!
//! * `blur`, if all CoC radii are within a hundredth of a pixel: the change is compared with the share of rays that the plan states;
//! * `fill`, if there are three layers or more and yet surfaces are missing behind the last one: estimated surfaces are added;
//! * `resolve`, if anti-aliased fragments are in focus: they are softened again;
//! * `highlights`, if bright areas need more discs than the plan allows: discs and lens samples are two different estimates;
//!   extrapolation makes such areas from a source that is clipped at white;
//! * `highlight-extrapolation`, if the source is scene-linear: colours that were not clipped become brighter;
//! * `merge` and `translucency` are facts of the stack and cannot be switched.

#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

use fastrand::Rng;
use std::sync::Arc;
use thinlens::finish;
use thinlens::image::{Image, Plane};
use thinlens::methods::{self, METHODS, Plan};
use thinlens::scene::{EffectKind, Layer, Scene};
use thinlens::settings::{Effort, Mask, Origin, ParameterValues, Settings, Switches, Values};
use thinlens::stack::{ColorRange, StackKind};

/// The kinds of the stacks, by turns.
const KINDS: [StackKind; 4] =
    [StackKind::PointSampled, StackKind::Coverage, StackKind::BeautyDepth, StackKind::Supersampled];

/// Number of stacks of each kind.
const CASES: u64 = 15;

/// Two pictures of at least this PSNR are visually equal, in dB.
const SAME_DB: f64 = 55.0;

/// Ranges of CoC radii, in pixels: in focus, slightly blurred, blurred on both sides of focus, behind focus, in front of it.
const RANGES_PX: [[f32; 2]; 5] = [[-0.009, 0.008], [-0.3, 2.5], [-12.0, 7.0], [2.0, 9.0], [-9.0, -1.6]];

/// One surface: a disc, or a plane that covers the picture.
struct Surface {
    /// Centre and radius in pixels; `None` for a plane that covers the picture.
    disc: Option<[f32; 3]>,
    coc_px: f32,
    alpha: f32,
    color: [f32; 3],
    seed: u64,
}

/// A random stack.
struct Case {
    seed: u64,
    scene: Scene,
    /// Whether every ray hits a known surface: there is a backdrop behind everything, and no fragment is missing.
    complete: bool,
    /// Whether a large surface is brighter than white.
    bright_area: bool,
}

impl Surface {
    /// A random disc of CoC radius `coc_px` in a picture of `width × height` pixels.
    fn disc(rng: &mut Rng, [width, height]: [usize; 2], coc_px: f32, seed: u64) -> Self {
        let position = |rng: &mut Rng, length: usize| rng.f32() * length as f32;
        let disc = [position(rng, width), position(rng, height), 3.0 + rng.f32() * 0.3 * height as f32];
        let alpha = if rng.u8(0..4) == 0 { 0.2 + 0.6 * rng.f32() } else { 1.0 };
        Self { disc: Some(disc), coc_px, alpha, color: std::array::from_fn(|_| rng.f32()), seed }
    }

    /// Its colour and alpha, and its CoC radius, at `x, y` in pixels; `None` outside of it. With `soft` its edge is one pixel
    /// wide.
    fn at(&self, x: f32, y: f32, soft: bool) -> Option<([f32; 4], f32)> {
        let inside = self.disc.map_or(f32::INFINITY, |[cx, cy, r]| r - (x - cx).hypot(y - cy));
        let cover = if soft { (inside + 0.5).clamp(0.0, 1.0) } else { f32::from(u8::from(inside > 0.0)) };
        let alpha = cover * self.alpha;
        // Texels four pixels wide, so that all samples of a pixel have the same one.
        let (tile_x, tile_y) = ((x / 4.0) as u64, (y / 4.0) as u64);
        let texture = Rng::with_seed(self.seed ^ (tile_x << 20) ^ (tile_y << 40)).f32();
        let [r, g, b] = self.color.map(|value| value * (0.4 + 0.6 * texture) * alpha);
        (alpha > 0.0).then_some(([r, g, b, alpha], self.coc_px))
    }
}

impl Case {
    fn new(seed: u64) -> Self {
        let rng = &mut Rng::with_seed(seed);
        let kind = KINDS[seed as usize % KINDS.len()];
        let [near, far] = RANGES_PX[(seed as usize / KINDS.len()) % RANGES_PX.len()];
        let size = [rng.usize(40..120), rng.usize(30..80)];
        let layers = if kind == StackKind::BeautyDepth { 1 } else { rng.usize(1..=4) };
        let between = |rng: &mut Rng| near + (far - near) * rng.f32();
        let mut surfaces: Vec<Surface> = (0..rng.u64(1..6))
            .map(|i| {
                let coc_px = between(rng);
                Surface::disc(rng, size, coc_px, seed * 31 + i)
            })
            .collect();
        let backdrop = rng.u8(0..4) > 0;
        if backdrop {
            let color = std::array::from_fn(|_| rng.f32());
            surfaces.push(Surface { disc: None, coc_px: far, alpha: 1.0, color, seed });
        }
        let bright_area = rng.u8(0..4) == 0;
        if bright_area {
            surfaces[0].color = [3.0; 3];
        }
        surfaces.sort_by(|a, b| a.coc_px.total_cmp(&b.coc_px));
        let supersample = if kind == StackKind::Supersampled { 2 } else { 1 };
        let (layers, cut) = layers_of(&surfaces, size, (layers, kind, supersample));
        let mut scene = Scene::new(layers, kind, supersample, 1000.0);
        // One in three is clipped at white, as a picture made for a display.
        if seed.is_multiple_of(3) {
            scene.color_range = ColorRange::UpToWhite;
        }
        let mut case = Self { seed, scene, complete: backdrop && !cut, bright_area };
        (0..rng.usize(0..12)).for_each(|_| case.light(rng));
        case.clip();
        case
    }

    /// Turns one random fragment of the nearest layer into a light.
    fn light(&mut self, rng: &mut Rng) {
        let Layer { color, alpha, .. } = &mut self.scene.layers[0];
        let (x, y) = (rng.usize(0..alpha.width()), rng.usize(0..alpha.height()));
        let value = 20.0 + 400.0 * rng.f32();
        if alpha.get(x, y) > 0.0 {
            color.iter_mut().for_each(|plane| plane.set(x, y, value));
        }
    }

    /// Clips colours at white if the source is limited to white.
    fn clip(&mut self) {
        if self.scene.color_range == ColorRange::UpToWhite {
            for Layer { color, alpha, .. } in &mut self.scene.layers {
                for plane in color {
                    let pairs = plane.values_mut().iter_mut().zip(alpha.values());
                    pairs.for_each(|(value, alpha)| *value = value.min(*alpha));
                }
            }
        }
    }

    fn settings(&self, switches: Switches) -> Settings {
        let values = Values {
            method: Some("shear".to_owned()),
            effort: Some(Effort::Views([48, 64, 256, 1024][self.seed as usize % 4])),
            blades: Some([0, 5, 6, 8][self.seed as usize / 2 % 4]),
            rotation_deg: Some(7.0 * self.seed as f32),
            blade_curvature: Some([0.5, 0.0, 0.02, 1.0, 0.004][self.seed as usize / 3 % 5]),
            squeeze: Some([1.0, 1.002, 1.33, 1.02, 2.0][self.seed as usize / 4 % 5]),
            // One in three of these is too small to be visible.
            cats_eye: Some([0.0, 0.6, 1e-4, 0.0, 1.1][self.seed as usize % 5]),
            vignetting: Some([0.0, 0.0, 1e-4, 0.5, 1.0][self.seed as usize / 2 % 5]),
            spherical_um: Some([0.0, 0.0, 40.0, 0.0, 3000.0, -4000.0, 0.0][self.seed as usize % 7]),
            axial_color_um: Some(
                [[0.0; 2], [20.0, -10.0], [0.0; 2], [3000.0, 0.0]][self.seed as usize / 3 % 4],
            ),
            lateral_color_um: Some([[0.0; 2], [0.0; 2], [900.0, -400.0]][self.seed as usize / 5 % 3]),
            ..Values::default()
        };
        let mut settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        settings.switches = switches;
        settings.mask = (self.seed % 6 == 5).then(|| Arc::new(half_open()));
        settings
    }

    /// The picture of `plan` after lateral colour and falloff.
    fn finished(&self, plan: &Plan) -> Image {
        finish::finish(self.picture(plan), plan, self.scene.field)
    }

    /// The plan with `effects` forced on.
    fn plan(&self, effects: &[EffectKind]) -> Plan {
        let force = effects.iter().map(|kind| kind.name().to_owned()).collect();
        let switches = Switches { force, ..Switches::default() };
        methods::Registry::default().prepare(self.scene.clone(), &self.settings(switches)).unwrap().2
    }

    fn picture(&self, plan: &Plan) -> Image {
        methods::render(self.extrapolated(plan), plan, &|_| {}).unwrap()
    }

    /// Smallest and largest absolute CoC radius of its fragments.
    fn coc_sizes_px(&self) -> [f32; 2] {
        let of_layer = |layer: &Layer| -> Vec<f32> {
            let pairs = layer.coc_px.values().iter().zip(layer.alpha.values());
            pairs.filter(|(_, alpha)| **alpha > 0.0).map(|(coc, _)| coc.abs()).collect()
        };
        let sizes = self.scene.layers.iter().flat_map(of_layer);
        sizes.fold([f32::INFINITY, 0.0], |[min, max], size| [min.min(size), max.max(size)])
    }

    /// Whether any fragment is blurred past its pixel, by its CoC radius and aberrations.
    fn is_blurred(&self) -> bool {
        let aberrations = self.plan(&[]).optics_requested.longest_shift_px();
        self.coc_sizes_px()[1] + aberrations > 0.01
    }

    /// The scene that methods blur by `plan`, with highlights extrapolated if the plan does so.
    fn extrapolated(&self, plan: &Plan) -> Scene {
        let scene = self.scene.clone();
        let extrapolates = plan.does(EffectKind::HighlightExtrapolation);
        if extrapolates { scene.extrapolated(&plan.extrapolation) } else { scene }
    }

    /// Whether forcing `kind` changes the picture by design; see the head of this file.
    fn by_design(&self, kind: EffectKind) -> bool {
        let [min_size_px, _] = self.coc_sizes_px();
        match kind {
            EffectKind::Blur => !self.is_blurred(),
            EffectKind::Fill => !self.complete && self.scene.layers.len() > 2,
            EffectKind::Resolve => self.scene.antialiasing.mean() > 0.0 && min_size_px < 1.5,
            EffectKind::Highlights => self.bright_area || self.scene.color_range == ColorRange::UpToWhite,
            EffectKind::HighlightExtrapolation => self.scene.color_range == ColorRange::Unbounded,
            // Neither can be switched, and `shear` does not shade an environment.
            EffectKind::Merge | EffectKind::Translucency | EffectKind::Environment => true,
            // Forced in a closed scene, it has no background to show.
            EffectKind::TransparentBackground
            | EffectKind::Reflections
            | EffectKind::Prefilter
            | EffectKind::BladeCurvature
            | EffectKind::Squeeze
            | EffectKind::ApertureImage
            | EffectKind::CatsEye
            | EffectKind::SphericalAberration
            | EffectKind::AxialColor
            | EffectKind::LateralColor
            | EffectKind::Vignetting => false,
            other => panic!("state here whether {other:?} changes the picture by design"),
        }
    }

    /// A description of the case for messages.
    fn name(&self) -> String {
        let Scene { layers, antialiasing, color_range, .. } = &self.scene;
        format!(
            "seed {}: {}, colours {color_range:?}, {} layers of {} × {}, CoC sizes {:?} px, complete: {}, bright area: {}",
            self.seed,
            antialiasing.in_words(),
            layers.len(),
            layers[0].width(),
            layers[0].height(),
            self.coc_sizes_px(),
            self.complete,
            self.bright_area
        )
    }
}

/// An aperture image whose lower half has a transmittance of a half.
fn half_open() -> Mask {
    let values = (0..64 * 64).map(|i| if i < 32 * 64 { 1.0 } else { 0.5 }).collect();
    Mask { name: "half open".to_owned(), width: 64, height: 64, values }
}

/// The nearest `count` fragments at each sample of a picture of `size` pixels, and whether any sample has more.
fn layers_of(
    surfaces: &[Surface],
    [width, height]: [usize; 2],
    (count, kind, supersample): (usize, StackKind, usize),
) -> (Vec<Layer>, bool) {
    let (columns, rows) = (width * supersample, height * supersample);
    let soft = matches!(kind, StackKind::Coverage | StackKind::BeautyDepth);
    let blank = || Layer {
        color: std::array::from_fn(|_| Plane::zeros(columns, rows)),
        alpha: Plane::zeros(columns, rows),
        coc_px: Plane::zeros(columns, rows),
    };
    let mut layers: Vec<Layer> = (0..count).map(|_| blank()).collect();
    let mut cut = false;
    for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        let middle = |place: usize| (place as f32 + 0.5) / supersample as f32;
        let mut hits = surfaces.iter().filter_map(|surface| surface.at(middle(x), middle(y), soft));
        for (layer, ([r, g, b, alpha], coc_px)) in layers.iter_mut().zip(hits.by_ref()) {
            layer.color.iter_mut().zip([r, g, b]).for_each(|(plane, value)| plane.set(x, y, value));
            layer.alpha.set(x, y, alpha);
            layer.coc_px.set(x, y, coc_px);
        }
        cut |= hits.next().is_some();
    }
    (layers, cut)
}

/// PSNR in dB of two pictures clipped to 0 … 1, including alpha.
fn psnr_db(a: &Image, b: &Image) -> f64 {
    let values = |image: &Image| -> Vec<f32> {
        image
            .planes
            .iter()
            .flat_map(|plane| plane.values().iter().map(|value| value.clamp(0.0, 1.0)))
            .collect()
    };
    let squares: Vec<f64> = values(a).iter().zip(values(b)).map(|(a, b)| f64::from(a - b).powi(2)).collect();
    -10.0 * (squares.iter().sum::<f64>() / squares.len() as f64).max(1e-20).log10()
}

fn cases() -> impl Iterator<Item = Case> {
    (0..CASES * KINDS.len() as u64).map(Case::new)
}

#[test]
fn the_cases_include_plans_with_and_without_each_effect() {
    let plans: Vec<Plan> = cases().map(|case| case.plan(&[])).collect();
    // The cases do not say what surfaces reflect.
    let reflected = [EffectKind::Reflections, EffectKind::Environment];
    for kind in EffectKind::ALL.into_iter().filter(|kind| !reflected.contains(kind)) {
        let on = plans.iter().filter(|plan| plan.does(kind)).count();
        assert!(on >= 4 && on <= plans.len() - 4, "{} is on in {on} of {} plans", kind.name(), plans.len());
    }
    let exempt = cases().flat_map(|case| EffectKind::ALL.map(|kind| case.by_design(kind))).filter(|by| *by);
    let free = plans.len() * EffectKind::ALL.len() - exempt.count();
    assert!(free > 150, "only {free} pairs of case and effect are tested");
}

#[test]
fn effects_that_a_plan_switches_off_would_not_be_visible() {
    let mut wrong = Vec::new();
    for case in cases() {
        let plan = case.plan(&[]);
        let planned = case.finished(&plan);
        let free: Vec<EffectKind> =
            EffectKind::ALL.into_iter().filter(|kind| !case.by_design(*kind)).collect();
        let alone = free.iter().filter(|kind| !plan.does(**kind)).map(std::slice::from_ref);
        for effects in alone.chain([free.as_slice()]) {
            let db = psnr_db(&case.finished(&case.plan(effects)), &planned);
            if db < SAME_DB {
                wrong.push(format!("{db:.1} dB with {effects:?} forced on; {}", case.name()));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn a_scene_within_a_hundredth_of_a_pixel_is_the_input_and_forced_blur_changes_no_more_than_the_plan_states() {
    let focused: Vec<Case> = cases().filter(|case| case.by_design(EffectKind::Blur)).collect();
    assert!(focused.len() >= 5, "only {} cases are in focus", focused.len());
    for case in focused {
        let pinhole = case.scene.pinhole();
        let plan = case.plan(&[]);
        assert_eq!(case.picture(&plan), pinhole, "bit for bit: {}", case.name());
        let blur = plan.effects.iter().find(|effect| effect.name == EffectKind::Blur).unwrap();
        let share: f32 = number_before(&blur.change, " % of a pixel's lens rays") / 100.0;
        if case.scene.layers.len() == 1 && case.complete {
            let values = Values {
                method: Some("accumulate".to_owned()),
                effort: Some(Effort::Views(1024)),
                ..Values::default()
            };
            let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
            let plan = methods::Registry::default()
                .plan(&case.scene.analyze(), &settings)
                .unwrap()
                .forced(EffectKind::Blur, true);
            // 0.001 for the sampling error of the rays.
            let max_excess = excess(&case.picture(&plan), &pinhole, share + 0.001);
            assert!(max_excess <= 0.0, "{max_excess} over the share of {share}: {}", case.name());
        }
    }
}

#[test]
fn rows_out_of_reach_of_any_blur_are_the_input_bit_for_bit() {
    let texture = |x: usize, y: usize, k: usize| Rng::with_seed((x + 100 * y + 10_000 * k) as u64).f32();
    let (width, height, focused) = (50, 60, 30);
    let layer = Layer {
        color: std::array::from_fn(|k| Plane::from_fn(width, height, |x, y| texture(x, y, k))),
        alpha: Plane::filled(width, height, 1.0),
        coc_px: Plane::from_fn(width, height, |_, y| if y < focused { 0.0 } else { 7.5 }),
    };
    let layers = vec![layer];
    let kind = StackKind::Coverage;
    let scene = Scene::new(layers, kind, 1, 1000.0);
    let case = Case { seed: 2, scene, complete: true, bright_area: false };
    // The disocclusion fill behind the edge would reach farther.
    let plan = case.plan(&[]).forced(EffectKind::Fill, false);
    let (image, pinhole) = (case.picture(&plan), case.scene.pinhole());
    let same = |y: &usize| (0..width).all(|x| image.pixel(x, *y) == pinhole.pixel(x, *y));
    let untouched = (0..height).take_while(same).count();
    // The largest bin radius is 7.5 px and at most half a bin more; a view may read one row farther.
    assert!((focused - 9..focused).contains(&untouched), "{untouched} rows from the top");
}

/// The number that stands before `words` in `text`.
fn number_before(text: &str, words: &str) -> f32 {
    text.split(words).next().and_then(|text| text.rsplit(' ').next()).unwrap().parse().unwrap()
}

/// The largest excess of a pixel's difference between `image` and `pinhole` over `share` times its contrast to its eight
/// neighbours.
fn excess(image: &Image, pinhole: &Image, share: f32) -> f32 {
    let (width, height) = (image.width(), image.height());
    let mut max = f32::NEG_INFINITY;
    for (image, pinhole) in image.planes.iter().zip(&pinhole.planes) {
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let own = pinhole.get(x, y);
            let around = (y.saturating_sub(1)..(y + 2).min(height))
                .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| (x, y)));
            let contrast = around.map(|(x, y)| (pinhole.get(x, y) - own).abs()).fold(0.0, f32::max);
            max = max.max((image.get(x, y) - own).abs() - share * contrast - 1e-5 * (1.0 + own));
        }
    }
    max
}

#[test]
fn every_method_does_as_the_switches_request() {
    let world = Case::new(10);
    let stats = world.scene.analyze();
    for method in METHODS {
        let info = method.info();
        for kind in EffectKind::ALL {
            for on in [false, true] {
                let names = vec![kind.name().to_owned()];
                let switches = if on {
                    Switches { force: names, ..Switches::default() }
                } else {
                    Switches { without: names, ..Switches::default() }
                };
                let values = Values { method: Some(info.name.to_owned()), ..Values::default() };
                let mut settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
                settings.switches = switches;
                let plan = match methods::Registry::default().plan(&stats, &settings) {
                    Ok(mut plan) => {
                        plan.views = plan.views.map(|_| 8);
                        plan
                    }
                    Err(error) => {
                        let text = error.to_string();
                        assert!(text.contains(kind.name()) && text.contains("cannot be"), "{text}");
                        continue;
                    }
                };
                assert_eq!(plan.does(kind), on, "{}: {kind:?}", info.name);
                let image = world.picture(&plan);
                let finite = image.planes.iter().flat_map(Plane::values).all(|value| value.is_finite());
                assert!(finite, "{}: {kind:?} {on}", info.name);
            }
        }
    }
}

mod a_requested_effect {
    use super::*;

    fn plan(method: &str, force: &[&str], without: &[&str]) -> Result<Plan, String> {
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let switches = Switches { force: owned(force), without: owned(without) };
        let values = Values { method: Some(method.to_owned()), ..Values::default() };
        let mut settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
        settings.switches = switches;
        let stats = cases().find(|case| case.complete).unwrap().scene.analyze();
        methods::Registry::default().plan(&stats, &settings).map_err(|error| error.to_string())
    }

    #[test]
    fn is_switched_and_reported_as_forced() {
        let own = plan("shear", &[], &[]).unwrap();
        assert!(own.does(EffectKind::Blur) && own.effects.iter().all(|effect| !effect.forced));
        let plan = plan("shear", &["open-background"], &["blur", "prefilter"]).unwrap();
        for (kind, on) in [
            (EffectKind::TransparentBackground, true),
            (EffectKind::Blur, false),
            (EffectKind::Prefilter, false),
        ] {
            let effect = plan.effects.iter().find(|effect| effect.name == kind).unwrap();
            assert!(effect.forced && effect.on == on, "{effect:?}");
            assert!(effect.reason.starts_with("requested; the plan's own choice was "), "{effect:?}");
        }
    }

    #[test]
    fn is_reported_as_off_if_nothing_is_blurred() {
        let plan = plan("shear", &["fill"], &["blur"]).unwrap();
        let on = plan.effects.iter().filter(|effect| effect.on && effect.name != EffectKind::Translucency);
        assert_eq!(on.count(), 0, "except for a fact of the stack: {:?}", plan.effects);
        let fill = plan.effects.iter().find(|effect| effect.name == EffectKind::Fill).unwrap();
        assert!(fill.forced && fill.reason.contains("force blur too"), "{fill:?}");
    }

    #[test]
    fn of_an_unknown_name_is_an_error_that_suggests_the_nearest_name_and_lists_all() {
        let error = plan("shear", &["hilights"], &[]).unwrap_err();
        assert!(error.contains("did you mean 'highlights'?") && error.contains("blur, merge, "), "{error}");
    }

    #[test]
    fn that_is_also_left_out_is_an_error() {
        let error = plan("shear", &["fill"], &["blur", "fill"]).unwrap_err();
        assert!(error.contains("'fill' is both forced and left out"), "{error}");
    }

    #[test]
    fn that_the_method_lacks_is_an_error() {
        let error = plan("gather", &["fill"], &[]).unwrap_err();
        assert!(error.contains("'fill' cannot be forced: gather has no such pass"), "{error}");
        assert!(plan("gather", &[], &["fill"]).is_ok(), "it is off already");
    }

    #[test]
    fn that_contradicts_the_stack_is_an_error() {
        let error = plan("shear", &["merge"], &[]).unwrap_err();
        assert!(error.contains("nothing to merge"), "{error}");
    }

    #[test]
    fn that_parameters_switch_off_gets_its_default_strength() {
        let mut settings = Settings::resolve(&[], ParameterValues::default());
        for key in ["prefilter", "resolve", "highlight_threshold"] {
            settings.parameters.set("shear", key, 0.0);
        }
        let force = ["prefilter", "resolve", "highlights"].map(str::to_owned).to_vec();
        settings.switches = Switches { force, ..Switches::default() };
        let plan = methods::Registry::default().plan(&Case::new(10).scene.analyze(), &settings).unwrap();
        let strengths = [EffectKind::Prefilter, EffectKind::Resolve, EffectKind::Highlights]
            .map(|kind| plan.strength(kind).unwrap());
        assert_eq!(strengths, [1.4, 0.08, 1.0], "the defaults of shear's parameters");
    }
}
