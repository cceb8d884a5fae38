"""An export in the background: its command line, its progress, its errors, and what a stop leaves."""

import math
import os
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

from blender import cli, lens_job
from blender.export_job import Choices, ExportJob, Host, Progress, frame_list
from blender.shared import frames

# Stands for Blender: writes the files of its frames as the exporter does, one of them unfinished.
WRITER = """
import sys, time, os
sys.path[:0] = [{exporters!r}]
from blender import cli
from blender.shared import frames
options = cli.parser(True).parse_args(sys.argv[1:])
for frame in frames.parse(options.frames):
    path = frames.path(options.output, frame)
    os.makedirs(os.path.dirname(path), exist_ok=True)
    part = os.path.join(os.path.dirname(path), "." + os.path.basename(path) + ".x1.part")
    print("peel 0", file=sys.stderr, flush=True)
    open(part, "w").close()
    open(os.path.join(os.environ["TMPDIR"], "pass.exr"), "w").close()
    if frame == {hang}:
        time.sleep(60)
    os.rename(part, path)
    print(f"frame {{frame}}: {{path}}, 1.2 s, 4×3 and 0 px around it, 2 layers", file=sys.stderr, flush=True)
"""


class CommandLine(unittest.TestCase):
    def test_what_the_panel_asks_for_is_what_the_command_line_understands(self) -> None:
        choices = Choices(
            "/a b/s.####.exr",
            (1, 2, 3, 7),
            overwrite=True,
            peels=3,
            kind="point",
            supersample=1,
            samples=16,
            overscan=0,
            denoise=False,
            background=True,
            cryptomatte=False,
            shading=True,
            scene="--odd scene",
            camera="my camera",
            view_layer="front",
        )
        options = cli.parser(True).parse_args(["copy.blend", *choices.options()])
        self.assertEqual(frames.parse(options.frames), [1, 2, 3, 7])
        for name in ("output", "peels", "kind", "supersample", "samples", "overscan", "denoise", "background"):
            self.assertEqual(getattr(options, name), getattr(choices, name), name)
        for name in ("cryptomatte", "shading", "scene", "camera", "view_layer", "overwrite"):
            self.assertEqual(getattr(options, name), getattr(choices, name), name)

    def test_what_is_left_open_is_left_to_the_command_line(self) -> None:
        options = cli.parser(True).parse_args(["copy.blend", *Choices("/s.exr", (5,)).options()])
        self.assertEqual((options.samples, options.overscan, options.denoise, options.background), (None,) * 4)

    def test_lists_of_frames_are_read_back_as_they_were(self) -> None:
        for wanted in ([1], [1, 2, 3], [-3, -2, 0, 1, 5], [2, 4, 6], [0, 1, 10, 11, 12, 40]):
            self.assertEqual(frames.parse(frame_list(wanted)), wanted)

    def test_blender_gets_the_options_after_two_dashes_and_fails_with_the_script(self) -> None:
        command = Host("/opt/blender", "python", "/x/cli.py", runs_scripts=False).command("copy.blend", ["--peels=3"])
        self.assertEqual(command[command.index("--") + 1 :], ["--peels=3"])
        self.assertLess(command.index("--python-exit-code"), command.index("--python"))
        self.assertLess(command.index("--disable-autoexec"), command.index("copy.blend"))

    def test_without_blender_python_runs_the_script(self) -> None:
        command = Host("", "/usr/bin/python", "/x/cli.py").command("copy.blend", ["--peels=3"])
        self.assertEqual(command, ["/usr/bin/python", "/x/cli.py", "copy.blend", "--peels=3"])


class Lines(unittest.TestCase):
    def test_frames_are_counted_whether_done_there_already_or_failed(self) -> None:
        progress = Progress(4)
        for line in (
            "frame 1: /s/a b.0001.exr is there already",
            "4 light samples a pixel: 2×2 places with 1 each, up to 4 peels",
            "distances of peel 0",
            "frame 2: /s/s.0002.exr, 3.4 s, 96×54 and 2 px around it, 3 layers",
            "frame 3: failed",
            "error: a render was stopped",
            "  in peel 1: /x, 1.0 s",
        ):
            progress.feed(line)
        self.assertEqual((progress.finished, progress.failed, progress.share), (3, 1, 0.75))

    def test_the_render_that_runs_is_shown(self) -> None:
        progress = Progress(2)
        self.assertIn("starting", progress.text)
        for step in ("overscan", "distances of peel 1", "peel 1", "denoising of peel 1", "background"):
            progress.feed(step)
            self.assertEqual(progress.text, f"frame 1 of 2: {step}")


