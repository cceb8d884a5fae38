"""Stacks from Blender hold what the scene's geometry says. Needs the bpy module."""

from __future__ import annotations

import contextlib
import io
import math
import os
import tempfile
import unittest
from typing import Any

import numpy as np

from . import blender_package
from .blender_scene import material

bpy, cli, module = blender_package.bpy, blender_package.cli, blender_package.module
export = module("export")
exr = module("shared").exr
Settings = module("settings").Settings

# The frame; with the lens below, a pixel is 0.01 of the distance.
SIZE = (40, 20)
PIXEL = 0.01
WORLD = (0.2, 0.3, 0.4)
QUICK = {"samples": 4, "overscan": 0, "threads": 2, "cryptomatte": False, "denoise": False}


def scene_of(size: tuple[int, int] = SIZE) -> Any:
    """An empty scene with a camera at the origin that looks along -z, y up."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.world = bpy.data.worlds.new("world")
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*WORLD, 1.0)
    data = bpy.data.cameras.new("camera")
    data.sensor_width, data.lens = 20.0, 20.0 / (size[0] * PIXEL)
    # So wide that surfaces at different distances are not merged.
    data.dof.focus_distance, data.dof.aperture_fstop = 3.0, 0.1
    data.dof.use_dof = True
    scene.camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(scene.camera)
    return scene


def glow(color: tuple[float, float, float]) -> Any:
    """A material that emits `color`: without noise."""
    made, (emission,) = material("glow", "ShaderNodeEmission")
    emission.inputs["Color"].default_value = (*color, 1.0)
    return made


def card(distance: float, box_px: tuple[float, float, float, float], made: Any) -> Any:
    """A card at `distance` that covers the pixels from left and top to right and bottom."""
    left, top, right, bottom = box_px
    x = [(value - SIZE[0] / 2) * PIXEL * distance for value in (left, right)]
    y = [(SIZE[1] / 2 - value) * PIXEL * distance for value in (bottom, top)]
    mesh = bpy.data.meshes.new("card")
    mesh.from_pydata([(x[i], y[j], -distance) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], [], [(0, 1, 2, 3)])
    mesh.materials.append(made)
    ob = bpy.data.objects.new("card", mesh)
    bpy.context.scene.collection.objects.link(ob)
    return ob


def stack_of(scene: Any, **settings: Any) -> tuple[list[dict[str, np.ndarray]], dict[str, Any]]:
    """The layers of the scene's stack, their channels without the peel's name, and the header."""
    silent = export.Talk(lambda text: None, lambda text: None)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "stack.exr")
        export.export(scene, Settings(**{**QUICK, **settings}), path, silent)
        (part,) = exr.read(path)
    layers: dict[int, dict[str, np.ndarray]] = {}
    for name, plane in part.channels.items():
        peel, _, channel = name.partition(".")
        layers.setdefault(int(peel.removeprefix("Peel")), {})[channel] = plane.astype(np.float64)
    return [layers[peel] for peel in sorted(layers)], part.attributes


def at(layers: list[dict[str, np.ndarray]], x: int, y: int) -> list[tuple[float, float, float]]:
    """Red, alpha and depth of the fragments of a pixel."""
    found = [tuple(float(layer[name][y, x]) for name in ("Combined.R", "Combined.A", "Depth.Z")) for layer in layers]
    return [fragment for fragment in found if fragment[1] > 0]


class Peels(unittest.TestCase):
    def assert_fragments(self, found: list[tuple], expected: list[tuple]) -> None:
        self.assertEqual(len(found), len(expected), found)
        np.testing.assert_allclose(found, expected, rtol=2e-3)

    def test_every_surface_of_a_pixel_is_a_layer_and_the_world_is_the_last(self):
        scene = scene_of()
        card(2.0, (0, 0, 20, 20), glow((0.5, 0, 0)))
        card(4.0, (10, 0, 30, 20), glow((3.0, 0, 0)))
        layers, _ = stack_of(scene)
        near, far, world = (0.5, 1, 2), (3, 1, 4), (WORLD[0], 1, 1e10)
        self.assert_fragments(at(layers, 5, 10), [near, world])
        self.assert_fragments(at(layers, 15, 10), [near, far, world])
        self.assert_fragments(at(layers, 25, 10), [far, world])
        self.assert_fragments(at(layers, 35, 10), [world])

    def test_alpha_is_the_share_of_the_pixel(self):
        scene = scene_of()
        card(2.0, (0, 0, 10.5, 20), glow((1.0, 0, 0)))
        card(4.0, (0, 0, 40, 15.25), glow((1.0, 0, 0)))
        layers, _ = stack_of(scene)
        self.assert_fragments(at(layers, 10, 5), [(0.5, 0.5, 2), (1, 1, 4), (WORLD[0], 1, 1e10)])
        layers, _ = stack_of(scene, supersample=4)
        self.assert_fragments(at(layers, 20, 15), [(0.25, 0.25, 4), (WORLD[0], 1, 1e10)])

    def test_the_inside_of_closed_meshes_is_left_out_and_that_of_transparent_ones_is_kept(self):
        scene = scene_of()
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.1, location=(0, 0, -3))
        ball = bpy.context.object
        ball.data.materials.append(glow((1.0, 0, 0)))
        card(5.0, (0, 0, 40, 20), glow((2.0, 0, 0)))
        # A mirrored ball has its outside where it was.
        for scale in (1, -1):
            ball.scale.x = scale
            layers, _ = stack_of(scene, background=False)
            self.assertEqual([round(depth) for _, _, depth in at(layers, 20, 10)], [3, 5])
        clear, (mix, transparent, emission) = material(
            "clear", "ShaderNodeMixShader", "ShaderNodeBsdfTransparent", "ShaderNodeEmission"
        )
        clear.node_tree.links.new(transparent.outputs[0], mix.inputs[1])
        clear.node_tree.links.new(emission.outputs[0], mix.inputs[2])
        ball.data.materials[0] = clear
        layers, _ = stack_of(scene, background=False, samples=256)
        found = at(layers, 20, 10)
        np.testing.assert_allclose([depth for _, _, depth in found], [2.9, 3.1, 5.0], rtol=5e-3)
        np.testing.assert_allclose([alpha for _, alpha, _ in found], [0.5, 0.5, 1.0], atol=0.05)

    def test_a_custom_property_overrules_what_is_closed(self):
        scene = scene_of()
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.1, location=(0, 0, -3))
        bpy.context.object.data.materials.append(glow((1.0, 0, 0)))
        for is_closed, depths in ((0, [2.9, 3.1]), (1, [2.9])):
            bpy.context.object["thinlens_closed"] = is_closed
            layers, _ = stack_of(scene, background=False)
            np.testing.assert_allclose([depth for _, _, depth in at(layers, 20, 10)], depths, rtol=5e-3)

    def test_what_is_behind_a_coloured_transparent_surface_is_seen_in_its_colour(self):
        scene = scene_of()
        tinted, (clear,) = material("tinted", "ShaderNodeBsdfTransparent")
        clear.inputs["Color"].default_value = (0.25, 0.5, 1.0, 1.0)
        card(2.0, (0, 0, 40, 20), tinted)
        card(4.0, (0, 0, 40, 20), glow((4.0, 4.0, 4.0)))
        layers, _ = stack_of(scene, background=False)
        self.assert_fragments(at(layers, 20, 10), [(1, 1, 2), (4, 1, 4)])
        self.assertAlmostEqual(float(layers[0]["Combined.B"][10, 20]), 4.0, delta=0.02)

    def test_denoising_leaves_emitted_light_as_it_is(self):
        scene = scene_of()
        card(2.0, (20, 10, 21, 11), glow((60.0, 0, 0)))
        plain, _ = stack_of(scene)
        denoised, _ = stack_of(scene, denoise=True)
        self.assertEqual(float(plain[0]["Combined.R"][10, 20]), 60.0)
        np.testing.assert_allclose(denoised[0]["Combined.R"], plain[0]["Combined.R"], atol=1e-3)

    def test_overscan_continues_the_frame(self):
        scene = scene_of()
        card(2.0, (3, 5, 17, 14), glow((1.0, 0, 0)))
        scene.camera.data.shift_x, scene.camera.data.shift_y = 0.1, -0.05
        plain, _ = stack_of(scene)
        wide, _ = stack_of(scene, overscan=6)
        self.assertEqual(wide[0]["Combined.R"].shape, (32, 52))
        for name in plain[0]:
            np.testing.assert_allclose(wide[0][name][6:-6, 6:-6], plain[0][name], rtol=1e-3, atol=1e-3)
        # A shift of 0.1 moves the picture to the left by a tenth of its width.
        self.assertEqual(plain[0]["Depth.Z"][7].tolist(), [2.0] * 13 + [1e10] * 27)

    def test_the_overscan_is_what_the_blur_needs(self):
        scene = scene_of()
        data = scene.camera.data
        card(2.0, (-200, -200, 200, 200), glow((1.0, 0, 0)))
        _, header = stack_of(scene, overscan=None, background=False)
        # CoC radius: f/N/2 · |1/z − 1/z_f| · f/w · W, a pixel being 1/100 at distance 1.
        radius = data.lens * 1e-3 / 0.1 / 2 * abs(1 / 2 - 1 / 3) / PIXEL
        x0 = int(np.frombuffer(header["dataWindow"].data, "<i4")[0])
        self.assertGreaterEqual(-x0, radius - 0.5)
        self.assertLessEqual(-x0, radius + 2.5)

    def test_the_header_has_the_lens(self):
        scene = scene_of((20, 40))
        data, dof = scene.camera.data, scene.camera.data.dof
        target = bpy.data.objects.new("target", None)
        target.location = (5.0, 1.0, -7.0)
        scene.collection.objects.link(target)
        dof.focus_object, dof.aperture_blades, dof.aperture_rotation = target, 5, math.radians(20)
        scene.unit_settings.scale_length = 0.01
        _, header = stack_of(scene, peels=1)
        expected = {
            "focal_length_mm": data.lens,
            # The sensor is fitted to the longer side.
            "sensor_width_mm": 10.0,
            "f_number": 0.1,
            "focus_distance": 7.0,
            "blades": 5,
            "rotation_deg": 20.0,
            "metres_per_unit": 1.0,
            "sensor_distance": "focal_length",
            "depth_convention": "planar",
            "kind": "coverage",
        }
        for name, value in expected.items():
            found = header[f"thinlens.{name}"]
            check = self.assertEqual if isinstance(value, str) else self.assertAlmostEqual
            check(found, value, *([] if isinstance(value, str) else [4]), msg=name)


class CommandLine(unittest.TestCase):
    def test_frames_are_written_once_and_errors_have_the_exit_codes_of_thinlens(self):
        with tempfile.TemporaryDirectory() as folder:
            blend = os.path.join(folder, "shot.blend")
            scene_of()
            ob = card(2.0, (0, 0, 10, 20), glow((1.0, 0, 0)))
            for frame, z in ((1, 0.0), (2, -1.0)):
                ob.location.z = z
                ob.keyframe_insert("location", frame=frame)
            bpy.ops.wm.save_as_mainfile(filepath=blend)
            options = [blend, "--frames", "1-2", "-o", os.path.join(folder, "a.####.exr"), "--peels", "1"]
            options += ["--samples", "1", "--overscan", "0", "--no-background"]
            code, said = self.run_quietly(options)
            self.assertEqual(code, 0, said)
            depths = [exr.read(os.path.join(folder, f"a.000{frame}.exr"))[0] for frame in (1, 2)]
            depths = [float(part.channels["Peel0.Depth.Z"][10, 8]) for part in depths]
            np.testing.assert_allclose(depths, [2.0, 3.0], rtol=1e-4)
            code, said = self.run_quietly(options)
            self.assertEqual((code, said.count("is there already")), (0, 2), said)
            self.assertEqual(self.run_quietly([*options, "--peels", "99"])[0], 2)
            self.assertEqual(self.run_quietly(["no.blend", *options[1:]])[0], 4)
            bpy.context.scene.render.engine = "BLENDER_WORKBENCH"
            bpy.ops.wm.save_as_mainfile(filepath=blend)
            self.assertEqual(self.run_quietly([*options, "--overwrite"])[0], 4)

    def test_scene_camera_and_view_layer_are_chosen_by_name(self):
        with tempfile.TemporaryDirectory() as folder:
            blend, stack = os.path.join(folder, "shot.blend"), os.path.join(folder, "stack.exr")
            scene = scene_of()
            bpy.data.scenes.new("empty")
            scene.name = "full"
            card(2.0, (0, 0, 20, 20), glow((1.0, 0, 0)))
            hidden = bpy.data.collections.new("hidden")
            scene.collection.children.link(hidden)
            hidden.objects.link(card(1.0, (0, 0, 40, 20), glow((7.0, 0, 0))))
            scene.collection.objects.unlink(hidden.objects[0])
            without = scene.view_layers.new("without")
            without.layer_collection.children["hidden"].exclude = True
            other = bpy.data.objects.new("other", scene.camera.data)
            other.location.z = 1.0
            scene.collection.objects.link(other)
            bpy.context.window.scene = bpy.data.scenes["empty"]
            bpy.ops.wm.save_as_mainfile(filepath=blend)
            options = [blend, "-o", stack, "--samples", "1", "--overscan", "0", "--scene", "full", "--no-background"]
            for more, depth in (
                ([], 1.0),
                (["--view-layer", "without"], 2.0),
                (["--view-layer", "without", "--camera", "other"], 3.0),
            ):
                code, said = self.run_quietly([*options, *more])
                self.assertEqual(code, 0, said)
                (part,) = exr.read(stack)
                self.assertAlmostEqual(float(part.channels["Peel0.Depth.Z"][10, 10]), depth, 3)
            code, said = self.run_quietly([*options, "--scene", "absent"])
            self.assertEqual((code, "empty, full" in said), (2, True), said)

    def run_quietly(self, arguments: list[str]) -> tuple[int, str]:
        said = io.StringIO()
        with contextlib.redirect_stderr(said):
            code = cli.main(arguments, True)
        return code, said.getvalue()


if __name__ == "__main__":
    unittest.main()
