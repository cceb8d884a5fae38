# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The peels of one frame: for each, a render of its distances, then one of its light."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import shading as shadings
from .denoise import Denoiser
from .passes import Job, Passes, Renderer
from .peel_nodes import PeelNodes, Show
from .settings import Say
from .shading import Shading
from .shared import exr
from .shared import lens as lenses
from .shared import merge as merging
from .volumes import Volumes

# Farther than everything, as a float.
BEYOND_ALL = 1e30
# Share of the samples with a surface behind the last peel, from which the user is told.
MISSED_SHARE = 0.01


@dataclass
class Peels:
    """Point samples of one frame, `[height][width]`, with `per_axis` of a pixel along each axis."""

    layers: list[merging.Layer]
    cryptomatte: dict[str, np.ndarray] = field(default_factory=dict)
    attributes: dict[str, exr.Attribute] = field(default_factory=dict)


class Peeler:
    """Renders peels: `renderer` through the materials that `nodes` are in."""

    def __init__(self, renderer: Renderer, nodes: PeelNodes, volumes: Volumes, say: Say) -> None:
        self.renderer, self.nodes, self.volumes, self.say = renderer, nodes, volumes, say
        # What denoises the peels, if they are denoised.
        self.denoiser: Denoiser | None = None
        # What measures reflections, if the peels have channels for them.
        self.shading: Shading | None = None

    def render(self, peels: int, samples: int, cryptomatte: bool) -> Peels:
        """At most `peels` peels of surfaces with so many light samples each."""
        out, depths = Peels([]), []
        for peel in range(peels):
            passes = self._distances(depths, cryptomatte and peel == 0)
            if peel == 0:
                self._keep_cryptomatte(passes, out)
            depth = passes.depth()
            if peel > 0 and not (depth < lenses.BACKGROUND).any():
                break
            depths.append(depth)
        self._say_coverage(depths, samples)
        out.layers = [self._lit(depth, samples, peel) for peel, depth in enumerate(depths)]
        return out

    def background(self, peels: Peels, samples: int) -> merging.Layer:
        """The world, behind everything. It is empty where there are surfaces behind the last peel."""
        self.nodes.select(Show.BEHIND, BEYOND_ALL)
        self.volumes.show(True)
        has_volume = bool(self.volumes.names)
        job = Job("background", samples if has_volume else 1, light=has_volume, transparent=False)
        color = self.renderer.render(job).vector("Combined", "RGB")
        depths = [layer.depth for layer in peels.layers]
        ends = np.ones(depths[-1].shape, bool)
        if (depths[-1] < lenses.BACKGROUND).any():
            missed = self._distances(depths, False).depth() < lenses.BACKGROUND
            ends = ~missed
            if missed.mean() >= MISSED_SHARE:
                self.say(f"note: {100 * missed.mean():.1f} % of the samples have surfaces behind peel {len(depths)}")
        more = shadings.of_background(color) if self.shading else ({}, {})
        return _layer(color, ends.astype(np.float32), np.full(ends.shape, lenses.NOTHING_HIT, np.float32), *more)

    def _distances(self, depths: list[np.ndarray], cryptomatte: bool) -> Passes:
        """A render of the nearest surfaces behind the last of `depths`."""
        self.nodes.select(Show.BEHIND, depths[-1] if depths else 0.0)
        self.volumes.show(False)
        return self.renderer.render(Job(f"distances of peel {len(depths)}", cryptomatte=cryptomatte))

    def _lit(self, depth: np.ndarray, samples: int, peel: int) -> merging.Layer:
        self.nodes.select(Show.AT, depth)
        self.volumes.show(True)
        name = f"peel {peel}"
        guides, shading = self.denoiser is not None, self.shading is not None
        job = Job(name, samples, light=True, guides=guides, shading=shading)
        passes = self.renderer.render(job)
        alpha = np.clip(passes.channel("Combined.A"), 0.0, 1.0)
        color = self._denoised(passes.vector("Combined", "RGB"), passes, name)
        more = self._shaded(passes, job) if self.shading else ({}, {})
        return _layer(color, np.where(depth < lenses.BACKGROUND, alpha, 0.0), depth, *more)

    def _shaded(self, passes: Passes, job: Job) -> tuple[dict, dict]:
        """The channels for reflections of the peel that is shown, rendered as `job`."""
        name = job.name
        diffuse = self._denoised(shadings.diffuse(passes), passes, name)
        near = self.shading.from_surfaces(self.renderer, job, passes)
        reflection = self._denoised(near.glossy(), near, f"reflections of {name}", has_emission=False)
        self.volumes.show(False)
        inverse = self.shading.inverse_distances(self.renderer, name)
        normals = self.shading.normals(passes)
        reflectance, roughness = self.shading.materials(self.renderer, name)
        return shadings.Measured(diffuse, reflection, normals, inverse, reflectance, roughness).channels()

    def _denoised(self, color: np.ndarray, passes: Passes, name: str, has_emission: bool = True) -> np.ndarray:
        """`color`, denoised where the peels are."""
        if self.denoiser is None:
            return color
        return self.denoiser.denoise(color, passes, f"denoising of {name}", has_emission)

    def _keep_cryptomatte(self, passes: Passes, out: Peels) -> None:
        out.cryptomatte = {name: plane for name, plane in passes.channels.items() if "Crypto" in name}
        out.attributes = {name: value for name, value in passes.attributes.items() if name.startswith("cryptomatte/")}

    def _say_coverage(self, depths: list[np.ndarray], samples: int) -> None:
        shares = [float((depth < lenses.BACKGROUND).mean()) for depth in depths]
        shown = ", ".join(f"{100 * share:.0f} %" for share in shares)
        self.say(f"peels cover {shown} of the picture, {samples} light samples each")


def _layer(color: np.ndarray, alpha: np.ndarray, depth: np.ndarray, sums: dict, means: dict) -> merging.Layer:
    """A layer that is empty where `alpha` is 0."""
    is_empty = alpha <= 0.0
    more = ({name: np.where(is_empty, 0.0, plane) for name, plane in planes.items()} for planes in (sums, means))
    return merging.Layer(
        np.where(is_empty[..., None], 0.0, color).astype(np.float32),
        alpha.astype(np.float32),
        np.where(is_empty, lenses.NOTHING_HIT, depth).astype(np.float32),
        *more,
    )
