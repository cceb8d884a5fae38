"""The integrator plug-in `thinlens_peels`: evaluates another integrator on every surface along the camera's rays.

Only the camera's rays are peeled: light, shadows and reflections see the whole scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from thinlens_stack.errors import ExportError
from thinlens_stack.lens import NOTHING_HIT
from thinlens_stack.merge import Layer, interleave, merge, stacked
from thinlens_stack.shading import DIFFUSE, REFLECTION, finish
from thinlens_stack.stack import Frame, channels

from . import shading
from .camera import Camera, Choice, places, regular, rotated
from .lanes import evaluate, is_scalar
from .shapes import Sides, has_media
from .walk import Rules, Surfaces, surface_at, walk

# Pixels whose phases are in memory at a time.
PIXELS_AT_A_TIME = 1 << 18


@dataclass(frozen=True)
class Sampling:
    """How a stack is sampled."""

    # Surfaces of each ray.
    peels: int = 4
    # Samples per pixel along each axis, each with its own surfaces.
    samples: int = 2
    # Light paths per pixel and peel, spread over those samples.
    paths: int = 16
    # Whether the samples are merged into coverage layers.
    is_merged: bool = True
    seed: int = 0
    # Whether the layers have the channels of `shading`.
    has_shading: bool = False

    def paths_per_sample(self) -> int:
        """Light paths of each fragment."""
        return max(1, -(-self.paths // self.samples**2))


@dataclass(frozen=True)
class Walked:
    """The surfaces of the rays of one phase; arrays `[peel][ray]`."""

    x: np.ndarray
    y: np.ndarray
    count: np.ndarray
    before: np.ndarray
    behind: np.ndarray
    transmission: np.ndarray
    # Planar, in scene units.
    depth: np.ndarray


class Peeler:
    """A scene seen by one of its sensors."""

    def __init__(self, scene: mi.Scene, sensor: mi.Sensor, inner: mi.SamplingIntegrator) -> None:
        """`inner` gives the light along a ray. Raises `ExportError` for sensors without perspective."""
        self.scene, self.inner = scene, inner
        self.camera = Camera(sensor)
        self.rules = Rules(Sides(scene, self.camera.place), bool(inner.hide_emitters))
        self.has_media = has_media(scene)
        box = scene.bbox()
        corners = np.array([box.min, box.max], np.float64).reshape(2, 3)
        # A ray parameter behind everything.
        self.beyond = 2.0 * float(np.abs(corners - self.camera.place).sum()) + 1.0

    def stack(self, frame: Frame, sampling: Sampling, choice: Choice) -> list[Layer]:
        """The layers of the frame with its margin, nearest first; the last of a pixel is the scene's environment."""
        layers = stacked(list(self.bands(frame, sampling, choice)))
        if sampling.has_shading:
            finish(layers)
        return layers

    def bands(self, frame: Frame, sampling: Sampling, choice: Choice) -> Iterator[list[Layer]]:
        """The layers of one band of rows after another."""
        width, height = frame.wide()
        lens = self.camera.lens(choice).for_merging()
        step = max(1, PIXELS_AT_A_TIME // width)
        for start in range(0, height, step):
            rows = range(start, min(height, start + step))
            phases = [self._phase(frame, rows, sampling, phase) for phase in range(sampling.samples**2)]
            yield merge(phases, lens, frame.width, sampling.peels) if sampling.is_merged else interleave(phases)

    def depth(self, frame: Frame, step: int) -> np.ndarray:
        """Planar depth of the nearest surface at every `step`-th pixel of frame and margin; `[row][column]`."""
        width, height = frame.wide()
        x = np.arange(0, width, step) + step / 2 - frame.overscan
        y = np.arange(0, height, step) + step / 2 - frame.overscan
        walked = self._walk(np.tile(x, len(y)), np.repeat(y, len(x)), 1)
        return np.where(walked.count > 0, walked.depth[0], NOTHING_HIT).reshape(len(y), len(x))

    def _walk(self, x: np.ndarray, y: np.ndarray, peels: int) -> Walked:
        """The surfaces of the rays through `x, y`, in pixels of the frame."""

        def surfaces(x: mi.Float, y: mi.Float) -> tuple[mi.Float, ...]:
            ray = self.camera.ray(x, y)
            found: Surfaces = walk(self.scene, ray, peels, self.rules)
            lists = (found.before, found.behind, found.transmission, found.on)
            return (found.count, *ray.o, *ray.d, *(value for values in lists for value in values))

        count, *numbers = evaluate(surfaces, (x, y))
        origin, direction = np.stack(numbers[:3], axis=1), np.stack(numbers[3:6], axis=1)
        before, behind, transmission, on = np.array(numbers[6:]).reshape(4, peels, len(x))
        depth = np.stack([self.camera.planar(origin + direction * at[:, None]) for at in on])
        return Walked(x, y, count.astype(int), before, behind, transmission, depth)

    def _phase(self, frame: Frame, rows: range, sampling: Sampling, phase: int) -> list[Layer]:
        """The layers of one sample of each pixel: the peels, and one for the environment behind them."""
        offset = (rotated if sampling.is_merged else regular)(sampling.samples, phase)
        walked = self._walk(*places(frame, rows, offset), sampling.peels)
        seed = (sampling.seed, phase, rows.start)
        paths = sampling.paths_per_sample()
        light = self._lights(walked, paths, seed)
        layers = [_empty(len(walked.x)) for _ in range(sampling.peels + 1)]
        for peel in range(sampling.peels):
            at = np.flatnonzero(walked.count > peel)
            passing = walked.transmission[peel, at]
            # What passes straight on is the light of the next peel, from the same paths: in sum, no noise is added.
            layers[peel].color[at] = light[peel, at] - passing[:, None] * light[peel + 1, at]
            layers[peel].alpha[at] = 1.0 - passing
            layers[peel].depth[at] = walked.depth[peel, at]
        color, alpha = self._background(walked, paths, seed)
        for peel, layer in enumerate(layers):
            at = np.flatnonzero((walked.count == peel) & (alpha > 0.0))
            layer.color[at], layer.alpha[at] = color[at], alpha[at]
        if sampling.has_shading:
            self._add_shading(walked, layers, paths, seed)
        return [layer.reshaped(len(rows), frame.wide()[0]) for layer in layers]

    def _lights(self, walked: Walked, paths: int, seed: tuple[int, ...]) -> np.ndarray:
        """The light along each ray from each of its surfaces on, and from behind the last one; `[peel][ray][3]`."""
        peels, rays = walked.before.shape
        light = np.zeros((peels + 1, rays, 3))
        for peel in range(peels):
            at = np.flatnonzero(walked.count > peel)
            # Fog before the first surface is part of its colour.
            starts = np.zeros(len(at)) if self.has_media and peel == 0 else walked.before[peel, at]
            light[peel, at], _ = self._light(walked.x[at], walked.y[at], starts, paths, (*seed, peel))
            ends = at[(walked.count[at] == peel + 1) & (walked.transmission[peel, at] > 0.0)]
            starts = walked.behind[peel, ends]
            light[peel + 1, ends], _ = self._light(walked.x[ends], walked.y[ends], starts, paths, (*seed, peel, 1))
        return light

    def _background(self, walked: Walked, paths: int, seed: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Colour `[ray][3]` and alpha `[ray]` of the environment, with the fog before it if no surface is there."""
        color, alpha = np.zeros((len(walked.x), 3)), np.zeros(len(walked.x))
        if self.scene.environment() is not None and not self.rules.hides_emitters:
            start = np.full(len(walked.x), self.beyond)
            color, alpha = self._light(walked.x, walked.y, start, 1, (*seed, len(walked.before)))
        if self.has_media:
            at = np.flatnonzero(walked.count == 0)
            start = np.zeros(len(at))
            color[at], alpha[at] = self._light(walked.x[at], walked.y[at], start, paths, (*seed, len(walked.before), 1))
        return color, alpha

    def _light(
        self, x: np.ndarray, y: np.ndarray, start: np.ndarray, paths: int, seed: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean light `[ray][3]` and share of hits `[ray]` along rays that start at the ray parameter `start`."""
        medium = self.camera.sensor.get_medium()
        # A ray from behind everything is not cut off at the far clip plane.
        is_endless = len(start) > 0 and float(start.max()) >= self.beyond

        def light(ray: mi.RayDifferential3f, start: mi.Float, sampler: mi.Sampler) -> tuple[mi.Float, ...]:
            end = mi.Float(np.inf) if is_endless else ray.maxt - start
            shortened = mi.Ray3f(ray.o + ray.d * start, ray.d, end, ray.time, ray.wavelengths)
            found = self.inner.sample(self.scene, sampler, mi.RayDifferential3f(shortened), medium, True)
            color = mi.Color3f(found[0])
            return color.x, color.y, color.z, mi.Float(found[1])

        found = self._mean(light, (x, y, start), paths, seed)
        return found[:, :3], found[:, 3]

    def _mean(
        self, follow: Callable[..., tuple[mi.Float, ...]], columns: Sequence[np.ndarray], paths: int, seed: tuple
    ) -> np.ndarray:
        """The mean of `follow(ray, start, sampler)` over random paths; `[ray][number]`.

        `columns` are the place of each ray, in pixels of the frame, and the ray parameter at which it starts.
        """
        if len(columns[0]) == 0:
            return np.zeros((0, 4))
        sampler = self._sampler(paths)
        count = sampler.sample_count()

        def one(x: mi.Float, y: mi.Float, start: mi.Float) -> tuple[mi.Float, ...]:
            return follow(self.camera.ray(x, y), start, sampler)

        def prepare(first: int, lanes: int) -> None:
            sampler.seed(_mixed((*seed, first)), lanes)

        found = evaluate(one, [np.repeat(column, count) for column in columns], prepare, count)
        return np.stack([values.reshape(-1, count).mean(axis=1) for values in found], axis=1)

    def _add_shading(self, walked: Walked, layers: list[Layer], paths: int, seed: tuple[int, ...]) -> None:
        """Adds the channels of `shading`. Of the environment and of surfaces that are only diffuse, all light is."""
        for layer in layers:
            layer.sums.update({name: layer.color[:, k].copy() for k, name in enumerate(DIFFUSE)})
            layer.sums.update({name: np.zeros(len(walked.x), np.float32) for name in REFLECTION})
            layer.means.update({name: np.zeros(len(walked.x), np.float32) for name in shading.MEANS})
            layer.means[shading.ROUGHNESS] += 1.0
        parts = (shading.DiffuseLight(self.scene, self.inner), shading.ReflectedLight(self.scene, self.inner))

        def diffuse(ray: mi.RayDifferential3f, start: mi.Float, sampler: mi.Sampler) -> tuple[mi.Float, ...]:
            return tuple(parts[0].light(surface_at(self.scene, ray, start), ray, sampler))

        def reflected(ray: mi.RayDifferential3f, start: mi.Float, sampler: mi.Sampler) -> tuple[mi.Float, ...]:
            return tuple(parts[1].light(surface_at(self.scene, ray, start), ray, sampler))

        def is_specular(x: mi.Float, y: mi.Float, start: mi.Float) -> tuple[mi.Bool]:
            ray = self.camera.ray(x, y)
            return (shading.is_specular(surface_at(self.scene, ray, start), ray),)

        def properties(x: mi.Float, y: mi.Float, start: mi.Float) -> tuple[mi.Float, ...]:
            ray = self.camera.ray(x, y)
            return shading.properties(self.scene, surface_at(self.scene, ray, start), ray, self.camera.axes)

        for peel, layer in enumerate(layers[:-1]):
            at = np.flatnonzero(walked.count > peel)
            if len(at) == 0:
                return
            columns = (walked.x[at], walked.y[at], walked.before[peel, at])
            shines = np.flatnonzero(evaluate(is_specular, columns)[0])
            shining = [column[shines] for column in columns]
            for follow, names, number in ((diffuse, DIFFUSE, 2), (reflected, REFLECTION, 3)):
                found = self._mean(follow, shining, paths, (*seed, peel, number))
                for k, name in enumerate(names):
                    layer.sums[name][at[shines]] = found[:, k]
            for name, values in zip(shading.MEANS, evaluate(properties, columns), strict=True):
                layer.means[name][at] = values

    def _sampler(self, paths: int) -> mi.Sampler:
        """The sensor's sampler, for so many samples a fragment or a few more."""
        if is_scalar():
            return mi.load_dict({"type": "independent", "sample_count": paths})
        sampler = self.camera.sensor.sampler().fork()
        sampler.set_sample_count(paths)
        sampler.set_samples_per_wavefront(sampler.sample_count())
        return sampler


def _empty(rays: int) -> Layer:
    return Layer(np.zeros((rays, 3), np.float32), np.zeros(rays, np.float32), np.full(rays, NOTHING_HIT, np.float32))


def _mixed(numbers: tuple[int, ...]) -> int:
    """A seed of 32 bits from several numbers."""
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])


