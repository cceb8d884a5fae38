# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""One run of thinlens on a stack: its command line, its end, and the picture it leaves. No Blender here."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from .child import Child
from .outcome import Outcome, error_text, warnings
from .shared import ExportError, exr, frames

# The levels of `--quality`.
DRAFT, PREVIEW, FINAL, REFERENCE = "draft", "preview", "final", "reference"
# The header's attribute without which the lens of a stack is not known; headers are shorter than this many bytes.
FOCAL_LENGTH = b"thinlens.focal_length_mm\0"
HEADER_BYTES = 1 << 16
# The attributes that say how a file is laid out.
LAYOUT = ("channels", "chunkCount", "compression", "dataWindow", "displayWindow", "lineOrder", "name", "type")


def flags(lens: Any, *, whole: bool) -> list[str]:
    """The flags of a `Lens` of the shared package.

    Those that change the blur alone; with `whole` also those of the frame, which the header of an exported stack has.
    """
    numbers = {
        "f-number": lens.f_number,
        "blades": lens.blades,
        "rotation": lens.rotation_deg,
        "squeeze": lens.squeeze,
    }
    if lens.focus_distance is not None:
        numbers["focus"] = lens.focus_distance
    if whole:
        numbers |= {"focal-length": lens.focal_length_mm, "sensor-width": lens.sensor_width_mm}
    # Nine digits are those of a float.
    return [f"--{name}={value:.9g}" for name, value in numbers.items()]


def has_lens(path: str) -> bool:
    """Whether the header of the stack at `path` has a lens."""
    try:
        return _has_lens(path, os.stat(path).st_mtime_ns)
    except OSError:
        return False


@lru_cache(maxsize=64)
def _has_lens(path: str, modified_ns: int) -> bool:
    """As `has_lens`, of a file as it was then: live re-lens asks ten times a second."""
    with open(path, "rb") as file:
        return FOCAL_LENGTH in file.read(HEADER_BYTES)


def stack_of(pattern: str, frame: int) -> str:
    """The stack of a frame. Raises `ExportError` if there is none."""
    path = frames.path(pattern, frame)
    if not os.path.isfile(path):
        raise ExportError("there is no stack of this frame", where=path, help="press Export first")
    return path


@dataclass(frozen=True)
class LensRun:
    """One run of the program."""

    program: str
    stack: str
    # Where the picture goes; it replaces what is there.
    result: str
    # Of the lens and the quality; empty: as the header has it.
    flags: tuple[str, ...] = ()

    def command(self, output: str) -> list[str]:
        """The command line that writes the picture to `output`.

        Further channels of the stack are left out: with them, Blender would take the picture for one of many layers.
        """
        return [self.program, "--quiet", "render", self.stack, "-o", output, "--carry=none", *self.flags]

    def at(self, quality: str) -> LensRun:
        """This run at a quality."""
        return replace(self, flags=(*self.flags, f"--quality={quality}"))


class LensJob:
    """A running program. Its picture appears at its end, complete or not at all."""

    def __init__(self, run: LensRun) -> None:
        """Starts it. Raises `ExportError` if the program cannot be started."""
        self.run = run
        self._start = time.monotonic()
        self._lines: list[str] = []
        # The program's own unfinished files are in this folder, so that they go with it.
        self._folder = tempfile.mkdtemp(prefix="thinlens-lens-")
        self._output = os.path.join(self._folder, "result.exr")
        self._finisher: threading.Thread | None = None
        self._outcome: Outcome | None = None
        try:
            self._child = Child(run.command(self._output))
        except BaseException:
            self._clean()
            raise

    @property
    def text(self) -> str:
        """For the user: what it does."""
        return f"lens: {os.path.basename(self.run.stack)}"

    @property
    def share(self) -> float:
        """How far it is: not known."""
        return 0.0

    def poll(self) -> Outcome | None:
        """How it ended, or None while it runs."""
        if self._finisher is None:
            code = self._child.code()
            self._lines += self._child.lines()
            if code is None:
                return None
            # Packing takes a while at large sizes; Blender's window does not wait for it.
            self._finisher = threading.Thread(target=self._finish, args=(code,), daemon=True)
            self._finisher.start()
        return None if self._finisher.is_alive() else self._outcome

    def stop(self) -> None:
        """Ends it. The earlier picture stays, unless the new one is complete already."""
        self._child.stop()
        if self._finisher is not None:
            self._finisher.join()
        self._clean()

    def _finish(self, code: int) -> None:
        said = warnings(self._lines)
        try:
            if code != 0:
                self._outcome = Outcome(False, error_text(self._lines, "thinlens", code), said)
                return
            publish(self._output, self.run.result)
            took = time.monotonic() - self._start
            self._outcome = Outcome(True, f"{self.run.result}, {took:.1f} s", said, self.run.result, took)
        except Exception as error:  # Without an outcome, the job would never end.
            text = str(error) if isinstance(error, ExportError) else f"error: {type(error).__name__}: {error}"
            self._outcome = Outcome(False, text, said)
        finally:
            self._clean()

    def _clean(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)


def wait(job: Any, pause_s: float = 0.02) -> Outcome:
    """How `job` ends, when it has ended. Stops it if the waiting is interrupted."""
    try:
        while (outcome := job.poll()) is None:
            time.sleep(pause_s)
    except BaseException:
        job.stop()
        raise
    return outcome


def publish(source: str, target: str) -> None:
    """Writes the frame of the picture `source`, without its margin, to `target` in one step. Makes the folder.

    Blender shows a picture's data window; a stack with overscan gives one that is larger than the frame.
    Raises `ExportError` if it cannot be written.
    """
    picture = exr.read(source)[0]
    frame, data = picture.display_window, picture.data_window
    channels = picture.channels
    if _holds(data, frame):
        rows = slice(frame[1] - data[1], frame[3] - data[1] + 1)
        columns = slice(frame[0] - data[0], frame[2] - data[0] + 1)
        channels, data = {name: plane[rows, columns] for name, plane in channels.items()}, frame
    header = {name: value for name, value in picture.attributes.items() if name not in LAYOUT}
    exr.write(target, channels, data, frame, header)


def _holds(outer: exr.Window, inner: exr.Window) -> bool:
    """Whether the window `inner` is within `outer`."""
    return outer[0] <= inner[0] and outer[1] <= inner[1] and inner[2] <= outer[2] and inner[3] <= outer[3]
