"""Frame lists, names of files, and the run over a sequence."""

import contextlib
import io
import tempfile
import unittest
from pathlib import Path

import numpy as np

from thinlens_stack import exr, frames
from thinlens_stack.errors import ExportError


class Lists(unittest.TestCase):
    def test_numbers_and_ranges_are_frames_in_order(self):
        self.assertEqual(frames.parse("7"), [7])
        self.assertEqual(frames.parse("3-5, 1,4"), [1, 3, 4, 5])
        self.assertEqual(frames.parse("1-10x4"), [1, 5, 9])
        self.assertEqual(frames.parse("-2-1"), [-2, -1, 0, 1])

    def test_other_texts_are_refused(self):
        for text in ("", "a", "5-3", "1-", "1,,2", "1-9x0", "1.5"):
            with self.assertRaisesRegex(ExportError, "list of frames"):
                frames.parse(text)

    def test_a_list_of_more_frames_than_anybody_means_is_refused_at_once(self):
        self.assertEqual(len(frames.parse("1-1000000")), frames.MOST_FRAMES)
        for text in ("1-1000001", "1-999999999999", "1-600000,700001-1200000"):
            with self.assertRaisesRegex(ExportError, "too many frames"):
                frames.parse(text)
        self.assertEqual(frames.parse("1-999999999x999999998"), [1, 999999999])


class Names(unittest.TestCase):
    def test_the_last_run_of_hashes_in_the_name_is_the_number(self):
        self.assertEqual(frames.path("shots/a.####.exr", 12), "shots/a.0012.exr")
        self.assertEqual(frames.path("a#.###.exr", 12345), "a#.12345.exr")
        self.assertEqual(frames.path("a.####.exr", -7), "a.-0007.exr")
        self.assertEqual(frames.path("folder##/a.exr", 1), "folder##/a.exr")

    def test_a_pattern_tells_frames_apart(self):
        self.assertTrue(frames.is_pattern("a.#.exr"))
        self.assertFalse(frames.is_pattern("a.exr"))


class Runs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.pattern = str(Path(folder.name) / "a.##.exr")
        self.exported = []

    def export(self, frame, path):
        self.exported.append(frame)
        if frame == 2:
            raise ExportError("no camera")
        exr.write(path, {"Y": np.zeros((1, 1), np.float32)}, (0, 0, 0, 0), (0, 0, 0, 0), {})
        return "one pixel"

    def run_frames(self, *arguments, **options):
        self.said = io.StringIO()
        with contextlib.redirect_stderr(self.said):
            return frames.run(*arguments, self.export, **options)

    def test_a_second_run_makes_what_is_missing(self):
        self.assertEqual(self.run_frames([1, 3], self.pattern), frames.DONE)
        self.assertEqual(self.run_frames([1, 3, 4], self.pattern), frames.DONE)
        self.assertEqual(self.exported, [1, 3, 4])
        self.assertEqual(len(self.said.getvalue().splitlines()), 3, "a line a frame")
        self.run_frames([1], self.pattern, overwrite=True)
        self.assertEqual(self.exported, [1, 3, 4, 1])

    def test_a_frame_that_fails_is_said_and_does_not_stop_the_others(self):
        self.assertEqual(self.run_frames([1, 2, 3], self.pattern), frames.SOME_FAILED)
        self.assertEqual(self.exported, [1, 2, 3])
        self.assertIn("no camera", self.said.getvalue())
        self.assertIn("1 of 3 frames failed", self.said.getvalue())

    def test_a_file_that_is_no_openexr_is_refused_before_anything_is_rendered(self):
        for name in ("a.png", "a", "stack.exr.tmp", "a.##.jpg"):
            self.assertEqual(self.run_frames([1], str(Path(self.pattern).with_name(name))), frames.WRONG_USAGE)
        self.assertEqual(self.exported, [])
        self.assertIn("ends in .exr", self.said.getvalue())

    def test_the_exit_code_tells_whether_all_frames_failed_or_some(self):
        self.assertEqual(self.run_frames([2], self.pattern), 1)
        self.assertEqual(self.run_frames([1, 2], self.pattern), 3)
        self.assertEqual(self.run_frames([1, 2], self.pattern), 3, "frame 1 is there already")
        self.export = self.fail_always
        self.assertEqual(self.run_frames([1, 2], self.pattern, overwrite=True), 1)

    def fail_always(self, frame, path):
        raise ExportError("no camera")

    def test_the_line_of_a_frame_names_its_file_once(self):
        for numbers, line in (
            ([1], r"\S+a\.01\.exr, \d+\.\d s, one pixel"),
            ([2], r"\S+a\.02\.exr: failed"),
            ([3, 4], r"frame 3: \S+a\.03\.exr, \d+\.\d s, one pixel"),
        ):
            self.run_frames(numbers, self.pattern)
            self.assertRegex(self.said.getvalue().splitlines()[0], f"^{line}$")

    def test_several_frames_do_not_go_into_one_file(self):
        self.assertEqual(self.run_frames([1, 3], "a.exr"), frames.WRONG_USAGE)
        self.assertEqual(self.exported, [])
