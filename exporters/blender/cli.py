# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""Peels of a Blender scene from a shell.

blender -b shot.blend -P cli.py -- --frames 1-100 -o stacks/shot.####.exr
python cli.py shot.blend --frames 1-100 -o stacks/shot.####.exr        (with the bpy module)
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

PACKAGE = "thinlens_blender"


def load_package() -> ModuleType:
    """This folder as a package, so that its modules find each other."""
    folder = Path(__file__).resolve().parent
    if PACKAGE not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            PACKAGE, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        module = importlib.util.module_from_spec(spec)
        sys.modules[PACKAGE] = module
        spec.loader.exec_module(module)
    return sys.modules[PACKAGE]


def parser(needs_scene: bool) -> argparse.ArgumentParser:
    """The command line. Within Blender, the scene is the open file."""
    own = argparse.ArgumentParser(prog="cli.py", description="Writes stacks of depth peels for thinlens.")
    if needs_scene:
        own.add_argument("file", metavar="FILE.blend", help="the scene")
    own.add_argument(
        "-o", "--output", required=True, metavar="FILE", help="the stack; # is replaced by the frame number"
    )
    own.add_argument("--frames", metavar="LIST", help='frames, such as "1-100,120"; default: the current one')
    own.add_argument("--overwrite", action="store_true", help="export frames again whose file is there")
    own.add_argument("--peels", type=int, default=4, metavar="N", help="most surfaces behind each other (default 4)")
    own.add_argument("--kind", choices=("point", "coverage", "super"), default="coverage", help="default: coverage")
    own.add_argument(
        "--supersample", type=int, default=2, metavar="S", help="S×S places in a pixel, 1 to 4 (default 2)"
    )
    own.add_argument("--samples", type=int, metavar="N", help="light samples of a pixel in all (default: the scene's)")
    own.add_argument("--overscan", type=int, metavar="PX", help="pixels around the frame (default: as the blur needs)")
    own.add_argument("--denoise", action=argparse.BooleanOptionalAction, help="default: as the scene")
    own.add_argument("--background", action=argparse.BooleanOptionalAction, help="the world as the last peel")
    own.add_argument("--cryptomatte", action=argparse.BooleanOptionalAction, default=True, help="default: on")
    own.add_argument(
        "--shading",
        action="store_true",
        help="channels for reflections: Diffuse, Reflection, Normal, ReflectedDistance, Specular, Roughness",
    )
    own.add_argument("--scene", metavar="NAME", help="default: the file's")
    own.add_argument("--camera", metavar="NAME", help="default: the scene's")
    own.add_argument("--view-layer", metavar="NAME", help="default: the first that is rendered")
    own.add_argument("--threads", type=int, metavar="N", help="default: as the scene")
    own.add_argument("-q", "--quiet", action="store_true", help="warnings and errors only")
    own.add_argument("-v", "--verbose", action="store_true", help="each render, and what Blender prints")
    return own


def main(arguments: list[str], needs_scene: bool) -> int:
    """Exports as `arguments` say. Returns the exit code."""
    options = parser(needs_scene).parse_args(arguments)
    load_package()
    run = importlib.import_module(f"{PACKAGE}.cli_run")
    return run.run(options)


if __name__ == "__main__":
    within_blender = "--" in sys.argv
    own_arguments = sys.argv[sys.argv.index("--") + 1 :] if within_blender else sys.argv[1:]
    sys.exit(main(own_arguments, not within_blender))
