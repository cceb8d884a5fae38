//! A ray tracer of its own: what a pinhole stores of mirrors in a stack, and what a lens sees of them. It knows nothing of CoC radii.
//!
//! Axes of the camera: right, up, towards the viewer; the pinhole is at the origin.

use glam::{DVec2, DVec3};
use std::f64::consts::PI;
use thinlens::gpu::DeviceChoice;
use thinlens::image::{Image, Plane};
use thinlens::lens::{Aperture, LensSpec, ThinLens, views};
use thinlens::render::{Job, Rendered, render_stack};
use thinlens::settings::{DepthConvention, Effort, Focus, SensorDistance, Switches, Values};
use thinlens::stack::depth::DepthScale;
use thinlens::stack::{Frame, Peel, ReadOptions, Shading, Stack};

/// Depth and distance of what a ray does not hit, as Blender writes them.
pub(crate) const NOTHING: f64 = 1e10;

/// The methods that move reflections.
pub(crate) const METHODS: [&str; 2] = ["accumulate", "shear"];

const SENSOR_MM: f32 = 36.0;

/// A camera with a lens.
#[derive(Clone, Copy)]
pub(crate) struct Camera {
    /// Data and display window in samples.
    pub(crate) frame: Frame,
    pub(crate) supersample: usize,
    pub(crate) convention: DepthConvention,
    pub(crate) focal_length_mm: f32,
    pub(crate) f_number: f32,
    pub(crate) focus: f32,
    pub(crate) blades: u32,
}

