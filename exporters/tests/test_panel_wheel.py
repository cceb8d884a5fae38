"""The panel in Blender: the export and the lens give what the program gives. Needs the bpy module."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

try:
    import bpy
except ImportError as error:
    raise unittest.SkipTest("the bpy module is not installed: the panel is not tested") from error

sys.path[:0] = [str(Path(__file__).parent)]
from blender import live, post_step, present, program, registration  # noqa: E402
from blender.shared import ExportError, exr  # noqa: E402
from blender_fingerprint import changes, fingerprint  # noqa: E402

try:
    PROGRAM = program.check(os.environ.get("THINLENS", ""))
except ExportError as error:
    raise unittest.SkipTest(f"the program thinlens is needed to test the panel: {error}") from error

SIZE = (96, 54)
OVERSCAN = 4
CAN_COMPARE = bpy.app.version >= (4, 5, 0)
COMMAND_LINE = post_step.COMMAND_LINE


def build(folder: str) -> Any:
    """A cube before a wall with a picture on it, saved as `folder`/shot.blend. The camera looks along +y."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.frame_start, scene.frame_end = 1, 2
    bpy.ops.mesh.primitive_cube_add(size=0.5, location=(0.0, 3.0, 0.0))
    bpy.context.object.data.materials.append(glow("cube", (1.0, 0.1, 0.1, 1.0)))
    bpy.ops.mesh.primitive_plane_add(size=20.0, location=(0.0, 9.0, 0.0), rotation=(np.pi / 2, 0.0, 0.0))
    bpy.context.object.data.materials.append(glow("wall", picture(folder)))
    data = bpy.data.cameras.new("camera")
    scene.camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(scene.camera)
    scene.camera.rotation_euler = (np.pi / 2, 0.0, 0.0)
    data.dof.focus_distance, data.dof.aperture_fstop = 3.0, 0.2
    data.dof.aperture_blades, data.dof.aperture_rotation, data.dof.aperture_ratio = 5, np.radians(20.0), 1.5
    own = data.thinlens
    own.peels, own.supersample, own.kind, own.overscan = 2, 1, "point", OVERSCAN
    own.apply_after, own.quality = False, "draft"
    # As a panel that is drawn does: properties are stored once they are looked at.
    scene.thinlens.use_post_step = False
    bpy.context.view_layer.update()
    bpy.ops.wm.save_as_mainfile(filepath=os.path.join(folder, "shot.blend"))
    return scene


def glow(name: str, color: Any) -> Any:
    """A material that emits a colour or an image."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    if isinstance(color, tuple):
        emission.inputs[0].default_value = color
        return material
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = color
    tree.links.new(texture.outputs[0], emission.inputs[0])
    return material


def picture(folder: str) -> Any:
    """A blue image with a path relative to the Blender file."""
    os.mkdir(os.path.join(folder, "textures"))
    image = bpy.data.images.new("blue", 8, 8, float_buffer=True)
    image.pixels.foreach_set(np.tile(np.float32([0.0, 0.0, 1.0, 1.0]), 64))
    path = os.path.join(folder, "textures", "blue.exr")
    image.filepath_raw, image.file_format = path, "OPEN_EXR"
    image.save()
    bpy.data.images.remove(image)
    image = bpy.data.images.load(path)
    image.filepath = "//../" + os.path.basename(folder) + "/textures/blue.exr"
    return image


class Panel(unittest.TestCase):
    """One scene, exported once through the operator."""

    @classmethod
    def setUpClass(cls) -> None:
        cls.place = tempfile.TemporaryDirectory()
        cls.folder = os.path.realpath(cls.place.name)
        cls.enterClassContext(mock.patch.dict(os.environ, {"PATH": os.path.dirname(PROGRAM.path)}))
        # A test of the command line in this process must not switch off the post step.
        cls.enterClassContext(mock.patch.dict(sys.modules))
        sys.modules.pop(COMMAND_LINE, None)
        registration.register()
        cls.scene = build(cls.folder)
        before = fingerprint() if CAN_COMPARE else {}
        cls.status = bpy.ops.thinlens.export()
        cls.changed = changes(before, fingerprint()) if CAN_COMPARE else []
        cls.stack = os.path.join(cls.folder, "stacks", "stack.0001.exr")

    @classmethod
    def tearDownClass(cls) -> None:
        registration.unregister()
        cls.place.cleanup()

    def setUp(self) -> None:
        self.camera = self.scene.camera
        self.own, self.dof = self.camera.data.thinlens, self.camera.data.dof
        self.own.lens = "CAMERA"
        self.own.property_unset("stack")
        self.dof.use_dof, self.dof.focus_object, self.dof.focus_distance = False, None, 3.0
        self.dof.aperture_fstop = 0.2
        self.scene.thinlens.use_post_step = False
        self.scene.render.engine = "CYCLES"
        self.scene.frame_set(1)

    def frame(self, stack: str, *flags: str, quality: str = "draft") -> np.ndarray:
        """The program's own picture, `[height][width][4]`, without the margin."""
        out = os.path.join(self.folder, "own.exr")
        command = [PROGRAM.path, "-q", "render", stack, "-o", out, f"--quality={quality}", *flags]
        subprocess.run(command, check=True, capture_output=True)
        part = exr.read(out)[0]
        x, y = -part.data_window[0], -part.data_window[1]
        planes = np.stack([part.channels[name] for name in "RGBA"], axis=-1)
        return planes[y : y + SIZE[1], x : x + SIZE[0]].astype(np.float32)

    def camera_flags(self, focus: float, f_number: float = 0.2) -> list[str]:
        """The flags of the lens of `build`."""
        own = ["--blades=5", "--rotation=20", "--squeeze=1.5"]
        return [f"--focus={focus}", f"--f-number={f_number}", *own]

    def shown(self) -> np.ndarray:
        """The image `thinlens`, row 0 on top."""
        image = bpy.data.images["thinlens"]
        self.assertEqual(tuple(image.size), SIZE)
        pixels = np.empty(SIZE[0] * SIZE[1] * 4, np.float32)
        image.pixels.foreach_get(pixels)
        return pixels.reshape(SIZE[1], SIZE[0], 4)[::-1]

    def refusal(self, operator: Any, **named: Any) -> str:
        """The error of an operator."""
        with self.assertRaises(RuntimeError) as caught:
            operator(**named)
        return str(caught.exception)


