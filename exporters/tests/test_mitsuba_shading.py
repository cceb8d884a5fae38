"""The channels of reflections against closed forms. Skipped where the package mitsuba is not installed."""

import math
import unittest

import numpy as np

from . import mitsuba_package

mi = mitsuba_package.load()
if mi is not None:
    from thinlens_mitsuba.camera import Camera, Choice
    from thinlens_mitsuba.peel_integrator import Peeler, Sampling

    from . import mitsuba_scenes as scenes

ALBEDO = (0.2, 0.4, 0.6)


def tilted(bsdf: dict, angle_deg: float = 0.0) -> dict:
    """A card at distance 4 through the axis, turned around the vertical: its left edge comes nearer."""
    transform = mi.ScalarTransform4f().translate([0, 0, -4]).rotate([0, 1, 0], angle_deg).scale(100.0)
    return {"type": "rectangle", "to_world": transform, "bsdf": bsdf}


def principled(**parameters) -> dict:
    """A material `principled` of colour `ALBEDO`."""
    return {"type": "principled", "base_color": {"type": "rgb", "value": list(ALBEDO)}, "roughness": 0.3} | parameters


@unittest.skipIf(mi is None, "the package mitsuba is not installed")
class Shading(unittest.TestCase):
    def channels(self, objects, paths=512, samples=1, field_deg=40.0, **integrator):
        """The channels of the first layer in the middle of the picture, with its colour as "Combined"."""
        scene = scenes.load(objects, scenes.sensor(1, 1, fov=field_deg), **integrator)
        sampling = Sampling(peels=2, samples=samples, paths=paths, is_merged=samples > 1, has_shading=True)
        peeler = Peeler(scene, scene.sensors()[0], scene.integrator())
        layer = peeler.stack(peeler.camera.frame(0), sampling, Choice(f_number=2.0))[0]
        found = {name: float(plane[0, 0]) for name, plane in (layer.sums | layer.means).items()}
        groups = {name.partition(".")[0] for name in found}
        vectors = {
            group: np.array([value for name, value in found.items() if name.startswith(group + ".")])
            for group in groups
        }
        return vectors | {"Combined": layer.color[0, 0]}

    def test_the_matrix_of_the_camera_puts_its_place_at_the_origin_and_what_it_looks_at_on_minus_z(self):
        look = mi.ScalarTransform4f().look_at(origin=[1, 2, 3], target=[4, 2, -1], up=[0, 1, 0])
        camera = Camera(mi.load_dict({"type": "perspective", "to_world": look}))
        place, target, above = (
            np.array([*at, 1.0]) @ camera.world_to_camera for at in ((1, 2, 3), (4, 2, -1), (1, 7, 3))
        )
        np.testing.assert_allclose(place, (0, 0, 0, 1), atol=1e-6)
        np.testing.assert_allclose(target, (0, 0, -5, 1), atol=1e-6)
        np.testing.assert_allclose(above, (0, 5, 0, 1), atol=1e-6)

    def test_a_diffuse_surface_has_only_diffuse_light_whatever_lights_it(self):
        matt = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(ALBEDO)}}
        bulb = {"type": "point", "position": [0.0, 1.0, -2.0], "intensity": 8.0}
        lamp = scenes.lamp(-1.0, (2.0, 2.0, 2.0), 1.0) | {
            "to_world": mi.ScalarTransform4f().translate([2, 0, -2]).rotate([0, 1, 0], -135)
        }
        for lights in ([scenes.sky(1.0)], [bulb], [lamp, scenes.sky(0.2)]):
            for integrator in ({"max_depth": 2}, {"max_depth": 4}, {"integrator": "direct"}):
                found = self.channels([tilted(matt, 20.0), *lights], **integrator)
                np.testing.assert_array_equal(found["Diffuse"], found["Combined"])

    def test_mirrors_and_metals_have_none(self):
        for bsdf in ({"type": "conductor", "material": "Ag"}, principled(metallic=1.0), {"type": "dielectric"}):
            found = self.channels([tilted(bsdf), scenes.sky(1.0)])
            np.testing.assert_array_equal(found["Diffuse"], 0.0)
            self.assertGreater(found["Combined"].min(), 0.1)

    def test_a_coat_leaves_the_diffuse_light_of_principled_as_it_is(self):
        bare = self.channels([tilted(principled(specular=0.0), 30.0), scenes.sky(1.0)], paths=1024)
        coated = self.channels([tilted(principled(specular=0.5), 30.0), scenes.sky(1.0)], paths=1024)
        np.testing.assert_allclose(bare["Diffuse"], bare["Combined"], rtol=0.05)
        np.testing.assert_allclose(coated["Diffuse"], bare["Combined"], rtol=0.05)
        self.assertGreater((coated["Combined"] - coated["Diffuse"]).min(), 0.01)

    def test_a_lamp_shines_by_itself(self):
        found = self.channels([scenes.lamp(4.0, (3.0, 2.0, 1.0))])
        np.testing.assert_allclose(found["Diffuse"], (3.0, 2.0, 1.0), rtol=1e-6)

    def wall(self, color=(3.0, 2.0, 1.0)):
        """A lamp that a mirror at 45° shows the camera, 3 to its right; the camera does not see it."""
        return scenes.lamp(0.0, color) | {
            "to_world": mi.ScalarTransform4f().translate([3, 0, -4]).rotate([0, 1, 0], -90).scale([2.0, 50.0, 1.0])
        }

    def test_the_light_of_surfaces_is_reflection_and_that_of_the_environment_is_not(self):
        mirrors = (
            {"type": "conductor", "material": "none"},
            {"type": "roughconductor", "material": "none", "alpha": 0.02},
            principled(metallic=1.0, roughness=0.1),
        )
        for bsdf in mirrors:
            for integrator in (
                {"max_depth": 2},
                {"max_depth": 5},
                {},
                {"integrator": "direct"},
                {"hide_emitters": True},
            ):
                found = self.channels([tilted(bsdf, 45.0), self.wall()], **integrator)
                np.testing.assert_allclose(found["Reflection"], found["Combined"], rtol=0.05)
                self.assertGreater(found["Reflection"].min(), 0.1)
            found = self.channels([tilted(bsdf, 45.0), scenes.sky(1.0)], paths=64)
            np.testing.assert_array_equal(found["Reflection"], 0.0)
            # The lamp hides the sky where it is.
            found = self.channels([tilted(bsdf, 45.0), self.wall(), scenes.sky(0.5)])
            alone = self.channels([tilted(bsdf, 45.0), self.wall()])
            np.testing.assert_allclose(found["Reflection"], alone["Reflection"], rtol=0.05)

    def test_the_parts_of_the_light_of_a_glossy_surface_add_up_to_it(self):
        bulb = {"type": "point", "position": [2.0, 1.0, -2.0], "intensity": 8.0}
        sun = {"type": "directional", "direction": [-1.0, 0.0, 0.0], "irradiance": 2.0}
        matt = scenes.card(0.0, {"type": "twosided", "bsdf": {"type": "diffuse"}}) | {
            "to_world": mi.ScalarTransform4f().translate([6, 0, -4]).rotate([0, 1, 0], -90).scale(50.0)
        }
        for bsdf in (
            {"type": "roughplastic", "alpha": 0.2},
            {"type": "plastic"},
            principled(specular=0.9),
            principled(metallic=0.5, clearcoat=1.0, sheen=0.5),
            {"type": "mask", "opacity": 0.5, "bsdf": {"type": "roughplastic", "alpha": 0.2}},
        ):
            # Mitsuba's `path` darkens what is within `mask`.
            integrator = {"integrator": "volpath" if bsdf["type"] == "mask" else "path", "max_depth": 4}
            near = self.channels([tilted(bsdf, 45.0), self.wall(), matt, bulb], paths=4096, **integrator)
            np.testing.assert_allclose(near["Diffuse"] + near["Reflection"], near["Combined"], rtol=0.05)
            self.assertGreater(near["Reflection"].min(), 0.0)
            far = self.channels([tilted(bsdf, 45.0), scenes.sky(1.0)], paths=256, max_depth=4)
            np.testing.assert_array_equal(far["Reflection"], 0.0)
            far = self.channels([tilted(bsdf, 45.0), sun], paths=256, max_depth=4)
            np.testing.assert_array_equal(far["Reflection"], 0.0)

    def test_what_is_not_told_from_diffuse_light_is_no_reflection(self):
        for bsdf in ({"type": "diffuse"}, {"type": "principledthin"}):
            found = self.channels([tilted(bsdf, 45.0), self.wall()], paths=16)
            np.testing.assert_array_equal(found["Reflection"], 0.0)
            np.testing.assert_array_equal(found["Diffuse"], found["Combined"])

    def test_normals_are_in_the_axes_of_the_camera_and_face_it(self):
        for angle in (0.0, 25.0, 205.0):
            found = self.channels([tilted({"type": "twosided", "bsdf": {"type": "diffuse"}}, angle)], paths=1)
            turned = math.radians(angle % 180.0)
            np.testing.assert_allclose(found["Normal"], (math.sin(turned), 0.0, math.cos(turned)), atol=1e-6)

    def test_the_reflected_distance_runs_along_the_mirrored_ray(self):
        mirror = {"type": "conductor", "material": "none"}
        # A mirror at 45° sends the ray to the right, to a wall 3 away.
        wall = scenes.card(0.0, scenes.black()) | {
            "to_world": mi.ScalarTransform4f().translate([3, 0, -4]).rotate([0, 1, 0], -90).scale(50.0)
        }
        found = self.channels([tilted(mirror, 45.0), wall], paths=1)
        np.testing.assert_allclose(found["ReflectedDistance"], 3.0, rtol=1e-4)
        found = self.channels([tilted(mirror, 45.0), scenes.sky(1.0)], paths=1)
        np.testing.assert_array_equal(found["ReflectedDistance"], np.float32(1e10))

    def test_merged_normals_have_length_one_and_distances_stay_distances(self):
        mirror = {"type": "sphere", "center": [0, 0, -4], "radius": 1.0, "bsdf": {"type": "conductor"}}
        behind = scenes.card(-2.0, scenes.black())
        found = self.channels([mirror, behind], paths=1, samples=3, field_deg=4.0)
        self.assertAlmostEqual(float(np.linalg.norm(found["Normal"])), 1.0, places=6)
        # Straight back from the sphere's front, at 3, to the card at -2; to the sides it is a little farther.
        self.assertTrue(5.0 <= float(found["ReflectedDistance"][0]) < 5.3, found["ReflectedDistance"])

    def test_reflectance_and_roughness_are_those_of_the_material(self):
        for bsdf, reflectance, roughness in (
            ({"type": "diffuse"}, 0.0, 1.0),
            ({"type": "roughplastic", "alpha": 0.16, "int_ior": 1.5, "ext_ior": 1.0}, 0.04, 0.4),
            (
                {"type": "twosided", "bsdf": {"type": "roughconductor", "alpha": 0.25, "eta": 0.5, "k": 2.0}},
                17 / 25,
                0.5,
            ),
            (principled(metallic=1.0), ALBEDO, 0.3),
            (principled(specular=0.5), 0.04, 0.3),
        ):
            found = self.channels([tilted(bsdf)], paths=1)
            np.testing.assert_allclose(found["Specular"], np.broadcast_to(reflectance, 3), atol=1e-4)
            np.testing.assert_allclose(found["Roughness"], roughness, atol=1e-6)
