# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""An export in a background Blender: its command line, its progress, and its end. No Blender here."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from .child import Child
from .outcome import Outcome, error_text, warnings
from .shared import frames

# The lines of `cli.py --verbose` that name a render, and the line of a frame that is done.
_STEP = re.compile(r"(?:distances of |denoising of |reflections of )?peel \d+|background|overscan")
_DONE = re.compile(r".+, \d+\.\d s(?:, .*)?|frame -?\d+: .* is there already")
_FAILED = re.compile(r".+: failed")


@dataclass(frozen=True)
class Host:
    """What runs `cli.py`."""

    # The program Blender; empty: `python` with the bpy module.
    blender: str
    python: str
    cli: str
    # Whether scripts in the file may run.
    runs_scripts: bool = True

    def command(self, file: str, options: Sequence[str]) -> list[str]:
        """The command line for the scene `file`."""
        if not self.blender:
            return [self.python, self.cli, file, *options]
        scripts = "--enable-autoexec" if self.runs_scripts else "--disable-autoexec"
        start = [self.blender, "--background", scripts, file, "--python-exit-code", "1", "--python", self.cli]
        return [*start, "--", *options]


@dataclass(frozen=True)
class Choices:
    """What the panel asks for. None is the default of `cli.py`."""

    # Absolute; # is replaced by the frame number.
    output: str
    # In ascending order, at least one.
    frames: tuple[int, ...]
    overwrite: bool = False
    peels: int = 4
    kind: str = "coverage"
    supersample: int = 2
    samples: int | None = None
    overscan: int | None = None
    denoise: bool | None = None
    background: bool | None = None
    cryptomatte: bool = True
    shading: bool = False
    scene: str | None = None
    camera: str | None = None
    view_layer: str | None = None

    def options(self) -> list[str]:
        """The flags of `cli.py`."""
        out = [f"--output={self.output}", f"--frames={frame_list(self.frames)}", "--verbose"]
        out += [f"--{name}" for name in ("overwrite", "shading") if getattr(self, name)]
        for name in ("peels", "kind", "supersample", "samples", "overscan", "scene", "camera", "view_layer"):
            value = getattr(self, name)
            out += [] if value is None else [f"--{name.replace('_', '-')}={value}"]
        for name in ("denoise", "background", "cryptomatte"):
            value = getattr(self, name)
            out += [] if value is None else [f"--{name}" if value else f"--no-{name}"]
        return out

    def targets(self) -> list[str]:
        """The files that the export writes."""
        return [frames.path(self.output, frame) for frame in self.frames]


def frame_list(wanted: Sequence[int]) -> str:
    """`wanted`, in ascending order, as `cli.py` takes them: 1-4,7. Frames below 0 are listed one by one."""
    runs: list[list[int]] = []
    for frame in wanted:
        if runs and runs[-1][0] >= 0 and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)


@dataclass
class Progress:
    """How far an export is, from its lines."""

    frames: int
    finished: int = 0
    failed: int = 0
    # The render that runs.
    step: str = ""
    lines: list[str] = field(default_factory=list)

    def feed(self, line: str) -> None:
        """Takes the next line."""
        if _STEP.fullmatch(line):
            self.step = line
            return
        self.lines.append(line)
        if _FAILED.fullmatch(line):
            self.failed += 1
        elif line.startswith(("error:", "warning:", "note:", " ")) or not _DONE.fullmatch(line):
            return
        self.finished += 1
        self.step = ""

    @property
    def share(self) -> float:
        """The share of the frames that are finished, 0 to 1."""
        return min(1.0, self.finished / self.frames)

    @property
    def text(self) -> str:
        """For the user."""
        count = f"frame {min(self.finished + 1, self.frames)} of {self.frames}" if self.frames > 1 else "stack"
        return f"{count}: {self.step or 'starting'}"


class ExportJob:
    """A running export. `folder` holds the copy of the scene; it is removed in the end."""

    def __init__(self, host: Host, file: str, choices: Choices, folder: str) -> None:
        """Starts it. Raises `ExportError` if the program cannot be started; the folder is removed then too."""
        self.choices, self.folder = choices, folder
        self.progress = Progress(len(choices.frames))
        self._kept = _partial_files(choices.targets())
        # What a stopped Blender leaves behind is in the folder.
        temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder)
        try:
            self._child = Child(host.command(file, choices.options()), temporary)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    @property
    def text(self) -> str:
        """For the user: how far it is."""
        return self.progress.text

    @property
    def share(self) -> float:
        """How far it is, 0 to 1."""
        return self.progress.share

    def poll(self) -> Outcome | None:
        """How it ended, or None while it runs."""
        code = self._child.code()
        for line in self._child.lines():
            self.progress.feed(line)
        if code is None:
            return None
        self._clean()
        lines, targets = self.progress.lines, self.choices.targets()
        if code != 0:
            failed = self.progress.failed if len(targets) > 1 else 0
            count = f"error: {failed} of {len(targets)} frames failed\n" if failed else ""
            return Outcome(False, count + error_text(lines, "Blender", code), warnings(lines))
        missing = [target for target in targets if not os.path.exists(target)]
        if missing:
            lost = error_text([*lines, f"error: {missing[0]} was not written"], "Blender", code)
            return Outcome(False, lost, warnings(lines))
        what = targets[0] if len(targets) == 1 else f"{len(targets)} frames, {targets[0]} to {targets[-1]}"
        return Outcome(True, f"exported {what}", warnings(lines))

    def stop(self) -> None:
        """Ends it and removes what is unfinished. Finished frames stay."""
        self._child.stop()
        self._clean()

    def _clean(self) -> None:
        for path in _partial_files(self.choices.targets()) - self._kept:
            path.unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)


def _partial_files(targets: Sequence[str]) -> set[Path]:
    """The unfinished files beside `targets`."""
    names = {f".{os.path.basename(target)}." for target in targets}
    folders = {Path(target).parent for target in targets}
    parts = (path for folder in folders if folder.is_dir() for path in folder.glob(".*.part"))
    return {path for path in parts if any(path.name.startswith(name) for name in names)}
