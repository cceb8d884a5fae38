//! Laws of the blur, tested for every method of the registry. Scenes are built in CoC space, so that each law concerns the blur
//! only; expected values are derived where they are used.
//!
//! A method that breaks a law by design declares a deviation, and is tested against the declared range: see [`Trial`].

#![expect(clippy::unwrap_used, reason = "a law whose scene cannot be made has failed")]

#[path = "laws/background.rs"]
mod background;

use std::sync::Arc;
use thinlens::image::{Image, Plane};
use thinlens::lens::{Aperture, LensSpec, ThinLens};
use thinlens::methods::{self, Law, METHODS, Method, Plan};
use thinlens::scene::{EffectKind, Layer, Scene};
use thinlens::settings::{Effort, Mask, Origin, ParameterValues, SensorDistance, Settings, Values};
use thinlens::stack::{Antialiasing, StackKind};

type Pixel = [f32; 4];

/// The cases of one law for one method: for each a figure, the range that the law allows, and a name.
struct Trial {
    method: &'static dyn Method,
    law: Law,
    cases: Vec<(f32, [f32; 2], String)>,
}

impl Trial {
    fn new(method: &'static dyn Method, law: Law) -> Self {
        Self { method, law, cases: Vec::new() }
    }

    fn add(&mut self, figure: f32, lawful: [f32; 2], case: impl Into<String>) {
        self.cases.push((figure, lawful, case.into()));
    }

    /// Tests every case against the law, or against the deviation that the method declares. A declared deviation fails if every
    /// case keeps the law.
    fn check(&self) {
        let within = |figure: f32, [min, max]: [f32; 2]| (min..=max).contains(&figure);
        let info = self.method.info();
        let deviation = info.deviations.iter().find(|deviation| deviation.law == self.law);
        for (figure, lawful, case) in &self.cases {
            let allowed = deviation.map_or(*lawful, |d| d.within);
            let figures: Vec<f32> = self.cases.iter().map(|(figure, ..)| *figure).collect();
            assert!(
                within(*figure, allowed),
                "{} and {:?}: {case}: {figure}, allowed {allowed:?}; all cases: {figures:?}",
                info.name,
                self.law
            );
        }
        if deviation.is_some() {
            let broken = self.cases.iter().any(|(figure, lawful, _)| !within(*figure, *lawful));
            assert!(broken, "{} keeps {:?}: remove its declared deviation", info.name, self.law);
        }
    }
}

/// A layer of `width × height` samples, `sample(x, y)` = colour, alpha and CoC radius.
fn layer(width: usize, height: usize, sample: impl Fn(usize, usize) -> (Pixel, f32)) -> Layer {
    let color = std::array::from_fn(|k| Plane::from_fn(width, height, |x, y| sample(x, y).0[k]));
    Layer {
        color,
        alpha: Plane::from_fn(width, height, |x, y| sample(x, y).0[3]),
        coc_px: Plane::from_fn(width, height, |x, y| sample(x, y).1),
    }
}

/// Point-sampled layers, nearest first.
fn scene(layers: Vec<Layer>) -> Scene {
    Scene::new(layers, StackKind::PointSampled, 1, 1000.0)
}

fn grey(value: f32) -> Pixel {
    [value, value, value, 1.0]
}

/// The plan for `scene` with `views` lens samples if the method samples the lens, and without the resolve pass, which would mix
/// neighbours in focus.
fn plan(method: &dyn Method, scene: &Scene, views: usize, blades: u32) -> Plan {
    plan_through(method, scene, views, Values { blades: Some(blades), ..Values::default() })
}

/// The same through the lens that `values` describe.
fn plan_through(method: &dyn Method, scene: &Scene, views: usize, values: Values) -> Plan {
    plan_for(method, scene, views, &Lens { values, mask: None })
}

/// The same through `lens`.
fn plan_for(method: &dyn Method, scene: &Scene, views: usize, lens: &Lens) -> Plan {
    let values = Values {
        method: Some(method.info().name.to_owned()),
        effort: samples_the_lens(method).then_some(Effort::Views(views)),
        ..lens.values.clone()
    };
    let mut settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
    settings.mask = lens.mask.clone();
    methods::Registry::default().plan(&scene.analyze(), &settings).unwrap().forced(EffectKind::Resolve, false)
}

