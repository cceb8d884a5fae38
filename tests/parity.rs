//! Every method with a GPU backend renders the same picture on a GPU as on the CPU.
//!
//! The tests run on any adapter, including software drivers. Without an adapter they pass without checking anything, unless
//! `THINLENS_REQUIRE_GPU` is set: then they fail.

#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "a test stops at the first thing that fails")]

use std::path::Path;
use std::sync::Arc;
use std::sync::OnceLock;
use thinlens::gpu::{DeviceChoice, DeviceKind, Gpu};
use thinlens::image::{Image, Plane};
use thinlens::methods::{self, LostRays, METHODS, Method, Plan};
use thinlens::render::{Job, NamedPreset, prepare, render};
use thinlens::scene::{EffectKind, Layer, ReflectingLayer, ReflectionStats, Reflections, Scene};
use thinlens::settings::{Effort, Origin, ParameterValues, Preset, Settings, Values};
use thinlens::stack::{Antialiasing, LIGHT_ALPHA, Source, StackKind};

/// Maximum difference between a method's two pictures.
#[derive(Clone, Copy)]
struct Tolerance {
    method: &'static str,
    /// Maximum difference of a value, relative to one plus that value.
    max_difference: f32,
    /// Fraction of all values that may differ more.
    outliers: f64,
    /// Reason for the tolerance.
    reason: &'static str,
}

const TOLERANCES: &[Tolerance] = &[
    Tolerance {
        method: "shear",
        max_difference: 3e-6,
        outliers: 0.0,
        reason: "the fragment that a view hits is decided by integers that the CPU computes; only the order of summation differs",
    },
    Tolerance {
        method: "accumulate",
        max_difference: 2e-6,
        outliers: 0.0,
        reason: "rays take the same steps by the same table; a ray exactly on the edge of a sample may hit its neighbour, which happens in no case",
    },
    Tolerance {
        method: "layer-rays",
        max_difference: 2e-5,
        outliers: 2e-5,
        reason: "the level of a cone is a logarithm; a root search that ends exactly on the edge of a sample may hit its neighbour",
    },
    Tolerance {
        method: "peel-rays",
        max_difference: 2e-6,
        outliers: 0.0,
        reason: "rays take the same steps through the same tables; where a division or fused multiply-add rounds differently, a ray on the edge of a sample may hit its neighbour, which happens in no case",
    },
    Tolerance {
        method: "recursive-gaussian",
        max_difference: 4e-6,
        outliers: 0.0,
        reason: "sums along lines are integers, rounded to single precision in each pass, as on the CPU",
    },
    Tolerance {
        method: "b-buffer",
        max_difference: 2e-6,
        outliers: 0.0,
        reason: "pyramids are sums; only their order and the rounding of divisions differ",
    },
    Tolerance {
        method: "opaque-blur",
        max_difference: 2e-6,
        outliers: 0.0,
        reason: "pyramids are sums; only their order and the rounding of divisions differ",
    },
    Tolerance {
        method: "pyramid-disocclusion",
        max_difference: 2e-6,
        outliers: 0.0,
        reason: "pyramids are sums; only their order and the rounding of divisions differ",
    },
    Tolerance {
        method: "point-splat",
        max_difference: 1e-5,
        outliers: 0.0,
        reason: "points, weights and the bounds of layers are computed on the CPU; only the order of summation differs",
    },
];

fn tolerance(method: &dyn Method) -> Tolerance {
    let name = method.info().name;
    let found = TOLERANCES.iter().find(|tolerance| tolerance.method == name);
    *found.unwrap_or_else(|| panic!("{name} has a GPU backend and no tolerance"))
}

impl Tolerance {
    /// Fraction of the values of `found` that differ from those of `expected` by more than `max_difference`, and the largest
    /// difference.
    fn outside(&self, found: &Image, expected: &Image) -> (f64, f32) {
        assert_eq!((found.width(), found.height()), (expected.width(), expected.height()));
        let (mut outside, mut count, mut worst) = (0usize, 0usize, 0.0f32);
        for (found, expected) in found.planes.iter().zip(&expected.planes) {
            for (&found, &expected) in found.values().iter().zip(expected.values()) {
                let difference = (found - expected).abs() / (1.0 + expected.abs());
                // NaN counts as outside.
                outside += usize::from(difference.is_nan() || difference > self.max_difference);
                worst = if difference.is_nan() { f32::INFINITY } else { worst.max(difference) };
                count += 1;
            }
        }
        (outside as f64 / count as f64, worst)
    }

    fn holds(&self, found: &Image, expected: &Image) -> bool {
        self.outside(found, expected).0 <= self.outliers
    }

    fn check(&self, found: &Image, expected: &Image, case: &str) {
        let (outside, worst) = self.outside(found, expected);
        assert!(
            outside <= self.outliers,
            "{}: {case}: {outside:.5} of all values differ by more than {}, expected at most {} ({}); largest difference {worst}",
            self.method,
            self.max_difference,
            self.outliers,
            self.reason
        );
    }
}

