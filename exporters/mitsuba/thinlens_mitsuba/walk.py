"""The walk of a camera ray through a scene: the surfaces that become its peels.

Left out are the inside of closed shapes, surfaces that let nearly all light through, and lamps that the integrator
hides.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .shapes import Sides

# Hits along a ray, including those left out, before it is given up.
MOST_HITS = 1024
# Surfaces that let more than this share of the light through are left out.
MOST_TRANSMISSION = 0.99
# Steps past a hit, as a share of the size of its coordinates: a hit is exact to about a tenth of it, in single
# precision.
STEP_SHARE = 1e-5
# Smallest cosine between ray and normal for which the step past a hit grows.
LEAST_COSINE = 0.02


@dataclass
class Surfaces:
    """The first surfaces of a ray; each list has one entry a peel, valid where `count` is larger than its index."""

    # Number of surfaces that were found, at most that of the peels.
    count: mi.UInt32
    # Ray parameters: just before the surface, on it, just behind it.
    before: list[mi.Float]
    on: list[mi.Float]
    behind: list[mi.Float]
    # Share of the light that passes the surface straight on, the same for all colours.
    transmission: list[mi.Float]


@dataclass(frozen=True)
class Rules:
    """What is a peel."""

    sides: Sides
    # Lamps are not seen.
    hides_emitters: bool


def walk(scene: mi.Scene, ray: mi.Ray3f, peels: int, rules: Rules) -> Surfaces:
    """The first `peels` surfaces along `ray`."""
    lists = [[mi.Float(0.0) for _ in range(peels)] for _ in range(4)]
    count, start, active = mi.UInt32(0), mi.Float(0.0), mi.Bool(True)
    for _ in range(MOST_HITS):
        surface = scene.ray_intersect(_from(ray, start), active)
        active &= surface.is_valid()
        at = start + surface.t
        step = _step(ray, surface)
        passing = _transmission(surface, _from(ray, start), active)
        is_peel = active & (passing <= MOST_TRANSMISSION) & _is_outside(surface, ray, rules)
        values = (at - dr.minimum(step, 0.5 * surface.t), at, at + step, passing)
        for peel in range(peels):
            is_this = is_peel & (count == peel)
            for found, value in zip(lists, values, strict=True):
                found[peel] = dr.select(is_this, value, found[peel])
        count = dr.select(is_peel, count + 1, count)
        start = dr.select(active, at + step, start)
        active &= count < peels
        dr.eval(count, start, active, lists)
        if dr.none(active):
            break
    return Surfaces(count, *lists)


def surface_at(scene: mi.Scene, ray: mi.Ray3f, start: mi.Float) -> mi.SurfaceInteraction3f:
    """The first hit of `ray` from the ray parameter `start` on."""
    return scene.ray_intersect(_from(ray, start))


def _from(ray: mi.Ray3f, start: mi.Float) -> mi.Ray3f:
    return mi.Ray3f(ray.o + ray.d * start, ray.d, ray.maxt - start, ray.time, ray.wavelengths)


def _step(ray: mi.Ray3f, surface: mi.SurfaceInteraction3f) -> mi.Float:
    """How far beyond a hit the ray leaves the surface."""
    size = dr.maximum(dr.max(dr.abs(surface.p)), dr.max(dr.abs(ray.o)))
    return STEP_SHARE * (size + surface.t) / dr.maximum(dr.abs(dr.dot(surface.n, ray.d)), LEAST_COSINE)


def _transmission(surface: mi.SurfaceInteraction3f, ray: mi.Ray3f, active: mi.Bool) -> mi.Float:
    """Share of the light of every colour that passes straight on: the smallest of the colours.

    What a tinted surface lets through beyond it counts as the surface's own colour.
    """
    bsdf = surface.bsdf(mi.RayDifferential3f(ray)) if dr.is_jit_v(mi.Float) else _scalar_bsdf(surface)
    if bsdf is None:
        return mi.Float(1.0)
    return dr.select(active, dr.min(bsdf.eval_null_transmission(surface, active)), 1.0)


def _scalar_bsdf(surface: mi.SurfaceInteraction3f) -> mi.BSDF | None:
    """The material that was hit; None where nothing was."""
    return surface.bsdf() if surface.is_valid() else None


def _is_outside(surface: mi.SurfaceInteraction3f, ray: mi.Ray3f, rules: Rules) -> mi.Bool:
    """Whether a hit is seen: not the inside of a closed shape, and no hidden lamp."""
    outside = rules.sides.of(surface) * dr.dot(surface.n, ray.d) <= 0.0
    if not rules.hides_emitters:
        return outside
    if dr.is_jit_v(mi.Float):
        return outside & (surface.shape.is_emitter() == mi.Bool(False))
    return outside and surface.is_valid() and not surface.shape.is_emitter()
