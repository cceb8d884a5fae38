"""The templates for render farms, with stand-ins for the farm and for the program.

A stand-in of the program writes its arguments, one call a line, and ends with the exit codes that it is
told, one a call; from 128 on, and where it is told to wait, it is ended by a signal.
"""

import json
import os
import signal
import subprocess
import tempfile
import textwrap
import time
import unittest
from pathlib import Path

EXPORTERS = Path(__file__).resolve().parent.parent
SLURM = EXPORTERS / "slurm"

PROGRAM = """\
#!/usr/bin/env python3
import json, os, signal, sys
with open("calls", "a") as calls:
    calls.write(json.dumps(sys.argv[1:]) + "\\n")
codes = os.environ["CODES"].split()
number = len(open("calls").readlines())
code = codes[min(number, len(codes)) - 1]
if code == "wait":
    signal.pause()
code = int(code)
if code > 128:
    os.kill(os.getpid(), code - 128)
sys.exit(code)
"""

SBATCH = """\
#!/usr/bin/env python3
import json, os, sys
with open("jobs", "a") as jobs:
    variables = {name: value for name, value in os.environ.items() if name.startswith("THINLENS_")}
    jobs.write(json.dumps([sys.argv[1:], variables]) + "\\n")
print(len(open("jobs").readlines()))
"""

SCONTROL = """\
#!/usr/bin/env bash
[[ $1 == show ]] && echo "MaxArraySize            = 1001"
[[ $1 != requeue ]] || { echo "$2" >>requeued; kill -KILL "$PPID"; }
"""


def embedded_task():
    """The script in the template for Open Job Description."""
    lines = (EXPORTERS / "openjd" / "template.yaml").read_text().splitlines()
    begin = lines.index("          data: |") + 1
    end = next(index for index, line in enumerate(lines) if line == "steps:")
    return textwrap.dedent("\n".join(lines[begin:end])) + "\n"


class Farm(unittest.TestCase):
    """A folder of its own, with stand-ins of programs."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        (self.folder / "bin").mkdir()
        for name, text in {"program": PROGRAM, "sbatch": SBATCH, "scontrol": SCONTROL}.items():
            (self.folder / "bin" / name).write_text(text)
            (self.folder / "bin" / name).chmod(0o755)

    def start(self, *arguments, **variables):
        path = f"{self.folder / 'bin'}:{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path, **{name: str(value) for name, value in variables.items()}}
        pipes = dict(stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        return subprocess.Popen(["bash", *map(str, arguments)], cwd=self.folder, env=environment, **pipes)

    def bash(self, *arguments, **variables):
        process = self.start(*arguments, **variables)
        stdout, stderr = process.communicate()
        return subprocess.CompletedProcess(process.args, process.returncode, stdout, stderr)

    def stop(self, process):
        """Ends the script, not the program, once the program runs; the script's exit code."""
        while not self.lines("calls"):
            time.sleep(0.01)
        process.send_signal(signal.SIGTERM)
        process.communicate()
        return process.returncode

    def lines(self, name):
        file = self.folder / name
        return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


class OpenJobDescription(Farm):
    def task(self, subcommand="render", frames="1-4", run=None, **variables):
        script = self.folder / "task.sh"
        script.write_text(embedded_task())
        values = dict(
            INPUT_FOLDER="in", INPUT_NAMES="a.####.exr", OUTPUT_FOLDER="out", OUTPUT_NAME="b.####.exr", FLAGS=""
        )
        values |= dict(RENDER_FLAGS="", THREADS=0, MEMORY="", PROGRAM="program", RETRIES=2, RETRY_SECONDS=0)
        values |= {name: value for name, value in variables.items() if name != "CODES"}
        named = {f"THINLENS_{name}": value for name, value in values.items()}
        return (run or self.bash)(script, subcommand, frames, CODES=variables.get("CODES", 0), **named)

    def test_both_steps_have_the_flags_of_the_shot_and_one_file_of_decisions(self):
        given = dict(FLAGS="--preset 'my lens.toml'", RENDER_FLAGS="--codec zips", MEMORY="4GiB", THREADS=3)
        self.task("plan", "1-9:2", **given)
        self.task("render", "1-3:2", INPUT_NAMES="a.####.exr 'z depth.####.exr'", **given)
        common = ["--decisions", "out/b.decisions.toml", "--preset", "my lens.toml"]
        plan = ["--threads", "3", "plan", "in/a.####.exr", "--frames=1-9x2", *common]
        render = ["--threads", "3", "render", "in/a.####.exr", "in/z depth.####.exr", "--frames=1-3x2", *common]
        render += ["-o", "out/b.####.exr", "--resume", "--progress", "openjd", "--memory", "4GiB", "--codec", "zips"]
        self.assertEqual(self.lines("calls"), [plan, render])

    def test_a_task_is_tried_again_where_that_may_help_and_as_often_as_allowed(self):
        for codes, calls, code in [
            ("0", 1, 0),
            ("1 137 0", 3, 0),
            ("1 1 1 0", 3, 1),
            ("2 0", 1, 2),
            ("3 0", 1, 3),
            ("4 0", 1, 4),
        ]:
            (self.folder / "calls").unlink(missing_ok=True)
            done = self.task(CODES=codes)
            self.assertEqual((len(self.lines("calls")), done.returncode), (calls, code), codes)

    def test_a_task_that_the_farm_stops_ends_the_program_and_is_not_tried_again(self):
        self.assertEqual(self.stop(self.task(run=self.start, CODES="wait")), 143)
        self.assertEqual(len(self.lines("calls")), 1)

    def test_the_farm_is_told_of_a_program_that_cannot_tell_itself(self):
        self.assertIn("openjd_fail: program ended with code 137", self.task(CODES="137", RETRIES=0).stdout)

    def test_a_value_is_words_and_is_never_run_or_expanded(self):
        self.task(FLAGS="$(touch ran) `touch ran` * ; touch ran")
        self.assertEqual(
            self.lines("calls")[0][5:14], ["$(touch", "ran)", "`touch", "ran`", "*", ";", "touch", "ran", "-o"]
        )
        self.assertFalse((self.folder / "ran").exists())
        refused = self.task(FLAGS="--preset 'portrait")
        self.assertEqual(refused.returncode, 2)
        self.assertIn("openjd_fail: Flags: a quote is not closed", refused.stdout)