/// The adapter for all tests, if there is one.
fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| {
        let gpu = Gpu::open(true).unwrap();
        let required = std::env::var_os("THINLENS_REQUIRE_GPU").is_some();
        assert!(gpu.is_some() || !required, "THINLENS_REQUIRE_GPU is set, and there is no adapter");
        gpu
    })
    .as_ref()
}

fn methods_with_gpu_backend() -> impl Iterator<Item = &'static dyn Method> {
    METHODS.into_iter().filter(|method| method.gpu().is_some())
}

/// Hash of the arguments, as a number from 0 to 1.
fn noise(x: usize, y: usize, seed: usize) -> f32 {
    let mut bits = (x * 73_856_093) ^ (y * 19_349_663) ^ (seed * 83_492_791);
    bits = (bits ^ (bits >> 13)).wrapping_mul(0x5bd1_e995) ^ (bits >> 15);
    (bits % 65_536) as f32 / 65_535.0
}

/// A layer of `width × height` samples, `sample(x, y)` = colour, alpha and CoC radius.
fn layer(width: usize, height: usize, sample: impl Fn(usize, usize) -> ([f32; 4], f32)) -> Layer {
    Layer {
        color: std::array::from_fn(|k| Plane::from_fn(width, height, |x, y| sample(x, y).0[k])),
        alpha: Plane::from_fn(width, height, |x, y| sample(x, y).0[3]),
        coc_px: Plane::from_fn(width, height, |x, y| sample(x, y).1),
    }
}

/// Four layers: near bars, translucent panes, a slanted floor through focus, and a far wall with holes.
fn layers(width: usize, height: usize, blur: f32) -> Vec<Layer> {
    let texture = |x: usize, y: usize, seed: usize, alpha: f32| {
        let fine =
            [0.2 + 0.6 * noise(x / 2, y / 3, seed), noise(x / 5, y / 4, seed + 1), noise(x, y, seed + 2)];
        [alpha * fine[0], alpha * fine[1], alpha * fine[2], alpha]
    };
    let bar = |x: usize| (x * 7 / width.max(1)) % 3 == 1;
    let pane = |x: usize, y: usize| (x + 2 * y) % 29 < 9;
    let hole = |x: usize, y: usize| (x / 6 + y / 5) % 7 == 3;
    let floor = move |y: usize| blur * (8.0 - 14.0 * y as f32 / height as f32);
    let fragments = move |x: usize, y: usize| {
        let near = bar(x).then(|| (texture(x, y, 1, 1.0), -9.0 * blur));
        let veil = pane(x, y).then(|| (texture(x, y, 2, 0.4), -7.5 * blur));
        let ground = (y * 3 > height).then(|| (texture(x, y, 3, 1.0), floor(y)));
        let wall = (!hole(x, y)).then(|| (texture(x, y, 4, 1.0), 9.0 * blur));
        [near, veil, ground, wall].into_iter().flatten().collect::<Vec<_>>()
    };
    let at = |x, y, k: usize| fragments(x, y).get(k).copied().unwrap_or(([0.0; 4], 0.0));
    (0..4).map(|k| layer(width, height, |x, y| at(x, y, k))).collect()
}

/// Scenes in which the background is visible somewhere, with their names.
fn open_scenes() -> Vec<(&'static str, Scene)> {
    let scene = |layers, coc_infinity_px| Scene::new(layers, StackKind::PointSampled, 1, coc_infinity_px);
    let texture =
        |x: usize, y: usize, seed: usize| [noise(x, y, seed), 0.5, noise(x / 3, y / 2, seed + 1), 1.0];
    let bar = |x: usize| (20..31).contains(&x);
    let scaled = |color: [f32; 4], alpha: f32| color.map(|value| alpha * value);
    let wall_with_clear_corner = layer(67, 41, |x, y| {
        let color = if x < 3 && y < 3 { [0.0; 4] } else { texture(x, y, 1) };
        (color, if bar(x) { -6.0 } else { 4.0 })
    });
    let element = layer(67, 41, |x, y| (scaled(texture(x, y, 2), 0.3), 0.1 * x as f32 - 5.0));
    let object = layer(67, 41, |x, y| {
        if bar(x) && (9..33).contains(&y) { (texture(x, y, 3), -10.0) } else { ([0.0; 4], 0.0) }
    });
    let panes = |seed: usize, coc_px: f32| {
        layer(67, 41, move |x, y| {
            let alpha = [0.0, 0.5, 0.93, 0.99, 1.0][(noise(x / 4, y / 4, seed) * 4.99) as usize];
            (scaled(texture(x, y, seed), alpha), coc_px)
        })
    };
    let light = |seed: usize, coc_px: f32| {
        layer(67, 41, move |x, y| {
            let [r, g, b, _] = texture(x, y, seed).map(|value| if bar(x) { 3.0 * value } else { 0.0 });
            ([r, g, b, if bar(x) { LIGHT_ALPHA } else { 0.0 }], coc_px)
        })
    };
    vec![
        ("nine clear pixels in a corner", scene(vec![wall_with_clear_corner], 9.0)),
        ("a lone translucent element", scene(vec![element], 6.0)),
        ("a lone opaque object, infinity on the other side of focus", scene(vec![object], 5.0)),
        ("light without alpha over nothing", scene(vec![light(8, -5.0)], 6.0)),
        ("light without alpha before panes", scene(vec![light(9, -4.0), panes(10, 3.0)], 7.0)),
        ("panes of every alpha", scene(vec![panes(5, -4.0), panes(7, 3.0)], 7.0)),
        ("mirrors behind bars and panes", mirrors(1)),
        ("mirrors of four samples a pixel", mirrors(2)),
    ]
}

