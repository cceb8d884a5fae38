"""Tests of the exporters.

From the root of the repository: `python -m unittest discover -s exporters/tests -t exporters`.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "common"))
