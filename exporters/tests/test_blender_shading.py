"""The channels for reflections from Blender against closed forms. Needs the bpy module."""

from __future__ import annotations

import math
import os
import tempfile
import unittest
from typing import Any

import numpy as np

from . import blender_package
from .blender_scene import material

bpy, mathutils, module = blender_package.bpy, blender_package.mathutils, blender_package.module
Euler, Matrix, Vector = mathutils.Euler, mathutils.Matrix, mathutils.Vector
export = module("export")
exr = module("shared").exr
Settings = module("settings").Settings

SIZE = (24, 12)
# The width of a pixel, at distance 1.
PIXEL = 0.04
WORLD = (0.2, 0.3, 0.4)
# From the camera's axes to the world's: the camera looks anywhere.
TO_WORLD = Matrix.LocRotScale(Vector((1.0, -2.0, 0.5)), Euler((0.7, 0.4, -1.1)), None)
# A mirror at distance 4 on the axis, turned by 45° to the right, to a wall that is 3 away.
MIRROR = Matrix.Translation((0.0, 0.0, -4.0)) @ Matrix.Rotation(math.radians(45.0), 4, "Y")
WALL = Matrix.Translation((3.0, 0.0, -4.0)) @ Matrix.Rotation(math.radians(-90.0), 4, "Y")

COLORS, MORE = ("Combined", "Diffuse", "Reflection", "Specular"), ("Depth.Z", "ReflectedDistance.V", "Roughness.V")
CHANNELS = (*(f"{group}.{end}" for group in COLORS for end in "RGB"), *(f"Normal.{end}" for end in "XYZ"), *MORE)


def scene_of() -> Any:
    """A scene with a camera, a lamp and a world."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.world = bpy.data.worlds.new("world")
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*WORLD, 1.0)
    data = bpy.data.cameras.new("camera")
    data.sensor_width, data.lens = 20.0, 20.0 / (SIZE[0] * PIXEL)
    data.dof.focus_distance, data.dof.aperture_fstop, data.dof.use_dof = 3.0, 0.5, True
    scene.camera = bpy.data.objects.new("camera", data)
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    lamp.data.energy, lamp.location = 300.0, TO_WORLD @ Vector((1.0, 1.0, -2.0))
    for ob in (scene.camera, lamp):
        scene.collection.objects.link(ob)
    scene.camera.matrix_world = TO_WORLD
    return scene


def surface(kind: str, **inputs: Any) -> Any:
    """A material of one shader."""
    made, (node,) = material(kind, f"ShaderNode{kind}")
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return made


def card(place: Matrix, made: Any) -> Any:
    """A large card whose normal is the third axis of `place`, in the camera's axes."""
    mesh = bpy.data.meshes.new("card")
    mesh.from_pydata([(x, y, 0.0) for x, y in ((-50, -50), (50, -50), (50, 50), (-50, 50))], [], [(0, 1, 2, 3)])
    mesh.materials.append(made)
    ob = bpy.data.objects.new("card", mesh)
    ob.matrix_world = TO_WORLD @ place
    bpy.context.scene.collection.objects.link(ob)
    return ob


# What exports told the user.
said: list[str] = []


def layers_of(scene: Any, **settings: Any) -> list[dict[str, np.ndarray]]:
    """The layers of the scene's stack: channels without the peel's name, groups of several as one array."""
    plain = {"samples": 16, "overscan": 0, "threads": 2, "cryptomatte": False, "denoise": False, "shading": True}
    silent = export.Talk(said.append, lambda text: None)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "stack.exr")
        export.export(scene, Settings(**{**plain, **settings}), path, silent)
        (part,) = exr.read(path)
    groups: dict[int, dict[str, list[np.ndarray]]] = {}
    for name in CHANNELS:
        for peel in range(8):
            if (full := f"Peel{peel}.{name}") in part.channels:
                group = groups.setdefault(peel, {}).setdefault(name.partition(".")[0], [])
                group.append(part.channels[full].astype(np.float64))
    return [{name: np.stack(planes, axis=-1) for name, planes in groups[peel].items()} for peel in sorted(groups)]


def rays() -> np.ndarray:
    """Directions of the pixels' rays in the camera's axes, of length 1, `[height][width][3]`."""
    x = (np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2) * PIXEL
    y = (SIZE[1] / 2 - np.arange(SIZE[1]) - 0.5) * PIXEL
    out = np.stack([*np.meshgrid(x, y), np.full(SIZE[::-1], -1.0)], axis=-1)
    return out / np.linalg.norm(out, axis=-1, keepdims=True)