/// `texture` at `x, y` of this alpha.
fn painted(x: usize, y: usize, seed: usize, alpha: f32) -> [f32; 4] {
    [noise(x / 2, y / 2, seed), noise(x, y / 3, seed + 1), 0.2, 1.0].map(|value| alpha * value)
}

/// What a wall of `width × height` samples reflects that hangs in the last of `layers` layers: a flat mirror on its left, a curved one on its
/// right, and between them something of both.
fn reflections(layers: usize, [width, height]: [usize; 2]) -> Reflections {
    let plane = |value: &dyn Fn(usize, usize) -> f32| Plane::from_fn(width, height, value);
    let flat = |x: usize| (2.0 - 3.0 * x as f32 / width as f32).clamp(0.0, 1.0);
    let is_panel = |x: usize| x % 31 < 28;
    let shown_px = |x: usize, y: usize| 5.0 + 4.0 * noise(x / 9, y / 7, 6);
    let surface = |x: usize| if is_panel(x) { 1 + (x / 31) as u32 } else { 0 };
    let share = |x: usize, share: f32| if is_panel(x) { share } else { 0.0 };
    let mirror = ReflectingLayer {
        light: std::array::from_fn(|k| plane(&|x, y| 2.0 * noise(x, y, 20 + k))),
        movement: std::array::from_fn(|k| {
            plane(&|x, y| [4.0, -1.0, 1.5, 3.0][k] + noise(x / 4, y / 4, 30 + k))
        }),
        coc_px: plane(&|_, _| 1.0),
        mirrored_px: [-0.2, 0.2].map(|off| plane(&|x, y| shown_px(x, y) + off)),
        flat: plane(&|x, _| share(x, flat(x))),
        curved: plane(&|x, _| share(x, 1.0 - flat(x))),
        surface: (0..width * height).map(|index| surface(index % width)).collect(),
    };
    let mut stats = ReflectionStats::default();
    stats.reflecting_fragments = width * height;
    stats.moving_fragments = width * height;
    stats.largest_movement_px = 6.0;
    let farthest_px = vec![f32::NEG_INFINITY, 9.2, 9.2, 9.2, 9.2, 9.2];
    let layers = (1..=layers).map(|layer| (layer == layers).then(|| mirror.clone())).collect();
    Reflections { layers, farthest_px, stats }
}

/// A wall that reflects, seen between bars and panes, with `supersample` samples a pixel along each axis.
fn mirrors(supersample: usize) -> Scene {
    let [width, height] = [67 * supersample, 41 * supersample];
    let before = layer(width, height, |x, y| match x / (10 * supersample) % 3 {
        0 => (painted(x, y, 11, 1.0), -5.0),
        1 => (painted(x, y, 12, 0.4), -2.0),
        _ => ([0.0; 4], 0.0),
    });
    let wall = layer(width, height, |x, y| (painted(x, y, 13, 1.0), 1.0));
    let kind = if supersample > 1 { StackKind::Supersampled } else { StackKind::PointSampled };
    let mut scene = Scene::new(vec![before, wall], kind, supersample, 12.0);
    scene.reflections = Some(Arc::new(reflections(2, [width, height])));
    scene
}

