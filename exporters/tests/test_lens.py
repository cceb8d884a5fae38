"""The lens: CoC radii against the thin-lens equation, the sensor's fit, overscan."""

import math
import unittest

import numpy as np

from thinlens_stack.lens import Lens, overscan_px, sensor_width_mm

# Aperture radius 12.5 mm.
LENS = Lens(focal_length_mm=50.0, sensor_width_mm=36.0, f_number=2.0, focus_distance=2.0)


class CocRadius(unittest.TestCase):
    def test_the_radius_is_that_of_the_cone_through_the_aperture(self):
        # By similar triangles, the cone from a point at z is R |z - s| / z wide at the focus distance s, where a
        # pixel is s · 36 / (50 · 1800) wide.
        for z in (0.5, 1.0, 2.0, 3.0, 50.0):
            cone = 0.0125 * (z - 2.0) / z
            self.assertAlmostEqual(float(LENS.coc_radius_px(z, 1800)), cone / (2.0 * 36.0 / 50.0 / 1800.0), places=9)

    def test_background_is_at_infinity(self):
        far = float(LENS.coc_radius_px(1e8, 1800))
        for background in (1e9, 1e10, math.inf, 0.0, -1.0, math.nan):
            self.assertAlmostEqual(float(LENS.coc_radius_px(background, 1800)), far, places=5)

    def test_the_radius_does_not_depend_on_the_unit(self):
        centimetres = Lens(50.0, 36.0, 2.0, focus_distance=200.0, metres_per_unit=0.01)
        self.assertAlmostEqual(
            float(centimetres.coc_radius_px(50.0, 900)), float(LENS.coc_radius_px(0.5, 900)), places=9
        )

    def test_a_real_camera_blurs_more_by_its_image_distance_over_the_focal_length(self):
        real = Lens(50.0, 36.0, 2.0, focus_distance=0.2, sensor_distance="thin_lens")
        held = Lens(50.0, 36.0, 2.0, focus_distance=0.2)
        image_distance = 1.0 / (1.0 / 50.0 - 1.0 / 200.0)
        ratio = float(real.coc_radius_px(1.0, 900) / held.coc_radius_px(1.0, 900))
        self.assertAlmostEqual(ratio, image_distance / 50.0, places=9)

    def test_a_pinhole_is_sharp_everywhere_and_merged_as_a_wide_lens(self):
        pinhole = Lens(50.0, 36.0)
        self.assertEqual(float(pinhole.coc_radius_px(0.1, 900)), 0.0)
        self.assertNotIn("thinlens.f_number", pinhole.attributes())
        self.assertNotIn("thinlens.focus_distance", pinhole.attributes())
        self.assertGreater(pinhole.for_merging().coc_scale_px(900), 0.0)


class SensorFit(unittest.TestCase):
    def test_the_width_is_what_the_frame_shows_of_the_sensor(self):
        for fit, frame, expected in (
            ("horizontal", (1920, 1080), 36.0),
            ("horizontal", (1080, 1920), 36.0),
            ("vertical", (1920, 1080), 24.0 * 16 / 9),
            ("vertical", (1000, 1000), 24.0),
            ("auto", (1920, 1080), 36.0),
            ("auto", (1080, 1920), 36.0 * 9 / 16),
        ):
            self.assertAlmostEqual(sensor_width_mm(fit, 36.0, 24.0, frame), expected, places=9)


class Overscan(unittest.TestCase):
    def wide(self, depth_at: dict[tuple[int, int], float]) -> np.ndarray:
        """Depth of a frame of 100 × 60 with a margin of 25: in focus but for the given pixels (column, row)."""
        depth = np.full((110, 150), 2.0)
        for (x, y), value in depth_at.items():
            depth[y + 25, x + 25] = value
        return depth

    def test_what_is_in_focus_needs_none(self):
        self.assertEqual(overscan_px(self.wide({}), (100, 60), 25, LENS), 0)

    def test_it_reaches_to_the_farthest_pixel_whose_blur_comes_in(self):
        # The radius at depth z is 100/36 · 50 · 0.0125 · (1/z - 1/2).
        near = 0.1
        radius = -float(LENS.coc_radius_px(near, 100))
        self.assertAlmostEqual(radius, 16.49, places=2)
        # Centres at 16.5 - 1 = 15.5 px from the frame reach in; the pixel beyond does not.
        self.assertEqual(overscan_px(self.wide({(-16, 30): near}), (100, 60), 25, LENS), 17)
        self.assertEqual(overscan_px(self.wide({(-17, 30): near}), (100, 60), 25, LENS), 0)
        self.assertEqual(overscan_px(self.wide({(107, 30): near}), (100, 60), 25, LENS), 9)
        # In a corner by the diagonal: 8.5 √2 = 12.02.
        self.assertEqual(overscan_px(self.wide({(-9, -9): near}), (100, 60), 25, LENS), 14)

    def test_it_stops_at_the_margin(self):
        everything = np.full((110, 150), 0.02)
        self.assertEqual(overscan_px(everything, (100, 60), 25, LENS), 25)

    def test_background_reaches_in(self):
        lens = Lens(50.0, 36.0, 2.0, focus_distance=0.2)
        sky = np.full((110, 150), 1e10)
        radius = float(lens.coc_radius_px(1e10, 100))
        self.assertLess(abs(overscan_px(sky, (100, 60), 25, lens) - radius), 2.0)
