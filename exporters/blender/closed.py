# SPDX-License-Identifier: GPL-3.0-or-later
"""Which connected pieces of a mesh are closed, and which way their normals point. Pure geometry: no Blender here.

The inside of a closed piece cannot be seen from outside; peels leave it out. Pieces are judged after welding: text,
and what is imported, has faces that meet without sharing vertices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Vertices nearer to each other than this share of the mesh's size are one.
WELD_SHARE = 1e-6
# A closed piece has at most this share of edges with one face, ...
MOST_BOUNDARY = 0.1
# ... of its area open, as the length of the sum of its area vectors, ...
MOST_OPENING = 0.1
# ... and of its half-edges running the way of another: neighbours whose normals disagree.
MOST_TURNED = 0.02
# 36 π V²/A³ is 1 for a ball; less than this and the piece encloses nothing.
LEAST_ROUNDNESS = 1e-10
# Share of the whole solid angle that a piece covers as seen from a point inside.
INSIDE_WINDING = 0.25


@dataclass
class Polygons:
    """A mesh: `points` `[vertex][3]`, `corners` with the vertex of each corner, `starts` with each face's first."""

    points: np.ndarray
    corners: np.ndarray
    starts: np.ndarray

    @property
    def face_of_corner(self) -> np.ndarray:
        """The face of each corner."""
        sizes = np.diff(np.append(self.starts, len(self.corners)))
        return np.repeat(np.arange(len(self.starts)), sizes)

    def next_corner(self) -> np.ndarray:
        """The corner after each, around its face."""
        following = np.arange(1, len(self.corners) + 1)
        following[np.append(self.starts[1:], len(self.corners)) - 1] = self.starts
        return following


@dataclass
class Pieces:
    """The connected pieces of a mesh."""

    # The piece of each face.
    of_face: np.ndarray
    # For each piece: +1 closed with normals out, -1 closed with normals in, 0 open.
    side: np.ndarray
    # Area of each piece.
    area: np.ndarray


def pieces(mesh: Polygons, eyes: np.ndarray) -> Pieces:
    """The pieces of `mesh`. One with any of the points `eyes`, `[n][3]`, inside counts as open: its inside is seen."""
    face = mesh.face_of_corner
    if len(face) == 0:
        return Pieces(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    vertex = _welded(mesh.points)[mesh.corners]
    following = mesh.next_corner()
    start, end = vertex, vertex[following]
    label = _connected(start, end)
    names, of_corner = np.unique(label[start], return_inverse=True)
    count = len(names)
    of_face = of_corner[mesh.starts]

    points = mesh.points.astype(np.float64) - mesh.points.mean(axis=0, dtype=np.float64)
    fan = _Fan(points, mesh, face, following)
    vectors = np.stack([np.bincount(of_corner, fan.area[:, k], count) for k in range(3)], axis=-1)
    area = np.bincount(of_corner, np.linalg.norm(fan.area, axis=1), count)
    volume = np.bincount(of_corner, (fan.centre * fan.area).sum(axis=1) / 3.0, count)
    boundary, turned = _edges(start, end, of_corner, count)
    safe = np.maximum(area, 1e-300)
    is_closed = (boundary <= MOST_BOUNDARY) & (turned <= MOST_TURNED)
    is_closed &= np.linalg.norm(vectors, axis=1) / safe <= MOST_OPENING
    is_closed &= 36.0 * np.pi * volume**2 / safe**3 >= LEAST_ROUNDNESS
    for eye in eyes - mesh.points.mean(axis=0, dtype=np.float64):
        if is_closed.any():
            winding = np.bincount(of_corner, fan.solid_angles(eye), count) / (4.0 * np.pi)
            is_closed &= np.abs(winding) < INSIDE_WINDING
    return Pieces(of_face, np.where(is_closed, np.sign(volume), 0.0), area)


class _Fan:
    """Each face as triangles: one a corner, to the next corner and to the face's centre."""

    def __init__(self, points: np.ndarray, mesh: Polygons, face: np.ndarray, following: np.ndarray) -> None:
        sizes = np.bincount(face)
        self.start = points[mesh.corners]
        self.end = points[mesh.corners[following]]
        centres = np.stack([np.bincount(face, self.start[:, k]) for k in range(3)], axis=-1) / sizes[:, None]
        self.centre = centres[face]
        # The triangle's area, along its normal.
        self.area = 0.5 * np.cross(self.start - self.centre, self.end - self.centre)

    def solid_angles(self, eye: np.ndarray) -> np.ndarray:
        """Signed solid angle of each triangle as seen from `eye` (van Oosterom and Strackee)."""
        a, b, c = (corner - eye for corner in (self.centre, self.start, self.end))
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        over = (a * np.cross(b, c)).sum(axis=1)
        under = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
        return 2.0 * np.arctan2(over, under)


def _welded(points: np.ndarray) -> np.ndarray:
    """The number of each vertex; vertices at one place have the same."""
    extent = float(np.ptp(points, axis=0).max(initial=0.0))
    cell = max(extent * WELD_SHARE, 1e-30)
    cells = np.round((points - points.min(axis=0)) / cell).astype(np.int64)
    # Cells count to 1/WELD_SHARE: three fit into 63 bits.
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    return np.unique(keys, return_inverse=True)[1].reshape(-1)


def _connected(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The name of the piece of each vertex, by edges: the lowest vertex in it."""
    label = np.arange(int(max(start.max(), end.max())) + 1)
    while True:
        lowest = np.minimum(label[start], label[end])
        new = label.copy()
        np.minimum.at(new, label[start], lowest)
        np.minimum.at(new, label[end], lowest)
        new = new[new]
        if np.array_equal(new, label):
            return label
        label = new


def _edges(start: np.ndarray, end: np.ndarray, piece: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """For each piece, the share of edges with one face, and the share of half-edges that run the way of another."""
    size = int(max(start.max(), end.max())) + 1
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, first, faces = np.unique(low * size + high, return_index=True, return_counts=True)
    edges = np.bincount(piece[first], minlength=count)
    boundary = np.bincount(piece[first[faces == 1]], minlength=count)
    _, first, times = np.unique(start * size + end, return_index=True, return_counts=True)
    repeated = np.bincount(piece[first], times - 1, minlength=count)
    return boundary / np.maximum(edges, 1), repeated / np.maximum(np.bincount(piece, minlength=count), 1)
