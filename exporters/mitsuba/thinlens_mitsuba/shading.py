"""What a surface of Mitsuba is in the channels of `thinlens_stack.shading`."""

from __future__ import annotations

import re
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from thinlens_stack.shading import DISTANCE, NORMAL, ROUGHNESS, SPECULAR

from .lanes import is_scalar

# Index of refraction of materials that do not tell theirs.
USUAL_INDEX = 1.5
# Squared densities below this are nothing.
LEAST_DENSITY = 1e-30
# The parts of materials that are neither diffuse nor let light straight on.
SPECULAR_LOBES = int(mi.BSDFFlags.Glossy | mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.DeltaTransmission)
MEANS = (*NORMAL, DISTANCE, *SPECULAR, ROUGHNESS)


def properties(
    scene: mi.Scene, surface: mi.SurfaceInteraction3f, ray: mi.RayDifferential3f, axes: np.ndarray
) -> tuple[mi.Float, ...]:
    """The channels `MEANS` of a surface that `ray` hits. `axes` are the camera's, in rows."""
    facing = surface.sh_frame.n * -dr.sign(dr.dot(surface.sh_frame.n, ray.d))
    normal = (dr.dot(mi.Vector3f(*map(float, axis)), facing) for axis in axes)
    mirrored = ray.d - 2.0 * dr.dot(ray.d, facing) * facing
    met = scene.ray_intersect(surface.spawn_ray(mirrored))
    inverse = dr.select(met.is_valid(), 1.0 / dr.maximum(dr.norm(met.p - surface.p), 1e-6), 0.0)
    bsdf = material(surface, ray)
    return (*normal, inverse, *_reflectance(bsdf, surface), _roughness(bsdf, surface))


def material(surface: mi.SurfaceInteraction3f, ray: mi.RayDifferential3f) -> mi.BSDF:
    """The material at a hit, which must be valid in scalar variants."""
    return surface.bsdf() if is_scalar() else surface.bsdf(ray)


def _has(bsdf: mi.BSDF, name: str) -> mi.Bool:
    return bsdf.has_attribute(name, True)


def _number(bsdf: mi.BSDF, name: str, surface: mi.SurfaceInteraction3f, where: mi.Bool) -> mi.Float:
    """A number of the material; 0 outside `where`."""
    if is_scalar():
        return bsdf.eval_attribute_1(name, surface, True) if where else 0.0
    return dr.select(where, bsdf.eval_attribute_1(name, surface, where), 0.0)


def _color(bsdf: mi.BSDF, name: str, surface: mi.SurfaceInteraction3f, where: mi.Bool) -> mi.Color3f:
    """A colour of the material; black outside `where`."""
    if is_scalar():
        return mi.Color3f(bsdf.eval_attribute(name, surface, True)) if where else mi.Color3f(0.0)
    return dr.select(where, mi.Color3f(bsdf.eval_attribute(name, surface, where)), 0.0)


def _reflectance(bsdf: mi.BSDF, surface: mi.SurfaceInteraction3f) -> mi.Color3f:
    """Specular reflectance at normal incidence: that of metals, of what has an index of refraction, of principled."""
    is_metal, has_index = _has(bsdf, "k"), _has(bsdf, "eta")
    eta, k = _color(bsdf, "eta", surface, is_metal), _color(bsdf, "k", surface, is_metal)
    metal = (dr.square(eta - 1.0) + dr.square(k)) / (dr.square(eta + 1.0) + dr.square(k))
    index = _number(bsdf, "eta", surface, has_index & (is_metal == mi.Bool(False)))
    # Smooth plastic and glass do not tell theirs in vectorised variants.
    index = dr.select(index > 0.0, index, USUAL_INDEX)
    clear = mi.Color3f(dr.square((index - 1.0) / (index + 1.0)))
    found = dr.select(is_metal, metal, dr.select(has_index, clear, mi.Color3f(0.0)))
    is_principled = _has(bsdf, "metallic")
    metallic = _number(bsdf, "metallic", surface, is_principled)
    plain = 0.08 * _number(bsdf, "specular", surface, is_principled & _has(bsdf, "specular"))
    principled = dr.lerp(mi.Color3f(plain), _color(bsdf, "base_color", surface, is_principled), metallic)
    return dr.select(is_principled, principled, found)