class SlurmSubmission(Farm):
    def submit(self, *options, frames="1-100"):
        names = ("--input", "in/a.####.exr", "--output", "out/b.####.exr")
        return self.bash(SLURM / "submit.sh", *names, "--frames", frames, *options)

    def chunks(self, frames, size):
        (self.folder / "jobs").unlink(missing_ok=True)
        done = self.submit("--chunk", size, frames=frames)
        self.assertEqual(done.returncode, 0, done.stderr)
        return self.lines("jobs")[1][1]["THINLENS_CHUNKS"].split()

    def test_the_array_waits_for_the_decision_and_has_a_task_for_each_chunk(self):
        done = self.submit(
            "--chunk", 30, "--at-once", 2, "--threads", 4, "--memory-mib", 1024, "--sbatch", "--comment='a b'"
        )
        self.assertEqual(done.stdout, "1 2\n")
        (decide, values), (render, _) = self.lines("jobs")
        self.assertEqual(values["THINLENS_STEP"], "plan")
        for option in ["--dependency=afterok:1", "--array=0-3%2"]:
            self.assertNotIn(option, decide)
            self.assertIn(option, render)
        for option in ["--cpus-per-task=4", "--mem=1280M", "--comment=a b"]:
            self.assertIn(option, decide)
            self.assertIn(option, render)

    def test_frames_are_cut_into_chunks_in_the_order_of_their_list(self):
        for frames, size, expected in [
            ("1-10", 4, ["1-4", "5-8", "9-10"]),
            ("7", 4, ["7"]),
            ("1-3,20-30x5", 4, ["1-3,20", "25,30"]),
            ("1-10y3", 10, ["2-3,5-6,8-9"]),
            ("1-10:3", 10, ["1,4,7,10,3,5,9,2,6,8"]),
            ("-5-1", 4, ["-5--2", "-1-1"]),
            ("3-1", 4, ["3,2,1"]),
            ("1-3,2-5", 9, ["1-5"]),
            ("0008-0010", 9, ["8-10"]),
        ]:
            self.assertEqual(self.chunks(frames, size), expected, frames)

    def test_what_cannot_be_submitted_is_said_before_anything_is(self):
        for options, frames in [
            ((), "1-a"),
            ((), "1-10x0"),
            (("--chunk", 0), "1"),
            (("--chunk", 1), "1-2000"),
            (("--no", 1), "1"),
        ]:
            done = self.submit(*options, frames=frames)
            self.assertEqual(done.returncode, 2, (options, frames, done.stderr))
            self.assertTrue(done.stderr.startswith("error: "), done.stderr)
        self.assertEqual(self.lines("jobs"), [])


class SlurmTask(Farm):
    def task(self, step="render", tries=0, codes="0", run=None, **variables):
        values = dict(
            STEP=step, INPUT="in/a.####.exr", OUTPUT="out/b.####.exr", FRAMES="1-9", CHUNKS="1-4 5-8 9", FLAGS=""
        )
        values |= dict(RENDER_FLAGS="", THREADS=2, MEMORY_MIB="", RETRIES=2, PROGRAM="program") | variables
        named = {f"THINLENS_{name}": value for name, value in values.items()}
        slurm = dict(SLURM_ARRAY_TASK_ID=1, SLURM_JOB_ID=77, SLURM_RESTART_COUNT=tries)
        return (run or self.bash)(SLURM / "render.sbatch", CODES=codes, **slurm, **named)

    def test_the_decision_is_for_the_shot_and_a_task_of_the_array_for_its_chunk(self):
        self.task("plan", FLAGS="--preset 'my lens.toml'")
        self.task("render", FLAGS="--preset 'my lens.toml'", RENDER_FLAGS="--codec zips", MEMORY_MIB=512)
        common = ["--decisions", "out/b.decisions.toml", "--preset", "my lens.toml"]
        plan = ["--threads", "2", "plan", "in/a.####.exr", "--frames=1-9", *common]
        render = ["--threads", "2", "render", "in/a.####.exr", "--frames=5-8", *common]
        render += ["-o", "out/b.####.exr", "--resume", "--memory", "512MiB", "--codec", "zips"]
        self.assertEqual(self.lines("calls"), [plan, render])

    def test_a_task_is_queued_again_where_that_may_help_and_as_often_as_allowed(self):
        for code, tries, again in [
            (1, 0, True),
            (137, 1, True),
            (1, 2, False),
            (0, 0, False),
            (2, 0, False),
            (3, 0, False),
            (4, 0, False),
        ]:
            (self.folder / "requeued").unlink(missing_ok=True)
            done = self.task(tries=tries, codes=str(code))
            self.assertEqual(self.lines("requeued"), [77] if again else [], code)
            if not again:
                self.assertEqual(done.returncode, code)

    def test_a_task_that_slurm_stops_ends_the_program_and_is_queued_by_slurm_alone(self):
        self.assertEqual(self.stop(self.task(run=self.start, codes="wait")), 143)
        self.assertEqual((len(self.lines("calls")), self.lines("requeued")), (1, []))


if __name__ == "__main__":
    unittest.main()
