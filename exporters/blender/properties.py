# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""What the panel stores in the file: on each camera how it is exported, on each scene the post step."""

from __future__ import annotations

from typing import Any

import bpy

from .lens_job import DRAFT, FINAL, PREVIEW, REFERENCE
from .settings import COVERAGE, MOST_PEELS, MOST_SUPERSAMPLE, POINT, SUPER

# The lens of a stack: the camera's as it is now, or the one in the file's header.
LENS_CAMERA, LENS_FILE = "CAMERA", "FILE"
FRAMES_CURRENT, FRAMES_RANGE = "CURRENT", "RANGE"
# A switch that can be left to the scene.
AS_SCENE, ON, OFF = "SCENE", "ON", "OFF"
# Blender from 4.5 on wants to be told that a path may begin with "//".
_PATH = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()
# Overscan as the blur needs it.
OVERSCAN_AUTO = -1

_THREE_WAYS = (
    (AS_SCENE, "As Scene", "As the scene is set up"),
    (ON, "On", "On"),
    (OFF, "Off", "Off"),
)
_KINDS = (
    (COVERAGE, "Coverage", "Averages over the pixel: small files, smooth edges"),
    (POINT, "Point", "One sample in the pixel's centre"),
    (SUPER, "Supersampled", "All samples of the pixel, unmerged: large files"),
)
_FRAMES = (
    (FRAMES_CURRENT, "Current Frame", "The current frame"),
    (FRAMES_RANGE, "Frame Range", "All frames of the scene's frame range, with its step"),
)
_LENSES = (
    (LENS_CAMERA, "Camera", "Focus, f-stop, blades, rotation and ratio of the camera as they are now"),
    (LENS_FILE, "Stack", "The lens that the stack was exported with"),
)
_QUALITIES = (
    (DRAFT, "Draft", "35 dB, or what 64 lens samples reach"),
    (PREVIEW, "Preview", "40 dB, or what 128 lens samples reach"),
    (FINAL, "Final", "45 dB, or what 256 lens samples reach"),
    (REFERENCE, "Reference", "55 dB, or what 4096 lens rays reach: slow"),
)


class ThinlensCamera(bpy.types.PropertyGroup):
    """Of a camera: `camera.data.thinlens`."""

    stack: bpy.props.StringProperty(
        name="Stack",
        description="The file of the stack. # is replaced by the frame number",
        subtype="FILE_PATH",
        options=_PATH,
        default="//stacks/stack.####.exr",
    )
    result: bpy.props.StringProperty(
        name="Result",
        description="The OpenEXR file of the picture with the lens. # is replaced by the frame number",
        subtype="FILE_PATH",
        options=_PATH,
        default="//lens/lens.####.exr",
    )
    frames: bpy.props.EnumProperty(name="Frames", items=_FRAMES, default=FRAMES_CURRENT)
    overwrite: bpy.props.BoolProperty(
        name="Overwrite", description="Export frames of a range again whose stack is there", default=False
    )
    peels: bpy.props.IntProperty(
        name="Peels", description="Most surfaces behind each other", default=4, min=1, max=MOST_PEELS
    )
    kind: bpy.props.EnumProperty(name="Kind", description="What a stack's samples are", items=_KINDS, default=COVERAGE)
    supersample: bpy.props.IntProperty(
        name="Places",
        description="Places in a pixel along each axis where the scene is sampled",
        default=2,
        min=1,
        max=MOST_SUPERSAMPLE,
    )
    samples: bpy.props.IntProperty(
        name="Samples", description="Light samples of a pixel in all; 0: as many as the scene has", default=0, min=0
    )
    overscan: bpy.props.IntProperty(
        name="Overscan",
        description="Pixels around the frame; -1: as many as the blur needs",
        default=OVERSCAN_AUTO,
        min=OVERSCAN_AUTO,
        soft_max=1024,
    )
    denoise: bpy.props.EnumProperty(name="Denoise", description="Denoise each peel", items=_THREE_WAYS)
    background: bpy.props.EnumProperty(name="World", description="The world as the last peel", items=_THREE_WAYS)
    cryptomatte: bpy.props.BoolProperty(name="Cryptomatte", description="Write object mattes", default=True)
    shading: bpy.props.BoolProperty(
        name="Reflections", description="Write the channels by which the lens moves reflections", default=False
    )
    view_layer: bpy.props.StringProperty(name="View Layer", description="Empty: the first that is rendered")
    apply_after: bpy.props.BoolProperty(
        name="Apply Lens After",
        description="Apply the lens to the stack of the current frame when it is exported",
        default=True,
    )
    lens: bpy.props.EnumProperty(name="Lens", description="The lens that is applied", items=_LENSES)
    quality: bpy.props.EnumProperty(name="Quality", items=_QUALITIES, default=FINAL)


class ThinlensScene(bpy.types.PropertyGroup):
    """Of a scene: `scene.thinlens`."""

    use_post_step: bpy.props.BoolProperty(
        name="After Render",
        description="Apply the lens to each OpenEXR frame with depth that a render writes, into a file beside it",
        default=False,
    )
    post_suffix: bpy.props.StringProperty(
        name="Suffix", description="Of the file beside the frame: NAME.lens.exr", default=".lens"
    )


def is_on(choice: str) -> bool | None:
    """A three-way switch; None is as the scene has it."""
    return {ON: True, OFF: False}.get(choice)


_OWNERS: tuple[tuple[Any, Any], ...] = ((bpy.types.Camera, ThinlensCamera), (bpy.types.Scene, ThinlensScene))


def register() -> None:
    """Adds the properties."""
    for owner, cls in _OWNERS:
        bpy.utils.register_class(cls)
        owner.thinlens = bpy.props.PointerProperty(type=cls)


def unregister() -> None:
    """Removes them. Values that were set stay in the file, unseen."""
    for owner, cls in reversed(_OWNERS):
        del owner.thinlens
        bpy.utils.unregister_class(cls)
