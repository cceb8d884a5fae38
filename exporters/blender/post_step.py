# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The post step: each frame that a render writes gets the lens, in a file beside it. A failure stops no render."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import bpy

from . import camera as cameras
from . import lens_job, preferences, present
from .cli import PACKAGE
from .lens_job import LensJob, LensRun
from .shared import ExportError

# Loaded once the command line of the exporter runs in this Blender.
COMMAND_LINE = f"{PACKAGE}.cli_run"
HEADER_FORMATS = ("OPEN_EXR", "OPEN_EXR_MULTILAYER")


class _State:
    """Of the render that runs, or of the last one."""

    # The lens of each frame, as flags, or why there is none.
    lenses: dict[int, list[str] | ExportError] = {}
    written: int = 0
    # Errors by frame.
    failures: dict[int, str] = {}


def failures() -> dict[int, str]:
    """The errors of the last render, by frame."""
    return _State.failures


def written() -> int:
    """How many pictures the post step of the last render wrote."""
    return _State.written


def beside(path: str, suffix: str) -> str:
    """The file of the picture with the lens of the frame at `path`."""
    own = Path(path)
    return str(own.with_name(f"{own.stem}{suffix or '.lens'}{own.suffix}"))


def _is_on(scene: Any) -> bool:
    """Whether the frames of `scene` get a lens. An export's renders are passes, not frames."""
    return scene.thinlens.use_post_step and COMMAND_LINE not in sys.modules


@bpy.app.handlers.persistent
def _on_start(scene: Any, *_: Any) -> None:
    _State.lenses, _State.failures, _State.written = {}, {}, 0


@bpy.app.handlers.persistent
def _on_frame(scene: Any, depsgraph: Any = None, *_: Any) -> None:
    """Keeps the lens of the frame: only the render's own dependency graph has its animated values."""
    if depsgraph is None or depsgraph.mode != "RENDER" or not _is_on(scene):
        return
    try:
        camera = cameras.find(scene, None)
        _State.lenses[scene.frame_current] = _flags(scene, camera.evaluated_get(depsgraph))
    except ExportError as error:
        _State.lenses[scene.frame_current] = error


@bpy.app.handlers.persistent
def _on_write(scene: Any, *_: Any) -> None:
    if not _is_on(scene):
        return
    frame = scene.frame_current
    try:
        said = _apply(scene, frame)
        _State.written += 1
        print(f"thinlens: frame {frame}: {said}", file=sys.stderr, flush=True)
    except Exception as error:  # Nothing here may stop a render.
        text = str(error) if isinstance(error, ExportError) else f"error: {type(error).__name__}: {error}"
        _State.failures[frame] = text
        print(f"thinlens: frame {frame}: failed\n{text}", file=sys.stderr, flush=True)
    present.redraw(("PROPERTIES",))


def _flags(scene: Any, camera: Any) -> list[str]:
    """The lens of a frame without a header. Raises `ExportError` if the frame is blurred already."""
    if camera.data.dof.use_dof:
        raise ExportError(
            "the frame is rendered with Blender's own depth of field",
            where=f"camera {camera.name}",
            help="switch Depth of Field off in the camera: its focus and f-stop are used all the same",
        )
    return present.lens_flags(scene, camera, whole=True, say=lambda text: print(text, file=sys.stderr))


def _apply(scene: Any, frame: int) -> str:
    """Gives the frame that was just written the lens. Returns what to say. Raises `ExportError`."""
    kind = scene.render.image_settings.file_format
    if kind not in HEADER_FORMATS:
        raise ExportError(
            "only OpenEXR frames have depth", found=kind, help="set the output's format to OpenEXR MultiLayer"
        )
    lens = _State.lenses.get(frame)
    if lens is None:
        lens = _flags(scene, cameras.find(scene, None))
    if isinstance(lens, ExportError):
        raise lens
    path = _written_file(scene.render, frame)
    flags = (*lens, "--depth-convention=planar")
    result = beside(path, scene.thinlens.post_suffix)
    quality = scene.camera.data.thinlens.quality
    outcome = lens_job.wait(LensJob(LensRun(preferences.program_path(), path, result, flags).at(quality)))
    for line in outcome.warnings:
        print(line, file=sys.stderr)
    if not outcome.is_done:
        raise ExportError(outcome.text.removeprefix("error: "))
    return outcome.text


def _written_file(render: Any, frame: int) -> str:
    """The file that a render just wrote: in an animation with the frame number in its name, else without."""
    still = render.filepath
    if render.use_file_extension and not still.lower().endswith(render.file_extension):
        still += render.file_extension
    paths = [os.path.abspath(bpy.path.abspath(path)) for path in (render.frame_path(frame=frame), still)]
    there = [path for path in paths if os.path.isfile(path)]
    if not there:
        raise ExportError("the frame was not found", found="no file", wanted=" or ".join(paths))
    return max(there, key=lambda path: os.stat(path).st_mtime_ns)


def _handlers() -> tuple[tuple[Any, Any], ...]:
    on = bpy.app.handlers
    return (on.render_init, _on_start), (on.frame_change_post, _on_frame), (on.render_write, _on_write)


def register() -> None:
    """Adds the handlers."""
    for handlers, own in _handlers():
        handlers.append(own)


def unregister() -> None:
    """Removes them."""
    for handlers, own in _handlers():
        if own in handlers:
            handlers.remove(own)
