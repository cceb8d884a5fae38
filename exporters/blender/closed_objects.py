# SPDX-License-Identifier: GPL-3.0-or-later
"""Marks the closed meshes of a scene, so that peels leave out their inside."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

from .journal import Journal
from .materials import is_transparent
from .peel_nodes import SIDE
from .settings import Say
from .shared import closed

# Custom property of an object by which the user overrules: true is closed, false open.
OVERRIDE = "thinlens_closed"
# Types of objects whose evaluated form is a mesh.
SOLID = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
# A mesh is of one kind if all but this share of its area is.
OTHER_AREA = 1e-3
# 36 π V²/A³ is 1 for a ball; with less than this, faces lie on each other and enclose nothing.
LEAST_ROUNDNESS = 1e-10


@dataclass
class Faces:
    """The faces of a mesh: which side of each is out (+1 front, -1 back, 0 both), and its area."""

    side: np.ndarray
    area: np.ndarray

    def common_side(self) -> float:
        """The side that all faces have, but for a negligible area; 0 if there is none."""
        for side in (1.0, -1.0):
            if self.area[self.side != side].sum() <= OTHER_AREA * self.area.sum():
                return side
        return 0.0


def mark(depsgraph: Any, eye: Any, journal: Journal, say: Say) -> int:
    """Marks every closed mesh as seen from `eye`, a point of the world. Returns how many objects have one.

    Meshes that let light through keep their inside: it is seen.
    """
    matrices: dict[Any, list[Any]] = defaultdict(list)
    for instance in depsgraph.object_instances:
        if instance.object.type in SOLID:
            matrices[instance.object.original].append(instance.matrix_world.inverted_safe())
    marked = 0
    for ob, own in matrices.items():
        eyes = np.array([tuple(matrix @ eye) for matrix in own], np.float64)
        marked += _mark_object(ob, ob.evaluated_get(depsgraph), eyes, journal, say)
    return marked


def _mark_object(ob: Any, evaluated: Any, eyes: np.ndarray, journal: Journal, say: Say) -> bool:
    """Marks one object, which is seen from `eyes` in its own space; whether it has a closed piece."""
    if OVERRIDE in ob and not ob[OVERRIDE]:
        return False
    mesh = evaluated.to_mesh()
    if mesh is None:
        return False
    try:
        faces = _faces(evaluated, mesh, eyes)
    finally:
        evaluated.to_mesh_clear()
    if OVERRIDE in ob:
        journal.set_custom(ob, SIDE, -1.0 if (faces.side * faces.area).sum() < 0 else 1.0)
        return True
    if not faces.side.any():
        return False
    if common := faces.common_side():
        journal.set_custom(ob, SIDE, common)
        return True
    return _mark_faces(ob, faces, eyes, journal, say)


def _mark_faces(ob: Any, faces: Faces, eyes: np.ndarray, journal: Journal, say: Say) -> bool:
    """Marks the faces of an object some of whose pieces are closed; whether it could be done."""
    if ob.type != "MESH":
        say(f"note: parts of {ob.name} are closed and others open; all count as open (set {OVERRIDE} to overrule)")
        return False
    if len(faces.side) != len(ob.data.polygons):
        # Modifiers give the attribute of the mesh that they change to the faces that come of it.
        faces = _faces(ob, ob.data, eyes)
    if SIDE not in ob.data.attributes:
        _set_attribute(ob.data, faces.side, journal)
    return True


def _set_attribute(mesh: Any, side: np.ndarray, journal: Journal) -> None:
    """Gives the faces of `mesh` their side."""
    journal.remember(mesh.attributes, "active_index")
    attribute = mesh.attributes.new(SIDE, "FLOAT", "FACE")
    journal.on_restore(lambda: mesh.attributes.remove(mesh.attributes[SIDE]))
    attribute.data.foreach_set("value", side.astype(np.float32))


def _faces(ob: Any, mesh: Any, eyes: np.ndarray) -> Faces:
    """The faces of `mesh` with the materials of `ob`, as seen from `eyes`."""
    points, triangles, face = _triangles(mesh)
    count = len(mesh.polygons)
    if len(triangles) == 0:
        return Faces(np.zeros(count), np.zeros(count))
    corners = points[triangles] - points.mean(axis=0)
    vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(vectors, axis=1)
    volume = (corners[:, 0] * vectors).sum(axis=1) / 3.0
    side = np.zeros(count)
    side[face] = _sides(points, triangles, eyes)
    is_closed = side[face] != 0.0
    if 36.0 * np.pi * volume[is_closed].sum() ** 2 < LEAST_ROUNDNESS * area[is_closed].sum() ** 3:
        side[:] = 0.0
    side[_clear_faces(ob, mesh)] = 0.0
    return Faces(side, np.bincount(face, area, count))


def _sides(points: np.ndarray, triangles: np.ndarray, eyes: np.ndarray) -> np.ndarray:
    """Which side of each triangle is out, seen from all `eyes`: both where one of them is inside."""
    low, high = points.min(axis=0), points.max(axis=0)
    near = eyes[((eyes >= low) & (eyes <= high)).all(axis=1)]
    outside = high + np.maximum(high - low, 1e-6)
    sides = closed.outsides(points, triangles, outside)
    for eye in near:
        sides = np.where(closed.outsides(points, triangles, eye) == 0, 0, sides)
    return sides


def _triangles(mesh: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices `[n][3]`, triangles `[m][3]` and the face of each triangle."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    mesh.calc_loop_triangles()
    triangles = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    face = np.empty(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("polygon_index", face)
    return points.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3).astype(np.int64), face


def _clear_faces(ob: Any, mesh: Any) -> np.ndarray:
    """For each face of `mesh`, whether its material may let through what is behind it."""
    material = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", material)
    slots = [slot.material for slot in ob.material_slots] or list(mesh.materials)
    clear = [bool(slot and slot.node_tree and is_transparent(slot.node_tree)) for slot in slots] or [False]
    return np.array(clear)[np.clip(material, 0, len(clear) - 1)]