@unittest.skipIf(os.name == "nt", "signals stop programs")
class Running(unittest.TestCase):
    def setUp(self) -> None:
        self.place = tempfile.TemporaryDirectory()
        self.addCleanup(self.place.cleanup)
        self.folder = os.path.join(self.place.name, "copy")
        os.mkdir(self.folder)
        self.output = os.path.join(self.place.name, "out", "s.##.exr")

    def start(self, program: str, wanted: tuple[int, ...] = (1, 2)) -> ExportJob:
        path = os.path.join(self.place.name, "program.py")
        Path(path).write_text(program)
        return ExportJob(Host("", sys.executable, path), "copy.blend", Choices(self.output, wanted), self.folder)

    def writer(self, hang: int = -1) -> str:
        return WRITER.format(exporters=str(Path(__file__).parents[1]), hang=hang)

    def files(self) -> list[str]:
        return sorted(os.listdir(os.path.dirname(self.output)))

    def test_an_export_ends_with_its_files_and_without_its_folder(self) -> None:
        outcome = lens_job.wait(self.start(self.writer()))
        self.assertTrue(outcome.is_done, outcome.text)
        self.assertEqual(self.files(), ["s.01.exr", "s.02.exr"])
        self.assertFalse(os.path.exists(self.folder))

    def test_a_stop_ends_the_program_and_leaves_what_was_finished(self) -> None:
        os.makedirs(os.path.dirname(self.output))
        foreign = [".other.01.exr.x1.part", ".s.02.exr.older.part"]
        for name in foreign:
            (Path(self.output).parent / name).touch()
        job = self.start(self.writer(hang=2))
        deadline = time.monotonic() + 30
        while len(self.files()) < 4 and time.monotonic() < deadline:
            self.assertIsNone(job.poll())
            time.sleep(0.02)
        self.assertIn(".s.02.exr.x1.part", self.files())
        job.stop()
        self.assertEqual(self.files(), [*foreign, "s.01.exr"])
        self.assertFalse(os.path.exists(self.folder))
        self.assertNotIn(
            self.folder, subprocess.run(["ps", "-Aww", "-o", "args"], capture_output=True, text=True).stdout
        )

    def test_errors_reach_the_user_in_the_program_s_words(self) -> None:
        said = "warning: volume fog has no depth\nframe 1: failed\nerror: only Cycles\n  found: X\nnot this"
        program = f"import sys; print({said!r}, file=sys.stderr); sys.exit(1)"
        outcome = lens_job.wait(self.start(program, (1,)))
        self.assertFalse(outcome.is_done)
        self.assertEqual(outcome.text, "error: only Cycles\n  found: X")
        self.assertEqual(outcome.warnings, ("warning: volume fog has no depth",))

    def test_frames_that_fail_alike_are_counted_and_their_error_is_said_once(self) -> None:
        said = "\n".join(f"frame {frame}: failed\nerror: no light\n  in peel 1" for frame in range(1, 4))
        program = f"import sys; print({said!r}, file=sys.stderr); sys.exit(1)"
        outcome = lens_job.wait(self.start(program, (1, 2, 3, 4)))
        self.assertEqual(outcome.text, "error: 3 of 4 frames failed\nerror: no light\n  in peel 1")

    def test_a_crash_is_reported_with_the_last_lines(self) -> None:
        outcome = lens_job.wait(self.start("raise ZeroDivisionError('no light')"))
        self.assertIn("ended with code 1", outcome.text)
        self.assertIn("ZeroDivisionError: no light", outcome.text)

    def test_an_end_without_the_files_is_a_failure(self) -> None:
        outcome = lens_job.wait(self.start("pass"))
        self.assertFalse(outcome.is_done)
        self.assertIn("s.01.exr was not written", outcome.text)

    def test_a_program_that_is_missing_is_an_error_and_the_folder_goes(self) -> None:
        host = Host("/nowhere/blender", "", "cli.py")
        with self.assertRaisesRegex(Exception, "/nowhere/blender"):
            ExportJob(host, "copy.blend", Choices(self.output, (1,)), self.folder)
        self.assertFalse(os.path.exists(self.folder))

    def test_progress_grows_to_one(self) -> None:
        job = self.start(self.writer())
        shares = [job.share]
        while job.poll() is None:
            shares.append(job.share)
        self.assertEqual(shares, sorted(shares))
        self.assertTrue(math.isclose(job.share, 1.0))


if __name__ == "__main__":
    unittest.main()
