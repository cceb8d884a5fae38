# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Preferences of the extension: where the program is."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from . import program
from .shared import ExportError


class ThinlensPreferences(bpy.types.AddonPreferences):
    """Shown in Blender's preferences below the extension."""

    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Program",
        description="The program thinlens, or its folder. Empty: the one on the search path",
        subtype="FILE_PATH",
    )

    def draw(self, context: Any) -> None:
        """The path, and what is found there."""
        self.layout.prop(self, "program")
        draw_state(self.layout)


class THINLENS_OT_check(bpy.types.Operator):
    """Looks for the program again, and says its version"""

    bl_idname = "thinlens.check"
    bl_label = "Check"

    def execute(self, context: Any) -> set[str]:
        """Reports the program, or what is wrong with it."""
        _check.cache_clear()
        try:
            found = program.check(preferred())
        except ExportError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"thinlens {found.version}, {found.path}")
        return {"FINISHED"}


def preferred() -> str:
    """The path that the user chose; empty if none."""
    addon = bpy.context.preferences.addons.get(__package__)
    chosen = addon.preferences.program if addon and addon.preferences else ""
    return bpy.path.abspath(chosen) if chosen else ""


def program_path() -> str:
    """The program. Raises `ExportError` if there is none."""
    return program.find(preferred())


def draw_state(layout: Any) -> None:
    """Draws the version of the program, or why it does not run."""
    found, error = state()
    if found:
        layout.label(text=f"thinlens {found.version}: {found.path}", icon="CHECKMARK")
        return
    column = layout.column(align=True)
    for number, line in enumerate(error.removeprefix("error: ").splitlines()):
        column.label(text=line.strip(), icon="BLANK1" if number else "ERROR")
    layout.operator(THINLENS_OT_check.bl_idname)


def state() -> tuple[program.Program | None, str]:
    """The program, or the error. It is run only if it has changed since it was run last."""
    try:
        path = program.find(preferred())
        return _check(path, Path(path).stat().st_mtime_ns)
    except ExportError as error:
        return None, str(error)
    except OSError as error:
        return None, f"error: the program thinlens cannot be read: {error.strerror}"


@lru_cache(maxsize=4)
def _check(path: str, modified_ns: int) -> tuple[program.Program | None, str]:
    try:
        return program.check(path), ""
    except ExportError as error:
        return None, str(error)


_CLASSES = (ThinlensPreferences, THINLENS_OT_check)


def register() -> None:
    """Adds the preferences."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Removes them."""
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
    _check.cache_clear()