/// Settings of a lens, and the image of its aperture.
struct Lens {
    values: Values,
    mask: Option<Arc<Mask>>,
}

fn samples_the_lens(method: &dyn Method) -> bool {
    method.samples_lens()
}

fn blur_with(method: &dyn Method, scene: &Scene, views: usize, blades: u32) -> Image {
    methods::render(scene.clone(), &plan(method, scene, views, blades), &|_| {}).unwrap()
}

fn blur(method: &dyn Method, scene: &Scene, views: usize) -> Image {
    blur_with(method, scene, views, 0)
}

/// A pseudo-random number from 0 to 1 that depends only on the arguments.
fn noise(x: usize, y: usize, seed: usize) -> f32 {
    let mut bits = (x * 73_856_093) ^ (y * 19_349_663) ^ (seed * 83_492_791);
    bits = (bits ^ (bits >> 13)).wrapping_mul(0x5bd1_e995) ^ (bits >> 15);
    (bits % 65_536) as f32 / 65_535.0
}

/// Largest difference between two pictures.
fn difference(a: &Image, b: &Image) -> f32 {
    let values =
        |image: &Image| image.planes.iter().flat_map(|plane| plane.values().to_vec()).collect::<Vec<_>>();
    values(a).iter().zip(values(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Peak signal-to-noise ratio over all channels, for values from 0 to 1.
fn psnr_db(a: &Image, b: &Image) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in a.planes.iter().zip(&b.planes) {
        for (a, b) in a.values().iter().zip(b.values()) {
            sum += f64::from(a - b).powi(2);
            count += 1.0;
        }
    }
    -10.0 * (sum / count).max(1e-20).log10()
}

/// A small scene with the difficult cases: a slanted floor through focus, near bars, a far wall behind both, and holes.
fn world(width: usize, height: usize) -> Scene {
    let texture = |x: usize, y: usize, seed| {
        let fine = noise(x / 3, y / 3, seed);
        [0.2 + 0.6 * fine, 0.3 + 0.4 * noise(x / 5, y / 4, seed + 1), 0.5 * fine, 1.0]
    };
    let bar = |x: usize| (x * 7 / width) % 3 == 1;
    let floor = |y: usize| 8.0 - 14.0 * y as f32 / height as f32;
    let front =
        layer(
            width,
            height,
            |x, y| if bar(x) { (texture(x, y, 1), -9.0) } else { (texture(x, y, 2), floor(y)) },
        );
    let middle =
        layer(
            width,
            height,
            |x, y| if bar(x) { (texture(x, y, 2), floor(y)) } else { (texture(x, y, 3), 9.0) },
        );
    let back = layer(width, height, |x, y| if bar(x) { (texture(x, y, 3), 9.0) } else { ([0.0; 4], 0.0) });
    scene(vec![front, middle, back])
}

#[test]
fn a_constant_picture_stays_constant_at_every_size_blur_and_aperture() {
    for method in METHODS {
        let mut trial = Trial::new(method, Law::Constancy);
        for (width, height) in [(1, 1), (1, 7), (9, 1), (2, 2), (17, 3), (33, 31)] {
            for coc in [-40.0, -3.3, 0.7, 12.0] {
                let flat = |_, _| (grey(0.6), coc);
                let slanted = |x: usize, y: usize| (grey(0.6), coc + 0.4 * x as f32 - 0.3 * y as f32);
                for layers in [vec![layer(width, height, flat)], vec![layer(width, height, slanted)]] {
                    let scene = scene(layers);
                    let expected = Image::from_fn(width, height, |_, _| grey(0.6));
                    for blades in [0, 5] {
                        let off = difference(&blur_with(method, &scene, 24, blades), &expected);
                        trial.add(
                            off,
                            [0.0, 1e-5],
                            format!("{width} × {height}, c = {coc}, {blades} blades"),
                        );
                    }
                }
            }
        }
        trial.check();
    }
}

#[test]
fn the_rounding_error_does_not_grow_with_thousands_of_views() {
    // In one running f32 sum of 10 000 views each addition would lose up to 2⁻²⁴ · 10 000 of a view's share: 6e-4.
    for method in METHODS.into_iter().filter(|&method| samples_the_lens(method)) {
        let scene = scene(vec![layer(5, 3, |x, _| (grey(0.6), 3.0 + x as f32 * 0.2))]);
        let off = difference(&blur(method, &scene, 10_000), &Image::from_fn(5, 3, |_, _| grey(0.6)));
        assert!(off < 3e-6, "{}: off by {off}", method.info().name);
    }
}

#[test]
fn without_blur_the_picture_is_the_input_bit_for_bit() {
    let colors = |x, y| [noise(x, y, 1), -3.0 * noise(x, y, 2), 60_000.0 * noise(x, y, 3), 1.0];
    for method in METHODS {
        let focused =
            scene(vec![layer(13, 9, |x, y| (colors(x, y), 0.0)), layer(13, 9, |_, _| (grey(9.0), 0.004))]);
        assert_eq!(blur(method, &focused, 64), Image::from_fn(13, 9, colors), "{}", method.info().name);
    }
}

#[test]
fn an_infinite_f_number_is_a_pinhole() {
    let spec = LensSpec {
        focal_length_mm: 85.0,
        f_number: f32::INFINITY,
        focus_distance: 2.0,
        sensor_width_mm: 36.0,
        sensor_distance: SensorDistance::ThinLens,
        metres_per_unit: 1.0,
    };
    let lens = ThinLens::new(&spec, 1920.0).unwrap();
    for z in [1e-3, 0.5, 2.0, 1e6, f32::INFINITY] {
        assert_eq!(lens.coc_radius_px(z), 0.0, "CoC radius at depth {z}");
    }
}

/// Sum, centroid and variance along x of a picture's red channel about `centre`.
fn moments(image: &Image, centre: f64) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for y in 0..image.height() {
        for x in 0..image.width() {
            let (value, offset) = (f64::from(image.planes[0].get(x, y)), x as f64 - centre);
            sums.iter_mut()
                .zip([1.0, offset, offset * offset])
                .for_each(|(sum, weight)| *sum += value * weight);
        }
    }
    [sums[0], sums[1] / sums[0], sums[2] / sums[0]]
}

#[test]
fn an_emitter_keeps_its_energy_and_centroid_and_has_the_variance_of_its_disc() {
    for method in METHODS {
        let [mut energy, mut centroid, mut spread] =
            [Law::Energy, Law::Place, Law::Spread].map(|law| Trial::new(method, law));
        for coc in [-9.5, -2.2, 1.4, 7.0] {
            for (brightness, blades) in [(0.8, 0), (400.0, 0), (400.0, 6)] {
                let emitter = |x, y| (if (x, y) == (24, 24) { grey(brightness) } else { grey(0.0) }, coc);
                let scene = scene(vec![layer(49, 49, emitter)]);
                let image = blur_with(method, &scene, 4096, blades);
                let [sum, centre, variance] = moments(&image, 24.0);
                let case = format!("c = {coc}, brightness {brightness}, {blades} blades");
                energy.add((sum / f64::from(brightness)) as f32, [0.998, 1.002], case.clone());
                centroid.add(centre.abs() as f32, [0.0, 0.01], case.clone());
                // A uniform aperture has variance c²·m, and the pixel adds up to 1/3. A method may round the radius to a bin
                // whose width is a 32nd of it, so by a 64th, which changes the variance by a 32nd.
                let moment = if blades == 0 { 0.25 } else { (2.0 + 0.5) / 12.0 };
                let disc = coc.powi(2) * moment;
                spread.add(
                    variance as f32 / disc,
                    [1.0 - 1.0 / 32.0, 1.0 + 1.0 / 32.0 + 1.0 / 3.0 / disc],
                    case,
                );
            }
        }
        [energy, centroid, spread].iter().for_each(Trial::check);
    }
}

/// Methods that have `effect`; at least two.
fn methods_with(effect: EffectKind) -> Vec<&'static dyn Method> {
    let found: Vec<_> =
        METHODS.into_iter().filter(|method| method.info().effects.contains(&effect)).collect();
    assert!(found.len() >= 2, "{effect:?}");
    found
}

