"""What a scene's shapes are to the peels: which of their faces are inside, and which are hidden lamps."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from thinlens_stack import closed

from .lanes import is_scalar

# Shapes that are closed by themselves.
CLOSED = ("Sphere", "Ellipsoids", "SDFGrid", "BSplineCurve", "LinearCurve")
# Both sides of a shape's faces are outside.
BOTH = np.zeros(1, np.int8)


class Sides:
    """The outside of every face of a scene, as in `closed.outsides`."""

    def __init__(self, scene: mi.Scene, viewpoint: np.ndarray) -> None:
        """`viewpoint` is the place of the camera in the world."""
        # Of the shapes of the scene, and of those that instances repeat as they are met.
        self.of_shape = {shape: _outsides(shape, viewpoint) for shape in scene.shapes()}
        if not is_scalar():
            self._tabulate()

    def _tabulate(self) -> None:
        """Lists the faces of all shapes one after the other, for look-ups by the number of a shape."""
        sides = [self._outsides(shape) for shape in _registered()]
        ends = np.cumsum([len(own) for own in sides])
        self.first = mi.UInt32(np.concatenate([[0], ends[:-1]]).astype(np.uint32))
        self.last = mi.UInt32((ends - 1).astype(np.uint32))
        self.faces = mi.Float(np.concatenate(sides).astype(np.float32))
        self.shapes = len(sides)

    def _outsides(self, shape: mi.Shape | None) -> np.ndarray:
        """The outside of a shape's faces. That of a shape in instances is judged as from far away."""
        if shape not in self.of_shape:
            self.of_shape[shape] = BOTH if shape is None else _outsides(shape, None)
        return self.of_shape[shape]

    def of(self, surface: mi.SurfaceInteraction3f) -> mi.Float:
        """The outside of the faces that were hit."""
        if is_scalar():
            own = self._outsides(surface.shape)
            return float(own[min(surface.prim_index, len(own) - 1)])
        number = dr.reinterpret_array(mi.UInt32, surface.shape)
        is_known = number < self.shapes
        first, last = (dr.gather(mi.UInt32, ends, number, is_known) for ends in (self.first, self.last))
        return dr.gather(mi.Float, self.faces, dr.minimum(first + surface.prim_index, last), is_known)


def _registered() -> list[mi.Shape | None]:
    """All shapes by their number in vectorised variants; None for numbers without a shape, such as 0."""
    shapes: list[mi.Shape | None] = [None]
    while True:
        try:
            shapes.append(dr.reinterpret_array(mi.ShapePtr, mi.UInt32(len(shapes)))[0])
        except RuntimeError:
            # Beyond the last number.
            return shapes


def _outsides(shape: mi.Shape, viewpoint: np.ndarray | None) -> np.ndarray:
    """The outside of a shape's faces; one for all where they are not triangles."""
    bsdf = shape.bsdf()
    if bsdf is None or mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null):
        # Instances have no faces of their own. Where light passes straight on, the far wall is seen through the near
        # one.
        return BOTH
    turned = -1 if shape.has_flipped_normals() else 1
    values = mi.traverse(shape)
    if "faces" in values:
        vertices, faces = (np.array(values[name]).reshape(-1, 3) for name in ("vertex_positions", "faces"))
        return turned * closed.outsides(vertices, faces, viewpoint)
    if shape.class_name() not in CLOSED:
        return BOTH
    if viewpoint is None:
        return np.array([turned], np.int8)
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
