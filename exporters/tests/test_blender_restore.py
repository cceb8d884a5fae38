"""An export from Blender leaves the open file as it was, also when it fails half-way. Needs the bpy module."""

from __future__ import annotations

import os
import tempfile
import unittest
from typing import Any
from unittest import mock

from . import blender_package
from .blender_fingerprint import changes, fingerprint
from .blender_scene import build

bpy, module = blender_package.bpy, blender_package.module
export, journal, passes, denoise = map(module, ("export", "journal", "passes", "denoise"))
Settings = module("settings").Settings

QUICK = {"peels": 2, "samples": 1, "supersample": 1, "kind": "point", "threads": 2, "shading": True}


class Injected(Exception):
    """A failure that the test makes."""


class Calls:
    """Counts the calls of a method, and fails after one of them has done its work."""

    def __init__(self, owner: Any, name: str, fail_at: int | None = None) -> None:
        self.count, self.fail_at = 0, fail_at
        self.original = getattr(owner, name)
        calls = self

        def counted(own: Any, *arguments: Any, **named: Any) -> Any:
            result = calls.original(own, *arguments, **named)
            calls.count += 1
            if calls.count == calls.fail_at:
                raise Injected(f"call {calls.count} of {name}")
            return result

        self.patch = mock.patch.object(owner, name, counted)


def run(scene: Any, path: str) -> None:
    silent = export.Talk(lambda text: None, lambda text: None)
    export.export(scene, Settings(**QUICK), path, silent)


class Restore(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = os.path.join(self.folder.name, "stack.exr")

    def test_an_export_leaves_the_file_as_it_was(self):
        scene = build()
        before = fingerprint()
        run(scene, self.path)
        self.assertEqual(changes(before, fingerprint()), [])
        self.assertTrue(os.path.exists(self.path))

    def test_the_fingerprint_sees_a_change(self):
        build()
        before = fingerprint()
        bpy.data.materials["gray"].node_tree.nodes.new("ShaderNodeMixShader")
        bpy.data.objects["ball"]["thinlens_side"] = 1.0
        self.assertGreaterEqual(len(changes(before, fingerprint())), 2)

    def test_a_failed_export_leaves_the_file_as_it_was_and_writes_nothing(self):
        scene = build()
        before = fingerprint()
        for owner, name, share in [
            *((journal.Journal, "set", share) for share in (0.1, 0.5, 0.9)),
            *((journal.Journal, "on_restore", share) for share in (0.05, 0.2, 0.4, 0.6, 0.8, 1.0)),
            *((passes.Renderer, "render", share) for share in (0.1, 0.5, 1.0)),
            (denoise.Denoiser, "denoise", 0.5),
        ]:
            with self.subTest(f"{name} at {share:.0%}"):
                calls = Calls(owner, name)
                with calls.patch:
                    run(scene, self.path)
                os.remove(self.path)
                self.assertGreater(calls.count, 0)
                with Calls(owner, name, max(1, round(share * calls.count))).patch, self.assertRaises(Injected):
                    run(scene, self.path)
                self.assertFalse(os.path.exists(self.path))
                self.assertEqual(changes(before, fingerprint()), [])


if __name__ == "__main__":
    unittest.main()