def _roughness(bsdf: mi.BSDF, surface: mi.SurfaceInteraction3f) -> mi.Float:
    """Root of the material's GGX α: 0 for smooth ones and 1 for those that reflect nothing specularly."""
    has_alpha, has_roughness = _has(bsdf, "alpha"), _has(bsdf, "roughness")
    rough = dr.sqrt(_number(bsdf, "alpha", surface, has_alpha))
    found = dr.select(has_alpha, rough, _number(bsdf, "roughness", surface, has_roughness))
    return dr.select(has_alpha | has_roughness | _has(bsdf, "eta"), found, 1.0)


def is_specular(surface: mi.SurfaceInteraction3f, ray: mi.RayDifferential3f) -> mi.Bool:
    """Whether the material at a hit tells a part that reflects or refracts specularly."""
    bsdf = material(surface, ray)
    return ((bsdf.flags() & SPECULAR_LOBES) != 0) & (_is_mixed(bsdf) == mi.Bool(False))


def _is_mixed(bsdf: mi.BSDF) -> mi.Bool:
    """Whether a material does not tell its diffuse part from the rest, nor is it told here: `principledthin`."""
    return _has(bsdf, "diff_trans")


class DiffuseLight:
    """The light that a surface sends to the camera by itself and by diffuse reflection."""

    def __init__(self, scene: mi.Scene, inner: mi.SamplingIntegrator) -> None:
        """`inner` is the integrator of the peels; with a bounce less it gives the light that arrives at a surface."""
        self.scene = scene
        self.further = _one_bounce_less(inner, bool(inner.hide_emitters))
        self.sees_no_lamps = bool(inner.hide_emitters)

    def light(self, surface: mi.SurfaceInteraction3f, ray: mi.RayDifferential3f, sampler: mi.Sampler) -> mi.Color3f:
        """The light towards the origin of `ray` along one random path."""
        lobe = Lobe(material(surface, ray), surface)
        lamp, weight = self.scene.sample_emitter_direction(surface, sampler.next_2d(), True)
        reflected, density = lobe.eval(surface.to_local(lamp.d))
        share = mi.Float(1.0) if self.sees_no_lamps else dr.select(lamp.delta, 1.0, _share(lamp.pdf, density))
        light = _emitted(self.scene, surface) + reflected * weight * share
        towards, passed, density = lobe.sample(sampler)
        return mi.Color3f(light + passed * self._arriving(surface, towards, density, sampler))

    def _arriving(
        self, surface: mi.SurfaceInteraction3f, towards: mi.Vector3f, density: mi.Float, sampler: mi.Sampler
    ) -> mi.Color3f:
        """The light from the local direction `towards`; that of lamps by its share against lamps that are chosen."""
        onward = mi.RayDifferential3f(surface.spawn_ray(surface.to_world(towards)))
        from_surfaces = mi.Color3f(0.0)
        if self.further is not None:
            from_surfaces = mi.Color3f(self.further.sample(self.scene, sampler, onward, None, True)[0])
        if self.sees_no_lamps:
            return from_surfaces
        met = self.scene.ray_intersect(onward)
        lamp = _emitted(self.scene, met)
        of_lamp = lamp * _share(density, _density_of_lamp(self.scene, surface, met, lamp))
        return of_lamp + (from_surfaces if self.further is None else from_surfaces - lamp)


