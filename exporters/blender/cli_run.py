# SPDX-License-Identifier: GPL-3.0-or-later
"""What `cli.py` does with its options."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any

import bpy

from .export import Talk, export
from .settings import Settings
from .shared import ExportError, frames

BAD_INPUT = 4


def run(options: argparse.Namespace) -> int:
    """Exports the frames of `options`. Returns the exit code."""
    try:
        scene = _open(getattr(options, "file", None), options.scene)
        wanted = frames.parse(options.frames) if options.frames else [scene.frame_current]
        settings = _settings(options).checked()
    except ExportError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT if getattr(error, "is_input", False) else frames.WRONG_USAGE
    talk = Talk(lambda text: _say(text, options), lambda text: options.verbose and print(text, file=sys.stderr))

    def one(frame: int, path: str) -> str:
        if frame != scene.frame_current:
            scene.frame_set(frame)
        return export(scene, settings, path, talk)

    before = scene.frame_current
    try:
        with contextlib.nullcontext() if options.verbose else _silent():
            return frames.run(wanted, bpy.path.abspath(options.output), one, overwrite=options.overwrite)
    finally:
        if scene.frame_current != before:
            scene.frame_set(before)


def _say(text: str, options: argparse.Namespace) -> None:
    if not options.quiet or text.startswith("warning"):
        print(text, file=sys.stderr, flush=True)


def _open(path: str | None, scene: str | None) -> Any:
    """The scene called `scene`, of the file at `path` or of the open one."""
    if path is not None:
        try:
            bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
        except RuntimeError as error:
            failure = ExportError("the scene cannot be opened", where=path, found=str(error).strip())
            failure.is_input = True
            raise failure from error
    if scene is None:
        return bpy.context.scene
    if scene not in bpy.data.scenes:
        raise ExportError("there is no such scene", found=scene, wanted=", ".join(s.name for s in bpy.data.scenes))
    return bpy.data.scenes[scene]


def _settings(options: argparse.Namespace) -> Settings:
    names = ("peels", "kind", "supersample", "samples", "overscan", "denoise", "background", "cryptomatte")
    names += ("camera", "view_layer", "threads")
    return Settings(**{name: getattr(options, name) for name in names})


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Leaves out what Blender prints on standard output."""
    sys.stdout.flush()
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)