def distances_to(plane: Matrix, starts: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """How far it is from `starts` along `ways` to a card."""
    normal, point = np.array(plane.col[2].xyz), np.array(plane.translation)
    return ((point - starts) @ normal) / (ways @ normal)


class Shading(unittest.TestCase):
    def setUp(self):
        said.clear()

    def test_a_diffuse_surface_has_only_diffuse_light(self):
        scene = scene_of()
        card(MIRROR, surface("BsdfDiffuse", Color=(0.2, 0.4, 0.6, 1.0)))
        for denoise in (False, True):
            (layer, world) = layers_of(scene, denoise=denoise)
            self.assertGreater(layer["Combined"].min(), 0.02)
            np.testing.assert_allclose(layer["Diffuse"], layer["Combined"], rtol=1e-3)
            np.testing.assert_array_equal(world["Diffuse"], world["Combined"])

    def test_a_mirror_has_none_and_a_coat_adds_none(self):
        scene = scene_of()
        made = surface("BsdfGlossy", Roughness=0.0, Color=(1.0, 1.0, 1.0, 1.0))
        mirror = card(MIRROR, made)
        layer = layers_of(scene)[0]
        np.testing.assert_allclose(layer["Combined"], np.broadcast_to(WORLD, layer["Combined"].shape), rtol=1e-3)
        np.testing.assert_allclose(layer["Diffuse"], 0.0, atol=1e-3)
        mirror.data.materials[0] = surface("BsdfPrincipled", Base_Color=(0.0, 0.0, 0.0, 1.0), Roughness=0.1)
        layer = layers_of(scene)[0]
        self.assertGreater(layer["Combined"].min(), 0.005)
        np.testing.assert_allclose(layer["Diffuse"], 0.0, atol=1e-3)

    def test_what_shines_or_is_seen_through_glass_counts_as_diffuse(self):
        scene = scene_of()
        glow = surface("Emission", Color=(3.0, 2.0, 1.0, 1.0))
        card(Matrix.Translation((0.0, 0.0, -9.0)), glow)
        layer = layers_of(scene)[0]
        np.testing.assert_allclose(
            layer["Diffuse"], np.broadcast_to((3.0, 2.0, 1.0), layer["Diffuse"].shape), rtol=1e-3
        )
        card(MIRROR, surface("BsdfRefraction", IOR=1.0, Roughness=0.0, Color=(0.5, 0.5, 0.5, 1.0)))
        layer = layers_of(scene)[0]
        np.testing.assert_allclose(
            layer["Diffuse"], np.broadcast_to((1.5, 1.0, 0.5), layer["Diffuse"].shape), rtol=5e-3
        )

    def test_normals_are_in_the_axes_of_the_camera_and_face_it(self):
        scene = scene_of()
        ob = card(MIRROR, surface("BsdfDiffuse"))
        normal = MIRROR.col[2].xyz
        for turned in (Matrix(), Matrix.Rotation(math.pi, 4, "Y")):
            ob.matrix_world = TO_WORLD @ MIRROR @ turned
            layer = layers_of(scene, samples=4)[0]
            np.testing.assert_allclose(layer["Normal"], np.broadcast_to(normal, layer["Normal"].shape), atol=1e-3)

    def test_the_reflected_distance_runs_along_the_mirrored_ray_whatever_the_surface_is_made_of(self):
        scene = scene_of()
        mirror = card(MIRROR, surface("BsdfGlossy", Roughness=0.0))
        ways = rays()
        starts = ways * distances_to(MIRROR, np.zeros(3), ways)[..., None]
        normal = np.array(MIRROR.col[2].xyz)
        mirrored = ways - 2.0 * (ways @ normal)[..., None] * normal
        expected = distances_to(WALL, starts, mirrored)
        self.assertAlmostEqual(float(distances_to(WALL, np.array((0, 0, -4.0)), np.array((1.0, 0, 0)))), 3.0)
        layer = layers_of(scene, samples=1)[0]
        np.testing.assert_array_equal(layer["ReflectedDistance"], np.float32(1e10))
        card(WALL, surface("Emission", Color=(5.0, 5.0, 5.0, 1.0)))
        for made in (None, surface("BsdfDiffuse"), surface("BsdfPrincipled")):
            if made:
                mirror.data.materials[0] = made
            found = layers_of(scene, samples=1, kind="point")
            hit = found[0]["Depth"][..., 0] - starts[..., 2] * -1.0
            # Where the wall is in front of the mirror, it is the first peel.
            is_mirror = np.abs(hit) < 1e-3
            self.assertGreater(is_mirror.mean(), 0.5)
            np.testing.assert_allclose(found[0]["ReflectedDistance"][is_mirror, 0], expected[is_mirror], rtol=1e-3)

    def test_the_light_of_surfaces_is_reflection_and_that_of_the_world_and_suns_is_not(self):
        scene = scene_of()
        mirror = card(MIRROR, surface("BsdfGlossy", Roughness=0.0, Color=(1.0, 1.0, 1.0, 1.0)))
        sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        sun.rotation_euler = (0.5, 1.5, 0.0)
        # The sun's light by two reflections is left out.
        scene.cycles.caustics_reflective = False
        scene.collection.objects.link(sun)
        bpy.data.objects["lamp"].hide_render = True
        shiny = surface("BsdfPrincipled", Roughness=0.2, Metallic=0.5)
        for made in (None, shiny):
            mirror.data.materials[0] = made or mirror.data.materials[0]
            for denoise in (False, True):
                layer = layers_of(scene, denoise=denoise)[0]
                self.assertGreater((layer["Combined"] - layer["Diffuse"]).min(), 0.05)
                np.testing.assert_allclose(layer["Reflection"], 0.0, atol=1e-4)
        if bpy.app.version < (5, 0):
            scene.world.use_nodes, scene.world.color = False, WORLD
            layer = layers_of(scene)[0]
            self.assertGreater((layer["Combined"] - layer["Diffuse"]).min(), 0.05)
            np.testing.assert_allclose(layer["Reflection"], 0.0, atol=1e-4)
            self.assertFalse(scene.world.use_nodes)
        # A matt wall in the light of the world and the sun: that is reflection.
        mirror.data.materials[0] = surface("BsdfGlossy", Roughness=0.0, Color=(1.0, 1.0, 1.0, 1.0))
        wall = card(WALL, surface("BsdfDiffuse"))
        layer = layers_of(scene, kind="point")[0]
        ways = rays()
        # Where the wall is in front of the mirror, it is the first peel.
        is_mirror = (
            np.abs(layer["Depth"][..., 0] + (ways * distances_to(MIRROR, np.zeros(3), ways)[..., None])[..., 2]) < 1e-3
        )
        is_lit = is_mirror & (layer["ReflectedDistance"][..., 0] < 1e9)
        self.assertGreater(layer["Reflection"][is_lit].min(), 0.005)
        np.testing.assert_allclose(layer["Reflection"][is_lit], layer["Combined"][is_lit], rtol=1e-3)
        wall.data.materials[0] = surface("Emission", Color=(3.0, 2.0, 1.0, 1.0))
        layer = layers_of(scene, kind="point")[0]
        self.assertGreater(is_lit.mean(), 0.4)
        lit = layer["Reflection"][is_lit]
        np.testing.assert_allclose(lit, np.broadcast_to((3.0, 2.0, 1.0), lit.shape), rtol=2e-3)

    def test_reflectance_and_roughness_are_read_from_the_shaders(self):
        scene = scene_of()
        ob = card(MIRROR, surface("BsdfDiffuse"))
        rgb = (0.2, 0.4, 0.6)
        tint = (*rgb, 1.0)
        for made, reflectance, roughness in (
            (surface("BsdfDiffuse"), 0.0, 1.0),
            (surface("BsdfGlossy", Color=tint, Roughness=0.3), rgb, 0.3),
            (surface("BsdfGlass", IOR=1.5, Roughness=0.1), 0.04, 0.1),
            (surface("BsdfPrincipled", Base_Color=tint, Metallic=1.0, Roughness=0.25), rgb, 0.25),
            (surface("BsdfPrincipled", Base_Color=tint, Roughness=0.5, IOR=1.5), 0.04, 0.5),
            (surface("BsdfPrincipled", IOR=2.0, Specular_IOR_Level=0.25, Roughness=0.5), 1.0 / 18.0, 0.5),
            (self.mixed("Fac"), (0.05, 0.1, 0.15), 0.3),
            (self.mixed("Fresnel"), (0.008, 0.016, 0.024), 0.3),
            (self.textured(), (0.5, 0.25, 0.75), 0.4),
        ):
            ob.data.materials[0] = made
            nodes = len(made.node_tree.nodes)
            layer = layers_of(scene, samples=1)[0]
            found = layer["Specular"]
            np.testing.assert_allclose(found, np.broadcast_to(reflectance, found.shape), atol=1e-3, err_msg=made.name)
            np.testing.assert_allclose(layer["Roughness"], roughness, atol=1e-3, err_msg=made.name)
            self.assertEqual(len(made.node_tree.nodes), nodes)
        self.assertFalse([line for line in said if "cannot be read" in line])

    def test_a_warning_names_materials_whose_reflectance_cannot_be_read(self):
        scene = scene_of()
        made, (node,) = material("velvet", "ShaderNodeBsdfToon")
        card(MIRROR, made)
        layer = layers_of(scene, samples=1)[0]
        np.testing.assert_array_equal(layer["Specular"], 0.0)
        np.testing.assert_array_equal(layer["Roughness"], 1.0)
        self.assertEqual(
            len([line for line in said if line.startswith("warning: shaders of velvet cannot be read")]), 1
        )

    @staticmethod
    def mixed(share: str) -> Any:
        """A glossy shader of colour 0.2, 0.4, 0.6 over a diffuse one, by a quarter or by the angle."""
        made, (mix, matt, shiny) = material(
            "mixed", "ShaderNodeMixShader", "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy"
        )
        tree = made.node_tree
        shiny.inputs["Color"].default_value, shiny.inputs["Roughness"].default_value = (0.2, 0.4, 0.6, 1.0), 0.3
        mix.inputs[0].default_value = 0.25
        if share == "Fresnel":
            fresnel = tree.nodes.new("ShaderNodeFresnel")
            fresnel.inputs["IOR"].default_value = 1.5
            tree.links.new(fresnel.outputs[0], mix.inputs[0])
        tree.links.new(matt.outputs[0], mix.inputs[1])
        tree.links.new(shiny.outputs[0], mix.inputs[2])
        return made

    @staticmethod
    def textured() -> Any:
        """Metal whose colour and roughness come from other nodes."""
        made, (metal, color, value, route) = material(
            "textured", "ShaderNodeBsdfPrincipled", "ShaderNodeRGB", "ShaderNodeValue", "NodeReroute"
        )
        tree = made.node_tree
        color.outputs[0].default_value, value.outputs[0].default_value = (0.5, 0.25, 0.75, 1.0), 0.4
        metal.inputs["Metallic"].default_value = 1.0
        tree.links.new(color.outputs[0], route.inputs[0])
        tree.links.new(route.outputs[0], metal.inputs["Base Color"])
        tree.links.new(value.outputs[0], metal.inputs["Roughness"])
        return made

    def test_a_surface_behind_another_has_its_own(self):
        scene = scene_of()
        card(Matrix.Translation((0.0, 0.0, -2.0)), surface("BsdfDiffuse"))
        card(Matrix.Translation((0.0, 0.0, -5.0)), surface("BsdfGlossy", Roughness=0.0))
        near, far, _ = layers_of(scene, samples=4)
        np.testing.assert_array_equal(near["ReflectedDistance"], np.float32(1e10))
        # Back to the near card, past it to nothing: 3 along the axis.
        cosine = -rays()[..., 2:]
        np.testing.assert_allclose(far["ReflectedDistance"], 3.0 / cosine, rtol=2e-3)
        np.testing.assert_allclose(far["Normal"], np.broadcast_to((0.0, 0.0, 1.0), far["Normal"].shape), atol=1e-3)

    def test_merged_normals_have_length_one(self):
        scene = scene_of()
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.8, location=TO_WORLD @ Vector((0.0, 0.0, -4.0)))
        bpy.ops.object.shade_smooth()
        layer = layers_of(scene, supersample=3)[0]
        is_there = layer["Depth"][..., 0] < 1e9
        length = np.linalg.norm(layer["Normal"], axis=-1)
        np.testing.assert_allclose(length[is_there], 1.0, atol=2e-3)
        np.testing.assert_array_equal(length[~is_there], 0.0)

    def test_without_the_option_there_are_no_such_channels(self):
        scene = scene_of()
        card(MIRROR, surface("BsdfDiffuse"))
        for layer in layers_of(scene, shading=False, samples=1):
            self.assertEqual(set(layer), {"Combined", "Depth"})


if __name__ == "__main__":
    unittest.main()