class PeelIntegrator(mi.SamplingIntegrator):
    """Renders the peels of a scene as coverage layers, with the channels of a stack.

    Parameters: `peels`, `supersample`, `overscan` (pixels), and the integrator to wrap.
    """

    def __init__(self, props: mi.Properties) -> None:
        """Raises `ExportError` without an integrator that can be wrapped."""
        super().__init__(props)
        self.sampling = Sampling(peels=props.get("peels", 4), samples=props.get("supersample", 2))
        self.overscan = props.get("overscan", 0)
        nested = [props[name] for name in props.unqueried() if isinstance(props[name], mi.Integrator)]
        self.inner = wrappable(nested[0] if nested else mi.load_dict({"type": "path"}))
        self.names: list[str] = []

    def sample(self, scene, sampler, ray, medium=None, active=True):
        """The light along a single ray, as the wrapped integrator sees it."""
        return self.inner.sample(scene, sampler, ray, medium, active)

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        """The stack, with its margin, as a tensor `[row][column][channel]` in the order of `aov_names`."""
        sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
        paths = spp or sensor.sampler().sample_count()
        own = self.sampling
        sampling = Sampling(own.peels, own.samples, paths, True, int(np.array(seed).reshape(-1)[0]))
        peeler = Peeler(scene, sensor, self.inner)
        picture = channels(peeler.stack(peeler.camera.frame(self.overscan), sampling, Choice()), half=False)
        self.names = list(picture)
        return mi.TensorXf(np.stack(list(picture.values()), axis=-1))

    def aov_names(self) -> list[str]:
        """The channels of what was rendered last."""
        return self.names


def wrappable(integrator: mi.Integrator) -> mi.SamplingIntegrator:
    """`integrator`, if it gives the light along single rays. Raises `ExportError` otherwise."""
    is_python = type(integrator).__module__.startswith("mitsuba.python")
    if isinstance(integrator, mi.SamplingIntegrator) and not is_python:
        return integrator
    raise ExportError(
        "this integrator cannot be peeled",
        found=integrator.class_name(),
        wanted="one that follows single camera rays, such as path, volpath or direct",
        help="name another one with --integrator path",
    )


mi.register_integrator("thinlens_peels", PeelIntegrator)