impl Camera {
    /// A camera of 50 mm f/0.25 focused at 2: a lens of radius 0.1, with a picture of `width` × `height` pixels.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        Self {
            frame: Frame::from_size(width, height),
            supersample: 1,
            convention: DepthConvention::Planar,
            focal_length_mm: 50.0,
            f_number: 0.25,
            focus: 2.0,
            blades: 0,
        }
    }

    /// The same picture of 2 × 2 samples a pixel.
    pub(crate) fn supersampled(self) -> Self {
        let [width, height] = [self.frame.data.width, self.frame.data.height];
        Self { frame: Frame::from_size(2 * width, 2 * height), supersample: 2, ..self }
    }

    /// Distance of the sensor in samples.
    pub(crate) fn focal_px(&self) -> f64 {
        f64::from(self.focal_length_mm / SENSOR_MM) * self.frame.display.width as f64
    }

    /// Radius of the lens in scene units.
    pub(crate) fn lens_radius(&self) -> f64 {
        0.5e-3 * f64::from(self.focal_length_mm) / f64::from(self.f_number)
    }

    /// CoC radius at planar depth `z`, in picture pixels across: the size of the image of a point on the plane in focus.
    pub(crate) fn coc_px(&self, z: f64) -> f64 {
        let focus = f64::from(self.focus);
        self.lens_radius() * (z - focus) / z * self.focal_px() / focus / self.supersample as f64
    }

    /// The place on the sensor of the sample position `x, y` (centres at halves), in units of its distance: right and up.
    fn on_sensor(&self, x: f64, y: f64) -> DVec2 {
        let (data, display) = (self.frame.data, self.frame.display);
        let right = x + f64::from(data.x - display.x) - 0.5 * display.width as f64;
        let down = y + f64::from(data.y - display.y) - 0.5 * display.height as f64;
        DVec2::new(right, -down / f64::from(self.frame.pixel_aspect)) / self.focal_px()
    }

    /// The sample position at which the pinhole sees `point`.
    pub(crate) fn seen_at(&self, point: DVec3) -> DVec2 {
        let (data, display) = (self.frame.data, self.frame.display);
        let [right, up] = [point.x, point.y].map(|across| across / -point.z * self.focal_px());
        let down = -up * f64::from(self.frame.pixel_aspect);
        DVec2::new(
            right - f64::from(data.x - display.x) + 0.5 * display.width as f64,
            down - f64::from(data.y - display.y) + 0.5 * display.height as f64,
        )
    }

    /// The ray of the pinhole through the sample position `x, y`.
    pub(crate) fn pinhole_ray(&self, x: f64, y: f64) -> Ray {
        Ray { from: DVec3::ZERO, along: self.on_sensor(x, y).extend(-1.0).normalize() }
    }

    /// The point of the lens that sees a point behind focus in the direction `u` (right, down, in pixels) from its place: the lens
    /// turns pictures of what is out of focus upside down, and the sensor the whole picture.
    pub(crate) fn on_lens(&self, u: DVec2) -> DVec3 {
        self.lens_radius() * DVec3::new(-u.x, u.y / f64::from(self.frame.pixel_aspect), 0.0)
    }

    /// The ray from [`Camera::on_lens`] through the point in focus at the sample position `x, y`.
    pub(crate) fn lens_ray(&self, x: f64, y: f64, u: DVec2) -> Ray {
        let in_focus = f64::from(self.focus) * self.on_sensor(x, y).extend(-1.0);
        let from = self.on_lens(u);
        Ray { from, along: (in_focus - from).normalize() }
    }

    pub(crate) fn lens(&self) -> ThinLens {
        let spec = LensSpec {
            focal_length_mm: self.focal_length_mm,
            f_number: self.f_number,
            focus_distance: self.focus,
            sensor_width_mm: SENSOR_MM,
            sensor_distance: SensorDistance::FocalLength,
            metres_per_unit: 1.0,
        };
        ThinLens::new(&spec, (self.frame.display.width / self.supersample) as f32).unwrap()
    }

    pub(crate) fn depth_scale(&self) -> DepthScale {
        DepthScale {
            convention: self.convention,
            near_clip: 0.0,
            near_far: [1.0, 41.0],
            focal_px: self.focal_px() as f32,
        }
    }

    /// The depth of a `point` as the convention has it.
    fn depth(&self, point: DVec3) -> f32 {
        let z = -point.z;
        let depth = match self.convention {
            DepthConvention::Ray => point.length(),
            DepthConvention::Inverse => 1.0 / z,
            DepthConvention::Normalised => (z - 1.0) / 40.0,
            _ => z,
        };
        depth as f32
    }

    /// Depth of nothing as the convention has it.
    fn no_depth(&self) -> f32 {
        match self.convention {
            DepthConvention::Inverse => 0.0,
            DepthConvention::Normalised => -1.0,
            _ => NOTHING as f32,
        }
    }

    /// The job that renders a stack of this camera by `method`, with as many lens samples.
    pub(crate) fn job(&self, method: &str, lens_samples: usize) -> Job {
        let values = Values {
            method: Some(method.to_owned()),
            effort: Some(Effort::Views(lens_samples)),
            focal_length_mm: Some(self.focal_length_mm),
            f_number: Some(self.f_number),
            sensor_width_mm: Some(SENSOR_MM),
            focus: Some(Focus::Distance(self.focus)),
            blades: (self.blades > 0).then_some(self.blades),
            near: Some(1.0),
            far: Some(41.0),
            ..Values::default()
        };
        Job { device: DeviceChoice::Cpu, ..Job::default() }.with_values(values)
    }

    /// The picture of `stack` by `method`.
    pub(crate) fn render(&self, stack: Stack, method: &str, lens_samples: usize) -> Rendered {
        render_stack(stack, &self.job(method, lens_samples), &|_| {}).unwrap()
    }

    /// The same, with some effects forced and others left out.
    pub(crate) fn render_with(
        &self,
        stack: Stack,
        method: &str,
        (force, without): (&[&str], &[&str]),
    ) -> Rendered {
        let names = |list: &[&str]| list.iter().map(|&name| name.to_owned()).collect();
        let switches = Switches { force: names(force), without: names(without) };
        render_stack(stack, &Job { switches, ..self.job(method, 128) }, &|_| {}).unwrap()
    }
}

#[derive(Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) from: DVec3,
    pub(crate) along: DVec3,
}

impl Ray {
    fn at(&self, distance: f64) -> DVec3 {
        self.from + distance * self.along
    }
}

/// A surface.
#[derive(Clone, Copy)]
pub(crate) enum Shape {
    /// A disc, or a plane with an infinite radius.
    Disc { at: DVec3, normal: DVec3, radius: f64 },
    /// A sphere, seen from without, or from within with a negative radius.
    Sphere { centre: DVec3, radius: f64 },
}

impl Shape {
    pub(crate) fn plane(at: DVec3, normal: DVec3) -> Self {
        Self::Disc { at, normal: normal.normalize(), radius: f64::INFINITY }
    }