/// Curved blades, squeezed: an aperture that differs between x and y, and when rotated by 180°.
fn oval() -> Values {
    Values {
        blades: Some(5),
        rotation_deg: Some(20.0),
        blade_curvature: Some(0.5),
        squeeze: Some(2.0),
        ..Values::default()
    }
}

#[test]
fn an_emitter_has_the_variance_of_curved_and_squeezed_blades_along_each_axis() {
    let aperture = Aperture::new(5, 20.0).unwrap().curved(0.5).unwrap().squeezed(2.0).unwrap();
    for method in methods_with(EffectKind::Squeeze) {
        let [mut energy, mut centroid, mut spread] =
            [Law::Energy, Law::Place, Law::Spread].map(|law| Trial::new(method, law));
        for (coc, brightness) in [(-9.5, 0.8), (-9.5, 400.0), (7.0, 0.8), (7.0, 400.0)] {
            let emitter = |x, y| (if (x, y) == (24, 24) { grey(brightness) } else { grey(0.0) }, coc);
            let scene = scene(vec![layer(49, 49, emitter)]);
            let plan = plan_through(method, &scene, 4096, oval());
            assert_eq!(plan.optics.aperture, aperture, "{}", method.info().name);
            let image = methods::render(scene, &plan, &|_| {}).unwrap();
            let transposed = Image::from_fn(49, 49, |x, y| image.pixel(y, x));
            let second = aperture.second_moments();
            for (axis, image, moment) in [("x", &image, second.x), ("y", &transposed, second.y)] {
                let [sum, centre, variance] = moments(image, 24.0);
                let case = format!("along {axis}, c = {coc}, brightness {brightness}");
                energy.add((sum / f64::from(brightness)) as f32, [0.995, 1.005], case.clone());
                centroid.add(centre.abs() as f32, [0.0, 0.05], case.clone());
                let disc = coc.powi(2) * moment;
                let pixel = 1.0 / 3.0 / disc;
                spread.add(variance as f32 / disc, [1.0 - 1.0 / 32.0, 1.0 + 1.0 / 32.0 + pixel], case);
            }
        }
        [energy, centroid, spread].iter().for_each(Trial::check);
    }
}

