//! Channels that say what a surface reflects, and how: beside the colour and the depth of a peel, under its prefix.
//!
//! | channel | what it is | in its place |
//! | --- | --- | --- |
//! | `Diffuse.R G B` | the colour without what the surface reflects specularly; premultiplied | Blender's `GlossDir`, `GlossInd`, `GlossCol`, with `R G B` each: the colour is diffuse but for `(GlossDir + GlossInd) · GlossCol` |
//! | `Normal.X Y Z` | shading normal in the camera's axes: right, up, towards the viewer | `Normal.R G B` |
//! | `ReflectedDistance.V` | along the mirrored ray from the surface, in scene units; 1e9 and more: the environment, or nothing | `.Z`, `.Y` or none for `.V`; without the channel, the environment everywhere |
//! | `Reflection.R G B` | the specular light that came from a surface; the rest is the environment's | |
//! | `Specular.R G B` | reflectance at normal incidence; with it, mirrors that face darkness are known as such | |
//! | `Roughness.V` | root of the GGX α | as above |
//!
//! Case is ignored. `Diffuse` and `Normal` are what a reflection needs. All of these channels are copied to the output too.

use super::{Peel, Window, alpha, windows};
use crate::finding::Finding;
use crate::image::Plane;

/// The specular light of a surface as a share of white, below which it reflects nothing: colours of half floats are rounded by as much.
const LEAST_LIGHT: f32 = 1.0 / 1024.0;

/// What the surfaces of a peel reflect. All planes have the size of the peel.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Shading {
    /// Red, green, blue of the specular light: scene-linear, premultiplied, part of the peel's colour.
    pub light: [Plane; 3],
    /// Shading normal in the camera's axes: right, up, towards the viewer. Zero, or not a number, where there is none.
    pub normal: [Plane; 3],
    /// Distance along the mirrored ray from the surface, in scene units; that of the environment is 1e9 or more, or infinite.
    pub reflected_distance: Plane,
    /// Reflectance at normal incidence, if the file has it.
    pub specular: Option<[Plane; 3]>,
    /// Root of the GGX α, if the file has it.
    pub roughness: Option<Plane>,
    /// The part of `light` that came from a surface, if the file has it.
    pub reflection: Option<[Plane; 3]>,
}

/// Where the specular light of a peel is in its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Light {
    /// The colour without it.
    Diffuse([usize; 3]),
    /// What it is the product of: direct and indirect light, and the surface's colour.
    Glossy([[usize; 3]; 3]),
}

/// The shading channels of a peel, as indices in the list of names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ShadingChannels {
    light: Light,
    normal: [usize; 3],
    reflected_distance: Option<usize>,
    specular: Option<[usize; 3]>,
    roughness: Option<usize>,
    reflection: Option<[usize; 3]>,
}

impl ShadingChannels {
    /// Those of the peel with this prefix; `None` without what a reflection needs.
    pub(super) fn of(names: &[&str], prefix: &str) -> Option<Self> {
        let start = if prefix.is_empty() { String::new() } else { format!("{prefix}.") };
        let index = |name: &str| {
            let is_it = |full: &&str| {
                full.get(..start.len()).is_some_and(|head| head == start)
                    && full[start.len()..].eq_ignore_ascii_case(name)
            };
            names.iter().position(is_it)
        };
        let three = |group: &str, parts: [&str; 3]| {
            let [first, second, third] = parts.map(|part| index(&format!("{group}.{part}")));
            Some([first?, second?, third?])
        };
        let rgb = |group: &str| three(group, ["R", "G", "B"]);
        let one = |group: &str| {
            let full = [".V", ".Z", ".Y", ""].map(|end| format!("{group}{end}"));
            full.iter().find_map(|name| index(name))
        };
        let glossy = || Some(Light::Glossy([rgb("GlossDir")?, rgb("GlossInd")?, rgb("GlossCol")?]));
        Some(Self {
            light: rgb("Diffuse").map(Light::Diffuse).or_else(glossy)?,
            normal: three("Normal", ["X", "Y", "Z"]).or_else(|| rgb("Normal"))?,
            reflected_distance: one("ReflectedDistance"),
            specular: rgb("Specular"),
            roughness: one("Roughness"),
            reflection: rgb("Reflection"),
        })
    }