class Export(Panel):
    @unittest.skipUnless(CAN_COMPARE, "Blender 4.2 crashes when all its properties are read")
    def test_the_export_leaves_the_open_file_as_it_was(self) -> None:
        self.assertEqual((self.status, self.changed), ({"FINISHED"}, []))
        self.assertEqual(bpy.data.filepath, os.path.join(self.folder, "shot.blend"))

    def test_the_copy_finds_a_texture_of_the_file_s_own_folder(self) -> None:
        part = exr.read(self.stack)[0]
        corner = [float(part.channels[f"Peel0.Combined.{name}"][0, 0]) for name in "RGB"]
        np.testing.assert_allclose(corner, [0.0, 0.0, 1.0], atol=1e-3)

    def test_the_copy_finds_the_caches_of_simulations_and_they_outlive_it(self) -> None:
        cache = Path(self.folder, "blendcache_shot", "cloth.bphys")
        cache.parent.mkdir()
        cache.touch()
        with tempfile.TemporaryDirectory() as folder:
            copy = present.save_copy(folder, print)
            self.assertTrue(Path(copy).with_name("blendcache_shot").joinpath(cache.name).exists())
        self.assertTrue(cache.exists())

    def test_painted_images_that_are_not_saved_are_named(self) -> None:
        image = next(own for own in bpy.data.images if own.filepath.endswith("blue.exr"))
        said: list[str] = []
        try:
            image.pixels[0] = 0.5
            with tempfile.TemporaryDirectory() as folder:
                present.save_copy(folder, said.append)
        finally:
            image.reload()
        self.assertEqual([image.name in text for text in said], [True])

    def test_no_copy_is_left(self) -> None:
        self.assertEqual([name for name in os.listdir(tempfile.gettempdir()) if "thinlens-export" in name], [])

    def test_an_error_of_the_background_blender_reaches_the_user(self) -> None:
        self.scene.render.engine = "BLENDER_WORKBENCH"
        text = self.refusal(bpy.ops.thinlens.export)
        self.assertIn("only Cycles renders peels", text)
        self.assertIn("set the render engine to Cycles", text)

    def test_several_frames_need_a_place_for_the_number(self) -> None:
        self.own.frames, self.own.stack = "RANGE", "//one.exr"
        try:
            self.assertIn("2 frames cannot go into one file", self.refusal(bpy.ops.thinlens.export))
        finally:
            self.own.frames = "CURRENT"

    def test_a_file_that_was_never_saved_has_no_folder(self) -> None:
        with mock.patch("bpy.path.abspath", lambda path: path.removeprefix("//")):
            self.assertIn("save the Blender file", self.refusal(bpy.ops.thinlens.export))


