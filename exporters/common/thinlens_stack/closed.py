"""Closed surfaces: their inside is never seen from outside, so that it need not be a peel."""

from __future__ import annotations

import numpy as np

# A surface is closed with at most this share of edges that only one triangle has, …
BOUNDARY_SHARE = 0.1
# … this length of its summed area vectors over its area (0 for a closed one), …
OPENING_SHARE = 0.1
# … and this share of edges along which neighbours are turned against each other.
TURNED_SHARE = 0.02
# Vertices nearer than this share of the surface's size are one.
WELD_SHARE = 1e-6


def outsides(vertices: np.ndarray, triangles: np.ndarray, viewpoint: np.ndarray | None) -> np.ndarray:
    """Which side of each triangle is the outside of a closed surface, `[m]`: 1 its front, -1 its back, 0 both.

    A triangle's front is where its corners are anticlockwise. Both are outside in open pieces, and in those that
    enclose `viewpoint`. Pieces are connected by common vertices or vertices at one place. `vertices` is `[n][3]`,
    `triangles` `[m][3]` indices.
    """
    vertices, triangles = np.asarray(vertices, np.float64), np.asarray(triangles, np.int64)
    sides = np.zeros(len(triangles), np.int8)
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if extent <= 0.0 or len(triangles) == 0:
        return sides
    triangles = _welded(vertices, WELD_SHARE * extent)[triangles]
    pieces = _pieces(triangles, len(vertices))
    order = np.argsort(pieces, kind="stable")
    starts = np.flatnonzero(np.diff(pieces[order], prepend=-1))
    for piece in np.split(order, starts[1:]):
        sides[piece] = _outside(vertices, triangles[piece], viewpoint)
    return sides


def _outside(vertices: np.ndarray, triangles: np.ndarray, viewpoint: np.ndarray | None) -> int:
    """The outside of one piece."""
    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(areas, axis=1).sum()
    if area <= 0.0 or np.linalg.norm(areas.sum(axis=0)) > OPENING_SHARE * area or not _has_closed_edges(triangles):
        return 0
    if viewpoint is not None and abs(winding_number(corners, viewpoint)) > 0.5:
        return 0
    volume = ((corners[:, 0] - corners[0, 0]) * areas).sum()
    return 1 if volume > 0.0 else -1


def winding_number(corners: np.ndarray, viewpoint: np.ndarray) -> float:
    """How often the triangles `corners`, `[m][3][3]`, enclose `viewpoint`: 0 outside a closed surface, ±1 inside."""
    a, b, c = np.moveaxis(corners - np.asarray(viewpoint, np.float64), 1, 0)
    lengths = [np.linalg.norm(edge, axis=1) for edge in (a, b, c)]
    volume = (a * np.cross(b, c)).sum(axis=1)
    # Half the tangent of each triangle's solid angle, after van Oosterom and Strackee.
    below = lengths[0] * lengths[1] * lengths[2]
    for (p, q), other in (((a, b), lengths[2]), ((b, c), lengths[0]), ((c, a), lengths[1])):
        below = below + (p * q).sum(axis=1) * other
    return float(np.arctan2(volume, below).sum() / (2.0 * np.pi))


def _welded(vertices: np.ndarray, distance: float) -> np.ndarray:
    """For each vertex, the index of the first one at its place."""
    cells = np.round(vertices / distance).astype(np.int64)
    _, first, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return first[inverse.reshape(-1)]


def _pieces(triangles: np.ndarray, vertices: int) -> np.ndarray:
    """The number of the connected piece of each triangle: that of the smallest vertex in it."""
    label = np.arange(vertices)
    while True:
        smallest = label[triangles].min(axis=1)
        before = label.copy()
        np.minimum.at(label, triangles.reshape(-1), np.repeat(smallest, 3))
        label = label[label]
        if np.array_equal(label, before):
            return label[triangles[:, 0]]


def _has_closed_edges(triangles: np.ndarray) -> bool:
    """Whether nearly all edges have two triangles that are turned alike."""
    starts, ends = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    proper = starts != ends
    starts, ends = starts[proper], ends[proper]
    edges = np.minimum(starts, ends) * (int(triangles.max()) + 1) + np.maximum(starts, ends)
    _, edge, counts = np.unique(edges, return_inverse=True, return_counts=True)
    turns = np.bincount(edge, np.where(starts < ends, 1.0, -1.0))
    boundary = np.count_nonzero(counts == 1)
    turned = np.count_nonzero((counts == 2) & (turns != 0.0))
    return boundary <= BOUNDARY_SHARE * len(counts) and turned <= TURNED_SHARE * len(counts)