/// Scenes of surfaces that go on from sample to sample, and of mixed kinds, with their names.
fn surface_scenes() -> Vec<(&'static str, Scene)> {
    let scene = |layers| Scene::new(layers, StackKind::PointSampled, 1, 12.0);
    let wall = |coc_px: f32| layer(67, 41, move |x, y| (painted(x, y, 3, 1.0), coc_px));
    let slope = |alpha: f32, px: [f32; 2]| {
        layer(67, 41, move |x, y| {
            (painted(x, y, 1, alpha), px[0] * (x as f32 - 33.0) + px[1] * (y as f32 - 20.0))
        })
    };
    // The pane is in the second layer where a bar is before it.
    let is_bar = |x: usize| (25..34).contains(&x);
    let pane_px = |x: usize, y: usize| 0.2 * x as f32 - 8.0 + 0.1 * y as f32;
    let before = layer(67, 41, |x, y| {
        if is_bar(x) { (painted(x, y, 5, 1.0), -16.0) } else { (painted(x, y, 6, 0.6), pane_px(x, y)) }
    });
    let behind = layer(67, 41, |x, y| {
        if is_bar(x) { (painted(x, y, 6, 0.6), pane_px(x, y)) } else { (painted(x, y, 7, 1.0), 11.0) }
    });
    let farthest =
        layer(67, 41, |x, y| if is_bar(x) { (painted(x, y, 7, 1.0), 11.0) } else { ([0.0; 4], 0.0) });
    let relief = |alpha: f32, amplitude: f32| {
        layer(67, 41, move |x, y| (painted(x, y, 8, alpha), 2.0 + amplitude * (2.0 * noise(x, y, 9) - 1.0)))
    };
    let close_before = layer(67, 41, |x, y| {
        (painted(x, y, 4, 1.0), 0.02 * (x as f32 - 33.0) + 0.1 * (y as f32 - 20.0) - 0.2)
    });
    let mut mixed = scene(layers(67, 41, 0.5));
    mixed.antialiasing = Antialiasing::by_pixel(Plane::from_fn(67, 41, |x, y| {
        ((x as f32 + y as f32 - 20.0) / 50.0).clamp(0.0, 1.0)
    }));
    vec![
        ("a translucent slope before a wall", scene(vec![slope(0.5, [0.0, 0.35]), wall(11.0)])),
        ("a translucent slope over nothing", scene(vec![slope(0.9, [0.2, 0.3])])),
        ("a pane that changes peel", scene(vec![before, behind, farthest])),
        ("an opaque slope of a pixel a row", scene(vec![slope(1.0, [0.0, 1.0]), wall(24.0)])),
        ("an opaque diagonal slope", scene(vec![slope(1.0, [0.6, 0.6]), wall(34.0)])),
        ("peels in the wrong order, close together", scene(vec![slope(1.0, [0.02, 0.1]), close_before])),
        ("relief", scene(vec![relief(1.0, 1.0), wall(11.0)])),
        ("rough relief", scene(vec![relief(1.0, 3.0), wall(11.0)])),
        ("translucent relief", scene(vec![relief(0.5, 2.0), wall(11.0)])),
        ("mixed kinds", mixed),
    ]
}

/// A scene of `count` layers, in each of which some samples have a fragment of this alpha.
fn many_layers(count: usize, alpha: f32) -> Scene {
    let near = |i: usize| {
        layer(23, 17, move |x, y| {
            let present = (x + 3 * y + i).is_multiple_of(13);
            (painted(x, y, i, if present { alpha } else { 0.0 }), 0.05 * i as f32 - 9.0)
        })
    };
    let wall = layer(23, 17, |x, y| (painted(x, y, 3, 1.0), 0.05 * count as f32));
    let layers = (1..count).map(near).chain([wall]).collect();
    Scene::new(layers, StackKind::PointSampled, 1, 40.0)
}

/// A test case: name, scene and settings.
struct Case {
    name: &'static str,
    scene: Scene,
    values: Values,
}

fn cases() -> Vec<Case> {
    let scene = |layers, kind| Scene::new(layers, kind, 1, 60.0);
    let textured = |blur| scene(layers(67, 41, blur), StackKind::PointSampled);
    let case = |name, scene| Case { name, scene, values: Values::default() };
    let supersampled = Scene::new(layers(62, 34, 1.0), StackKind::Supersampled, 2, 60.0);
    let lights = || {
        let mut layers = layers(67, 41, 1.0);
        [(9, 9), (40, 12), (41, 30), (63, 38)].into_iter().for_each(|(x, y)| {
            layers[0].color.iter_mut().for_each(|plane| plane.set(x, y, 300.0));
            layers[0].alpha.set(x, y, 1.0);
        });
        scene(layers, StackKind::PointSampled)
    };
    let opaque = |width, height| {
        let near = layer(width, height, |x, y| {
            ([noise(x, y, 1), 0.5, noise(x, y, 2), f32::from((x + y) % 3 != 0)], -6.0 - x as f32)
        });
        let far = layer(width, height, |x, y| ([noise(x, y, 3), noise(x, y, 4), 0.2, 1.0], 5.0));
        scene(vec![near, far], StackKind::PointSampled)
    };
    let surfaces = |[near, far]: [fn(usize, usize) -> f32; 2]| {
        let surface = |seed: usize, coc_px: fn(usize, usize) -> f32| {
            layer(90, 70, move |x, y| {
                let color = [noise(x / 3, y / 2, seed), noise(x, y, seed + 1), 0.3 * seed as f32, 1.0];
                (color, coc_px(x, y))
            })
        };
        scene(vec![surface(1, near), surface(2, far)], StackKind::PointSampled)
    };
    let (slope, wall) =
        (|_: usize, y: usize| 0.06 * y as f32 - 3.0, |x: usize, _: usize| 3.0 + 0.01 * x as f32);
    let blades = Values {
        blades: Some(5),
        rotation_deg: Some(20.0),
        blade_curvature: Some(0.5),
        squeeze: Some(1.6),
        ..Values::default()
    };
    let aberrations = Values {
        cats_eye: Some(0.8),
        spherical_um: Some(-400.0),
        axial_color_um: Some([120.0, -60.0]),
        ..Values::default()
    };
    let open = open_scenes().into_iter().map(|(name, scene)| case(name, scene));
    let closed = vec![
        case("textured layers", textured(1.0)),
        case("little blur", textured(0.2)),
        case("much blur", textured(6.0)),
        case("samples averaged over pixels", scene(layers(67, 41, 1.0), StackKind::Coverage)),
        case("a supersampled stack", supersampled),
        case("one layer", scene(layers(67, 41, 1.0)[..1].to_vec(), StackKind::BeautyDepth)),
        case("lights", lights()),
        case("large surfaces", surfaces([slope, wall])),
        case("peels in the wrong order", surfaces([wall, slope])),
        case("one pixel", opaque(1, 1)),
        case("one row", opaque(19, 1)),
        case("one column", opaque(1, 23)),
        case("an odd size", opaque(33, 17)),
        Case { name: "blades", scene: textured(1.0), values: blades },
        Case { name: "an aberrated lens", scene: lights(), values: aberrations },
    ];
    closed.into_iter().chain(open).collect()
}

