# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""What an export is asked to do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .shared import ExportError

# The kinds of stack, by the word of the command line.
POINT, COVERAGE, SUPER = "point", "coverage", "super"
MOST_PEELS = 16
MOST_SUPERSAMPLE = 4
MOST_SAMPLES = 1 << 24
MOST_OVERSCAN = 8192
# As in Blender.
MOST_THREADS = 1024

# Takes a line of text for the user.
Say = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """The settings of an export. `None` means: as the scene has it."""

    # Most surfaces of a sample, the nearest first. The background comes on top of them.
    peels: int = 4
    kind: str = COVERAGE
    # Samples of a pixel along each axis.
    supersample: int = 2
    # Light samples of a pixel in all, as in a render without peels; each of its samples gets its share.
    samples: int | None = None
    # Pixels around the frame; None: as many as the blur needs.
    overscan: int | None = None
    denoise: bool | None = None
    # Whether the world is the last peel.
    background: bool | None = None
    cryptomatte: bool = True
    # Whether there are channels for reflections.
    shading: bool = False
    camera: str | None = None
    view_layer: str | None = None
    threads: int | None = None

    def checked(self) -> Settings:
        """These settings. Raises `ExportError` for values out of range."""
        ranges = {"peels": (1, MOST_PEELS), "supersample": (1, MOST_SUPERSAMPLE), "samples": (1, MOST_SAMPLES)}
        ranges |= {"overscan": (0, MOST_OVERSCAN), "threads": (1, MOST_THREADS)}
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ExportError(f"{name} is out of range", found=str(value), wanted=f"{low} to {high}")
        if self.kind not in (POINT, COVERAGE, SUPER):
            raise ExportError("there is no such kind of stack", found=self.kind, wanted="point, coverage or super")
        return self

    @property
    def per_axis(self) -> int:
        """Samples of a pixel along each axis."""
        return 1 if self.kind == POINT else self.supersample

    def samples_each(self, scene_samples: int) -> int:
        """Light samples of each of a pixel's samples."""
        return max(1, -(-(self.samples or scene_samples) // self.per_axis**2))
