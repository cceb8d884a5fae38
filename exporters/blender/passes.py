# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Renders of one view layer with Cycles, read back as arrays."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from .journal import Journal
from .peel_nodes import FILTER_WIDTH_PX
from .shared import ExportError, exr
from .view_layer import stand_in

# Camera rays pass so many hidden or transparent surfaces.
TRANSPARENT_BOUNCES = 1024
# Of a view layer.
SHADING_PASSES = ("use_pass_normal", "use_pass_glossy_direct", "use_pass_glossy_indirect", "use_pass_glossy_color")

# The passes of specular reflection in Blender 4 and Blender 5.
GLOSSY = (("GlossDir", "Glossy Direct"), ("GlossInd", "Glossy Indirect"), ("GlossCol", "Glossy Color"))

# Is told the name of each render before it starts.
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Job:
    """One render: its name for the user, and what it computes."""

    name: str
    # Light samples of each pixel of the render.
    samples: int = 1
    # Without light, surfaces are black; depth is the same.
    light: bool = False
    # Whether the background is empty.
    transparent: bool = True
    # Whether what denoising needs is rendered too.
    guides: bool = False
    # Whether normals and what is reflected specularly are rendered too.
    shading: bool = False
    # Without light, how often rays are reflected.
    bounces: int = 0
    cryptomatte: bool = False


@dataclass
class Passes:
    """The passes of a render: channels by their full name, arrays `[height][width]`, and the header's attributes."""

    channels: dict[str, np.ndarray]
    attributes: dict[str, exr.Attribute]
    # Name of the view layer.
    layer: str

    def channel(self, *names: str) -> np.ndarray:
        """The first channel of the view layer among `names`. Raises `ExportError` if there is none."""
        for name in names:
            if (full := f"{self.layer}.{name}") in self.channels:
                return self.channels[full].astype(np.float32)
        raise ExportError("a render lacks a pass", found=" ".join(self.channels), wanted=" or ".join(names))

    def depth(self) -> np.ndarray:
        """Planar distance in scene units; 1e10 where nothing was hit."""
        return self.channel("Depth.Z", "Depth.V")

    def emission(self) -> np.ndarray:
        """The light that the surfaces emit themselves, `[height][width][3]`."""
        # Blender 4 and Blender 5.
        return np.stack([self.channel(f"Emit.{end}", f"Emission.{end}") for end in "RGB"], axis=-1)

    def glossy(self) -> np.ndarray:
        """The light that surfaces reflect specularly, `[height][width][3]`."""
        direct, indirect, color = (
            # Blender 4 and Blender 5.
            np.stack([self.channel(f"{short}.{end}", f"{long}.{end}") for end in "RGB"], axis=-1)
            for short, long in GLOSSY
        )
        return (direct + indirect) * color

    def vector(self, name: str, ends: str) -> np.ndarray:
        """The pass `name` with channels `ends`, `[height][width][len(ends)]`."""
        return np.stack([self.channel(f"{name}.{end}") for end in ends], axis=-1)


class Renderer:
    """Renders one view layer of a scene, whose settings it changes for point samples; the journal restores them."""

    def __init__(self, scene: Any, layer: Any, folder: str, journal: Journal, progress: Progress) -> None:
        """For what the view layer `layer` shows."""
        self.scene, self.progress = scene, progress
        self.path = os.path.join(folder, "pass.exr")
        self.bounces = scene.cycles.max_bounces
        kinds = ("object", "material", "asset")
        self.cryptomattes = [kind for kind in kinds if kind == "object" or getattr(layer, _cryptomatte(kind))]
        write_float_exr(scene, self.path, journal)
        _render_plainly(scene, journal)
        _sample_points(scene, journal)
        self.layer = stand_in(scene, layer, journal)
        for other in scene.view_layers:
            journal.set(other, "use", other == self.layer)

    def render(self, job: Job) -> Passes:
        """The passes of one render. Raises `ExportError` if it fails or is stopped."""
        cycles, layer = self.scene.cycles, self.layer
        cycles.samples = job.samples
        cycles.max_bounces = self.bounces if job.light else job.bounces
        self.scene.render.film_transparent = job.transparent
        layer.use_pass_emit = layer.cycles.denoising_store_passes = job.guides
        for kind in self.cryptomattes:
            setattr(layer, _cryptomatte(kind), job.cryptomatte)
        for name in SHADING_PASSES:
            setattr(layer, name, job.shading)
        self.progress(job.name)
        return Passes(*render_to(self.scene, self.path, job.name), layer.name)


def render_to(scene: Any, path: str, name: str) -> tuple[dict[str, np.ndarray], dict[str, exr.Attribute]]:
    """Channels and attributes of a render of `scene`, which writes the file `path`; removes the file."""
    try:
        bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        raise ExportError("Blender could not render", where=name, found=str(error).strip()) from error
    if not os.path.exists(path):
        raise ExportError("a render was stopped", where=name)
    channels: dict[str, np.ndarray] = {}
    attributes: dict[str, exr.Attribute] = {}
    for part in exr.read(path):
        # In files of several parts, channels may lack the name of theirs.
        channels |= {_full(part.name, channel): plane for channel, plane in part.channels.items()}
        attributes |= part.attributes
    os.remove(path)
    return channels, attributes


def _full(part: str, channel: str) -> str:
    return channel if not part or channel.startswith(f"{part}.") or "." in channel else f"{part}.{channel}"


def write_float_exr(scene: Any, path: str, journal: Journal) -> None:
    """Lets `scene` write its renders to `path`, as one uncompressed multi-layer file of floats."""
    render = scene.render
    image = render.image_settings
    # In this order, so that what depends on the format is restored after it.
    journal.remember(image, "exr_codec", "color_depth", "color_mode", "file_format", "media_type")
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format = "OPEN_EXR_MULTILAYER"
    image.color_mode, image.color_depth, image.exr_codec = "RGBA", "32", "NONE"
    journal.set(image, "use_exr_interleave", True)
    journal.set(image, "use_preview", False)
    journal.set(render, "filepath", path)
    journal.set(render, "use_file_extension", False)


def _render_plainly(scene: Any, journal: Journal) -> None:
    """Turns off what a peel must not have, and remembers what renders change."""
    render, cycles = scene.render, scene.cycles
    for name in ("use_motion_blur", "use_border", "use_crop_to_border", "use_compositing", "use_sequencer"):
        journal.set(render, name, False)
    for name in ("use_multiview", "use_freestyle", "use_stamp", "use_persistent_data", "use_single_layer"):
        journal.set(render, name, False)
    journal.set(render, "dither_intensity", 0.0)
    journal.remember(render, "resolution_x", "resolution_y", "resolution_percentage", "film_transparent")
    journal.remember(cycles, "samples", "max_bounces")
    journal.set(cycles, "use_denoising", False)
    journal.set(cycles, "time_limit", 0.0)
    journal.set(cycles, "film_transparent_glass", False)
    # The image of distances is never scaled down.
    journal.set(cycles, "texture_limit_render", "OFF")


def _sample_points(scene: Any, journal: Journal) -> None:
    """Makes every sample of a pixel one of its centre."""
    cycles = scene.cycles
    journal.set(cycles, "pixel_filter_type", "BLACKMAN_HARRIS")
    journal.set(cycles, "filter_width", FILTER_WIDTH_PX)
    journal.set(cycles, "transparent_max_bounces", TRANSPARENT_BOUNCES)


def _cryptomatte(kind: str) -> str:
    return f"use_pass_cryptomatte_{kind}"