    /// Distance and normal of the place where `ray` meets it.
    fn meets(&self, ray: &Ray) -> Option<(f64, DVec3)> {
        const LEAST: f64 = 1e-9;
        match *self {
            Self::Disc { at, normal, radius } => {
                let distance = (at - ray.from).dot(normal) / ray.along.dot(normal);
                let normal = normal * -ray.along.dot(normal).signum();
                (distance > LEAST && ray.at(distance).distance(at) < radius).then_some((distance, normal))
            }
            Self::Sphere { centre, radius } => {
                let to_centre = centre - ray.from;
                let nearest = to_centre.dot(ray.along);
                let inside = radius * radius - (to_centre.length_squared() - nearest * nearest);
                // The far side of a sphere is seen from within.
                let distance = nearest - radius.signum() * inside.max(0.0).sqrt();
                let normal = (ray.at(distance) - centre) / radius;
                (inside > 0.0 && distance > LEAST && normal.dot(ray.along) < 0.0)
                    .then_some((distance, normal))
            }
        }
    }
}

/// What a surface looks like.
#[derive(Clone, Copy)]
pub(crate) enum Look {
    Mirror,
    Painted(fn(DVec3) -> [f64; 3]),
}

/// Surfaces before an environment, which has a colour in each direction.
#[derive(Clone)]
pub(crate) struct World {
    pub(crate) things: Vec<(Shape, Look)>,
    pub(crate) environment: fn(DVec3) -> [f64; 3],
}

/// What a ray meets.
#[derive(Clone, Copy)]
pub(crate) struct Hit {
    pub(crate) at: DVec3,
    pub(crate) color: [f64; 3],
    /// Normal and distance of what is reflected, of a mirror.
    pub(crate) mirror: Option<(DVec3, f64)>,
}

impl World {
    fn nearest(&self, ray: &Ray, among: impl Fn(&Look) -> bool) -> Option<(f64, DVec3, Look)> {
        let met = self.things.iter().filter(|(_, look)| among(look));
        let met = met
            .filter_map(|(shape, look)| shape.meets(ray).map(|(distance, normal)| (distance, normal, *look)));
        met.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// What is painted where `ray` ends, and how far away; mirrors are not seen.
    fn painted(&self, ray: &Ray) -> ([f64; 3], f64) {
        match self.nearest(ray, |look| matches!(look, Look::Painted(_))) {
            Some((distance, _, Look::Painted(color))) => (color(ray.at(distance)), distance),
            _ => ((self.environment)(ray.along), NOTHING),
        }
    }

    fn look(&self, ray: &Ray, (distance, normal, look): (f64, DVec3, Look)) -> Hit {
        let at = ray.at(distance);
        match look {
            Look::Painted(color) => Hit { at, color: color(at), mirror: None },
            Look::Mirror => {
                let along = ray.along - 2.0 * ray.along.dot(normal) * normal;
                let (color, reflected) = self.painted(&Ray { from: at, along });
                Hit { at, color, mirror: Some((normal, reflected)) }
            }
        }
    }

    /// All that `ray` meets, nearest first.
    pub(crate) fn hits(&self, ray: &Ray) -> Vec<Hit> {
        let met = self.things.iter().filter_map(|(shape, look)| Some((shape.meets(ray)?, *look)));
        let mut met: Vec<_> = met.map(|((distance, normal), look)| (distance, normal, look)).collect();
        met.sort_by(|a, b| a.0.total_cmp(&b.0));
        met.into_iter().map(|met| self.look(ray, met)).collect()
    }

    /// The colour that `ray` sees.
    pub(crate) fn color(&self, ray: &Ray) -> [f64; 3] {
        let met = self.nearest(ray, |_| true).map(|met| self.look(ray, met));
        met.map_or_else(|| (self.environment)(ray.along), |hit| hit.color)
    }

    /// What `camera` stores of it in `peels` peels; the last one has the environment where nothing is left.
    pub(crate) fn stack(&self, camera: &Camera, peels: usize) -> Stack {
        let (width, height) = (camera.frame.data.width, camera.frame.data.height);
        let rays: Vec<(Ray, Vec<Hit>)> = (0..width * height)
            .map(|i| camera.pinhole_ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5))
            .map(|ray| (ray, self.hits(&ray)))
            .collect();
        let plane = |value: &dyn Fn(&Ray, &[Hit]) -> f64| {
            let values: Vec<f32> = rays.iter().map(|(ray, hits)| value(ray, hits) as f32).collect();
            Plane::from_values(width, height, &values)
        };
        let peel = |number: usize| Peel {
            color: [0, 1, 2].map(|k| {
                plane(&|ray, hits| match hits.get(number) {
                    Some(hit) => hit.color[k],
                    None if hits.len() == number => (self.environment)(ray.along)[k],
                    None => 0.0,
                })
            }),
            alpha: plane(&|_, hits| f64::from(u8::from(hits.len() >= number))),
            depth: plane(&|_, hits| {
                f64::from(hits.get(number).map_or(camera.no_depth(), |hit| camera.depth(hit.at)))
            }),
        };
        let mirror = |hits: &[Hit], number: usize| hits.get(number).and_then(|hit| hit.mirror);
        let shading = |number: usize| {
            let light =
                |k: usize| plane(&|_, hits| mirror(hits, number).map_or(0.0, |_| hits[number].color[k]));
            let normal =
                |k: usize| plane(&|_, hits| mirror(hits, number).map_or(0.0, |(normal, _)| normal[k]));
            let distance = plane(&|_, hits| mirror(hits, number).map_or(0.0, |(_, distance)| distance));
            Shading::new([0, 1, 2].map(light), [0, 1, 2].map(normal), distance)
        };
        let options = ReadOptions {
            convention: Some(camera.convention),
            supersample: (camera.supersample > 1).then_some(camera.supersample),
            near: Some(1.0),
            far: Some(41.0),
            ..ReadOptions::default()
        };
        let mut stack = Stack::from_peels((0..peels).map(peel).collect(), camera.frame, &options).unwrap();
        stack.shading = (0..peels).map(|number| Some(shading(number))).collect();
        stack
    }

