"""What the extension adds to Blender goes again, whoever removes it first. Needs the bpy module."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

try:
    import bpy
except ImportError as error:
    raise unittest.SkipTest("the bpy module is not installed: the panel is not tested") from error

from blender import live, registration

FOLDER = Path(registration.__file__).parent
# Enables the extension as Blender does, then runs a line.
SCRIPT = """
import sys
import bpy
import addon_utils
sys.path.insert(0, sys.argv[1])
extension = addon_utils.enable("thinlens_extension", handle_error=lambda error: sys.exit(str(error)))
{line}
"""


def is_there() -> tuple[bool, bool, bool]:
    """Whether the properties, the operators and the handlers are."""
    return (
        hasattr(bpy.types.Camera, "thinlens"),
        hasattr(bpy.types, "THINLENS_OT_live"),
        live._before_load in bpy.app.handlers.load_pre,
    )


class Registration(unittest.TestCase):
    def test_it_goes_once_and_comes_again_also_after_factory_settings(self) -> None:
        for _ in range(2):
            registration.register()
            self.assertEqual(is_there(), (True,) * 3)
            bpy.ops.wm.read_factory_settings(use_empty=True)
            registration.unregister()
            self.assertEqual(is_there(), (False,) * 3)
            registration.unregister()
            bpy.ops.wm.read_factory_settings(use_empty=True)
            registration.unregister()

    def test_a_blender_in_which_it_is_enabled_ends_without_a_word(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            package = Path(folder) / "thinlens_extension"
            shutil.copytree(FOLDER, package)
            shutil.copytree(FOLDER.parent / "common" / "thinlens_stack", package / "thinlens_stack")
            for line in (
                "",
                "sys.exit(0)",
                "bpy.ops.wm.read_factory_settings(use_empty=True)",
                "bpy.ops.wm.read_factory_settings(use_empty=True); extension.unregister()",
                "extension.unregister()",
            ):
                with self.subTest(line):
                    command = [sys.executable, "-c", SCRIPT.format(line=line), folder]
                    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
                    self.assertEqual((done.returncode, done.stderr), (0, ""), done.stdout)
                    self.assertNotIn("Traceback", done.stdout)


if __name__ == "__main__":
    unittest.main()
