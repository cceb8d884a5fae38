# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The export of one frame: renders, with the scene changed and restored, then merging and writing."""

from __future__ import annotations

import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from . import camera as cameras
from . import closed_objects, cryptomatte, materials, overscan, shading, view_layer
from .camera import View
from .denoise import Denoiser
from .journal import Journal
from .passes import Progress, Renderer
from .peel_nodes import PeelNodes
from .peels import Peeler, Peels
from .settings import COVERAGE, POINT, Say, Settings
from .shared import ExportError, stack
from .shared import merge as merging
from .shared import shading as names
from .volumes import Volumes

# What the header of a stack calls a kind.
KINDS = {POINT: "point", COVERAGE: "coverage"}


@dataclass(frozen=True)
class Rendered:
    """What is left of the renders when the scene is as it was."""

    peels: Peels
    view: View
    lens: Any
    overscan: int


@dataclass(frozen=True)
class Talk:
    """Where an export reports to: lines for the user, and the names of renders as they start."""

    say: Say
    progress: Progress


def export(scene: Any, settings: Settings, path: str, talk: Talk) -> str:
    """Writes the stack of the scene's current frame to `path`. Returns what to say of it. Raises `ExportError`."""
    settings.checked()
    rendered = render(scene, settings, talk)
    frame = stack.Frame(rendered.view.width, rendered.view.height, rendered.overscan)
    per_axis = settings.per_axis
    layers, crypto = rendered.peels.layers, rendered.peels.cryptomatte
    kind = stack.Kind(KINDS.get(settings.kind, "supersampled" if per_axis > 1 else "point"), per_axis)
    if settings.kind == COVERAGE:
        layers = merging.merge(merging.split(layers, per_axis), rendered.lens.for_merging(), rendered.view.width)
        crypto = cryptomatte.merged(crypto, per_axis)
        kind = stack.Kind("coverage")
    names.finish(layers)
    attributes = {
        **rendered.peels.attributes,
        "pixelAspectRatio": float(rendered.view.pixel_aspect),
        "software": f"Blender {bpy.app.version_string}",
        "thinlens.exporter": f"Blender exporter {version()}",
    }
    stack.write(path, {**stack.channels(layers), **crypto}, frame, kind, rendered.lens, attributes)
    return f"{frame.width}×{frame.height} and {frame.overscan} px around it, {len(layers)} layers"


def render(scene: Any, settings: Settings, talk: Talk) -> Rendered:
    """Renders the peels of the scene's current frame. The open file is as before when it returns or raises."""
    check_engine(scene)
    layer = view_layer.find(scene, settings.view_layer, talk.say)
    layer.update()
    camera = cameras.find(scene, settings.camera)
    view = cameras.view_of(scene, camera)
    lens = cameras.lens_of(camera, view, talk.say)
    with tempfile.TemporaryDirectory(prefix="thinlens-") as folder, Journal() as journal:
        return _render(_Open(scene, layer, folder, journal, talk), settings, Rendered(Peels([]), view, lens, 0), camera)


def check_engine(scene: Any) -> None:
    """Raises `ExportError` unless Cycles renders `scene`."""
    if scene.render.engine != "CYCLES":
        raise ExportError(
            "only Cycles renders peels",
            where=f"scene {scene.name}",
            found=scene.render.engine,
            help="set the render engine to Cycles",
        )


@dataclass(frozen=True)
class _Open:
    """The open file while it is changed."""

    scene: Any
    layer: Any
    folder: str
    journal: Journal
    talk: Talk


