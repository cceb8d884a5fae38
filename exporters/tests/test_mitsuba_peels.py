"""Peels of Mitsuba scenes that are known in closed form. Skipped where the package mitsuba is not installed."""

import math
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

from . import mitsuba_package

mi = mitsuba_package.load()
if mi is not None:
    from thinlens_mitsuba.camera import Camera, Choice, regular, rotated
    from thinlens_mitsuba.peel_integrator import Peeler, Sampling, wrappable
    from thinlens_stack.errors import ExportError

    from . import mitsuba_scenes as scenes

WHITE, RED, BLUE = (1.0, 1.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 3.0)


def peels(scene, overscan=0, **sampling):
    """The layers of a scene, one sample a pixel unless `sampling` says otherwise."""
    peeler = Peeler(scene, scene.sensors()[0], wrappable(scene.integrator()))
    sampling = {"samples": 1, "paths": 1, "is_merged": False} | sampling
    return peeler.stack(peeler.camera.frame(overscan), Sampling(**sampling), Choice(f_number=2.0, focus_distance=2.0))


@unittest.skipIf(mi is None, "the package mitsuba is not installed")
class Peels(unittest.TestCase):
    def fragments(self, objects, integrator="path", **sampling):
        """What the ray through the middle of the picture meets."""
        parameters = {name: sampling.pop(name) for name in ("hide_emitters", "max_depth") if name in sampling}
        return scenes.middle(peels(scenes.load(objects, scenes.sensor(1, 1), integrator, **parameters), **sampling))

    def assert_fragments(self, found, expected):
        self.assertEqual(len(found), len(expected), found)
        for (color, alpha, depth), (wanted_color, wanted_alpha, wanted_depth) in zip(found, expected, strict=True):
            np.testing.assert_allclose(color, wanted_color, atol=1e-3)
            self.assertAlmostEqual(alpha, wanted_alpha, places=5)
            self.assertLess(abs(depth / wanted_depth - 1.0), 1e-5)

    def test_surfaces_follow_each_other_and_the_environment_is_the_last(self):
        objects = [scenes.lamp(5.0, BLUE), scenes.lamp(2.0, RED), scenes.sky(0.5)]
        self.assert_fragments(
            self.fragments(objects), [(RED, 1.0, 2.0), (BLUE, 1.0, 5.0), ((0.5, 0.5, 0.5), 1.0, 1e10)]
        )

    def test_no_more_peels_than_asked_for_hide_no_environment(self):
        objects = [scenes.lamp(depth, RED) for depth in (2.0, 3.0, 4.0)]
        self.assertEqual(len(self.fragments(objects, peels=2)), 2)
        self.assertEqual(len(self.fragments([*objects, scenes.sky(0.5)], peels=2)), 3)

    def test_depth_is_planar_all_over_the_frame(self):
        layers = peels(scenes.load([scenes.lamp(5.0, BLUE)], scenes.sensor(24, 16)))
        np.testing.assert_allclose(layers[0].depth, 5.0, rtol=1e-5)

    def test_the_inside_of_closed_shapes_is_no_peel_and_the_back_of_a_card_is(self):
        cube = {"type": "cube", "to_world": mi.ScalarTransform4f().translate([0, 0, -4]), "bsdf": scenes.black()}
        ball = {"type": "sphere", "center": [0, 0, -8], "bsdf": scenes.black()}
        group = {"type": "shapegroup", "shape": {"type": "cube", "bsdf": scenes.black()}}
        copy = {
            "type": "instance",
            "to_world": mi.ScalarTransform4f().translate([0, 0, -14]),
            "group": {"type": "ref", "id": "object2"},
        }
        found = self.fragments([cube, ball, group, copy, scenes.card(11.0, scenes.black(), turned=True)])
        np.testing.assert_allclose([depth for *_, depth in found], [3.0, 7.0, 11.0, 13.0], rtol=1e-5)

    def test_each_hair_is_a_peel(self):
        hairs = "\n\n".join(f"-2 0 {z} 0.05\n-1 0 {z} 0.05\n1 0 {z} 0.05\n2 0 {z} 0.05" for z in (-2, -3))
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "hairs.txt"
            file.write_text(hairs)
            curves = {"type": "bsplinecurve", "filename": str(file), "bsdf": {"type": "diffuse"}}
            found = self.fragments([curves, scenes.lamp(5.0, RED)])
        np.testing.assert_allclose([depth for *_, depth in found], [1.95, 2.95, 5.0], rtol=1e-4)

    def test_a_room_around_the_camera_is_seen_from_inside(self):
        room = {"type": "cube", "to_world": mi.ScalarTransform4f().scale(9.0), "bsdf": scenes.black()}
        dome = {"type": "sphere", "radius": 20.0, "bsdf": scenes.black()}
        found = self.fragments([room, dome])
        np.testing.assert_allclose([depth for *_, depth in found], [9.0, 20.0], rtol=1e-5)

    def test_a_mask_has_its_opacity_and_nothing_of_what_is_behind_it(self):
        veil = {"type": "mask", "opacity": 0.25, "bsdf": {"type": "diffuse", "reflectance": 0.0}}
        gone = {"type": "mask", "opacity": 0.0, "bsdf": {"type": "diffuse"}}
        objects = [scenes.card(2.0, veil), scenes.card(3.0, gone), scenes.lamp(5.0, RED)]
        (color, alpha, depth), behind = self.fragments(objects, paths=1024)
        self.assert_fragments([behind], [(RED, 1.0, 5.0)])
        self.assertEqual((alpha, round(depth, 4)), (0.25, 2.0))
        # Of 1024 paths that hit 2 or 0, the mean has a standard deviation of 0.027.
        np.testing.assert_allclose(color, 0.0, atol=0.11)

    def test_translucent_peels_in_front_of_each_other_show_what_the_integrator_sees(self):
        veil = {"type": "mask", "opacity": 0.5, "bsdf": {"type": "diffuse", "reflectance": 0.0}}
        objects = [scenes.card(2.0, veil), scenes.card(3.0, veil), scenes.lamp(5.0, RED)]
        for count in (1, 2, 3):
            found = self.fragments(objects, paths=1024, peels=count)
            self.assertEqual([alpha for _, alpha, _ in found], [0.5, 0.5, 1.0][:count])
            np.testing.assert_allclose([color[0] for color, *_ in found], [0.0, 0.0, 2.0][:count], atol=0.15)

    def test_glass_has_the_depth_of_its_front_and_the_colour_of_what_is_seen_through_it(self):
        slab = {
            "type": "cube",
            "to_world": mi.ScalarTransform4f().translate([0, 0, -3]).scale([100, 100, 1]),
            "bsdf": {"type": "dielectric", "int_ior": 1.5},
        }
        # A slab passes (1 - R) / (1 + R) of the light, after all reflections inside.
        reflected = ((1.5 - 1.0) / (1.5 + 1.0)) ** 2
        (color, alpha, depth), wall = self.fragments([slab, scenes.lamp(7.0, WHITE)], paths=1024)
        self.assert_fragments([wall], [(WHITE, 1.0, 7.0)])
        self.assertEqual((alpha, round(depth, 4)), (1.0, 2.0))
        np.testing.assert_allclose(color, (1.0 - reflected) / (1.0 + reflected), atol=0.04)

    def test_a_tinted_pane_passes_on_its_least_colour_and_keeps_the_rest(self):
        tint = {"type": "rgb", "value": [0.8, 0.4, 0.4]}
        pane = {"type": "thindielectric", "specular_transmittance": tint}
        reflected = ((1.5046 / 1.000277 - 1.0) / (1.5046 / 1.000277 + 1.0)) ** 2
        passed = (1.0 - reflected) / (1.0 + reflected)
        (color, alpha, _), _ = self.fragments([scenes.card(2.0, pane), scenes.lamp(7.0, WHITE)], paths=1024)
        self.assertAlmostEqual(alpha, 1.0 - 0.4 * passed, places=3)
        np.testing.assert_allclose(color, (0.4 * passed, 0.0, 0.0), atol=0.07)

    def test_hidden_lamps_are_no_peels_but_shine(self):
        wall = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.5}}
        objects = [scenes.lamp(2.0, WHITE, scale=0.1), scenes.card(5.0, wall), scenes.sky(1.0)]
        (found,) = self.fragments(objects, hide_emitters=True, paths=256)
        self.assertAlmostEqual(found[2], 5.0, places=4)
        self.assertGreater(found[0][0], 0.4)

    def test_fog_is_part_of_the_first_surface(self):
        fog = {
            "type": "cube",
            "to_world": mi.ScalarTransform4f().translate([0, 0, -3]),
            "bsdf": {"type": "null"},
            "interior": {"type": "homogeneous", "albedo": 0.0, "sigma_t": 0.5},
        }
        (found,) = self.fragments([fog, scenes.lamp(7.0, WHITE)], "volpath", paths=1024)
        self.assertAlmostEqual(found[2], 7.0, places=4)
        # Two units of fog.
        np.testing.assert_allclose(found[0], math.exp(-1.0), atol=0.06)

    def test_the_plug_in_renders_the_channels_that_it_names(self):
        peels = mi.load_dict({"type": "thinlens_peels", "peels": 2, "supersample": 2, "inner": {"type": "path"}})
        scene = scenes.load([scenes.lamp(2.0, RED), scenes.lamp(5.0, BLUE)], scenes.sensor(6, 4))
        picture = np.array(mi.render(scene, integrator=peels, spp=4))
        planes = dict(zip(peels.aov_names(), np.moveaxis(picture, -1, 0), strict=True))
        self.assertEqual(picture.shape, (4, 6, 10))
        np.testing.assert_allclose(planes["Peel0.Combined.R"], 2.0)
        np.testing.assert_allclose(planes["Peel1.Depth.Z"], 5.0, rtol=1e-5)

    def test_integrators_without_single_rays_are_refused_by_name(self):
        with self.assertRaisesRegex(ExportError, "ParticleTracer"):
            self.fragments([scenes.lamp(2.0, RED)], "ptracer")


