# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Live re-lens: while it is on, the picture follows the camera's focus, f-stop, blades, rotation and ratio.

A timer looks at the camera ten times a second. So every way to change the lens is seen: a field, a key frame, the focus
object that moves, an undo.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from dataclasses import replace
from typing import Any

import bpy

from . import present, result_image
from .lens_job import DRAFT, FINAL, LensJob, LensRun
from .outcome import Outcome
from .relens import Level, Relens
from .shared import ExportError

TIMER_S = 0.1
IDLE = "waiting for the lens to change"


class Session:
    """Live re-lens of one camera, from being switched on to being switched off."""

    def __init__(self, scene: str, camera: str) -> None:
        """For the camera object and the scene of these names."""
        self.scene, self.camera = scene, camera
        # For the panel: what is shown, or the error.
        self.text = IDLE
        self.is_error = False
        self._folder = tempfile.mkdtemp(prefix="thinlens-live-")
        # The file of the last picture at final quality, there or not.
        self._result = ""
        self._relens = Relens(self._begin)

    @property
    def is_settled(self) -> bool:
        """Whether the picture of the present lens is there at final quality, or failed."""
        return self._relens.is_settled(self._lens())

    def tick(self) -> None:
        """Looks at the camera and at the job, and shows a picture that is ready."""
        outcome = self._relens.tick(self._lens(), time.monotonic())
        if outcome is not None:
            self._show(outcome)

    def stop(self) -> None:
        """Ends the job. The picture stays in Blender; the file of a draft goes."""
        self._relens.stop()
        if self._result:
            result_image.point_elsewhere(self._folder, self._result)
        shutil.rmtree(self._folder, ignore_errors=True)

    def _lens(self) -> tuple[LensRun, int] | None:
        """What is to be rendered now, with the time at which the stack was written; None if that is not possible."""
        try:
            scene = bpy.data.scenes.get(self.scene)
            if scene is None:
                raise ExportError("the scene is gone", found=self.scene, help="switch live re-lens on again")
            run = present.lens_run(scene, present.cameras.find(scene, self.camera), lambda text: None, is_live=True)
            return run, os.stat(run.stack).st_mtime_ns
        except (ExportError, OSError) as error:
            self._say(str(error), is_error=True)
            return None

    def _begin(self, lens: tuple[LensRun, int], level: Level) -> LensJob:
        run = lens[0]
        self._result = run.result
        if level is Level.FINAL:
            return LensJob(run.at(FINAL))
        return LensJob(replace(run.at(DRAFT), result=os.path.join(self._folder, "draft.exr")))

    def _show(self, outcome: Outcome) -> None:
        text = outcome.text
        if outcome.is_done:
            try:
                result_image.show(outcome.path)
                is_draft = outcome.path.startswith(self._folder)
                text = f"{'draft' if is_draft else 'final'}, {outcome.seconds:.1f} s"
            except ExportError as error:
                outcome, text = Outcome(False, str(error)), str(error)
        self._say(text, is_error=not outcome.is_done)

    def _say(self, text: str, *, is_error: bool) -> None:
        if (text, is_error) != (self.text, self.is_error):
            self.text, self.is_error = text, is_error
            present.redraw(("PROPERTIES",))


class _State:
    """The session that is on, if one is."""

    session: Session | None = None


def session() -> Session | None:
    """The session that is on, or None."""
    return _State.session


def stop() -> None:
    """Switches live re-lens off."""
    if _State.session is not None:
        _State.session.stop()
    _State.session = None
    if bpy.app.timers.is_registered(_on_timer):
        bpy.app.timers.unregister(_on_timer)


def start(scene: str, camera: str) -> Session:
    """Switches live re-lens on for a camera object of a scene."""
    stop()
    _State.session = Session(scene, camera)
    bpy.app.timers.register(_on_timer, first_interval=TIMER_S)
    return _State.session


def _on_timer() -> float | None:
    if _State.session is None:
        return None
    try:
        _State.session.tick()
    except BaseException:
        # Blender prints it and drops the timer.
        stop()
        raise
    return TIMER_S


@bpy.app.handlers.persistent
def _before_load(*_: Any) -> None:
    """Another file is opened: its camera is another one."""
    stop()


class THINLENS_OT_live(bpy.types.Operator):
    """Switches live re-lens on or off: the picture follows the camera's focus, f-stop, blades, rotation and ratio"""

    bl_idname = "thinlens.live"
    bl_label = "Live Re-Lens"

    camera: bpy.props.StringProperty(
        name="Camera", description="The camera object; empty: that of the panel, or the scene's", options={"SKIP_SAVE"}
    )

    def execute(self, context: Any) -> set[str]:
        """Switches it."""
        if session() is not None:
            stop()
            return {"FINISHED"}
        try:
            camera = present.camera_of(context, self.camera)
            present.lens_run(context.scene, camera, lambda text: self.report({"WARNING"}, text), is_live=True)
        except ExportError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        start(context.scene.name, camera.name)
        return {"FINISHED"}


def register() -> None:
    """Adds the switch."""
    bpy.utils.register_class(THINLENS_OT_live)
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    """Switches it off and removes it."""
    stop()
    if _before_load in bpy.app.handlers.load_pre:
        bpy.app.handlers.load_pre.remove(_before_load)
    bpy.utils.unregister_class(THINLENS_OT_live)