def _render(file: _Open, settings: Settings, start: Rendered, camera: Any) -> Rendered:
    """Renders the peels that `start` lacks."""
    scene, journal, say, view = file.scene, file.journal, file.talk.say, start.view
    # The last step of all: what depends on the rest is as it was, too.
    journal.on_restore(file.layer.update)
    wishes = _Wishes.of(scene, settings)
    eye = camera.matrix_world.translation.copy()
    per_axis = settings.per_axis
    wishes.say(settings, say)
    if settings.threads:
        journal.set(scene.render, "threads_mode", "FIXED")
        journal.set(scene.render, "threads", settings.threads)
    renderer = Renderer(scene, file.layer, file.folder, journal, file.talk.progress)
    data = cameras.stand_in(scene, camera, journal)
    _hide_lamps(scene, journal, say)
    over = settings.overscan
    if over is None:
        over = overscan.find(renderer, data, view, start.lens, say)
    size = tuple((length + 2 * over) * per_axis for length in (view.width, view.height))
    # Adaptive subdivision as fine as in the user's picture.
    journal.set(scene.cycles, "dicing_rate", scene.cycles.dicing_rate * per_axis)
    _mark_closed(renderer.layer, eye, journal, say)
    nodes = PeelNodes(size, view.pixels_per_slope(start.lens.focal_length_mm) * per_axis, journal)
    volumes = Volumes(scene, journal)
    wrapped = materials.wrap_all(nodes.group, journal, say)
    _say_materials(wrapped.tinted, volumes.names, say)
    cameras.aim(scene, data, view, over, size)
    peeler = Peeler(renderer, nodes, volumes, say)
    if wishes.denoises:
        peeler.denoiser = Denoiser(size, scene, file.folder, journal, file.talk.progress)
    if settings.shading:
        peeler.shading = shading.Shading(scene, renderer.layer, wrapped.surfaces, camera, journal)
        peeler.shading.say_unread(say)
    peels = peeler.render(settings.peels, wishes.samples, settings.cryptomatte)
    if wishes.has_background:
        peels.layers.append(peeler.background(peels, wishes.samples))
    return Rendered(peels, view, start.lens, over)


@dataclass(frozen=True)
class _Wishes:
    """What the user asks for, by the settings or by the scene before it is changed."""

    # Light samples of each of a pixel's samples.
    samples: int
    has_background: bool
    denoises: bool

    @classmethod
    def of(cls, scene: Any, settings: Settings) -> _Wishes:
        # Without a world, the background is black, and as opaque.
        background, denoise = settings.background, settings.denoise
        return cls(
            settings.samples_each(scene.cycles.samples),
            not scene.render.film_transparent if background is None else background,
            scene.cycles.use_denoising if denoise is None else denoise,
        )

    def say(self, settings: Settings, say: Say) -> None:
        """Tells the user how many samples will be rendered."""
        per_axis = settings.per_axis
        total, grid = self.samples * per_axis**2, f"{per_axis}×{per_axis}"
        say(f"{total} light samples a pixel: {grid} places with {self.samples} each, up to {settings.peels} peels")


def _mark_closed(layer: Any, eye: Any, journal: Journal, say: Say) -> None:
    """Gives every surface a material, and marks the closed ones."""
    materials.give_nodes(journal)
    materials.fill_empty_slots(journal)
    for ball in bpy.data.metaballs:
        journal.set(ball, "resolution", ball.render_resolution)
    layer.update()
    closed_objects.mark(layer.depsgraph, eye, journal, say)


def version() -> str:
    """The version of this exporter."""
    manifest = Path(__file__).with_name("blender_manifest.toml")
    return tomllib.loads(manifest.read_text(encoding="utf-8"))["version"]


def _hide_lamps(scene: Any, journal: Journal, say: Say) -> None:
    """Hides lamps from the camera: they have no depth."""
    for ob in scene.objects:
        if ob.type == "LIGHT" and ob.data.type != "SUN" and ob.visible_camera and not ob.hide_render:
            say(f"warning: lamp {ob.name} has no depth and is hidden from the camera; use a mesh that emits light")
            journal.set(ob, "visible_camera", False)


def _say_materials(tinted: list[str], volumes: list[str], say: Say) -> None:
    """Says what the materials cannot have in a stack."""
    if tinted:
        names = ", ".join(sorted(tinted))
        say(f"note: coloured transparent material {names}: what is behind is seen in it, at its depth")
    if volumes:
        names = ", ".join(sorted(volumes))
        say(f"warning: volume of {names} has no depth: what is behind it keeps it, and it blurs with that")
