# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The open file as the panel's jobs need it: which camera, its lens, its files, and a copy of everything."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from . import camera as cameras
from . import lens_job, preferences
from .export_job import Choices, Host
from .lens_job import LensRun
from .properties import FRAMES_RANGE, LENS_FILE, is_on
from .settings import Say
from .shared import ExportError, frames

# The folder beside a file where Blender keeps caches of simulations.
CACHE = "blendcache_"


def camera_of(context: Any, name: str = "") -> Any:
    """The camera object `name`; without a name, that of the panel, or the scene's. Raises `ExportError` if none."""
    scene = context.scene
    data = None if name else getattr(context, "camera", None)
    shown = getattr(context, "object", None)
    if data is not None:
        users = [shown, scene.camera, *scene.objects]
        name = next((ob.name for ob in users if ob is not None and ob.data == data), "")
    return cameras.find(scene, name or None)


def absolute(path: str, what: str) -> str:
    """`path` of the file's own folder. Raises `ExportError` if that is not known."""
    full = bpy.path.abspath(path)
    if not os.path.isabs(full):
        raise ExportError(
            f"the file of the {what} has no folder",
            found=f'"{path}"',
            help="save the Blender file, or give a full path",
        )
    return os.path.normpath(full)


def lens_flags(scene: Any, camera: Any, *, whole: bool, say: Say) -> list[str]:
    """The flags of the lens of `camera` as it is now; `say` is told what the program cannot do.

    Raises `ExportError` if the camera is focused on nothing.
    """
    cameras.checked_focus_distance(camera)
    own = cameras.lens_of(camera, cameras.view_of(scene, camera), lambda text: _warn(text, say))
    return lens_job.flags(own, whole=whole)


def _warn(text: str, say: Say) -> None:
    if text.startswith("warning"):
        say(text)


def lens_run(scene: Any, camera: Any, say: Say, *, is_live: bool = False) -> LensRun:
    """The run that applies the lens to the stack of the current frame, without its quality.

    The lens is the one that the panel names; with `is_live`, the camera's.
    Raises `ExportError` if there is no stack or no program.
    """
    own = camera.data.thinlens
    stack = lens_job.stack_of(absolute(own.stack, "stack"), scene.frame_current)
    result = frames.path(absolute(own.result, "result"), scene.frame_current)
    if not result.lower().endswith(".exr"):
        raise ExportError("the result is an OpenEXR file", found=result, wanted="a name that ends with .exr")
    if os.path.realpath(stack) == os.path.realpath(result):
        raise ExportError("the result would replace the stack", where=result, help="choose another file for the result")
    is_known = lens_job.has_lens(stack)
    is_stored = own.lens == LENS_FILE and not is_live
    flags = [] if is_stored else lens_flags(scene, camera, whole=not is_known, say=say)
    return LensRun(preferences.program_path(), stack, result, tuple(flags))


def choices(scene: Any, camera: Any) -> Choices:
    """What the panel of `camera` asks an export for. Raises `ExportError` if frames have no place in the file name."""
    own = camera.data.thinlens
    wanted = (scene.frame_current,)
    if own.frames == FRAMES_RANGE:
        wanted = tuple(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))
    output = absolute(own.stack, "stack")
    if len(wanted) > 1 and not frames.is_pattern(output):
        raise ExportError(
            f"{len(wanted)} frames cannot go into one file", found=output, wanted="a name such as stack.####.exr"
        )
    return Choices(
        output,
        wanted,
        overwrite=own.overwrite,
        peels=own.peels,
        kind=own.kind,
        supersample=own.supersample,
        samples=own.samples or None,
        overscan=own.overscan if own.overscan >= 0 else None,
        denoise=is_on(own.denoise),
        background=is_on(own.background),
        cryptomatte=own.cryptomatte,
        shading=own.shading,
        scene=scene.name,
        camera=camera.name,
        view_layer=own.view_layer or None,
    )


def host() -> Host:
    """What runs an export beside this Blender."""
    cli = str(Path(__file__).with_name("cli.py"))
    return Host(bpy.app.binary_path, sys.executable, cli, runs_scripts=not bpy.app.autoexec_fail)


def save_copy(folder: str, say: Say) -> str:
    """Saves the open file as it is now into `folder`; it stays open under its own name. Returns the copy's path.

    Paths in the copy still lead to what they led to. Raises `ExportError` if it cannot be saved.
    """
    unsaved = [image.name for image in bpy.data.images if image.is_dirty and not image.packed_file and image.users]
    if unsaved:
        say(f"warning: image {', '.join(unsaved)} has changes that are not saved: the export does not see them")
    # Under the same name, because caches of simulations are looked for by the file's name.
    own = Path(bpy.data.filepath)
    copy = os.path.join(folder, own.name if bpy.data.filepath else "untitled.blend")
    try:
        bpy.ops.wm.save_as_mainfile(filepath=copy, copy=True, relative_remap=True, compress=False, check_existing=False)
    except RuntimeError as error:
        raise ExportError("a copy of the file cannot be saved", where=copy, found=str(error).strip()) from error
    if bpy.data.filepath:
        _link_cache(own, folder, say)
    return copy


def _link_cache(own: Path, folder: str, say: Say) -> None:
    """Lets the copy in `folder` find the caches of the simulations of the file `own`."""
    cache = own.with_name(CACHE + own.stem)
    if not cache.is_dir():
        return
    try:
        os.symlink(cache, os.path.join(folder, cache.name), target_is_directory=True)
    except OSError as error:
        say(f"warning: simulations are computed again: their cache cannot be linked ({error.strerror})")


def redraw(kinds: Sequence[str]) -> None:
    """Draws the areas of these kinds again."""
    manager = bpy.context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas if window.screen else ():
            if area.type in kinds:
                area.tag_redraw()