    /// The indices, in the order in which [`ShadingChannels::read`] takes their planes.
    pub(super) fn indices(&self) -> impl Iterator<Item = usize> + use<> {
        let light: Vec<usize> = match self.light {
            Light::Diffuse(diffuse) => diffuse.to_vec(),
            Light::Glossy(passes) => passes.concat(),
        };
        let single = [self.reflected_distance, self.roughness].into_iter().flatten();
        let colors = [self.specular, self.reflection].into_iter().flatten().flatten();
        light.into_iter().chain(self.normal).chain(single).chain(colors)
    }

    /// The shading of a peel of this `color`, from the planes of [`ShadingChannels::indices`], which `next` gives in the peel's window.
    pub(super) fn read(&self, color: &[Plane; 3], mut next: impl FnMut() -> Plane) -> Shading {
        let mut light = [next(), next(), next()];
        match self.light {
            Light::Diffuse(_) => {
                combine(&mut light, color, |diffuse, color| color - diffuse);
            }
            Light::Glossy(_) => {
                combine(&mut light, &[next(), next(), next()], |direct, indirect| direct + indirect);
                combine(&mut light, &[next(), next(), next()], |light, own| light * own);
            }
        }
        // Without a finite light there is nothing to move.
        combine(&mut light, color, |light, _| if light.is_finite() { light } else { 0.0 });
        let normal = [next(), next(), next()];
        let everywhere = || Plane::filled(color[0].width(), color[0].height(), f32::INFINITY);
        let reflected_distance = self.reflected_distance.map_or_else(everywhere, |_| next());
        let roughness = self.roughness.map(|_| next());
        let specular = self.specular.map(|_| [next(), next(), next()]);
        let reflection = self.reflection.map(|_| [next(), next(), next()]);
        Shading { light, normal, reflected_distance, specular, roughness, reflection }
    }

    /// A warning about the peel `name`, if its file does not say how far away what it reflects lies.
    pub(super) fn doubt(&self, name: &str) -> Option<Finding> {
        let text = format!(
            "{name} has Diffuse and Normal, but no ReflectedDistance: what it reflects is taken as infinitely far away"
        );
        self.reflected_distance.is_none().then(|| Finding::warning("reflections", text))
    }
}

/// Replaces each value of `planes` by what `of` makes of it and of that of `others`.
fn combine(planes: &mut [Plane; 3], others: &[Plane; 3], of: impl Fn(f32, f32) -> f32) {
    for (plane, other) in planes.iter_mut().zip(others) {
        plane
            .values_mut()
            .iter_mut()
            .zip(other.values())
            .for_each(|(value, other)| *value = of(*value, *other));
    }
}

impl Shading {
    /// A surface that reflects `light`, which is part of its colour, with this `normal`, from the `reflected_distance`.
    pub fn new(light: [Plane; 3], normal: [Plane; 3], reflected_distance: Plane) -> Self {
        Self { light, normal, reflected_distance, specular: None, roughness: None, reflection: None }
    }

    /// The shading with light that is multiplied by the peel's alpha, and was not.
    #[must_use]
    pub(super) fn premultiplied(mut self, of_peel: &Plane) -> Self {
        alpha::premultiply(&mut self.light, of_peel);
        self.reflection.iter_mut().for_each(|reflection| alpha::premultiply(reflection, of_peel));
        self
    }

    /// The shading of a peel with data window `from` in the window `to`.
    pub(super) fn placed(self, from: Window, to: Window) -> Self {
        let placed = |plane: Plane| windows::place(plane, from, to, 0.0);
        Self {
            light: self.light.map(placed),
            normal: self.normal.map(placed),
            reflected_distance: placed(self.reflected_distance),
            specular: self.specular.map(|planes| planes.map(placed)),
            roughness: self.roughness.map(placed),
            reflection: self.reflection.map(|planes| planes.map(placed)),
        }
    }

    /// All its planes.
    pub(crate) fn planes(&self) -> impl Iterator<Item = &Plane> {
        let single = [Some(&self.reflected_distance), self.roughness.as_ref()].into_iter().flatten();
        let colors = [&self.specular, &self.reflection].into_iter().flatten().flatten();
        self.light.iter().chain(&self.normal).chain(single).chain(colors)
    }

    /// Whether the surface at column `x` of row `y` reflects light specularly, or would if it faced any: seen from elsewhere on the lens, a
    /// mirror that faces darkness shows the lamp beside it.
    pub(crate) fn reflects(&self, x: usize, y: usize) -> bool {
        let is_more =
            |planes: &[Plane; 3], least: f32| planes.iter().any(|plane| plane.get(x, y).abs() > least);
        is_more(&self.light, LEAST_LIGHT)
            || self.specular.as_ref().is_some_and(|specular| is_more(specular, 0.0))
    }

