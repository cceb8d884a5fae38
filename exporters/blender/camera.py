# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The camera: its frame, its lens, and the pinhole camera that stands in for it while peels are rendered."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import bpy

from .journal import Journal
from .settings import Say
from .shared import ExportError, lens

# Cycles reads one blade as a disc and two as three.
BLADES = {1: 0, 2: 3}
LARGEST_SQUEEZE = 4.0


@dataclass(frozen=True)
class View:
    """The frame of a camera. Pixels are those of the picture that the user renders."""

    width: int
    height: int
    # Width over height of a pixel.
    pixel_aspect: float
    # Of the sensor's part that the frame's width shows.
    sensor_width_mm: float
    # Of the frame against the optical axis: to the right and up, in pixel widths.
    shift_px: tuple[float, float]

    def pixels_per_slope(self, focal_length_mm: float) -> float:
        """Pixel widths per unit of x/z: the focal length in pixels."""
        return self.width * focal_length_mm / self.sensor_width_mm


def find(scene: Any, name: str | None) -> Any:
    """The camera object `name`, or that of the scene.

    Raises `ExportError` if there is none, or if its lens is not a perspective one.
    """
    camera = scene.camera if name is None else scene.objects.get(name)
    if camera is None or camera.type != "CAMERA":
        found = "no camera" if name is None else f'"{name}"'
        cameras = ", ".join(ob.name for ob in scene.objects if ob.type == "CAMERA") or "a camera in the scene"
        raise ExportError("the scene has no such camera", where=f"scene {scene.name}", found=found, wanted=cameras)
    if camera.data.type != "PERSP":
        raise ExportError(
            "only a perspective camera has a lens that thinlens knows",
            where=f"camera {camera.name}",
            found=camera.data.type.lower(),
            help="set the camera's lens to Perspective",
        )
    return camera


def view_of(scene: Any, camera: Any) -> View:
    """The frame of `camera` in `scene`."""
    render, data = scene.render, camera.data
    width, height = (
        max(1, size * render.resolution_percentage // 100) for size in (render.resolution_x, render.resolution_y)
    )
    aspect = render.pixel_aspect_x / render.pixel_aspect_y
    fit = data.sensor_fit
    if fit == "AUTO":
        fit = "HORIZONTAL" if width * aspect >= height else "VERTICAL"
    sensor_width = lens.sensor_width_mm(
        data.sensor_fit, data.sensor_width, data.sensor_height, (width * aspect, float(height))
    )
    # A shift of 1 is the side that the sensor is fitted to.
    side = width if fit == "HORIZONTAL" else height / aspect
    return View(width, height, aspect, sensor_width, (data.shift_x * side, data.shift_y * side))


def focus_distance(camera: Any) -> float:
    """Planar distance of the focus, in scene units: of the focus object's origin or of the bone, if there is one."""
    dof = camera.data.dof
    target = dof.focus_object
    if target is None:
        return float(dof.focus_distance)
    matrix = target.matrix_world
    if target.type == "ARMATURE" and dof.focus_subtarget in target.pose.bones:
        matrix = matrix @ target.pose.bones[dof.focus_subtarget].matrix
    own = camera.matrix_world.normalized()
    return float(abs((matrix.translation - own.translation).dot(own.col[2].xyz)))


def checked_focus_distance(camera: Any) -> float:
    """`focus_distance`. Raises `ExportError` if nothing can be in focus there."""
    distance = focus_distance(camera)
    if distance > 0.0:
        return distance
    raise ExportError(
        "the camera is focused on itself",
        where=f"camera {camera.name}",
        found=f"focus distance {distance:g}",
        wanted="a distance above 0",
        help="set the focus distance, or choose another focus object",
    )


def lens_of(camera: Any, view: View, say: Say) -> Any:
    """The lens of `camera` as the stack's header has it; `say` is told what cannot be written."""
    data = camera.data
    dof = data.dof
    squeeze = dof.aperture_ratio
    if not 1.0 <= squeeze <= LARGEST_SQUEEZE:
        say(f"warning: the aperture's ratio {squeeze:g} is not offered by thinlens (1 to 4); the stack has ratio 1")
        squeeze = 1.0
    if not dof.use_dof:
        say(f"note: depth of field is off in camera {camera.name}; its lens is written all the same")
    # Without depth of field the focus may never have been set.
    distance = checked_focus_distance(camera) if dof.use_dof else focus_distance(camera)
    return lens.Lens(
        focal_length_mm=data.lens,
        sensor_width_mm=view.sensor_width_mm,
        f_number=dof.aperture_fstop if dof.aperture_fstop > 0 else math.inf,
        focus_distance=distance if distance > 0.0 else None,
        blades=BLADES.get(dof.aperture_blades, dof.aperture_blades),
        rotation_deg=math.degrees(dof.aperture_rotation),
        squeeze=squeeze,
    )


def stand_in(scene: Any, camera: Any, journal: Journal) -> Any:
    """A pinhole camera in the place of `camera`, now the scene's; returns its data.

    It is not animated: a render would set the animated values again. Markers do not switch cameras meanwhile.
    """
    data = journal.made(bpy.data.cameras, camera.data.copy())
    data.animation_data_clear()
    data.dof.use_dof = False
    own = journal.made(bpy.data.objects, bpy.data.objects.new("thinlens camera", data))
    own.matrix_world = camera.matrix_world.normalized()
    for marker in scene.timeline_markers:
        journal.set(marker, "camera", None)
    journal.set(scene, "camera", own)
    return data


def aim(scene: Any, data: Any, view: View, overscan: int, size: tuple[int, int]) -> None:
    """Makes the scene's next render one of `size` pixels: the frame with `overscan` picture pixels around it."""
    wide = view.width + 2 * overscan
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = view.sensor_width_mm * wide / view.width
    data.shift_x, data.shift_y = (shift / wide for shift in view.shift_px)
