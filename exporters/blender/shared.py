# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The package that the exporters share, under one name wherever it is.

Written out by `thinlens export blender`, it lies in this folder; in the project's tree, in `../common`.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

_NAME = "thinlens_stack"


def _package() -> str:
    """The import name of the shared package."""
    here = Path(__file__).resolve().parent
    if (here / _NAME).is_dir():
        return f"{__package__}.{_NAME}"
    common = str(here.parent / "common")
    if common not in sys.path:
        sys.path.append(common)
    return _NAME


_ROOT = _package()
closed = importlib.import_module(f"{_ROOT}.closed")
errors = importlib.import_module(f"{_ROOT}.errors")
exr = importlib.import_module(f"{_ROOT}.exr")
frames = importlib.import_module(f"{_ROOT}.frames")
lens = importlib.import_module(f"{_ROOT}.lens")
merge = importlib.import_module(f"{_ROOT}.merge")
shading = importlib.import_module(f"{_ROOT}.shading")
stack = importlib.import_module(f"{_ROOT}.stack")

ExportError = errors.ExportError
