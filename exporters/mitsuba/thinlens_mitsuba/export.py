"""The export of one scene file."""

from __future__ import annotations

import argparse
import sys
import time

import mitsuba as mi

from thinlens_stack import exr, frames, stack
from thinlens_stack.errors import ExportError
from thinlens_stack.lens import Lens, overscan_px

from .camera import Choice
from .peel_integrator import Peeler, Sampling, wrappable

# The auto overscan looks this far around the frame, as a share of its width.
MOST_OVERSCAN = 0.25
# Width of the depth picture that it looks at, in samples.
DEPTH_WIDTH = 240


def export(options: argparse.Namespace, frame: int | None, target: str) -> str:
    """Exports a scene into the file `target`; returns what to say of it. Raises `ExportError` if it cannot."""
    cpu = time.process_time()
    scene = _load(options, frame)
    if not scene.shapes():
        raise ExportError("the scene has no shapes: nothing has a depth", where=options.scene)
    sensors = scene.sensors()
    if options.sensor >= len(sensors):
        raise ExportError("there is no such sensor", found=f"{len(sensors)} sensors", wanted=f"sensor {options.sensor}")
    sensor = sensors[options.sensor]
    inner = mi.load_dict({"type": options.integrator}) if options.integrator else scene.integrator()
    peeler = Peeler(scene, sensor, wrappable(inner))
    choice = Choice(options.f_number, options.focus, options.sensor_width, options.metres_per_unit)
    lens = peeler.camera.lens(choice)
    overscan = _overscan(peeler, lens) if options.overscan is None else options.overscan
    extent = peeler.camera.frame(overscan)
    sampling = Sampling(
        peels=options.peels,
        samples=options.supersample,
        paths=options.spp or sensor.sampler().sample_count(),
        is_merged=options.kind == "coverage",
        seed=options.seed,
        has_shading=options.shading,
    )
    if peeler.has_media:
        _warn("fog is part of the colour of the first surface behind it; surfaces behind that one lack it")
    layers = peeler.stack(extent, sampling, choice)
    kind = stack.Kind(options.kind, options.supersample if options.kind == "supersampled" else 1)
    attributes = _attributes()
    if options.shading:
        matrix = peeler.camera.world_to_camera.astype("<f4").tobytes()
        attributes["worldToCamera"] = exr.Raw("m44f", matrix)
    stack.write(target, stack.channels(layers, half=not options.float), extent, kind, lens, attributes)
    return (
        f"{extent.width}×{extent.height} with {overscan} px around it, {len(layers)} layers, "
        f"{time.process_time() - cpu:.1f} CPU s"
    )


def _load(options: argparse.Namespace, frame: int | None) -> mi.Scene:
    """The scene of a frame. Raises `ExportError` if it cannot be loaded."""

    def numbered(text: str) -> str:
        return text if frame is None else frames.path(text, frame)

    parameters = {}
    for definition in options.define:
        name, equals, value = definition.partition("=")
        if not equals:
            raise ExportError("this is not a parameter of the scene", found=f"-D {definition}", wanted="-D NAME=VALUE")
        parameters[name] = numbered(value)
    path = numbered(options.scene)
    try:
        # Merging shapes puts lamps in an order that changes from run to run, and the noise with it.
        scene = mi.load_file(path, optimize=False, **parameters)
    except (RuntimeError, OSError) as error:
        raise ExportError("the scene cannot be loaded", where=path, found=str(error).strip()) from error
    if not isinstance(scene, mi.Scene):
        raise ExportError("this file holds no scene", where=path, found=scene.class_name())
    return scene


def _overscan(peeler: Peeler, lens: Lens) -> int:
    """How far around the frame there is something whose blur reaches into it, in pixels."""
    if lens.coc_scale_px(1.0) == 0.0 or lens.focus_distance is None:
        _warn("without a lens there is no overscan: give --f-number and --focus, or --overscan")
        return 0
    frame = peeler.camera.frame(0)
    margin = int(MOST_OVERSCAN * frame.width)
    step = max(1, frame.width // DEPTH_WIDTH)
    depth = peeler.depth(peeler.camera.frame(margin), step)
    found = overscan_px(depth, (frame.width, frame.height), margin, lens)
    if found == margin:
        _warn(f"overscan stops at {margin} px: something farther outside blurs into the frame")
    return found


def _attributes() -> dict[str, exr.Attribute]:
    """The header attributes that name the programs."""
    return {"software": f"Mitsuba {mi.__version__}", "thinlens.exporter": "mitsuba"}


def _warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)