/// An aperture image whose opening lies to one side, with a bar across it.
fn mask() -> Mask {
    let side = 128;
    let light = |i: usize| {
        let (x, y) = ((i % side) as f32 / 64.0 - 1.0, (i / side) as f32 / 64.0 - 1.0);
        if x > -0.2 && (y - 0.1).abs() > 0.1 { 0.4 + 0.6 * y.abs() } else { 0.0 }
    };
    Mask {
        name: "opening".to_owned(),
        width: side,
        height: side,
        values: (0..side * side).map(light).collect(),
    }
}

/// Lenses with one aberration each, and one with all of them. The focal length is so short that aberrations of micrometres are
/// many pixels of a small picture.
fn aberrated_lenses() -> Vec<(Vec<EffectKind>, Lens)> {
    let short = || Values { focal_length_mm: Some(5.0), f_number: Some(1.0), ..Values::default() };
    let lens = |values| Lens { values, mask: None };
    let image = || Some(Arc::new(mask()));
    let cats_eye = || Values { cats_eye: Some(1.0), ..short() };
    let soft = |um| Values { spherical_um: Some(um), ..short() };
    let colors = || Values { axial_color_um: Some([400.0, -250.0]), ..short() };
    let all = Values { cats_eye: Some(0.7), spherical_um: Some(-300.0), squeeze: Some(1.5), ..colors() };
    vec![
        (vec![EffectKind::Squeeze, EffectKind::BladeCurvature], lens(oval())),
        (vec![EffectKind::ApertureImage], Lens { values: short(), mask: image() }),
        (vec![EffectKind::CatsEye], lens(cats_eye())),
        (vec![EffectKind::SphericalAberration], lens(soft(1200.0))),
        (vec![EffectKind::SphericalAberration], lens(soft(-1200.0))),
        (vec![EffectKind::AxialColor], lens(colors())),
        (
            vec![
                EffectKind::Squeeze,
                EffectKind::ApertureImage,
                EffectKind::CatsEye,
                EffectKind::SphericalAberration,
                EffectKind::AxialColor,
            ],
            Lens { values: all, mask: image() },
        ),
    ]
}