/// The plan of `method` for `scene`, and the scene prepared for the blur.
fn prepared(method: &dyn Method, scene: Scene, values: &Values, views: usize) -> (Scene, Plan) {
    let samples = method.samples_lens();
    let values = Values {
        method: Some(method.info().name.to_owned()),
        effort: samples.then_some(Effort::Views(views)),
        ..values.clone()
    };
    let settings = Settings::resolve(&[(Origin::Flag, &values)], ParameterValues::default());
    let (scene, _, plan) = methods::Registry::default().prepare(scene, &settings).unwrap();
    (scene, plan)
}

fn on_cpu(scene: &Scene, plan: &Plan) -> Image {
    methods::render(scene.clone(), plan, &|_| {}).unwrap()
}

/// The picture that `gpu` renders; checks that the GPU was used and the CPU was not.
fn on_gpu(gpu: &Gpu, scene: &Scene, plan: &Plan) -> Image {
    let before = gpu.usage().unwrap().passes;
    let (image, fault) = methods::render_on(gpu, scene.clone(), plan, &|_| {}).unwrap();
    assert!(fault.is_none(), "{}: {}", plan.method, fault.unwrap());
    assert!(gpu.usage().unwrap().passes > before, "{}: the GPU was not used", plan.method);
    image
}

#[test]
fn every_case_gives_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    for method in methods_with_gpu_backend() {
        for Case { name, scene, values } in cases() {
            for views in [5, 48] {
                let (scene, plan) = prepared(method, scene.clone(), &values, views);
                let case = format!("{name}, {views} views");
                tolerance(method).check(&on_gpu(gpu, &scene, &plan), &on_cpu(&scene, &plan), &case);
            }
        }
    }
}

#[test]
fn every_effect_on_and_off_gives_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    for method in methods_with_gpu_backend() {
        for Case { name, scene, values } in cases().into_iter().filter(|case| case.name != "much blur") {
            let (scene, plan) = prepared(method, scene, &values, 24);
            let both = method.info().effects.iter().flat_map(|kind| [false, true].map(|on| (kind, on)));
            let forced = both.map(|(kind, on)| (kind, on, plan.clone().forced(*kind, on)));
            // The plan as it is decided has its own test: every case.
            for (kind, on, plan) in forced.filter(|(.., forced)| *forced != plan) {
                let case = format!("{name}, {kind:?} {on}");
                tolerance(method).check(&on_gpu(gpu, &scene, &plan), &on_cpu(&scene, &plan), &case);
            }
        }
    }
}

#[test]
fn lost_rays_that_count_as_black_give_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    let sampling = methods_with_gpu_backend().filter(|method| method.samples_lens());
    for method in sampling {
        let wall = Scene::new(layers(67, 41, 1.0), StackKind::PointSampled, 1, 60.0);
        let object = layer(67, 41, |x, y| {
            let near = (20..31).contains(&x);
            ([noise(x, y, 1), 0.5, 0.2, 1.0], if near { -8.0 } else { 5.0 })
        });
        let closed = Scene::new(vec![object], StackKind::PointSampled, 1, 9.0);
        let named = [("textured layers", wall), ("a closed picture", closed)];
        for (name, scene) in named.into_iter().chain(open_scenes()) {
            let (scene, plan) = prepared(method, scene, &Values::default(), 24);
            let mut plan = plan.forced(EffectKind::Fill, false);
            plan.lost_rays = LostRays::Black;
            tolerance(method).check(&on_gpu(gpu, &scene, &plan), &on_cpu(&scene, &plan), name);
        }
    }
}

#[test]
fn surfaces_that_go_on_and_mixed_kinds_give_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    for method in methods_with_gpu_backend() {
        for (name, scene) in surface_scenes() {
            for views in [5, 48] {
                let (scene, plan) = prepared(method, scene.clone(), &Values::default(), views);
                let case = format!("{name}, {views} views");
                tolerance(method).check(&on_gpu(gpu, &scene, &plan), &on_cpu(&scene, &plan), &case);
            }
        }
    }
}