class ReflectedLight:
    """The light that a surface sends to the camera specularly and that came to it from surfaces and near lamps.

    That of the environment, and of lamps at infinity, is left out: the paths that reach it count as black.
    """

    def __init__(self, scene: mi.Scene, inner: mi.SamplingIntegrator) -> None:
        """`inner` as for `DiffuseLight`. What hides lamps from the camera does not hide them from mirrors."""
        self.scene = scene
        self.further = _one_bounce_less(inner, False)
        self.sees_no_lamps = self.further is not None and bool(self.further.hide_emitters)

    def light(self, surface: mi.SurfaceInteraction3f, ray: mi.RayDifferential3f, sampler: mi.Sampler) -> mi.Color3f:
        """The light towards the origin of `ray` along one random path. The surface must be `is_specular`."""
        lobe = SpecularLobe(material(surface, ray), surface)
        lamp, weight = self.scene.sample_emitter_direction(surface, sampler.next_2d(), True)
        reflected, density = lobe.eval(surface.to_local(lamp.d))
        share = dr.select(lamp.delta, 1.0, _share(lamp.pdf, density))
        chosen = mi.Color3f(dr.select(_is_near(lamp), reflected * weight * share, 0.0))
        towards, passed, density = lobe.sample(sampler)
        onward = mi.RayDifferential3f(surface.spawn_ray(surface.to_world(towards)))
        return chosen + mi.Color3f(passed) * self._arriving(surface, onward, density, sampler)

    def _arriving(
        self, surface: mi.SurfaceInteraction3f, onward: mi.RayDifferential3f, density: mi.Float, sampler: mi.Sampler
    ) -> mi.Color3f:
        """The light along `onward` from what it meets; that of lamps by its share against lamps that are chosen."""
        met = self.scene.ray_intersect(onward)
        lamp = _emitted(self.scene, met)
        found = lamp * _share(density, _density_of_lamp(self.scene, surface, met, lamp))
        if self.further is not None:
            beyond = mi.Color3f(self.further.sample(self.scene, sampler, onward, None, True)[0])
            # Where lamps are hidden, what is behind one is not seen in the mirror.
            found += dr.select(dr.max(lamp) > 0.0, 0.0, beyond) if self.sees_no_lamps else beyond - lamp
        return mi.Color3f(dr.select(met.is_valid(), found, 0.0))


def _emitted(scene: mi.Scene, surface: mi.SurfaceInteraction3f) -> mi.Color3f:
    """What a surface, or the environment where nothing was hit, shines by itself."""
    emitter = surface.emitter(scene)
    if is_scalar():
        return mi.Color3f(0.0) if emitter is None else mi.Color3f(emitter.eval(surface, True))
    return mi.Color3f(emitter.eval(surface, True))


def _density_of_lamp(
    scene: mi.Scene, surface: mi.SurfaceInteraction3f, met: mi.SurfaceInteraction3f, lamp: mi.Color3f
) -> mi.Float:
    """The density with which the lamp that was met, of light `lamp`, is chosen from `surface`; 0 where it is none."""
    is_lamp = dr.max(lamp) > 0.0
    if is_scalar() and not is_lamp:
        return 0.0
    sample = mi.DirectionSample3f(scene, met, surface)
    return dr.select(is_lamp, scene.pdf_emitter_direction(surface, sample, is_lamp), 0.0)


def _is_near(lamp: mi.DirectionSample3f) -> mi.Bool:
    """Whether a lamp that was chosen is neither the environment nor at infinity."""
    if is_scalar():
        return lamp.emitter is not None and not mi.has_flag(lamp.emitter.flags(), mi.EmitterFlags.Infinite)
    return mi.has_flag(lamp.emitter.flags(), mi.EmitterFlags.Infinite) == mi.Bool(False)