#[test]
fn every_method_with_an_aberration_renders_it_as_the_reference_does() {
    let world = world(56, 40);
    let reference = methods::Registry::default().by_name("accumulate").unwrap();
    let picture = |method: &dyn Method, views, lens: &Lens| {
        let plan = plan_for(method, &world, views, lens).forced(EffectKind::Prefilter, false);
        methods::render(world.clone(), &plan, &|_| {}).unwrap()
    };
    let plain = picture(reference, 4096, &Lens { values: Values::default(), mask: None });
    for (effects, lens) in aberrated_lenses() {
        let truth = picture(reference, 4096, &lens);
        let plain_db = psnr_db(&plain, &truth);
        assert!(plain_db < 40.0, "the picture without {effects:?} must differ: {plain_db} dB");
        let able = |method: &&dyn Method| effects.iter().all(|effect| method.info().effects.contains(effect));
        let able: Vec<_> = METHODS.into_iter().filter(able).collect();
        assert!(able.len() >= 2, "{effects:?}");
        for method in able {
            let mut trial = Trial::new(method, Law::Convergence);
            let db = psnr_db(&picture(method, 1024, &lens), &truth);
            trial.add(db as f32, [45.0, f32::INFINITY], format!("{effects:?}"));
            trial.check();
        }
    }
}

#[test]
fn a_focused_background_is_sharp_behind_a_blurred_foreground() {
    let front =
        || layer(48, 24, |x, _| if (20..26).contains(&x) { (grey(0.5), -8.0) } else { ([0.0; 4], 0.0) });
    let back = |value: &dyn Fn(usize, usize) -> f32| layer(48, 24, |x, y| (grey(value(x, y)), 0.0));
    let checker = |x: usize, y: usize| ((x + y) % 2) as f32;
    for method in METHODS {
        let rendered =
            |value: &dyn Fn(usize, usize) -> f32| blur(method, &scene(vec![front(), back(value)]), 256);
        let (black, white, checkered) = (rendered(&|_, _| 0.0), rendered(&|_, _| 1.0), rendered(&checker));
        let expected =
            Image::from_fn(
                48,
                24,
                |x, y| {
                    if checker(x, y) == 1.0 { white.pixel(x, y) } else { black.pixel(x, y) }
                },
            );
        let mut sharpness = Trial::new(method, Law::Sharpness);
        sharpness.add(difference(&checkered, &expected), [0.0, 1e-5], "checkers behind a bar");
        sharpness.check();
        // Six columns of foreground are spread over 16: the background is visible even at their centre.
        let mut see_through = Trial::new(method, Law::SeeThrough);
        let share = white.pixel(23, 12)[0] - black.pixel(23, 12)[0];
        see_through.add(share, [0.3, 0.7], "the middle of the bar");
        see_through.check();
    }
}

#[test]
fn an_opaque_focused_foreground_occludes_a_blurred_background() {
    for method in METHODS {
        let front = layer(32, 16, |x, y| (grey(noise(x, y, 4)), 0.0));
        let back = layer(32, 16, |_, _| (grey(500.0), 12.0));
        let image = blur(method, &scene(vec![front, back]), 64);
        let expected = Image::from_fn(32, 16, |x, y| grey(noise(x, y, 4)));
        let mut trial = Trial::new(method, Law::Occlusion);
        trial.add(difference(&image, &expected), [0.0, 1e-5], "noise in front of a bright wall");
        trial.check();
    }
}

/// Share of a bright wall that is visible through an opaque surface in front of it, whose CoC radius changes by `across` and
/// `down` pixels per sample. Returns the mean and the largest share away from the border, past which a slanted surface
/// continues level.
fn leak(method: &'static dyn Method, (across, down): (f32, f32)) -> (f32, f32) {
    let slanted = layer(48, 48, |x, y| (grey(0.5), across * (x as f32 - 24.0) + down * (y as f32 - 24.0)));
    let wall = layer(48, 48, |_, _| (grey(0.9), 60.0));
    let image = blur(method, &scene(vec![slanted, wall]), 256);
    let inner = (14..34).flat_map(|y| (14..34).map(move |x| (x, y)));
    let shares: Vec<f32> = inner.map(|(x, y)| (image.pixel(x, y)[0] - 0.5) / 0.4).collect();
    (shares.iter().sum::<f32>() / shares.len() as f32, shares.iter().fold(0.0, |max, share| share.max(max)))
}