#[test]
fn three_hundred_layers_give_the_same_picture_or_an_error_of_the_gpu() {
    let Some(gpu) = gpu() else { return };
    for method in methods_with_gpu_backend().filter(|method| method.lens_sampling().is_some()) {
        let (scene, plan) = prepared(method, many_layers(300, 1.0), &Values::default(), 8);
        let (image, fault) = methods::render_on(gpu, scene.clone(), &plan, &|_| {}).unwrap();
        tolerance(method).check(&image, &on_cpu(&scene, &plan), "300 layers");
        // Textures of some adapters have 256 layers at most.
        let words = fault.map(|fault| fault.to_string());
        assert!(words.iter().all(|words| words.contains("too large for the GPU")), "{words:?}");
    }
}

#[test]
fn more_translucent_layers_than_a_ray_remembers_are_rendered_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for name in ["shear", "accumulate"] {
        let method = methods::Registry::default().by_name(name).unwrap();
        let (scene, plan) = prepared(method, many_layers(32, 0.4), &Values::default(), 8);
        tolerance(method).check(&on_gpu(gpu, &scene, &plan), &on_cpu(&scene, &plan), "32 layers");
        let (scene, plan) = prepared(method, many_layers(33, 0.4), &Values::default(), 8);
        let (image, fault) = methods::render_on(gpu, scene.clone(), &plan, &|_| {}).unwrap();
        let fault = fault.unwrap().to_string();
        assert!(fault.contains("33 layers") && fault.contains("`device = cpu`"), "{name}: {fault}");
        assert_eq!(image, on_cpu(&scene, &plan), "{name}: bit for bit");
    }
}

#[test]
fn many_views_give_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    for method in methods_with_gpu_backend().filter(|method| method.lens_sampling().is_some()) {
        let scene = Scene::new(layers(31, 21, 0.6), StackKind::PointSampled, 1, 60.0);
        for views in [1, 130, 700] {
            let (scene, plan) = prepared(method, scene.clone(), &Values::default(), views);
            tolerance(method).check(
                &on_gpu(gpu, &scene, &plan),
                &on_cpu(&scene, &plan),
                &format!("{views} views"),
            );
        }
    }
}

/// Rendered stacks that are small enough for a test.
fn samples() -> Vec<(Scene, Settings)> {
    let sample = |name: &str, input: &str| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name);
        let preset = std::fs::read_to_string(folder.join("preset.toml")).unwrap();
        let preset =
            Some(NamedPreset { name: name.to_owned(), preset: Preset::parse(&preset, name).unwrap() });
        let sources = vec![Source::File(folder.join(input))];
        let prepared =
            prepare(&Job { sources, preset, device: DeviceChoice::Cpu, ..Job::default() }).unwrap();
        (prepared.scene, prepared.settings)
    };
    vec![sample("fence", "stack.exr"), sample("table", "pinhole.exr")]
}

#[test]
fn the_samples_give_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    for (scene, settings) in samples() {
        for method in methods_with_gpu_backend() {
            let mut settings = settings.clone();
            settings.method.value = method.info().name.to_owned();
            settings.effort.value = method.samples_lens().then_some(Effort::Views(16));
            let (scene, _, plan) = methods::Registry::default().prepare(scene.clone(), &settings).unwrap();
            tolerance(method).check(&on_gpu(gpu, &scene, &plan), &on_cpu(&scene, &plan), "a sample");
        }
    }
}

#[test]
fn bands_leave_no_seams() {
    if gpu().is_none() {
        return;
    }
    // An adapter of this test's own, since passes are counted.
    let whole = Gpu::open(true).unwrap().unwrap();
    for method in methods_with_gpu_backend() {
        let name = method.info().name;
        // From 32 views on, rows take turns with several sets of views.
        for (blur, views) in [(0.3, 24), (1.0, 48)] {
            let scene = Scene::new(layers(61, 157, blur), StackKind::PointSampled, 1, 60.0);
            let (scene, plan) = prepared(method, scene, &Values::default(), views);
            let before = whole.usage().unwrap().passes;
            let expected = on_gpu(&whole, &scene, &plan);
            let passes = whole.usage().unwrap().passes - before;
            // Smaller and smaller bands, until not even one row fits.
            let mut small = Gpu::open(true).unwrap().unwrap();
            let (mut bytes, mut banded) = (1_000_000, 0);
            loop {
                bytes = bytes * 3 / 4;
                small = small.limited_to(bytes);
                let before = small.usage().unwrap().passes;
                let (image, fault) = methods::render_on(&small, scene.clone(), &plan, &|_| {}).unwrap();
                if let Some(fault) = fault {
                    assert!(fault.to_string().contains("too large for the GPU"), "{name}: {fault}");
                    break;
                }
                tolerance(method).check(&image, &expected, &format!("blur {blur}, bands of {bytes} bytes"));
                banded += usize::from(small.usage().unwrap().passes - before >= passes + passes / 2);
            }
            assert!(banded > 0, "{name}: nothing was rendered in bands");
        }
    }
}

