# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The buttons: export, apply the lens, cancel. In a window they run beside the user's work; without one they wait."""

from __future__ import annotations

import os
import shutil
import tempfile
from typing import Any

import bpy

from . import lens_job, present, result_image
from .export_job import ExportJob
from .lens_job import LensJob
from .outcome import Outcome
from .shared import ExportError

TIMER_S = 0.2
CAMERA = "The camera object; empty: that of the panel, or the scene's"


class Runs:
    """An operator that runs one job at a time; a mix-in."""

    # The running operator of this class, for the panel.
    job: Any = None
    is_cancelled = False

    def begin(self, context: Any) -> Any:
        """The job. Raises `ExportError`."""
        raise NotImplementedError

    def end(self, context: Any, outcome: Outcome) -> None:
        """Called when the job is done. Raises `ExportError`."""
        raise NotImplementedError

    def execute(self, context: Any) -> set[str]:
        """Runs the job: to its end in the background, else as a modal operator."""
        cls = type(self)
        if cls.job is not None:
            self.report({"ERROR"}, f"error: {self.bl_label} is running already")
            return {"CANCELLED"}
        try:
            job = self.begin(context)
        except ExportError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if bpy.app.background or context.window is None:
            return self._finish(context, lens_job.wait(job))
        cls.job, cls.is_cancelled = job, False
        self._timer = context.window_manager.event_timer_add(TIMER_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Looks after the job; all events are for others too."""
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        cls = type(self)
        present.redraw(("PROPERTIES",))
        if cls.is_cancelled or cls.job is None:
            self.cancel(context)
            self.report({"INFO"}, f"{self.bl_label} cancelled")
            return {"CANCELLED"}
        outcome = cls.job.poll()
        if outcome is None:
            return {"PASS_THROUGH"}
        self._forget(context)
        return self._finish(context, outcome)

    def cancel(self, context: Any) -> None:
        """Ends the job. Blender calls this too, when a file is opened or the window is closed."""
        type(self).stop()
        self._forget(context)

    @classmethod
    def stop(cls) -> None:
        """Ends the job, if one runs."""
        if cls.job is not None:
            cls.job.stop()
        cls.job = None

    def say(self, text: str) -> None:
        """Tells the user."""
        self.report({"WARNING" if text.startswith("warning") else "INFO"}, text)

    def _forget(self, context: Any) -> None:
        type(self).job = None
        context.window_manager.event_timer_remove(self._timer)

    def _finish(self, context: Any, outcome: Outcome) -> set[str]:
        for line in outcome.warnings:
            self.report({"WARNING"}, line)
        if not outcome.is_done:
            self.report({"ERROR"}, outcome.text)
            return {"CANCELLED"}
        self.report({"INFO"}, outcome.text)
        try:
            self.end(context, outcome)
        except ExportError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class THINLENS_OT_export(Runs, bpy.types.Operator):
    """Renders a stack of this camera in a Blender in the background, from a copy of the file as it is now"""

    bl_idname = "thinlens.export"
    bl_label = "Export Stack"

    camera: bpy.props.StringProperty(name="Camera", description=CAMERA, options={"SKIP_SAVE"})

    def begin(self, context: Any) -> ExportJob:
        """Saves the copy and starts the background Blender."""
        camera = present.camera_of(context, self.camera)
        choices = present.choices(context.scene, camera)
        self._camera = camera.name
        folder = tempfile.mkdtemp(prefix="thinlens-export-")
        try:
            copy = present.save_copy(folder, self.say)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return ExportJob(present.host(), copy, choices, folder)

    def end(self, context: Any, outcome: Outcome) -> None:
        """Applies the lens, if the panel says so."""
        camera = present.camera_of(context, self._camera)
        own = camera.data.thinlens
        if own.apply_after and os.path.exists(_stack(context.scene, own)):
            bpy.ops.thinlens.apply(camera=self._camera)


def _stack(scene: Any, own: Any) -> str:
    return present.frames.path(present.absolute(own.stack, "stack"), scene.frame_current)


class THINLENS_OT_apply(Runs, bpy.types.Operator):
    """Gives the stack of the current frame the lens, and shows the picture as the image "thinlens" """

    bl_idname = "thinlens.apply"
    bl_label = "Apply Lens"

    camera: bpy.props.StringProperty(name="Camera", description=CAMERA, options={"SKIP_SAVE"})

    def begin(self, context: Any) -> LensJob:
        """Starts the program."""
        camera = present.camera_of(context, self.camera)
        run = present.lens_run(context.scene, camera, self.say)
        return LensJob(run.at(camera.data.thinlens.quality))

    def end(self, context: Any, outcome: Outcome) -> None:
        """Loads the picture."""
        result_image.show(outcome.path)


class THINLENS_OT_cancel(bpy.types.Operator):
    """Ends the export or the lens that is running; finished frames stay"""

    bl_idname = "thinlens.cancel"
    bl_label = "Cancel"

    def execute(self, context: Any) -> set[str]:
        """Marks the jobs; their operators end them."""
        for cls in (THINLENS_OT_export, THINLENS_OT_apply):
            cls.is_cancelled = True
        return {"FINISHED"}


_CLASSES = (THINLENS_OT_export, THINLENS_OT_apply, THINLENS_OT_cancel)


def running() -> Any:
    """The job that runs, or None."""
    return THINLENS_OT_export.job or THINLENS_OT_apply.job


def register() -> None:
    """Adds the operators."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Ends their jobs and removes them."""
    for cls in (THINLENS_OT_export, THINLENS_OT_apply):
        cls.stop()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