class Lobe:
    """Diffuse reflection of the materials that were hit. Directions are local; values include the cosine.

    Materials tell their diffuse part from the rest, except `principled`, whose diffuse part is evaluated here.
    """

    def __init__(self, bsdf: mi.BSDF, surface: mi.SurfaceInteraction3f) -> None:
        """`surface` is where `bsdf` was hit."""
        self.bsdf, self.surface = bsdf, surface
        self.context = mi.BSDFContext()
        self.context.type_mask = int(mi.BSDFFlags.Diffuse)
        self.is_principled = _has(bsdf, "metallic")
        through = _number(bsdf, "spec_trans", surface, self.is_principled & _has(bsdf, "spec_trans"))
        share = (1.0 - _number(bsdf, "metallic", surface, self.is_principled)) * (1.0 - through)
        self.base = _color(bsdf, "base_color", surface, self.is_principled) * share
        self.roughness = _number(bsdf, "roughness", surface, self.is_principled)

    def eval(self, towards: mi.Vector3f) -> tuple[mi.Color3f, mi.Float]:
        """Reflection towards a direction, and the density of `sample` there."""
        value = self.bsdf.eval(self.context, self.surface, towards)
        density = _density(self.bsdf, self.surface, self.context, towards)
        cosine = dr.maximum(towards.z, 0.0) / dr.pi
        return (
            mi.Color3f(dr.select(self.is_principled, self.principled(towards), value)),
            dr.select(self.is_principled, cosine, density),
        )

    def sample(self, sampler: mi.Sampler) -> tuple[mi.Vector3f, mi.Color3f, mi.Float]:
        """A random direction, the reflection towards it over its density, and the density; 0 where there is none."""
        found = _sampled(self.bsdf, self.surface, self.context, sampler)
        spread = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        cosine = dr.maximum(spread.z, 1e-6) / dr.pi
        own = self.principled(spread) / cosine
        return (
            mi.Vector3f(dr.select(self.is_principled, spread, found.towards)),
            mi.Color3f(dr.select(self.is_principled, own, found.weight)),
            dr.select(self.is_principled, cosine, found.density),
        )

    def principled(self, towards: mi.Vector3f) -> mi.Color3f:
        """The diffuse part of `principled`: Burley 2012, section 5.3."""
        view = self.surface.wi
        half = dr.normalize(view + towards)
        inward, outward = (dr.power(dr.clip(1.0 - dr.abs(way.z), 0.0, 1.0), 5) for way in (view, towards))
        back = 2.0 * self.roughness * dr.square(dr.dot(half, towards))
        spread = (1.0 - 0.5 * inward) * (1.0 - 0.5 * outward)
        returned = back * (inward + outward + inward * outward * (back - 1.0))
        is_above = (view.z > 0.0) & (towards.z > 0.0)
        return self.base * dr.select(is_above, (spread + returned) * towards.z / dr.pi, 0.0)


class SpecularLobe:
    """What the materials that were hit do with light but for diffuse reflection, and but for what passes straight on.

    Directions are local; values include the cosine.
    """

    def __init__(self, bsdf: mi.BSDF, surface: mi.SurfaceInteraction3f) -> None:
        """`surface` is where `bsdf` was hit."""
        self.bsdf, self.surface = bsdf, surface
        self.context = mi.BSDFContext()
        # `principled` knows no parts: all of it is evaluated, and its diffuse part taken away.
        self.context.type_mask = SPECULAR_LOBES
        self.diffuse = Lobe(bsdf, surface)

    def eval(self, towards: mi.Vector3f) -> tuple[mi.Color3f, mi.Float]:
        """Reflection towards a direction, and the density of `sample` there."""
        value = mi.Color3f(self.bsdf.eval(self.context, self.surface, towards))
        return self._without_diffuse(value, towards), _density(self.bsdf, self.surface, self.context, towards)

    def sample(self, sampler: mi.Sampler) -> tuple[mi.Vector3f, mi.Color3f, mi.Float]:
        """A random direction, the reflection towards it over its density, and the density: infinite for mirrors."""
        found = _sampled(self.bsdf, self.surface, self.context, sampler)
        value = self._without_diffuse(found.weight * found.density, found.towards)
        weight = dr.select(found.is_mirrored, found.weight, value / dr.maximum(found.density, LEAST_DENSITY))
        return found.towards, mi.Color3f(weight), dr.select(found.is_mirrored, dr.inf, found.density)

    def _without_diffuse(self, value: mi.Color3f, towards: mi.Vector3f) -> mi.Color3f:
        rest = dr.maximum(value - self.diffuse.principled(towards), 0.0)
        return mi.Color3f(dr.select(self.diffuse.is_principled, rest, value))


