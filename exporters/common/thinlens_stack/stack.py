"""Writing of a stack: layers and their lens as one OpenEXR file that thinlens reads without a preset."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from . import VERSION, exr
from .lens import Lens
from .merge import Layer

# Largest half float.
HALF_MAX = 65504.0


@dataclass(frozen=True)
class Frame:
    """The frame and the margin around it, in picture pixels."""

    width: int
    height: int
    overscan: int = 0

    def windows(self, samples: int = 1) -> tuple[exr.Window, exr.Window]:
        """Data window and display window of a picture with so many samples per pixel along each axis."""
        width, height, margin = (samples * length for length in (self.width, self.height, self.overscan))
        return (-margin, -margin, width + margin - 1, height + margin - 1), (0, 0, width - 1, height - 1)

    def wide(self) -> tuple[int, int]:
        """Width and height with the margin."""
        return self.width + 2 * self.overscan, self.height + 2 * self.overscan


@dataclass(frozen=True)
class Kind:
    """What a stack's samples are: "point", "coverage" or "supersampled", with S samples per pixel along each axis."""

    name: str
    samples: int = 1

    def attributes(self) -> dict[str, exr.Attribute]:
        """The header attributes of the kind."""
        more = {"thinlens.supersample": self.samples} if self.samples > 1 else {}
        return {"thinlens.kind": self.name} | more


def channels(layers: Sequence[Layer], *, half: bool = True) -> dict[str, np.ndarray]:
    """The channels `Peel0.Combined.R` … of layers, nearest first: colour half or float, depth float.

    A channel of `sums` or `means` named `Diffuse.R` becomes `Peel0.Diffuse.R`.
    """
    out = {}
    for peel, layer in enumerate(layers):
        colors = {f"Combined.{name}": layer.color[..., k] for k, name in enumerate("RGB")}
        colors |= {"Combined.A": layer.alpha, **layer.sums, **layer.means}
        for name, plane in colors.items():
            out[f"Peel{peel}.{name}"] = _half(plane) if half and not _needs_float(name) else plane.astype(np.float32)
        out[f"Peel{peel}.Depth.Z"] = layer.depth.astype(np.float32)
    return out


def _needs_float(name: str) -> bool:
    """Whether a channel is a distance, which half floats are too coarse and too short for."""
    return name.endswith(".V") and "Distance" in name


def _half(plane: np.ndarray) -> np.ndarray:
    return np.clip(np.nan_to_num(plane, posinf=HALF_MAX, neginf=-HALF_MAX), -HALF_MAX, HALF_MAX).astype(np.float16)


def write(
    path: str | os.PathLike[str],
    picture: Mapping[str, np.ndarray],
    frame: Frame,
    kind: Kind,
    lens: Lens,
    attributes: Mapping[str, exr.Attribute],
) -> None:
    """Writes the channels `picture` (from `channels`, and others of that size) with the header of a stack.

    `attributes` are further ones, such as `software`. Raises `ExportError` if the file cannot be written.
    """
    samples = kind.samples if kind.name == "supersampled" else 1
    data_window, display_window = frame.windows(samples)
    own = {"thinlens.depth_convention": "planar", "thinlens.version": VERSION}
    header = {**lens.attributes(), **kind.attributes(), **own, **attributes}
    exr.write(path, picture, data_window, display_window, header)