#[test]
fn a_slanted_surface_has_no_cracks() {
    // All neighbours, also across a corner, differ by less than half a pixel of CoC radius.
    for method in METHODS {
        let mut trial = Trial::new(method, Law::NoCracks);
        for slant in [(0.0, 0.3), (0.24, 0.1), (-0.45, 0.0), (0.2, -0.28)] {
            trial.add(leak(method, slant).1, [-1.0, 3e-5], format!("slant {slant:?}"));
        }
        trial.check();
    }
}

#[test]
fn a_surface_that_is_steep_across_the_corners_of_its_samples_has_no_cracks() {
    // Neighbours differ by less than half a pixel of CoC radius, and by more across a corner.
    for method in METHODS {
        let mut trial = Trial::new(method, Law::NoCracksAcrossCorners);
        for slant in [(0.3, -0.37), (0.45, 0.45)] {
            trial.add(leak(method, slant).1, [-1.0, 3e-5], format!("slant {slant:?}"));
        }
        trial.check();
    }
}

#[test]
fn a_surface_that_continues_one_peel_farther_behind_a_nearer_one_has_no_cracks() {
    // A floor through focus, and a near bar in front of its middle rows, where the floor is the second peel.
    let floor = |y: usize| 0.3 * (y as f32 - 24.0);
    let barred = |y: usize| (20..28).contains(&y);
    let first = layer(48, 48, |_, y| (grey(0.5), if barred(y) { -12.0 } else { floor(y) }));
    let second = layer(48, 48, |_, y| if barred(y) { (grey(0.5), floor(y)) } else { (grey(0.9), 25.0) });
    let third = layer(48, 48, |_, y| if barred(y) { (grey(0.9), 25.0) } else { ([0.0; 4], 0.0) });
    let shear = methods::Registry::default().by_name("shear").unwrap();
    let image = blur(shear, &scene(vec![first, second, third]), 256);
    for y in 14..34 {
        let leak = image.pixel(24, y)[0] - 0.5;
        assert!(leak.abs() < 1e-5, "{leak} is visible through it in row {y}");
    }
}

#[test]
fn a_layer_of_half_coverage_halves_the_light_behind_it() {
    for method in METHODS {
        let translucent = layer(32, 16, |_, _| ([0.1, 0.1, 0.1, 0.5], -6.0));
        let wall = layer(32, 16, |_, _| (grey(0.8), 5.0));
        let image = blur(
            method,
            &Scene { antialiasing: Antialiasing::AVERAGES, ..scene(vec![translucent, wall]) },
            64,
        );
        let mut trial = Trial::new(method, Law::Veil);
        let off = difference(&image, &Image::from_fn(32, 16, |_, _| grey(0.1 + 0.5 * 0.8)));
        trial.add(off, [0.0, 1e-5], "grey translucent layer, grey wall");
        trial.check();
    }
}

#[test]
fn an_object_on_a_transparent_background_keeps_its_coverage() {
    for method in METHODS {
        let mut trial = Trial::new(method, Law::Transparency);
        for coc in [-5.0, 5.0] {
            let object = layer(64, 64, |x, y| {
                let inside = (24..40).contains(&x) && (24..40).contains(&y);
                (if inside { grey(0.5) } else { [0.0; 4] }, if inside { coc } else { 0.0 })
            });
            let image = blur(method, &scene(vec![object]), 256);
            let alpha: f32 = image.planes[3].values().iter().sum();
            trial.add(alpha / 256.0, [255.0 / 256.0, 257.0 / 256.0], format!("16 × 16 pixels at c = {coc}"));
            for (red, alpha) in image.planes[0].values().iter().zip(image.planes[3].values()) {
                assert!(
                    (red - 0.5 * alpha).abs() < 1e-5,
                    "{}: colour {red} at coverage {alpha}",
                    method.info().name
                );
            }
            let far_off = image.pixel(0, 0).into_iter().fold(0.0, f32::max);
            assert!(far_off < 1e-5, "{}: {far_off} far from it", method.info().name);
        }
        trial.check();
    }
}

