# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The panel thinlens below a camera's depth of field: export, apply the lens, live re-lens, the post step.

It only shows properties and buttons; what they do is in `operators.py`, `live.py` and `post_step.py`.
"""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from . import live, operators, post_step, preferences
from .properties import FRAMES_RANGE
from .settings import POINT

# The panels of a camera's depth of field: Cycles has one of its own.
CYCLES = "CYCLES"
PARENTS = {CYCLES: "CYCLES_CAMERA_PT_dof", "OTHER": "DATA_PT_camera_dof"}

# About the width of a letter at the interface's scale 1, and how many of them an icon and the margins take.
LETTER_PX, ICON_LETTERS = 7.0, 8
# Of a line of text, as a share of a button's height.
LINE_HEIGHT = 0.8


class Shown:
    """What the panels have in common; a mix-in."""

    bl_label = "thinlens"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Whether a camera is shown, and this is the panel of the scene's renderer."""
        is_cycles = context.engine == CYCLES
        return context.camera is not None and is_cycles == cls.is_for_cycles

    def draw(self, context: Any) -> None:
        """Everything but the settings of the export."""
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        own = context.camera.thinlens
        found, error = preferences.state()
        if found is None:
            box = layout.box()
            _draw_text(box, context, error.removeprefix("error: "), "ERROR")
            box.operator("thinlens.check")
        job = operators.running()
        if job is not None:
            _draw_job(layout, job)
        column = layout.column()
        column.enabled = job is None
        _draw_export(column, own)
        column.separator()
        _draw_lens(column, own)
        _draw_live(layout, context)
        layout.separator()
        _draw_post_step(layout, context)


def _draw_job(layout: Any, job: Any) -> None:
    row = layout.row(align=True)
    row.progress(factor=job.share, text=job.text)
    row.operator("thinlens.cancel", text="", icon="X")


def _draw_export(column: Any, own: Any) -> None:
    column.prop(own, "stack")
    column.prop(own, "frames")
    if own.frames == FRAMES_RANGE:
        column.prop(own, "overwrite")
    column.prop(own, "apply_after")
    column.operator("thinlens.export", icon="RENDER_STILL")


def _draw_lens(column: Any, own: Any) -> None:
    column.prop(own, "result")
    column.row().prop(own, "lens", expand=True)
    column.prop(own, "quality")
    column.operator("thinlens.apply", icon="CAMERA_DATA")


def _draw_live(layout: Any, context: Any) -> None:
    session = live.session()
    layout.operator("thinlens.live", icon="PLAY", depress=session is not None)
    if session is not None:
        _draw_text(layout, context, session.text, "ERROR" if session.is_error else "INFO")


def _draw_post_step(layout: Any, context: Any) -> None:
    own = context.scene.thinlens
    layout.column(heading="Lens").prop(own, "use_post_step")
    if not own.use_post_step:
        return
    layout.prop(own, "post_suffix")
    failed = post_step.failures()
    if failed:
        frame, text = next(iter(failed.items()))
        _draw_text(layout, context, f"frames without a lens: {len(failed)}; frame {frame}:\n{text}", "ERROR")
    elif post_step.written():
        _draw_text(layout, context, f"frames with the lens: {post_step.written()}", "CHECKMARK")


def _draw_text(layout: Any, context: Any, text: str, icon: str) -> None:
    """Draws lines of text, broken at the width of the panel."""
    per_line = int(context.region.width / (LETTER_PX * context.preferences.system.ui_scale)) - ICON_LETTERS
    lines = [part for line in text.splitlines() for part in textwrap.wrap(line.strip(), max(per_line, ICON_LETTERS))]
    column = layout.column(align=True)
    column.scale_y = LINE_HEIGHT
    for number, line in enumerate(lines):
        column.label(text=line, icon="BLANK1" if number else icon)


class ShownSettings:
    """The settings of the export; a mix-in."""

    bl_label = "Export Settings"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        """The settings that `cli.py` has as flags."""
        layout, own = self.layout, context.camera.thinlens
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.enabled = operators.running() is None
        layout.prop(own, "peels")
        layout.prop(own, "kind")
        row = layout.row()
        row.enabled = own.kind != POINT
        row.prop(own, "supersample")
        for name in ("samples", "overscan", "denoise", "background", "cryptomatte", "shading"):
            layout.prop(own, name)
        layout.prop_search(own, "view_layer", context.scene, "view_layers")


def _panels() -> list[Any]:
    """The panel and its settings, for Cycles and for the other renderers.

    A panel whose parent is missing, because Cycles is switched off, stands by itself.
    """
    out = []
    for engine, parent in PARENTS.items():
        name = f"THINLENS_PT_{engine.lower()}"
        where = {"bl_parent_id": parent} if hasattr(bpy.types, parent) else {}
        out.append(type(name, (Shown, bpy.types.Panel), {**where, "is_for_cycles": engine == CYCLES}))
        out.append(type(f"{name}_stack", (ShownSettings, bpy.types.Panel), {"bl_parent_id": name}))
    return out


_registered: list[Any] = []


def register() -> None:
    """Adds the panels."""
    for cls in _panels():
        bpy.utils.register_class(cls)
        _registered.append(cls)


def unregister() -> None:
    """Removes them."""
    while _registered:
        bpy.utils.unregister_class(_registered.pop())
