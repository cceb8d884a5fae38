# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The program thinlens: where it is, and whether it runs. No Blender here."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from .shared import ExportError

NAME = "thinlens"
# Time for the program to print its version, in seconds.
VERSION_TIMEOUT_S = 20.0
HELP = "install thinlens, or give its path in the preferences of the extension"


@dataclass(frozen=True)
class Program:
    """A program that runs."""

    path: str
    version: str


def find(preferred: str = "") -> str:
    """The path of the program: `preferred`, a file or its folder; if that is empty, the one on the search path.

    Where the search path has none, the folder is looked into that `cargo install` writes to: a Blender that was not
    started from a shell often has a short search path. Raises `ExportError` if there is no such program.
    """
    if preferred:
        return _executable(Path(preferred).expanduser())
    cargo = Path.home() / ".cargo" / "bin"
    found = shutil.which(NAME) or shutil.which(NAME, path=str(cargo))
    if found is None:
        raise ExportError(
            "the program thinlens was not found", wanted=f"{NAME} on the search path or in {cargo}", help=HELP
        )
    return found


def _executable(path: Path) -> str:
    """`path`, or the program in the folder `path`, if it can be run."""
    if path.is_dir():
        path /= f"{NAME}.exe" if sys.platform == "win32" else NAME
    if not path.is_file():
        raise ExportError("the program thinlens was not found", where="the preferences", found=str(path), help=HELP)
    if not os.access(path, os.X_OK):
        raise ExportError("this file is not a program", where="the preferences", found=str(path), help=HELP)
    return str(path)


def check(preferred: str = "") -> Program:
    """The program that `find` finds, with its version. Raises `ExportError` if there is none or it does not run."""
    path = find(preferred)
    try:
        done = subprocess.run(
            [path, "--version"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=VERSION_TIMEOUT_S,
            creationflags=hidden(),
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ExportError("the program thinlens does not run", where=path, found=str(error), help=HELP) from error
    words = done.stdout.split()
    if done.returncode != 0 or len(words) != 2 or words[0] != NAME:
        said = (done.stdout + done.stderr).strip()[:200] or f"exit code {done.returncode}"
        raise ExportError("this program is not thinlens", where=path, found=said, wanted="a version", help=HELP)
    return Program(path, words[1])


def hidden() -> int:
    """Flags of `subprocess` that keep Windows from opening a console."""
    return getattr(subprocess, "CREATE_NO_WINDOW", 0)