#[test]
fn a_mirrored_or_transposed_scene_gives_the_mirrored_or_transposed_picture() {
    type Mapping = fn(usize, usize) -> (usize, usize);
    let mappings: [Mapping; 3] = [|x, y| (39 - x, y), |x, y| (x, 39 - y), |x, y| (y, x)];
    let world = world(40, 40);
    let mapped = |plane: &Plane, mapping: Mapping| {
        Plane::from_fn(40, 40, |x, y| {
            let (x, y) = mapping(x, y);
            plane.get(x, y)
        })
    };
    for method in METHODS {
        let mut trial = Trial::new(method, Law::Symmetry);
        let image = blur(method, &world, 1024);
        for (mapping, case) in mappings.into_iter().zip(["left to right", "top to bottom", "transposed"]) {
            let layers = world.layers.iter().map(|layer| Layer {
                color: layer.color.each_ref().map(|plane| mapped(plane, mapping)),
                alpha: mapped(&layer.alpha, mapping),
                coc_px: mapped(&layer.coc_px, mapping),
            });
            let of_mapped_scene = blur(method, &scene(layers.collect()), 1024);
            let expected = Image { planes: image.planes.each_ref().map(|plane| mapped(plane, mapping)) };
            // The lens samples are not symmetric, so the two differ by their sampling error.
            trial.add(psnr_db(&of_mapped_scene, &expected) as f32, [48.0, f32::INFINITY], case);
        }
        trial.check();
    }
}

#[test]
fn finite_input_gives_finite_output_however_extreme() {
    let wild = [0.0, -5.0, 65_504.0, 1e-30, 1e4, f32::MIN_POSITIVE];
    let alphas = [0.0, 1e-7, 0.3, 0.9995, 1.0];
    let cocs = [-2000.0, -50.0, -0.5, 0.0, 1e-20, 0.499, 30.0, 900.0];
    for method in METHODS {
        for seed in 0..6usize {
            let pick = |values: &[f32], x: usize, y: usize, k: usize| {
                values[(noise(x, y, seed * 10 + k) * (values.len() as f32 - 0.01)) as usize]
            };
            let make = |k: usize| {
                layer(23, 11, |x, y| {
                    let color = pick(&wild, x, y, k);
                    ([color, -color, color * 0.5, pick(&alphas, x, y, k + 1)], pick(&cocs, x, y, k + 2))
                })
            };
            for views in [1, 3, 64] {
                let image = blur(method, &scene(vec![make(0), make(3), make(6)]), views);
                let finite =
                    image.planes.iter().all(|plane| plane.values().iter().all(|value| value.is_finite()));
                assert!(finite, "{}: seed {seed}, {views} views", method.info().name);
                let alpha = image.planes[3].values().iter().all(|alpha| (0.0..=1.0 + 1e-5).contains(alpha));
                assert!(alpha, "{}: seed {seed}, {views} views: alpha outside 0 … 1", method.info().name);
            }
        }
    }
}

#[test]
fn a_scene_without_fragments_is_a_transparent_picture() {
    for method in METHODS {
        let image = blur(method, &scene(vec![layer(8, 5, |_, _| ([0.0; 4], 0.0))]), 16);
        assert_eq!(image, Image::transparent(8, 5), "{}", method.info().name);
    }
}

#[test]
fn the_picture_depends_neither_on_the_number_of_threads_nor_on_repetition() {
    let world = world(61, 37);
    for method in METHODS {
        let with_threads = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| blur(method, &world, 32))
        };
        let one = with_threads(1);
        assert_eq!(one, with_threads(3), "{}: one and three threads", method.info().name);
        assert_eq!(one, with_threads(1), "{}: first and second time", method.info().name);
    }
}

#[test]
fn a_small_change_of_focus_makes_a_small_change_of_picture() {
    let world = world(48, 32);
    let refocused = |shift: f32| {
        let mut scene = world.clone();
        for layer in &mut scene.layers {
            layer.coc_px.values_mut().iter_mut().for_each(|coc| *coc += shift);
        }
        scene
    };
    for method in METHODS {
        let before = blur(method, &refocused(0.0), 256);
        let after = blur(method, &refocused(0.02), 256);
        let mut trial = Trial::new(method, Law::Continuity);
        trial.add(psnr_db(&before, &after) as f32, [38.0, f32::INFINITY], "0.02 px further");
        trial.check();
    }
}

