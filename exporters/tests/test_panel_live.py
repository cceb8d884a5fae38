"""Live re-lens in Blender: the picture follows the camera, as the program renders it. Needs the bpy module."""

from __future__ import annotations

import contextlib
import os
import time
import unittest
from collections.abc import Iterator

import numpy as np

from .test_panel_wheel import Panel, bpy, live


class Live(Panel):
    @contextlib.contextmanager
    def switched_on(self) -> Iterator[live.Session]:
        bpy.ops.thinlens.live()
        try:
            yield live.session()
        finally:
            live.stop()

    def settle(self, session: live.Session) -> None:
        """What the timer does, until the picture is final."""
        deadline = time.monotonic() + 60.0
        session.tick()
        while not session.is_settled and time.monotonic() < deadline:
            time.sleep(0.02)
            session.tick()
        self.assertTrue(session.is_settled, session.text)

    def test_the_picture_follows_the_camera(self) -> None:
        with self.switched_on() as session:
            self.settle(session)
            for focus, f_number in ((9.0, 0.2), (3.0, 0.4)):
                self.dof.focus_distance, self.dof.aperture_fstop = focus, f_number
                self.settle(session)
                self.assertFalse(session.is_error, session.text)
                expected = self.frame(self.stack, *self.camera_flags(focus, f_number), quality="final")
                np.testing.assert_array_equal(self.shown(), expected)

    def test_it_follows_the_camera_also_where_the_stack_s_own_lens_is_applied(self) -> None:
        self.own.lens = "FILE"
        with self.switched_on() as session:
            self.dof.focus_distance = 6.0
            self.settle(session)
        expected = self.frame(self.stack, *self.camera_flags(6.0), quality="final")
        np.testing.assert_array_equal(self.shown(), expected)

    def test_an_image_of_a_draft_does_not_refer_to_a_file_that_is_gone(self) -> None:
        bpy.ops.thinlens.apply()
        result = bpy.data.images["thinlens"].filepath
        with self.switched_on() as session:
            self.dof.focus_distance = 4.5
            deadline = time.monotonic() + 60.0
            while not session.text.startswith("draft") and time.monotonic() < deadline:
                session.tick()
            draft = self.shown()
        self.assertEqual(bpy.data.images["thinlens"].filepath, result)
        np.testing.assert_array_equal(self.shown(), draft)

    def test_an_error_is_shown_and_the_next_good_lens_clears_it(self) -> None:
        with self.switched_on() as session:
            self.own.stack = "//nowhere.exr"
            session.tick()
            self.assertTrue(session.is_error)
            self.assertIn("nowhere.exr", session.text)
            self.own.property_unset("stack")
            self.settle(session)
            self.assertFalse(session.is_error, session.text)

    def test_the_switch_turns_off_and_leaves_no_timer_and_no_folder(self) -> None:
        with self.switched_on() as session:
            folder = session._folder
            self.assertTrue(bpy.app.timers.is_registered(live._on_timer))
            bpy.ops.thinlens.live()
        self.assertIsNone(live.session())
        self.assertFalse(bpy.app.timers.is_registered(live._on_timer))
        self.assertFalse(os.path.exists(folder))


if __name__ == "__main__":
    unittest.main()