#[test]
fn a_frame_higher_than_the_largest_texture_gives_the_same_picture() {
    let Some(gpu) = gpu() else { return };
    for method in methods_with_gpu_backend() {
        let scene = Scene::new(layers(3, gpu.max_texels() + 90, 1.0), StackKind::PointSampled, 1, 60.0);
        let (scene, plan) = prepared(method, scene, &Values::default(), 4);
        tolerance(method).check(&on_gpu(gpu, &scene, &plan), &on_cpu(&scene, &plan), "a strip");
    }
}

/// `image` shifted `columns` to the right.
fn shifted(image: &Image, columns: usize) -> Image {
    Image::from_fn(image.width(), image.height(), |x, y| image.pixel(x.saturating_sub(columns), y))
}

#[test]
fn the_comparison_detects_a_shift_a_difference_and_swapped_peels() {
    let Some(gpu) = gpu() else { return };
    for method in methods_with_gpu_backend() {
        let tolerance = tolerance(method);
        let scene = Scene::new(layers(67, 41, 1.0), StackKind::PointSampled, 1, 60.0);
        let (scene, plan) = prepared(method, scene, &Values::default(), 24);
        let expected = on_cpu(&scene, &plan);
        let name = method.info().name;
        assert!(
            !tolerance.holds(&shifted(&on_gpu(gpu, &scene, &plan), 1), &expected),
            "{name}: shifted by a pixel"
        );
        let off = |value: f32| value + 2.0 * tolerance.max_difference * (1.0 + value.abs());
        let brighter = Image::from_fn(67, 41, |x, y| expected.pixel(x, y).map(off));
        assert!(!tolerance.holds(&brighter, &expected), "{name}: twice the tolerance");
        let mut swapped = scene.clone();
        swapped.layers.reverse();
        // The order alone makes no difference to a method that sorts by depth, so depths are negated too.
        swapped.layers.iter_mut().for_each(|layer| {
            layer.coc_px.values_mut().iter_mut().for_each(|coc| *coc = -*coc);
        });
        assert!(!tolerance.holds(&on_gpu(gpu, &swapped, &plan), &expected), "{name}: peels swapped");
    }
}

#[test]
fn the_comparison_detects_another_kind_another_surface_and_another_row() {
    let Some(gpu) = gpu() else { return };
    for name in ["shear", "accumulate"] {
        let method = methods::Registry::default().by_name(name).unwrap();
        let found = |scene: Scene| {
            let (scene, plan) = prepared(method, scene, &Values::default(), 48);
            (on_gpu(gpu, &scene, &plan), on_cpu(&scene, &plan))
        };
        let scene = |name: &str| surface_scenes().into_iter().find(|(found, _)| *found == name).unwrap().1;
        let mixed = scene("mixed kinds");
        let points = Scene { antialiasing: Antialiasing::POINT_SAMPLES, ..mixed.clone() };
        assert!(!tolerance(method).holds(&found(points).0, &found(mixed).1), "{name}: point samples only");
        let slope = scene("a translucent slope before a wall");
        let mut steps = slope.clone();
        steps.layers[0].coc_px.values_mut().iter_mut().for_each(|coc| *coc = 5.0 * (*coc / 5.0).round());
        assert!(!tolerance(method).holds(&found(steps).0, &found(slope.clone()).1), "{name}: in steps");
        let (on_gpu, on_cpu) = found(slope);
        let row_below = Image::from_fn(67, 41, |x, y| on_gpu.pixel(x, (y + 1).min(40)));
        assert!(!tolerance(method).holds(&row_below, &on_cpu), "{name}: a row below");
    }
}

#[test]
fn a_frame_that_fails_on_the_gpu_is_rendered_on_the_cpu_and_the_error_returned() {
    if gpu().is_none() {
        return;
    }
    for method in methods_with_gpu_backend() {
        let lost = Gpu::open(true).unwrap().unwrap();
        lost.lose();
        let scene = Scene::new(layers(31, 21, 1.0), StackKind::PointSampled, 1, 60.0);
        let (scene, plan) = prepared(method, scene, &Values::default(), 8);
        let (image, fault) = methods::render_on(&lost, scene.clone(), &plan, &|_| {}).unwrap();
        assert!(fault.unwrap().to_string().contains("the GPU failed"), "{}", method.info().name);
        assert_eq!(image, on_cpu(&scene, &plan), "{}: bit for bit", method.info().name);
    }
}

#[test]
fn a_frame_that_fails_half_way_on_the_gpu_is_rendered_again_on_the_cpu() {
    if gpu().is_none() {
        return;
    }
    for method in methods_with_gpu_backend() {
        let gpu = Gpu::open(true).unwrap().unwrap();
        let scene = Scene::new(layers(31, 21, 1.0), StackKind::PointSampled, 1, 60.0);
        let (scene, plan) = prepared(method, scene, &Values::default(), 700);
        let (image, fault) = methods::render_on(&gpu, scene.clone(), &plan, &|_| gpu.lose()).unwrap();
        let name = method.info().name;
        assert!(fault.unwrap().to_string().contains("the GPU failed"), "{name}");
        assert_eq!(image, on_cpu(&scene, &plan), "{name}: bit for bit");
    }
}