    /// What `camera` sees through its lens: the mean of `count` rays a pixel, at points of the lens that follow a spiral.
    pub(crate) fn truth(&self, camera: &Camera, count: usize) -> Image {
        let side = camera.supersample as f64;
        let (width, height) =
            (camera.frame.data.width / camera.supersample, camera.frame.data.height / camera.supersample);
        let points: Vec<DVec2> = if camera.blades > 0 {
            let points = views(count, Aperture::new(camera.blades, 0.0).unwrap());
            points.into_iter().map(|view| view.lens.as_dvec2()).collect()
        } else {
            (0..count).map(|i| on_spiral(i, count)).collect()
        };
        let round = DVec2::new(1.0, f64::from(camera.frame.pixel_aspect));
        // Rays start at places of the pixel that have nothing to do with their points on the lens.
        let within = |i: usize| DVec2::new(0.754_877_666, 0.569_840_291) * (i as f64 + 0.5);
        let pixel = |x: usize, y: usize| {
            let mut sum = [0.0; 3];
            for (i, &u) in points.iter().enumerate() {
                let place = (DVec2::new(x as f64, y as f64) + within(i * 7 % count).fract()) * side;
                let color = self.color(&camera.lens_ray(place.x, place.y, u * round));
                sum.iter_mut().zip(color).for_each(|(sum, value)| *sum += value);
            }
            let [r, g, b] = sum.map(|sum| (sum / count as f64) as f32);
            [r, g, b, 1.0]
        };
        Image::from_fn(width, height, pixel)
    }
}

/// Point `i` of `count` of a disc of radius 1, which the points cover evenly.
pub(crate) fn on_spiral(i: usize, count: usize) -> DVec2 {
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    DVec2::from_angle(golden_angle * i as f64) * ((i as f64 + 0.5) / count as f64).sqrt()
}

/// `stack` without what it says of reflections.
pub(crate) fn without_shading(stack: &Stack) -> Stack {
    let mut stack = stack.clone();
    stack.shading = Vec::new();
    stack
}

/// Peak signal-to-noise ratio in dB of what a viewer shows, `border` pixels from the edges of the frame.
pub(crate) fn displayed_psnr_db(image: &Image, reference: &Image, border: usize) -> f64 {
    thinlens::metrics::score(image, reference, border).unwrap().psnr_db
}

/// The largest difference between two pictures, in colour or alpha.
pub(crate) fn difference(a: &Image, b: &Image) -> f32 {
    let values = a.planes.iter().zip(&b.planes).flat_map(|(a, b)| a.values().iter().zip(b.values()));
    values
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, |largest, value| if value <= largest { largest } else { value })
}

/// Whether all values of `image` are finite and none lies beyond `range`.
pub(crate) fn is_within(image: &Image, [least, most]: [f32; 2]) -> bool {
    image.planes.iter().flat_map(Plane::values).all(|value| (least..=most).contains(value))
}

/// A texture in space: smooth, about `size` wide.
pub(crate) fn waves(at: DVec3, size: f64) -> [f64; 3] {
    let wave = |direction: DVec3| 0.5 + 0.35 * (at.dot(direction) / size * 2.0 * PI).sin();
    [wave(DVec3::new(1.0, 0.3, 0.2)), wave(DVec3::new(-0.4, 1.0, 0.3)), wave(DVec3::new(0.5, 0.6, 0.9))]
}