class Lens(Panel):
    def test_the_image_is_the_program_s_picture_of_the_camera_s_lens(self) -> None:
        bpy.ops.thinlens.apply()
        np.testing.assert_array_equal(self.shown(), self.frame(self.stack, *self.camera_flags(3.0)))

    def test_another_lens_replaces_the_picture_in_the_same_image(self) -> None:
        bpy.ops.thinlens.apply()
        image, first = bpy.data.images["thinlens"], self.shown()
        self.dof.focus_distance, self.dof.aperture_fstop = 9.0, 0.4
        bpy.ops.thinlens.apply()
        self.assertEqual([own for own in bpy.data.images if own.name.startswith("thinlens")], [image])
        self.assertGreater(np.abs(self.shown() - first).max(), 0.1)
        np.testing.assert_array_equal(self.shown(), self.frame(self.stack, *self.camera_flags(9.0, 0.4)))

    def test_the_focus_object_s_distance_is_taken_along_the_axis(self) -> None:
        target = bpy.data.objects.new("target", None)
        self.scene.collection.objects.link(target)
        target.location = (2.0, 5.0, 1.0)
        self.dof.focus_object = target
        bpy.context.view_layer.update()
        bpy.ops.thinlens.apply()
        np.testing.assert_array_equal(self.shown(), self.frame(self.stack, *self.camera_flags(5.0)))

    def test_the_stack_s_own_lens_is_that_of_the_export(self) -> None:
        self.own.lens, self.dof.aperture_fstop = "FILE", 8.0
        bpy.ops.thinlens.apply()
        np.testing.assert_array_equal(self.shown(), self.frame(self.stack))
        np.testing.assert_array_equal(self.shown(), self.frame(self.stack, *self.camera_flags(3.0)))

    def test_a_frame_without_a_stack_is_an_error_that_names_the_file(self) -> None:
        self.scene.frame_set(2)
        self.assertIn("stack.0002.exr", self.refusal(bpy.ops.thinlens.apply))

    def test_an_error_of_the_program_reaches_the_user(self) -> None:
        whole = Path(self.stack).read_bytes()
        self.addCleanup(Path(self.stack).write_bytes, whole)
        Path(self.stack).write_bytes(whole[:-200])
        self.assertIn("truncated", self.refusal(bpy.ops.thinlens.apply))

    def test_a_camera_that_is_focused_on_itself_is_an_error(self) -> None:
        self.dof.focus_distance = 0.0
        self.assertIn("focused on itself", self.refusal(bpy.ops.thinlens.apply))

    def test_a_missing_program_is_said_with_what_to_do(self) -> None:
        with mock.patch.dict(os.environ, {"PATH": "/nowhere", "HOME": self.folder}):
            for operator in (bpy.ops.thinlens.apply, bpy.ops.thinlens.check, bpy.ops.thinlens.live):
                self.assertIn("install thinlens", self.refusal(operator))

    def test_the_version_is_reported(self) -> None:
        self.assertEqual(bpy.ops.thinlens.check(), {"FINISHED"})


class Registration(unittest.TestCase):
    def state(self) -> dict[str, Any]:
        """All that an extension can add."""
        handlers = {name: [own for own in getattr(bpy.app.handlers, name) if callable(own)] for name in HANDLERS}
        types = {name for name in dir(bpy.types) if "thinlens" in name.lower()}
        owners = {owner.__name__: hasattr(owner, "thinlens") for owner in (bpy.types.Camera, bpy.types.Scene)}
        return {**handlers, "types": types, **owners, "timer": bpy.app.timers.is_registered(live._on_timer)}

    def test_what_is_registered_goes_again(self) -> None:
        before = self.state()
        self.assertNotIn(True, (before["Camera"], before["Scene"], before["timer"]))
        for _ in range(2):
            registration.register()
            self.assertTrue(hasattr(bpy.context.scene, "thinlens"))
            self.assertIn("THINLENS_PT_cycles", dir(bpy.types))
            live.start("Scene", "camera")
            registration.unregister()
            self.assertEqual(self.state(), before)


HANDLERS = [name for name in dir(bpy.app.handlers) if isinstance(getattr(bpy.app.handlers, name), list)]

if __name__ == "__main__":
    unittest.main()