#[test]
fn a_frame_too_large_for_the_gpu_is_rendered_on_the_cpu_and_the_error_returned() {
    if gpu().is_none() {
        return;
    }
    let small = Gpu::open(true).unwrap().unwrap().limited_to(256);
    for method in methods_with_gpu_backend() {
        let scene = Scene::new(layers(31, 21, 1.0), StackKind::PointSampled, 1, 60.0);
        let (scene, plan) = prepared(method, scene, &Values::default(), 8);
        let (image, fault) = methods::render_on(&small, scene.clone(), &plan, &|_| {}).unwrap();
        assert!(fault.unwrap().to_string().contains("too large for the GPU"), "{}", method.info().name);
        assert_eq!(image, on_cpu(&scene, &plan), "{}: bit for bit", method.info().name);
    }
}

/// A job on the smallest sample.
fn job(device: DeviceChoice) -> Job {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join("fence");
    Job { sources: vec![Source::File(folder.join("stack.exr"))], device, ..Job::default() }
}

#[test]
fn a_job_whose_gpu_is_lost_runs_on_the_cpu_with_a_warning() {
    if gpu().is_none() {
        return;
    }
    let prepared = prepare(&job(DeviceChoice::Gpu)).unwrap();
    prepared.gpu.as_ref().unwrap().lose();
    let rendered = prepared.blur(&|_| {}).unwrap();
    assert_eq!(rendered.device.kind, DeviceKind::Cpu, "{:?}", rendered.device);
    assert!(rendered.device.reason.contains("the GPU failed"), "{:?}", rendered.device);
    let report = rendered.report(Vec::new(), String::new());
    let told = report.warnings.iter().any(|warning| warning.contains("the frame was rendered on the CPU"));
    assert!(told, "{:?}", report.warnings);
    assert_eq!(rendered.image, render(&job(DeviceChoice::Cpu), &|_| {}).unwrap().image, "bit for bit");
}

#[test]
fn a_job_for_the_gpu_runs_on_it_and_reports_its_usage() {
    if gpu().is_none() {
        return;
    }
    let rendered = render(&job(DeviceChoice::Gpu), &|_| {}).unwrap();
    assert_eq!(rendered.device.kind, DeviceKind::Gpu, "{:?}", rendered.device);
    assert!(rendered.gpu_usage.unwrap().passes > 0);
    let on_cpu = render(&job(DeviceChoice::Cpu), &|_| {}).unwrap();
    assert_eq!(on_cpu.device.kind, DeviceKind::Cpu);
    tolerance(methods::Registry::default().by_name("auto").unwrap()).check(
        &rendered.image,
        &on_cpu.image,
        "a job",
    );
}

#[test]
fn a_method_without_a_gpu_backend_is_refused_for_the_gpu_and_runs_on_the_cpu_by_auto() {
    if gpu().is_none() {
        return;
    }
    let stack = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/fence/stack.exr");
    let job = |device, method: &str, effort| Job {
        sources: vec![Source::File(stack.clone())],
        flags: Values { method: Some(method.to_owned()), effort, ..Values::default() },
        device,
        ..Job::default()
    };
    let refused = |method, effort| prepare(&job(DeviceChoice::Gpu, method, effort)).unwrap_err().to_string();
    let error = refused("scatter", None);
    assert!(error.contains("scatter runs on the CPU only") && error.contains("shear"), "{error}");
    let error = refused("shear", Some(Effort::TimeBudget(1.0)));
    assert!(error.contains("the time per view"), "{error}");
    let prepared = prepare(&job(DeviceChoice::Auto, "scatter", None)).unwrap();
    assert_eq!(prepared.device.kind, DeviceKind::Cpu);
    assert_eq!(prepared.device.reason, "scatter runs on the CPU only");
}

#[test]
fn a_target_is_searched_for_on_the_cpu_and_rendered_on_the_gpu() {
    if gpu().is_none() {
        return;
    }
    let stack = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/fence/stack.exr");
    let job = |device| Job {
        sources: vec![Source::File(stack.clone())],
        flags: Values { effort: Some(Effort::TargetDb(35.0)), ..Values::default() },
        device,
        ..Job::default()
    };
    let [on_gpu, on_cpu] =
        [DeviceChoice::Gpu, DeviceChoice::Cpu].map(|device| render(&job(device), &|_| {}).unwrap());
    assert_eq!(on_gpu.device.kind, DeviceKind::Gpu);
    let [found, expected] = [&on_gpu, &on_cpu].map(|rendered| rendered.outcome.as_ref().unwrap());
    assert_eq!((found.views, found.met), (expected.views, expected.met), "the same search");
    assert_eq!(
        on_gpu.plan.views,
        Some(found.views),
        "the picture has the number of views that the search found"
    );
    tolerance(methods::Registry::default().by_name("auto").unwrap()).check(
        &on_gpu.image,
        &on_cpu.image,
        "a target",
    );
}
