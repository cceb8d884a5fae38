"""Scenes of lamps and cards whose peels are known, for the tests of the Mitsuba exporter.

A variant of Mitsuba must be set before this is imported.
"""

import mitsuba as mi
import numpy as np

# The camera looks from the origin along -z; the frame's width is seen under 40°.
FIELD_DEG = 40.0


def to_world():
    """The camera's transform."""
    return mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, -1], [0, 1, 0])


def sensor(width: int, height: int, **parameters) -> dict:
    """A pinhole of the given film size; `parameters` are added or replace others."""
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    film |= {name: parameters.pop(name) for name in list(parameters) if name.startswith("crop_")}
    own = {"type": "perspective", "fov": FIELD_DEG, "fov_axis": "x", "to_world": to_world(), "film": film}
    return own | parameters


def load(objects: list[dict], camera: dict, integrator: str = "path", **parameters) -> mi.Scene:
    """A scene of `objects`, seen by `camera`."""
    return mi.load_dict(
        {"type": "scene", "light": {"type": integrator, **parameters}, "camera": camera}
        | {f"object{i}": shape for i, shape in enumerate(objects)}
    )


def lamp(depth: float, color: tuple[float, float, float], scale: float = 100.0, x: float = 0.0, y: float = 0.0) -> dict:
    """A black square of half side `scale` that shines towards the camera, at planar distance `depth`."""
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([x, y, -depth]).scale(scale),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(color)}},
    }


def card(depth: float, bsdf: dict, turned: bool = False) -> dict:
    """A square over the whole frame, at planar distance `depth`; `turned` shows the camera its back."""
    transform = mi.ScalarTransform4f().translate([0, 0, -depth]).scale(100.0)
    if turned:
        transform = transform.rotate([0, 1, 0], 180)
    return {"type": "rectangle", "to_world": transform, "bsdf": bsdf}


def sky(value: float) -> dict:
    """An environment of one colour."""
    return {"type": "constant", "radiance": value}


def black() -> dict:
    """A material that reflects nothing, on both sides."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.0}}


def middle(layers) -> list[tuple[tuple[float, float, float], float, float]]:
    """The fragments `(colour, alpha, depth)` in the middle of the picture, without empty ones."""
    row, column = (length // 2 for length in layers[0].alpha.shape)
    found = [(layer.color[row, column], layer.alpha[row, column], layer.depth[row, column]) for layer in layers]
    return [(tuple(np.round(c, 4).tolist()), float(a), float(d)) for c, a, d in found if a > 0.0]
