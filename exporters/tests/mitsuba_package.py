"""Whether Mitsuba is installed: the package, and not the folder `exporters/mitsuba`, which has its name."""

import importlib
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

# The exporter's modules.
FOLDER = Path(__file__).resolve().parent.parent / "mitsuba"


def is_installed() -> bool:
    """Whether the package `mitsuba` can be imported."""
    found = importlib.util.find_spec("mitsuba")
    return found is not None and found.origin is not None


def load() -> ModuleType | None:
    """The package with its variant set, and the exporter's modules on the path; None where it is not installed.

    The variant is scalar_rgb, or that of the environment variable THINLENS_MITSUBA_VARIANT.
    """
    if not is_installed():
        return None
    if str(FOLDER) not in sys.path:
        sys.path.insert(0, str(FOLDER))
    package = importlib.import_module("mitsuba")
    package.set_variant(os.environ.get("THINLENS_MITSUBA_VARIANT", "scalar_rgb"))
    return package