@dataclass
class _Sampled:
    """A random direction from a surface, local."""

    towards: mi.Vector3f
    # The reflection towards it over the density; of a perfect mirror, its share over the chance that it is chosen.
    weight: mi.Color3f
    density: mi.Float
    is_mirrored: mi.Bool


def _sampled(bsdf: mi.BSDF, surface: mi.SurfaceInteraction3f, parts: mi.BSDFContext, sampler: mi.Sampler) -> _Sampled:
    """A random direction by the `parts` of a material."""
    numbers = sampler.next_1d(), sampler.next_2d()
    lets_through = _lets_through(bsdf)
    found, weight = bsdf.sample(parts, surface, *numbers, lets_through == mi.Bool(False))
    whole, share = bsdf.sample(mi.BSDFContext(), surface, *numbers, lets_through)
    is_part = (whole.sampled_type & parts.type_mask & int(mi.BSDFFlags.Delta)) != 0
    density = _density(bsdf, surface, parts, whole.wo)
    value = mi.Color3f(bsdf.eval(parts, surface, whole.wo, lets_through)) / dr.maximum(density, LEAST_DENSITY)
    return _Sampled(
        mi.Vector3f(dr.select(lets_through, whole.wo, found.wo)),
        mi.Color3f(dr.select(lets_through, dr.select(is_part, share, value), weight)),
        dr.select(lets_through, density, found.pdf),
        dr.select(lets_through, is_part, (found.sampled_type & int(mi.BSDFFlags.Delta)) != 0),
    )


def _density(bsdf: mi.BSDF, surface: mi.SurfaceInteraction3f, parts: mi.BSDFContext, towards: mi.Vector3f) -> mi.Float:
    """The density with which `_sampled` finds a direction."""
    lets_through = _lets_through(bsdf)
    own = bsdf.pdf(parts, surface, towards, lets_through == mi.Bool(False))
    return dr.select(lets_through, bsdf.pdf(mi.BSDFContext(), surface, towards, lets_through), own)


def _lets_through(bsdf: mi.BSDF) -> mi.Bool:
    """Whether a material lets light straight on, as `mask` does.

    `mask` samples nothing at all where that part is left out. All of it is sampled, and the other parts weigh nothing.
    """
    return (bsdf.flags() & int(mi.BSDFFlags.Null)) != 0


def _share(density: mi.Float, other: mi.Float) -> mi.Float:
    """The weight of a sample of this density, where another way of sampling has the density `other`."""
    shared = dr.square(density) / dr.maximum(dr.square(density) + dr.square(other), LEAST_DENSITY)
    return dr.select(dr.isinf(density), 1.0, shared)


def _one_bounce_less(inner: mi.SamplingIntegrator, hides: bool) -> mi.SamplingIntegrator | None:
    """The integrator for the light that arrives at a surface; None where there is none but that of lamps.

    Of `path`, it `hides` lamps from where it starts or does not.
    """
    if inner.class_name() == "DirectIntegrator":
        return None
    depth = re.search(r"max_depth = (\d+)", str(inner))
    if inner.class_name() != "PathIntegrator" or depth is None:
        return inner
    most = int(depth[1])
    if most > 1 << 20:
        # Endless.
        return inner if bool(inner.hide_emitters) == hides else mi.load_dict({"type": "path", "hide_emitters": hides})
    if most <= 2:
        return None
    return mi.load_dict({"type": "path", "max_depth": most - 1, "hide_emitters": hides})
