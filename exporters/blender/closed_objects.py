# SPDX-License-Identifier: GPL-3.0-or-later
"""Marks the closed meshes of a scene, so that peels leave out their inside."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np

from .closed import Pieces, Polygons, pieces
from .journal import Journal
from .materials import is_transparent
from .peel_nodes import SIDE
from .settings import Say

# Custom property of an object by which the user overrules: true is closed, false open.
OVERRIDE = "thinlens_closed"
# Types of objects whose evaluated form is a mesh.
SOLID = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
# A mesh is of one kind if all but this share of its area is.
OTHER_AREA = 1e-3


def mark(depsgraph: Any, eye: Any, journal: Journal, say: Say) -> int:
    """Marks every closed mesh as seen from `eye`, a point of the world. Returns how many objects have one.

    Meshes that let light through keep their inside: it is seen.
    """
    matrices: dict[Any, list[Any]] = defaultdict(list)
    for instance in depsgraph.object_instances:
        if instance.object.type in SOLID:
            matrices[instance.object.original].append(instance.matrix_world.copy())
    return sum(
        _mark_object(ob, ob.evaluated_get(depsgraph), eyes_in(own, eye), journal, say) for ob, own in matrices.items()
    )


def eyes_in(matrices: list[Any], eye: Any) -> np.ndarray:
    """The point `eye` of the world in the space of each instance, `[n][3]`."""
    return np.array([tuple(matrix.inverted_safe() @ eye) for matrix in matrices], np.float64)


def _mark_object(ob: Any, evaluated: Any, eyes: np.ndarray, journal: Journal, say: Say) -> bool:
    """Marks one object; whether it has a closed piece."""
    if OVERRIDE in ob and not ob[OVERRIDE]:
        return False
    mesh = evaluated.to_mesh()
    if mesh is None:
        return False
    try:
        found = pieces(polygons(mesh), eyes)
        faces = len(mesh.polygons)
        clear = _clear_faces(evaluated, mesh)
    finally:
        evaluated.to_mesh_clear()
    if OVERRIDE in ob:
        journal.set_custom(ob, SIDE, -1.0 if (found.side * found.area).sum() < 0 else 1.0)
        return True
    side = np.where(clear, 0.0, found.side[found.of_face]) if faces else np.zeros(0)
    return _mark_faces(ob, side, found, eyes, journal, say)


def _mark_faces(ob: Any, side: np.ndarray, found: Pieces, eyes: np.ndarray, journal: Journal, say: Say) -> bool:
    """Marks an object of whose evaluated faces `side` says which are closed."""
    if not side.any():
        return False
    # Share of the area on each side, a face having its piece's mean.
    weight = found.area[found.of_face] / np.bincount(found.of_face)[found.of_face]
    common = max((1.0, -1.0), key=lambda value: weight[side == value].sum())
    if weight[side != common].sum() <= OTHER_AREA * weight.sum():
        journal.set_custom(ob, SIDE, common)
        return True
    if ob.type != "MESH":
        say(f"note: parts of {ob.name} are closed and others open; all count as open (set {OVERRIDE} to overrule)")
        return False
    if len(side) != len(ob.data.polygons):
        # Modifiers carry the attribute of the mesh they change to the faces that come of it.
        own = pieces(polygons(ob.data), eyes)
        side = np.where(_clear_faces(ob, ob.data), 0.0, own.side[own.of_face]) if len(own.of_face) else np.zeros(0)
        if not side.any():
            return False
    _set_attribute(ob.data, side, journal)
    return True


def _set_attribute(mesh: Any, side: np.ndarray, journal: Journal) -> None:
    """Gives the faces of `mesh` their side. A mesh that several objects share is marked once."""
    if SIDE in mesh.attributes:
        return
    journal.remember(mesh.attributes, "active_index")
    attribute = mesh.attributes.new(SIDE, "FLOAT", "FACE")
    journal.on_restore(lambda: mesh.attributes.remove(mesh.attributes[SIDE]))
    attribute.data.foreach_set("value", np.ascontiguousarray(side, np.float32))


def polygons(mesh: Any) -> Polygons:
    """The geometry of a Blender mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    starts = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    return Polygons(points.reshape(-1, 3), corners.astype(np.int64), starts.astype(np.int64))


def _clear_faces(ob: Any, mesh: Any) -> np.ndarray:
    """For each face of `mesh`, whether its material may let through what is behind it."""
    material = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", material)
    slots = [slot.material for slot in ob.material_slots] or list(mesh.materials)
    clear = [bool(slot and slot.node_tree and is_transparent(slot.node_tree)) for slot in slots] or [False]
    return np.array(clear)[np.clip(material, 0, len(clear) - 1)]
