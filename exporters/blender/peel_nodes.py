# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The node group that decides which surfaces the camera sees in a peel.

It compares a surface's distance with that of the peel before it, or of the peel itself, which an image holds for each
pixel. Only camera rays ask it: light, shadows and reflections see the whole scene.
"""

from __future__ import annotations

from enum import Enum
from typing import Any

import bpy
import numpy as np

from .journal import Journal

# Attributes that say that a surface belongs to a closed mesh: of an object, and of faces. Their value is +1 where
# normals point out, -1 where they point in, 0 for an open surface.
SIDE = "thinlens_side"
# Two surfaces nearer to each other than this share of their distance are one: twice the error of a float distance
# through a camera's matrices.
DEPTH_ROUNDING = 2e-5
# Width of the pixel filter, the smallest that Cycles takes. One ray in 500 strays farther, up to half a pixel.
FILTER_WIDTH_PX = 0.01
# How far a ray is off its pixel's centre is known to this, from window coordinates in floats. The factor allows for
# curved surfaces.
OFFSET_ERROR_PX = 0.004
OFFSET_FACTOR = 1.2
# Smallest cosine between ray and surface normal: grazing surfaces are taken as this steep.
SMALLEST_COSINE = 0.01


class Show(Enum):
    """Which surfaces the camera sees."""

    # Those behind the distances.
    BEHIND = 0.0
    # Those at the distances.
    AT = 1.0


class PeelNodes:
    """The node group, with the image of distances that it looks up in window coordinates."""

    def __init__(self, size: tuple[int, int], pixels_per_slope: float, journal: Journal) -> None:
        """For a render of `size` pixels with this focal length in pixels. The journal removes what is made."""
        self.size = size
        images = bpy.data.images
        self.image = journal.made(
            images, images.new("thinlens peel depth", *size, alpha=False, float_buffer=True, is_data=True)
        )
        groups = bpy.data.node_groups
        self.group = journal.made(groups, groups.new("thinlens peel", "ShaderNodeTree"))
        self._build(Maths(self.group), pixels_per_slope)

    def select(self, show: Show, depth: np.ndarray | float) -> None:
        """Shows the surfaces behind or at `depth`: planar distances `[height][width]`, row 0 on top, or one for all."""
        width, height = self.size
        pixels = np.empty((height, width, 4), np.float32)
        pixels[...] = depth[::-1, :, None] if isinstance(depth, np.ndarray) else depth
        self.image.pixels.foreach_set(pixels.reshape(-1))
        self.image.update()
        self._show.outputs[0].default_value = show.value

    def _build(self, maths: Maths, pixels_per_slope: float) -> None:
        self.group.interface.new_socket("Show", in_out="OUTPUT", socket_type="NodeSocketFloat")
        self._show = maths.node("ShaderNodeValue")
        distance = maths.node("ShaderNodeCameraData").outputs["View Z Depth"]
        visible = maths.op("MULTIPLY", self._selected(maths, distance, pixels_per_slope), _outside(maths))
        is_camera = maths.node("ShaderNodeLightPath").outputs["Is Camera Ray"]
        shown = maths.op("MAXIMUM", visible, maths.op("SUBTRACT", 1.0, is_camera))
        maths.link(shown, maths.node("NodeGroupOutput").inputs[0])

    def _selected(self, maths: Maths, distance: Any, pixels_per_slope: float) -> Any:
        """1 for surfaces behind or at the distance of the image, as selected."""
        window = maths.node("ShaderNodeTexCoord").outputs["Window"]
        texture = maths.node("ShaderNodeTexImage")
        texture.image, texture.interpolation, texture.extension = self.image, "Closest", "EXTEND"
        maths.link(window, texture.inputs[0])
        split = maths.node("ShaderNodeSeparateColor")
        maths.link(texture.outputs[0], split.inputs[0])
        wanted = split.outputs[0]
        behind = maths.op("GREATER_THAN", distance, maths.op("MULTIPLY", wanted, 1.0 + DEPTH_ROUNDING))
        # The distance is that of the ray through the pixel's centre. On a slanted surface, that of this ray differs.
        offset = maths.op("MULTIPLY_ADD", self._offset_px(maths, window), OFFSET_FACTOR, OFFSET_ERROR_PX)
        slope = maths.op("DIVIDE", maths.op("DIVIDE", offset, pixels_per_slope), _cosine(maths))
        tolerance = maths.op("MULTIPLY", wanted, maths.op("ADD", slope, DEPTH_ROUNDING))
        difference = maths.op("ABSOLUTE", maths.op("SUBTRACT", distance, wanted))
        at = maths.op("LESS_THAN", difference, tolerance)
        share = self._show.outputs[0]
        return maths.op(
            "ADD", maths.op("MULTIPLY", behind, maths.op("SUBTRACT", 1.0, share)), maths.op("MULTIPLY", at, share)
        )

    def _offset_px(self, maths: Maths, window: Any) -> Any:
        """How far the ray is off the centre of its pixel, in pixels."""
        pixel = maths.vector("MULTIPLY", window, (*self.size, 0.0))
        centred = maths.vector("SUBTRACT", maths.vector("FRACTION", pixel), (0.5, 0.5, 0.0))
        return maths.vector("LENGTH", centred)


class Maths:
    """Adds nodes to a tree."""

    def __init__(self, tree: Any) -> None:
        self.tree = tree

    def node(self, kind: str) -> Any:
        return self.tree.nodes.new(kind)

    def link(self, output: Any, target: Any) -> None:
        self.tree.links.new(output, target)

    def op(self, operation: str, *operands: Any) -> Any:
        """The output of a math node; operands are numbers or outputs."""
        node = self.node("ShaderNodeMath")
        node.operation = operation
        for target, operand in zip(node.inputs, operands, strict=False):
            if isinstance(operand, int | float):
                target.default_value = operand
            else:
                self.link(operand, target)
        return node.outputs[0]

    def vector(self, operation: str, *operands: Any) -> Any:
        """The output of a vector math node; operands are triples or outputs."""
        node = self.node("ShaderNodeVectorMath")
        node.operation = operation
        for target, operand in zip(node.inputs, operands, strict=False):
            if isinstance(operand, tuple):
                target.default_value = operand
            else:
                self.link(operand, target)
        return node.outputs["Value" if operation in ("LENGTH", "DOT_PRODUCT") else "Vector"]


def _cosine(maths: Maths) -> Any:
    """Cosine of the angle between ray and surface normal, at least `SMALLEST_COSINE`."""
    geometry = maths.node("ShaderNodeNewGeometry")
    dot = maths.vector("DOT_PRODUCT", geometry.outputs["True Normal"], geometry.outputs["Incoming"])
    return maths.op("MAXIMUM", maths.op("ABSOLUTE", dot), SMALLEST_COSINE)


def _outside(maths: Maths) -> Any:
    """0 for the inner faces of closed meshes, 1 for all others."""
    sides = []
    for kind in ("OBJECT", "GEOMETRY"):
        attribute = maths.node("ShaderNodeAttribute")
        attribute.attribute_type, attribute.attribute_name = kind, SIDE
        sides.append(attribute.outputs["Fac"])
    backfacing = maths.node("ShaderNodeNewGeometry").outputs["Backfacing"]
    # +1 where the front of the face is seen, -1 where its back is.
    seen = maths.op("SUBTRACT", 1.0, maths.op("MULTIPLY", backfacing, 2.0))
    product = maths.op("MULTIPLY", maths.op("ADD", *sides), seen)
    return maths.op("GREATER_THAN", product, -0.5)
