# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The picture with the lens in Blender: one image datablock, loaded again in place."""

from __future__ import annotations

from typing import Any

import bpy

from . import present
from .shared import ExportError

NAME = "thinlens"


def show(path: str) -> Any:
    """Loads the picture at `path` into the image `thinlens`, and shows it in an Image Editor that is open.

    Returns the image. Raises `ExportError` if Blender cannot load it.
    """
    image = bpy.data.images.get(NAME)
    try:
        if image is None:
            image = bpy.data.images.load(path, check_existing=False)
            image.name = NAME
        else:
            image.source = "FILE"
            image.filepath = path
            image.reload()
    except RuntimeError as error:
        raise ExportError("Blender cannot load the picture", where=path, found=str(error).strip()) from error
    _put_into_editor(image)
    present.redraw(("IMAGE_EDITOR", "PROPERTIES", "NODE_EDITOR"))
    return image


def point_elsewhere(folder: str, path: str) -> None:
    """Lets the image refer to `path`, if its file is in `folder`, which is going. Its pixels stay as they are."""
    image = bpy.data.images.get(NAME)
    if image is not None and image.filepath.startswith(folder):
        image.filepath_raw = path


def _put_into_editor(image: Any) -> None:
    """Shows `image` in the largest Image Editor, unless one shows it already."""
    manager = bpy.context.window_manager
    windows = manager.windows if manager else ()
    areas = [area for window in windows if window.screen for area in window.screen.areas]
    editors = [area for area in areas if area.type == "IMAGE_EDITOR"]
    if not editors or any(area.spaces.active.image == image for area in editors):
        return
    max(editors, key=lambda area: area.width * area.height).spaces.active.image = image
