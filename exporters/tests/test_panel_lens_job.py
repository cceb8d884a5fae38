"""One run of thinlens: its flags are the camera's values, its picture is the frame, complete or not there."""

import math
import os
import sys
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np
from blender import lens_job
from blender.lens_job import LensJob, LensRun
from blender.shared import ExportError, exr, lens

from .test_panel_program import script

CAMERA = lens.Lens(
    50.0, 36.0, f_number=1.4, focus_distance=2.5, blades=6, rotation_deg=-30.0, squeeze=2.0, metres_per_unit=1.0
)


def values(flags: list[str]) -> dict[str, float]:
    return {name: float(value) for name, value in (flag.removeprefix("--").split("=") for flag in flags)}


class Flags(unittest.TestCase):
    def test_every_value_of_the_blur_is_a_flag_so_that_none_of_the_header_stays(self) -> None:
        expected = {"focus": 2.5, "f-number": 1.4, "blades": 6, "rotation": -30, "squeeze": 2}
        self.assertEqual(values(lens_job.flags(CAMERA, whole=False)), expected)

    def test_a_stack_without_a_lens_gets_the_frame_s_too(self) -> None:
        whole = values(lens_job.flags(CAMERA, whole=True))
        self.assertEqual((whole["focal-length"], whole["sensor-width"]), (50, 36))

    def test_floats_survive_the_command_line(self) -> None:
        for value in (np.float32(0.1), np.float32(1 / 3), np.float32(16777217.0), np.float32(1e-7)):
            own = lens.Lens(50.0, 36.0, f_number=float(value), focus_distance=float(value))
            read = values(lens_job.flags(own, whole=False))
            self.assertEqual((np.float32(read["focus"]), np.float32(read["f-number"])), (value, value))

    def test_a_pinhole_has_an_infinite_f_number(self) -> None:
        self.assertEqual(values(lens_job.flags(lens.Lens(50.0, 36.0), whole=False))["f-number"], math.inf)

    def test_a_quality_comes_on_top(self) -> None:
        run = LensRun("thinlens", "s.exr", "r.exr", ("--focus=2",)).at(lens_job.DRAFT)
        self.assertEqual(run.command("o.exr")[-2:], ["--focus=2", "--quality=draft"])


class Place(unittest.TestCase):
    """A folder with a stack."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.result = str(self.folder / "new" / "lens.exr")

    def picture(self, window: exr.Window, frame: exr.Window, **attributes: float) -> str:
        width, height = exr.size(window)
        x, y = np.meshgrid(np.arange(width) + window[0], np.arange(height) + window[1])
        path = str(self.folder / "stack.exr")
        channels = {"R": (100 * y + x).astype(np.float16), "A": np.ones((height, width), np.float32)}
        exr.write(path, channels, window, frame, {f"thinlens.{name}": value for name, value in attributes.items()})
        return path


class Files(Place):
    def test_a_lens_in_the_header_is_seen(self) -> None:
        frame = (0, 0, 3, 2)
        self.assertTrue(lens_job.has_lens(self.picture(frame, frame, focal_length_mm=50.0)))
        self.assertFalse(lens_job.has_lens(self.picture(frame, frame, f_number=2.0)))
        self.assertFalse(lens_job.has_lens("/nowhere.exr"))

    def test_the_picture_is_the_frame_without_the_margin(self) -> None:
        lens_job.publish(self.picture((-2, -1, 5, 4), (0, 0, 3, 2), f_number=2.0), self.result)
        part = exr.read(self.result)[0]
        self.assertEqual((part.data_window, part.display_window), ((0, 0, 3, 2), (0, 0, 3, 2)))
        expected = [[100 * y + x for x in range(4)] for y in range(3)]
        np.testing.assert_array_equal(part.channels["R"], np.array(expected, np.float16))
        self.assertEqual(part.channels["R"].dtype, np.float16)
        self.assertEqual(part.attributes["thinlens.f_number"], 2.0)

    def test_a_picture_of_a_part_of_the_frame_stays_as_it_is(self) -> None:
        lens_job.publish(self.picture((1, 1, 2, 2), (0, 0, 3, 2)), self.result)
        part = exr.read(self.result)[0]
        self.assertEqual((part.data_window, part.display_window), ((1, 1, 2, 2), (0, 0, 3, 2)))

    def test_a_missing_stack_is_an_error_that_names_its_file(self) -> None:
        with self.assertRaisesRegex(ExportError, r"s\.0012\.exr"):
            lens_job.stack_of("/nowhere/s.####.exr", 12)


@unittest.skipIf(os.name == "nt", "shell scripts stand for programs")
class Running(Place):
    def job(self, text: str) -> LensJob:
        """Of a program in Python that gets the arguments of thinlens: the stack is `s`, the output `o`."""
        program = self.folder / "program.py"
        program.write_text(f"import shutil, sys, time\ns, o = sys.argv[3], sys.argv[5]\n{text}\n")
        path = script(str(self.folder), f'exec "{sys.executable}" "{program}" "$@"')
        return LensJob(LensRun(path, self.picture((-1, 0, 4, 2), (0, 0, 3, 2)), self.result))

    def test_the_picture_of_a_run_is_at_its_place_in_the_end(self) -> None:
        outcome = lens_job.wait(self.job("shutil.copy(s, o); print('warning: dim', file=sys.stderr)"))
        self.assertTrue(outcome.is_done, outcome.text)
        self.assertEqual((outcome.path, outcome.warnings), (self.result, ("warning: dim",)))
        self.assertEqual(exr.read(self.result)[0].data_window, (0, 0, 3, 2))

    def test_a_failed_run_says_why_and_leaves_the_earlier_picture(self) -> None:
        os.makedirs(os.path.dirname(self.result))
        Path(self.result).write_text("earlier")
        outcome = lens_job.wait(self.job("print('error: no depth\\n  help: add it', file=sys.stderr); sys.exit(1)"))
        self.assertEqual((outcome.is_done, outcome.text), (False, "error: no depth\n  help: add it"))
        self.assertEqual(Path(self.result).read_text(), "earlier")

    def test_a_damaged_picture_is_a_failure_and_not_an_endless_job(self) -> None:
        outcome = lens_job.wait(self.job("open(o, 'w').write('half a pic')"))
        self.assertFalse(outcome.is_done)
        self.assertFalse(os.path.exists(self.result))

    def test_a_stopped_run_leaves_nothing(self) -> None:
        job = self.job("open(o, 'w').close(); time.sleep(60)")
        deadline = time.monotonic() + 30
        while not os.path.exists(job._output) and time.monotonic() < deadline:
            self.assertIsNone(job.poll())
            time.sleep(0.02)
        job.stop()
        self.assertFalse(os.path.exists(os.path.dirname(job._output)))
        self.assertFalse(os.path.exists(self.result))


if __name__ == "__main__":
    unittest.main()