@unittest.skipIf(mi is None, "the package mitsuba is not installed")
class Places(unittest.TestCase):
    def test_a_lamp_is_where_it_projects_to_and_overscan_continues_the_frame(self):
        # 12 / (2 tan 20°) = 16.5 px focal length: a lamp 0.4 wide at distance 4 is 1.65 px wide, in 64 samples a pixel.
        focal_px = 6.0 / math.tan(math.radians(20.0))
        for x, y in ((0.5, -0.3), (-1.0, 1.1), (1.75, 0.2)):
            scene = scenes.load([scenes.lamp(4.0, RED, 0.2, x, y)], scenes.sensor(12, 8))
            (layer, *_) = peels(scene, overscan=3, samples=8)
            rows, columns = np.mgrid[: layer.alpha.shape[0], : layer.alpha.shape[1]] / 8 - 3 + 1 / 16
            place = [(layer.alpha * index).sum() / layer.alpha.sum() for index in (columns, rows)]
            # Half the distance of samples.
            np.testing.assert_allclose(place, (6.0 + focal_px * x / 4.0, 4.0 - focal_px * y / 4.0), atol=1 / 16)
            self.assertAlmostEqual(float(layer.alpha.sum()) / 64, (focal_px * 0.4 / 4.0) ** 2, delta=0.2)

    def test_the_samples_of_a_pixel_form_grids(self):
        for samples in (1, 2, 3, 4):
            phases = range(samples**2)
            for grid in (regular, rotated):
                cells = {tuple(int(place * samples) for place in grid(samples, phase)) for phase in phases}
                self.assertEqual(len(cells), samples**2, "one in each cell")
                np.testing.assert_allclose(np.mean([grid(samples, phase) for phase in phases], axis=0), 0.5)
            for axis in (0, 1):
                levels = sorted(rotated(samples, phase)[axis] * samples**2 for phase in phases)
                np.testing.assert_allclose(levels, np.arange(samples**2) + 0.5, atol=1e-9)

    def test_large_pictures_are_exported_in_parts(self):
        objects = [scenes.lamp(3.0, RED, 0.6, 0.4), scenes.lamp(6.0, BLUE, 1.0, -0.5, 0.3), scenes.sky(0.25)]
        scene = scenes.load(objects, scenes.sensor(11, 7))
        whole = peels(scene, overscan=1, samples=2, is_merged=True)
        with (
            mock.patch("thinlens_mitsuba.peel_integrator.PIXELS_AT_A_TIME", 30),
            mock.patch("thinlens_mitsuba.lanes.LANES_AT_A_TIME", 8),
            mock.patch("thinlens_stack.merge.PIXELS_AT_A_TIME", 13),
        ):
            parts = peels(scene, overscan=1, samples=2, is_merged=True)
        for one, other in zip(whole, parts, strict=True):
            np.testing.assert_allclose(one.color, other.color, atol=1e-6)
            np.testing.assert_array_equal(one.alpha, other.alpha)
            np.testing.assert_allclose(one.depth, other.depth, rtol=1e-6)

    def test_the_picture_is_the_renderers_own(self):
        objects = [scenes.lamp(3.0, RED, 0.6, 0.4), scenes.lamp(6.0, BLUE, 1.0, -0.5, 0.3), scenes.sky(0.25)]
        scene = scenes.load(objects, scenes.sensor(20, 12, sampler={"type": "independent", "sample_count": 512}))
        expected = np.array(mi.render(scene))[..., :3]
        layers = peels(scene, samples=4)
        shown, passing = np.zeros_like(layers[0].color), np.ones_like(layers[0].alpha)
        for layer in layers:
            shown += passing[..., None] * layer.color
            passing = passing * (1.0 - layer.alpha)
        shown = shown.reshape(12, 4, 20, 4, 3).mean(axis=(1, 3))
        # At edges both are known to about a fourth of the step there.
        self.assertLess(np.abs(shown - expected).max(), 0.6)
        self.assertLess(np.abs(shown - expected).mean(), 0.03)


