# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""What `cli.py` does with its options."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any

import bpy

from .export import Talk, check_engine, export
from .settings import Settings
from .shared import ExportError, frames

BAD_INPUT = 4


def run(options: argparse.Namespace) -> int:
    """Exports the frames of `options`. Returns the exit code."""
    code = frames.WRONG_USAGE
    try:
        settings = _settings(options).checked()
        listed = frames.parse(options.frames) if options.frames else None
        code = BAD_INPUT
        _open(getattr(options, "file", None))
        code = frames.WRONG_USAGE
        scene = _scene(options.scene)
        code = BAD_INPUT
        check_engine(scene)
    except ExportError as error:
        print(error, file=sys.stderr)
        return code
    wanted = listed or [scene.frame_current]
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


def _open(path: str | None) -> None:
    """Opens the file at `path`, if there is one to open."""
    if path is not None:
        try:
            bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
        except RuntimeError as error:
            raise ExportError("the scene cannot be opened", where=path, found=str(error).strip()) from error


def _scene(name: str | None) -> Any:
    """The scene `name` of the open file, or the one that it shows."""
    if name is None:
        return bpy.context.scene
    if name not in bpy.data.scenes:
        raise ExportError("there is no such scene", found=name, wanted=", ".join(s.name for s in bpy.data.scenes))
    return bpy.data.scenes[name]


def _settings(options: argparse.Namespace) -> Settings:
    names = ("peels", "kind", "supersample", "samples", "overscan", "denoise", "background", "cryptomatte", "shading")
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
