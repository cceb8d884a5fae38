"""The post step in Blender: each frame gets the lens of its moment, and no failure stops a render. Needs bpy."""

from __future__ import annotations

import os
import tempfile
import unittest

import numpy as np

from .test_panel_wheel import Panel, bpy, exr, post_step

# Of the two frames of the animation.
FOCUS = {1: 3.0, 2: 7.0}


class PostStep(Panel):
    def setUp(self) -> None:
        super().setUp()
        render, layer = self.scene.render, bpy.context.view_layer
        layer.use_pass_z = True
        if hasattr(render.image_settings, "media_type"):
            render.image_settings.media_type = "MULTI_LAYER_IMAGE"
        render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
        self.frames = tempfile.TemporaryDirectory(dir=self.folder)
        self.addCleanup(self.frames.cleanup)
        render.filepath = os.path.join(self.frames.name, "f.####")
        self.scene.thinlens.use_post_step = True

    def written(self) -> list[str]:
        return sorted(os.listdir(self.frames.name))

    def test_each_frame_gets_the_lens_of_its_own_moment(self) -> None:
        for frame, focus in FOCUS.items():
            self.dof.focus_distance = focus
            self.dof.keyframe_insert("focus_distance", frame=frame)
        self.addCleanup(self.camera.data.animation_data_clear)
        bpy.ops.render.render(animation=True)
        self.assertEqual(post_step.failures(), {})
        self.assertEqual(self.written(), ["f.0001.exr", "f.0001.lens.exr", "f.0002.exr", "f.0002.lens.exr"])
        for frame, focus in FOCUS.items():
            source = os.path.join(self.frames.name, f"f.{frame:04d}.exr")
            flags = [*self.camera_flags(focus), "--focal-length=50", "--sensor-width=36", "--carry=none"]
            part = exr.read(source.replace(".exr", ".lens.exr"))[0]
            planes = np.stack([part.channels[name] for name in "RGBA"], axis=-1).astype(np.float32)
            np.testing.assert_array_equal(planes, self.frame(source, *flags))

    def test_a_still_gets_its_lens_too(self) -> None:
        bpy.ops.render.render(write_still=True)
        self.assertEqual((post_step.failures(), post_step.written()), ({}, 1))
        self.assertEqual(self.written(), ["f.####.exr", "f.####.lens.exr"])

    def test_failures_stop_no_render_and_are_kept(self) -> None:
        self.dof.use_dof = True
        bpy.ops.render.render(animation=True)
        self.assertEqual(self.written(), ["f.0001.exr", "f.0002.exr"])
        self.assertEqual(sorted(post_step.failures()), [1, 2])
        self.assertIn("switch Depth of Field off", post_step.failures()[2])

    def test_a_frame_without_depth_is_a_failure_in_the_program_s_words(self) -> None:
        bpy.context.view_layer.use_pass_z = False
        bpy.ops.render.render(write_still=True)
        self.assertIn("depth", post_step.failures()[1])

    def test_other_formats_are_refused(self) -> None:
        image = self.scene.render.image_settings
        if hasattr(image, "media_type"):
            image.media_type = "IMAGE"
        image.file_format = "PNG"
        bpy.ops.render.render(write_still=True)
        self.assertIn("OpenEXR MultiLayer", post_step.failures()[1])

    def test_it_is_off_by_default(self) -> None:
        self.scene.thinlens.property_unset("use_post_step")
        bpy.ops.render.render(write_still=True)
        self.assertEqual(self.written(), ["f.####.exr"])


if __name__ == "__main__":
    unittest.main()
