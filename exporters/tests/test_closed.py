"""Closed surfaces are told from open ones, and their outside from their inside."""

import unittest

import numpy as np

from thinlens_stack.closed import outsides, winding_number

OUTSIDE = np.array([5.0, 1.0, 2.0])


def cube(welded: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """A cube from -1 to 1 whose triangles are anticlockwise from outside; unwelded, each has its own vertices."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    if welded:
        return corners, triangles
    return corners[triangles].reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def divided(corners: np.ndarray, times: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles `[m][3][3]`, each divided into four so many times, with vertices of their own."""
    for _ in range(times):
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def outside(vertices: np.ndarray, triangles: np.ndarray, viewpoint: np.ndarray) -> int:
    """The outside of all triangles of a mesh, which is one for all."""
    (side,) = set(outsides(vertices, triangles, viewpoint).tolist()) or {0}
    return side


class Outsides(unittest.TestCase):
    def test_a_cube_shows_its_outside_whether_its_vertices_are_shared_or_not(self):
        for welded in (True, False):
            vertices, triangles = cube(welded)
            self.assertEqual(outside(vertices, triangles, OUTSIDE), 1)
            self.assertEqual(outside(vertices, triangles[:, ::-1], OUTSIDE), -1)
            self.assertEqual(outside(1e-4 * vertices + 7.0, triangles, OUTSIDE), 1, "small and far from the origin")

    def test_a_room_shows_both_sides_to_a_camera_in_it(self):
        vertices, triangles = cube()
        for turned in (triangles, triangles[:, ::-1]):
            self.assertEqual(outside(vertices, turned, np.array([0.5, 0.2, 0.1])), 0)

    def test_open_and_inconsistent_meshes_show_both_sides(self):
        vertices, triangles = cube()
        self.assertEqual(outside(vertices, triangles[2:], OUTSIDE), 0, "a box without its lid")
        self.assertEqual(outside(vertices, triangles[:2], OUTSIDE), 0, "a card")
        turned = triangles.copy()
        turned[0] = turned[0][::-1]
        self.assertEqual(outside(vertices, turned, OUTSIDE), 0, "one triangle is turned")
        self.assertEqual(outside(vertices[:0], triangles[:0], OUTSIDE), 0, "nothing")
        self.assertEqual(outside(np.zeros((3, 3)), np.array([[0, 1, 2]]), OUTSIDE), 0, "a point")

    def test_a_fine_box_without_a_lid_is_open_though_few_of_its_edges_are(self):
        vertices, triangles = cube(welded=False)
        vertices, triangles = divided(vertices[triangles], 3)
        self.assertEqual(outside(vertices, triangles, OUTSIDE), 1)
        is_lid = (vertices[triangles][:, :, 2] > 0.999).all(axis=1)
        self.assertEqual(outside(vertices, triangles[~is_lid], OUTSIDE), 0)

    def test_a_box_with_turned_triangles_on_opposite_sides_is_inconsistent(self):
        vertices, triangles = cube()
        # The first triangles of the two quads at x = -1 and x = 1: their area vectors cancel.
        triangles = triangles.copy()
        triangles[[0, 2]] = triangles[[0, 2], ::-1]
        self.assertEqual(outside(vertices, triangles, OUTSIDE), 0)

    def test_the_pieces_of_a_mesh_are_judged_one_by_one(self):
        vertices, triangles = cube()
        # A cube, a room around the camera at 5, 1, 2, and a card.
        everything = np.concatenate([vertices, 3 * vertices + OUTSIDE, vertices + 20.0])
        faces = np.concatenate([triangles, triangles + 8, triangles[:2] + 16])
        order = np.random.default_rng(3).permutation(len(faces))
        expected = np.repeat([1, 0, 0], [12, 12, 2])
        np.testing.assert_array_equal(outsides(everything, faces[order], OUTSIDE), expected[order])

    def test_a_long_strip_is_one_piece(self):
        strip = np.array([[i, i % 2, 0.0] for i in range(200)])
        faces = np.array([[i, i + 1, i + 2] for i in range(198)])
        self.assertEqual(outside(strip, faces[::-1], OUTSIDE), 0)

    def test_a_point_is_enclosed_once_inside_and_not_at_all_outside(self):
        vertices, triangles = cube()
        self.assertAlmostEqual(abs(winding_number(vertices[triangles], np.array([0.3, -0.2, 0.9]))), 1.0, places=9)
        self.assertAlmostEqual(winding_number(vertices[triangles], OUTSIDE), 0.0, places=9)