#[test]
fn every_method_converges_to_the_reference() {
    let reference = methods::Registry::default().by_name("accumulate").unwrap();
    let cases = [(world(56, 40), 0), (world(40, 56), 5)];
    let truths = cases.each_ref().map(|(world, blades)| blur_with(reference, world, 4096, *blades));
    for method in METHODS {
        let mut trial = Trial::new(method, Law::Convergence);
        for ((world, blades), truth) in cases.iter().zip(&truths) {
            let plan = plan(method, world, 1024, *blades).forced(EffectKind::Prefilter, false);
            let db = psnr_db(&methods::render(world.clone(), &plan, &|_| {}).unwrap(), truth);
            trial.add(db as f32, [45.0, f32::INFINITY], format!("a small world, {blades} blades"));
        }
        trial.check();
    }
}

#[test]
fn single_pixels_equal_those_of_the_picture_whatever_was_requested_before() {
    let (width, height) = (45, 31);
    let mut scene = world(width, height);
    // A highlight, and pixels at every border.
    scene.layers.iter_mut().for_each(|layer| layer.color[1].set(20, 15, 40.0));
    let corners = [0, width - 1, (height - 1) * width, height * width - 1];
    let pixels: Vec<usize> = (0..width * height).step_by(7).chain(corners).collect();
    let hexagon = Lens { values: Values { blades: Some(6), ..Values::default() }, mask: None };
    let (_, aberrated) = aberrated_lenses().pop().unwrap();
    let mut sampling = 0;
    for (method, lens) in METHODS.into_iter().flat_map(|method| [(method, &hexagon), (method, &aberrated)]) {
        let Some(samples) = method.lens_sampling() else { continue };
        let plan = plan_for(method, &scene, 8, lens).forced(EffectKind::Resolve, true);
        let sampled = samples.sampled(&scene, &plan).into_owned();
        let without_lights = plan.clone().forced(EffectKind::Highlights, false);
        let mut sampler = samples.begin(scene.clone(), &plan);
        for views in [16, 128, 16, 8] {
            let values = sampler.pixels(views, &pixels);
            let picture = samples.begin(sampled.clone(), &without_lights).picture(views, &|_| {});
            for (value, &pixel) in values.iter().zip(&pixels) {
                let expected = picture.planes.each_ref().map(|plane| plane.values()[pixel]);
                let near = value.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs().max(1.0));
                assert!(
                    near,
                    "{}: {value:?}, expected {expected:?} at {pixel}, {views} views",
                    method.info().name
                );
            }
        }
        let after_pixels = sampler.picture(8, &|_| {});
        assert_eq!(
            after_pixels,
            samples.begin(scene.clone(), &plan).picture(8, &|_| {}),
            "{}",
            method.info().name
        );
        sampling += 1;
    }
    assert!(sampling >= 8, "{sampling} times: four methods sample the lens");
}

#[test]
fn supersampled_layers_blur_as_the_coverage_that_their_samples_represent() {
    // A slanted edge at twice the resolution, in front of focus and behind it; colours are constant along it.
    let edge = |x: usize, y: usize| x + y / 2 < 48;
    let front = layer(96, 64, |x, y| if edge(x, y) { (grey(0.9), -5.0) } else { (grey(0.2), 6.0) });
    let back = layer(96, 64, |x, y| if edge(x, y) { (grey(0.2), 6.0) } else { ([0.0; 4], 0.0) });
    let scene = Scene { antialiasing: Antialiasing::AVERAGES, supersample: 2, ..scene(vec![front, back]) };
    let reference = blur(methods::Registry::default().by_name("accumulate").unwrap(), &scene, 1024);
    for method in METHODS {
        let image = blur(method, &scene, 1024);
        assert_eq!((image.width(), image.height()), (48, 32), "{}: picture size", method.info().name);
        let mut trial = Trial::new(method, Law::Supersampling);
        trial.add(psnr_db(&image, &reference) as f32, [40.0, f32::INFINITY], "a slanted edge");
        trial.check();
    }
}
