"""What a scene's shapes are to the peels: which of their faces are inside, and which are hidden lamps."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from thinlens_stack import closed

from .lanes import is_scalar

# Shapes that are closed by themselves.
CLOSED = ("Sphere", "Ellipsoids", "SDFGrid", "BSplineCurve", "LinearCurve")


class Sides:
    """The outside of every face of a scene, as in `closed.outsides`; 0 for shapes in instances."""

    def __init__(self, scene: mi.Scene, viewpoint: np.ndarray) -> None:
        """`viewpoint` is the place of the camera in the world."""
        sides = {shape: _outsides(shape, viewpoint) for shape in scene.shapes()}
        if is_scalar():
            self.of_shape = sides
            return
        # The faces of all shapes one after the other; face 0 is that of unknown shapes.
        numbers = {shape: int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0]) for shape in sides}
        self.shapes = max(numbers.values(), default=0) + 1
        first, last = np.zeros(self.shapes, np.uint32), np.zeros(self.shapes, np.uint32)
        faces = [np.zeros(1, np.int8)]
        for shape, own in sides.items():
            first[numbers[shape]] = sum(map(len, faces))
            last[numbers[shape]] = first[numbers[shape]] + len(own) - 1
            faces.append(own)
        self.first, self.last = mi.UInt32(first), mi.UInt32(last)
        self.faces = mi.Float(np.concatenate(faces).astype(np.float32))

    def of(self, surface: mi.SurfaceInteraction3f) -> mi.Float:
        """The outside of the faces that were hit."""
        if is_scalar():
            own = self.of_shape.get(surface.shape, [0])
            return float(own[min(surface.prim_index, len(own) - 1)])
        number = dr.reinterpret_array(mi.UInt32, surface.shape)
        is_known = number < self.shapes
        first, last = (dr.gather(mi.UInt32, ends, number, is_known) for ends in (self.first, self.last))
        return dr.gather(mi.Float, self.faces, dr.minimum(first + surface.prim_index, last), is_known)


def _outsides(shape: mi.Shape, viewpoint: np.ndarray) -> np.ndarray:
    """The outside of a shape's faces; one for all where they are not triangles."""
    if mi.has_flag(shape.bsdf().flags(), mi.BSDFFlags.Null):
        # The far wall is seen through the near one.
        return np.zeros(1, np.int8)
    turned = -1 if shape.has_flipped_normals() else 1
    if shape.is_mesh():
        vertices = np.array(shape.vertex_positions_buffer()).reshape(-1, 3)
        return turned * closed.outsides(vertices, np.array(shape.faces_buffer()).reshape(-1, 3), viewpoint)
    if shape.class_name() not in CLOSED:
        return np.zeros(1, np.int8)
    box = shape.bbox()
    low, high = np.array(box.min).reshape(-1), np.array(box.max).reshape(-1)
    middle, half = (low + high) / 2, (high - low) / 2
    # The ellipsoid in the box; for other shapes than spheres a guess. Inside, both sides are kept.
    is_outside = (((viewpoint - middle) / np.maximum(half, 1e-30)) ** 2).sum() > 1.0
    return np.array([turned if is_outside else 0], np.int8)


def has_media(scene: mi.Scene) -> bool:
    """Whether there is fog, smoke or the like in the scene."""
    media = [medium for shape in scene.shapes() for medium in (shape.interior_medium(), shape.exterior_medium())]
    return any(medium is not None for medium in [*media, *(sensor.get_medium() for sensor in scene.sensors())])