    /// Removes what the surface at column `x` of row `y` reflects: its light stays with the colour.
    pub(super) fn clear(&mut self, x: usize, y: usize) {
        let planes = self.light.iter_mut().chain(&mut self.normal).chain(self.specular.iter_mut().flatten());
        planes.for_each(|plane| plane.set(x, y, 0.0));
    }

    /// Surfaces of the size of `data` that reflect nothing, with the channels that any of `all` has.
    fn nothing<'a>(data: Window, all: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let zeros = || Plane::zeros(data.width, data.height);
        let three = || [zeros(), zeros(), zeros()];
        let any = |has: fn(&Self) -> bool| all.clone().any(has);
        Self {
            specular: any(|one| one.specular.is_some()).then(three),
            roughness: any(|one| one.roughness.is_some()).then(zeros),
            reflection: any(|one| one.reflection.is_some()).then(three),
            ..Self::new(three(), three(), zeros())
        }
    }

    /// Takes over what the surface at column `x` of row `y` of `other` reflects.
    fn take(&mut self, other: &Self, x: usize, y: usize) {
        let three = |to: &mut [Plane; 3], from: &[Plane; 3]| {
            to.iter_mut().zip(from).for_each(|(to, from)| to.set(x, y, from.get(x, y)));
        };
        three(&mut self.light, &other.light);
        three(&mut self.normal, &other.normal);
        self.reflected_distance.set(x, y, other.reflected_distance.get(x, y));
        for (to, from) in [(&mut self.specular, &other.specular), (&mut self.reflection, &other.reflection)] {
            to.as_mut().zip(from.as_ref()).into_iter().for_each(|(to, from)| three(to, from));
        }
        let roughness = self.roughness.as_mut().zip(other.roughness.as_ref());
        roughness.into_iter().for_each(|(to, from)| to.set(x, y, from.get(x, y)));
    }
}

/// What the surfaces of `after` reflect, peels with the data window `to`: each fragment as the same one of `before`, with the data window
/// `from`, where it may have been in another peel.
pub(super) fn followed(
    shading: Vec<Option<Shading>>,
    (before, from): (&[Peel], Window),
    (after, to): (&[Peel], Window),
) -> Vec<Option<Shading>> {
    let placed: Vec<Option<Shading>> =
        shading.into_iter().map(|shading| shading.map(|shading| shading.placed(from, to))).collect();
    let mut found: Vec<Option<Shading>> = vec![None; if placed.is_empty() { 0 } else { after.len() }];
    let [right, down] = [from.x.abs_diff(to.x), from.y.abs_diff(to.y)].map(|offset| offset as usize);
    let values = |peel: &Peel, x: usize, y: usize| {
        let color = peel.color.each_ref().map(|plane| plane.get(x, y));
        (color, peel.alpha.get(x, y), peel.depth.get(x, y))
    };
    for (shading, peel) in placed.iter().zip(before) {
        let Some(shading) = shading else { continue };
        for (x, y) in (0..from.height).flat_map(|y| (0..from.width).map(move |x| (x, y))) {
            let at = (x + right, y + down);
            let fragment = values(peel, x, y);
            if fragment.1 > 0.0
                && shading.reflects(at.0, at.1)
                && let Some(number) = after.iter().position(|peel| values(peel, at.0, at.1) == fragment)
            {
                let nothing = || Shading::nothing(to, placed.iter().flatten());
                found[number].get_or_insert_with(nothing).take(shading, at.0, at.1);
            }
        }
    }
    found
}

/// Removes what surfaces reflect from the pixels whose fragments were `reordered`: these are no longer in the peel that says so.
pub(super) fn unordered(shading: &mut [Option<Shading>], reordered: &[(usize, usize)]) -> Option<Finding> {
    let mut cleared = 0;
    for &(x, y) in reordered {
        let before = shading.iter().flatten().any(|shading| shading.reflects(x, y));
        shading.iter_mut().flatten().for_each(|shading| shading.clear(x, y));
        cleared += usize::from(before);
    }
    let text = format!("{cleared} pixels reflect nothing that the lens moves: their fragments were sorted");
    (cleared > 0).then(|| Finding::note("reflections", text))
}
