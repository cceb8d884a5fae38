"""Exports a stack of depth peels from a Mitsuba 3 scene: `python export.py scene.xml -o stack.exr`."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
# The shared package lies beside this file, or in `common` beside its folder.
for folder in (HERE, HERE.parent / "common"):
    if (folder / "thinlens_stack").is_dir():
        sys.path.insert(0, str(folder))
        break
sys.path.insert(0, str(HERE))

from thinlens_mitsuba.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
