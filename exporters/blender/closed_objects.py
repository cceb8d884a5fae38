# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
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


class Geometry:
    """A copy of a mesh, with the matrices from the world into each of its instances."""

    def __init__(self, ob: Any, mesh: Any) -> None:
        """`mesh` with the materials of `ob`."""
        self.count = len(mesh.polygons)
        self.points, self.triangles, self.face = _triangles(mesh)
        self.clear = _clear_faces(ob, mesh)
        self.matrices: list[Any] = []

    def faces(self, eye: Any) -> Faces:
        """The faces as seen from `eye`, a point of the world, in all instances."""
        if len(self.triangles) == 0:
            return Faces(np.zeros(self.count), np.zeros(self.count))
        eyes = np.array([tuple(matrix @ eye) for matrix in self.matrices], np.float64).reshape(-1, 3)
        corners = self.points[self.triangles] - self.points.mean(axis=0)
        vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(vectors, axis=1)
        volume = (corners[:, 0] * vectors).sum(axis=1) / 3.0
        side = np.zeros(self.count)
        side[self.face] = _sides(self.points, self.triangles, eyes)
        is_closed = side[self.face] != 0.0
        if 36.0 * np.pi * volume[is_closed].sum() ** 2 < LEAST_ROUNDNESS * area[is_closed].sum() ** 3:
            side[:] = 0.0
        side[self.clear] = 0.0
        return Faces(side, np.bincount(self.face, area, self.count))


def mark(depsgraph: Any, eye: Any, journal: Journal, say: Say) -> int:
    """Marks every closed mesh as seen from `eye`, a point of the world. Returns how many objects have one.

    Meshes that let light through keep their inside: it is seen.
    """
    geometries = _geometries(depsgraph)
    return sum(_mark_object(ob, own, eye, journal, say) for ob, own in geometries.items())


def _geometries(depsgraph: Any) -> dict[Any, list[Geometry]]:
    """The meshes of each object: its own, and those of the instances that it makes without an object for them."""
    meshes: dict[Any, dict[int, Geometry]] = defaultdict(dict)
    others: dict[Any, list[Any]] = defaultdict(list)
    for instance in depsgraph.object_instances:
        ob = instance.object
        matrix = instance.matrix_world.inverted_safe()
        if ob.type == "MESH":
            own, key = meshes[ob.original], ob.data.as_pointer()
            own[key] = own.get(key) or Geometry(ob, ob.data)
            own[key].matrices.append(matrix)
        elif ob.type in SOLID:
            others[ob.original].append(matrix)
    out = {ob: [one for one in own.values() if one.count] for ob, own in meshes.items()}
    for ob, matrices in others.items():
        if ob not in out:
            out[ob] = _converted(ob.evaluated_get(depsgraph), matrices)
    return out


def _converted(evaluated: Any, matrices: list[Any]) -> list[Geometry]:
    """The mesh of an object that is none, such as a metaball."""
    mesh = evaluated.to_mesh()
    try:
        geometry = Geometry(evaluated, mesh) if mesh and len(mesh.polygons) else None
    finally:
        evaluated.to_mesh_clear()
    if geometry is None:
        return []
    geometry.matrices = matrices
    return [geometry]


def _mark_object(ob: Any, geometries: list[Geometry], eye: Any, journal: Journal, say: Say) -> bool:
    """Marks one object; whether it has a closed piece."""
    if not geometries or (OVERRIDE in ob and not ob[OVERRIDE]):
        return False
    found = [geometry.faces(eye) for geometry in geometries]
    if OVERRIDE in ob:
        outward = sum((faces.side * faces.area).sum() for faces in found)
        journal.set_custom(ob, SIDE, -1.0 if outward < 0 else 1.0)
        return True
    if not any(faces.side.any() for faces in found):
        return False
    sides = {faces.common_side() for faces in found}
    if len(sides) == 1 and 0.0 not in sides:
        journal.set_custom(ob, SIDE, sides.pop())
        return True
    if ob.type == "MESH" and len(found) == 1:
        _mark_faces(ob, found[0], geometries[0].matrices, eye, journal)
        return True
    say(f"note: parts of {ob.name} are closed and others open; all count as open (set {OVERRIDE} to overrule)")
    return False


def _mark_faces(ob: Any, faces: Faces, matrices: list[Any], eye: Any, journal: Journal) -> None:
    """Marks the faces of an object some of whose pieces are closed."""
    if len(faces.side) != len(ob.data.polygons):
        # Modifiers give the attribute of the mesh that they change to the faces that come of it.
        own = Geometry(ob, ob.data)
        own.matrices = matrices
        faces = own.faces(eye)
    if SIDE not in ob.data.attributes:
        _set_attribute(ob.data, faces.side, journal)


def _set_attribute(mesh: Any, side: np.ndarray, journal: Journal) -> None:
    """Gives the faces of `mesh` their side."""
    journal.remember(mesh.attributes, "active_index")
    attribute = mesh.attributes.new(SIDE, "FLOAT", "FACE")
    journal.on_restore(lambda: mesh.attributes.remove(mesh.attributes[SIDE]))
    attribute.data.foreach_set("value", side.astype(np.float32))


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
