"""Frames of a sequence: which, into which files, and what to tell the shell."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Sequence

from . import exr
from .errors import ExportError

# Exit codes, those of thinlens.
DONE = 0
FAILED = 1
WRONG_USAGE = 2
SOME_FAILED = 3

# More frames than a list can be meant to have.
MOST_FRAMES = 1_000_000

_RANGE = re.compile(r"(-?\d+)(?:-(-?\d+)(?:x(\d+))?)?")


def parse(text: str) -> list[int]:
    """The frames of a list such as `1-100,120` or `1-100x5` (every fifth), in ascending order, each once.

    Raises `ExportError` for other texts.
    """
    frames: set[int] = set()
    for item in text.split(","):
        match = _RANGE.fullmatch(item.strip())
        first, last, step = (None if group is None else int(group) for group in match.groups()) if match else [None] * 3
        last = first if last is None else last
        if first is None or last < first or step == 0:
            raise ExportError(
                "this is not a list of frames", found=f'"{text}"', wanted='numbers and ranges, such as "1-100,120"'
            )
        if (last - first) // (step or 1) + len(frames) >= MOST_FRAMES:
            raise ExportError("the list has too many frames", found=f'"{text}"', wanted=f"at most {MOST_FRAMES}")
        frames.update(range(first, last + 1, step or 1))
    return sorted(frames)


def path(pattern: str, frame: int) -> str:
    """The file of a frame: the last run of `#` in the file name is its number, with at least as many digits."""
    folder_end = max(pattern.rfind("/"), pattern.rfind("\\")) + 1
    runs = list(re.finditer("#+", pattern[folder_end:]))
    if not runs:
        return pattern
    start, end = (folder_end + at for at in runs[-1].span())
    digits = f"{abs(frame):0{end - start}d}"
    return pattern[:start] + ("-" if frame < 0 else "") + digits + pattern[end:]


def is_pattern(pattern: str) -> bool:
    """Whether different frames have different files."""
    return path(pattern, 0) != path(pattern, 1)


def _check(pattern: str, count: int) -> None:
    """Raises `ExportError` unless so many frames can be written by `pattern`."""
    if not pattern.lower().endswith(".exr"):
        raise ExportError("stacks are OpenEXR files", found=pattern, wanted="a name that ends in .exr")
    if count > 1 and not is_pattern(pattern):
        raise ExportError(
            f"{count} frames cannot go into one file",
            found=pattern,
            wanted="a place for the frame number, such as shot.####.exr",
        )


def run(frames: Sequence[int], pattern: str, export: Callable[[int, str], str], *, overwrite: bool = False) -> int:
    """Exports each frame by `export(frame, path)`, which returns what to say of it. One line a frame on standard error.

    Frames whose file is complete are skipped, unless `overwrite`. A frame that fails does not stop the others.
    Returns the exit code: `SOME_FAILED` if others are there.
    """
    try:
        _check(pattern, len(frames))
    except ExportError as error:
        print(error, file=sys.stderr)
        return WRONG_USAGE
    failed = 0
    for frame in frames:
        target = path(pattern, frame)
        before = f"frame {frame}: " if len(frames) > 1 else ""
        if not overwrite and len(frames) > 1 and exr.is_complete(target):
            print(f"{before}{target} is there already", file=sys.stderr, flush=True)
            continue
        start = time.monotonic()
        try:
            said = export(frame, target)
        except ExportError as error:
            failed += 1
            print(f"{before or f'{target}: '}failed\n{error}", file=sys.stderr, flush=True)
            continue
        took = f"{time.monotonic() - start:.1f} s"
        print(f"{before}{target}, {took}{said and ', ' + said}", file=sys.stderr, flush=True)
    if failed and len(frames) > 1:
        print(f"{failed} of {len(frames)} frames failed", file=sys.stderr)
    if failed:
        return SOME_FAILED if failed < len(frames) else FAILED
    return DONE