@unittest.skipIf(mi is None, "the package mitsuba is not installed")
class LensOfTheSensor(unittest.TestCase):
    def lens(self, width, height, choice=None, **parameters):
        camera = mi.load_dict(scenes.sensor(width, height, **parameters))
        return Camera(camera).lens(choice or Choice())

    def test_the_focal_length_is_that_of_the_field_along_the_given_axis(self):
        tangent = math.tan(math.radians(20.0))
        for width, height, axis, of_width in (
            (300, 200, "x", 1.0),
            (300, 200, "y", 2 / 3),
            (200, 300, "larger", 1.5),
            (200, 300, "smaller", 1.0),
            (300, 400, "diagonal", 5 / 3),
        ):
            focal_length = self.lens(width, height, fov_axis=axis).focal_length_mm
            self.assertAlmostEqual(focal_length, 18.0 * of_width / tangent, delta=1e-3 * focal_length)

    def test_a_crop_shows_part_of_the_sensor(self):
        lens = self.lens(300, 200, crop_offset_x=30, crop_offset_y=20, crop_width=100, crop_height=150)
        self.assertAlmostEqual(lens.sensor_width_mm, 12.0)
        self.assertAlmostEqual(lens.focal_length_mm, 18.0 / math.tan(math.radians(20.0)), places=3)

    def test_the_aperture_and_the_focus_of_a_thin_lens_are_those_of_the_lens(self):
        own = {"type": "thinlens", "aperture_radius": 0.02, "focus_distance": 3.5}
        lens = self.lens(300, 200, Choice(metres_per_unit=0.5), **own)
        self.assertAlmostEqual(lens.focus_distance, 3.5, places=6)
        self.assertAlmostEqual(lens.aperture_radius(), 0.02, places=6)
        chosen = self.lens(300, 200, Choice(f_number=4.0, focus_distance=9.0), **own)
        self.assertEqual((chosen.f_number, chosen.focus_distance), (4.0, 9.0))

    def test_a_pinhole_leaves_the_lens_open(self):
        lens = self.lens(300, 200)
        self.assertEqual((lens.f_number, lens.focus_distance), (math.inf, None))

    def test_sensors_without_perspective_are_refused(self):
        with self.assertRaisesRegex(ExportError, "Orthographic"):
            Camera(mi.load_dict({"type": "orthographic"}))
