"""Further channels of each peel, for reflections that the lens moves: how a surface reflects, and what.

- `Diffuse.R` `.G` `.B`: the colour without what the surface reflects specularly; premultiplied. Merged as colour.
- `Reflection.R` `.G` `.B`: the part of the specular light that came from surfaces and near lamps; premultiplied. The
  rest, Combined − Diffuse − Reflection, came from the environment. Merged as colour.
- `Normal.X` `.Y` `.Z`: the shading normal in the camera's axes: right, up, towards the viewer. Mean, of length 1.
- `ReflectedDistance.V`: along the mirrored ray, in scene units; 1e10 if it meets nothing. Harmonic mean.
- `Specular.R` `.G` `.B`: the reflectance at normal incidence. Mean.
- `Roughness.V`: the root of the GGX α. Mean.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .lens import NOTHING_HIT
from .merge import Layer

DIFFUSE = tuple(f"Diffuse.{name}" for name in "RGB")
REFLECTION = tuple(f"Reflection.{name}" for name in "RGB")
NORMAL = tuple(f"Normal.{name}" for name in "XYZ")
SPECULAR = tuple(f"Specular.{name}" for name in "RGB")
ROUGHNESS = "Roughness.V"
# Until the layers are merged, this channel has the inverse of the distance.
DISTANCE = "ReflectedDistance.V"


def finish(layers: Sequence[Layer]) -> None:
    """Gives merged layers normals of length 1, and distances in place of their inverse.

    Layers without these channels stay as they are.
    """
    for layer in layers:
        if DISTANCE not in layer.means:
            continue
        normal = np.stack([layer.means[name] for name in NORMAL])
        length = np.linalg.norm(normal, axis=0)
        for name, plane in zip(NORMAL, normal / np.where(length > 0.0, length, 1.0), strict=True):
            layer.means[name] = plane.astype(np.float32)
        inverse = np.maximum(layer.means[DISTANCE], 1.0 / NOTHING_HIT)
        layer.means[DISTANCE] = (1.0 / inverse).astype(np.float32)
