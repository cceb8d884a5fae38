"""Blender's module `bpy` and the exporter's package, for tests. Where `bpy` is not installed, the test is skipped."""

from __future__ import annotations

import importlib
import sys
import unittest
from pathlib import Path
from types import ModuleType

try:
    import bpy
    import mathutils
except ImportError as error:
    raise unittest.SkipTest("the bpy module is not installed: the Blender exporter is not tested") from error

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "blender"))
cli = importlib.import_module("cli")
cli.load_package()


def module(name: str) -> ModuleType:
    """A module of the exporter."""
    return importlib.import_module(f"{cli.PACKAGE}.{name}")


__all__ = ["bpy", "cli", "mathutils", "module"]
