"""The lens of a stack: what the header says of it, and how far it blurs.

Depths and distances are planar and in scene units; lengths of the lens are in millimetres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

# Depths from this value on are background: nothing was hit.
BACKGROUND = 1e9
# The depth that is written where nothing was hit.
NOTHING_HIT = 1e10
# Without a lens, samples are merged as for this one: wide, so that a later choice of lens finds surfaces apart.
MERGING_F_NUMBER = 2.0


@dataclass(frozen=True)
class Lens:
    """A thin lens with its sensor. `f_number` infinite is a pinhole; `focus_distance` None leaves the focus open."""

    focal_length_mm: float
    sensor_width_mm: float
    f_number: float = math.inf
    # Planar, in scene units.
    focus_distance: float | None = None
    # "focal_length" (Blender, Mitsuba) or "thin_lens" (a real camera).
    sensor_distance: str = "focal_length"
    # 0 is a disc.
    blades: int = 0
    # Anticlockwise in the picture behind focus.
    rotation_deg: float = 0.0
    # 0 straight, 1 round.
    blade_curvature: float = 0.0
    # Height over width of the aperture, 1 to 4; the height is that of the f-number.
    squeeze: float = 1.0
    metres_per_unit: float = 1.0

    def attributes(self) -> dict[str, float | int | str]:
        """The header attributes `thinlens.*` of the lens. What is open is left out."""
        numbers = {
            "focal_length_mm": float(self.focal_length_mm),
            "sensor_width_mm": float(self.sensor_width_mm),
            "blades": int(self.blades),
            "rotation_deg": float(self.rotation_deg),
            "blade_curvature": float(self.blade_curvature),
            "squeeze": float(self.squeeze),
            "sensor_distance": self.sensor_distance,
            "metres_per_unit": float(self.metres_per_unit),
        }
        if math.isfinite(self.f_number):
            numbers["f_number"] = float(self.f_number)
        if self.focus_distance is not None:
            numbers["focus_distance"] = float(self.focus_distance)
        return {f"thinlens.{name}": value for name, value in numbers.items()}

    def aperture_radius(self) -> float:
        """Radius of the aperture in scene units."""
        return 0.5e-3 * self.focal_length_mm / self.f_number / self.metres_per_unit

    def coc_scale_px(self, width_px: float) -> float:
        """By how much the CoC radius in pixels grows with 1/depth, in pixels · scene units, in a picture so wide."""
        scale = width_px * self.focal_length_mm / self.sensor_width_mm * self.aperture_radius()
        if self.sensor_distance == "thin_lens" and self.focus_distance is not None:
            focal_length = 1e-3 * self.focal_length_mm / self.metres_per_unit
            scale /= 1.0 - focal_length / self.focus_distance
        return scale

    def coc_radius_px(self, depth: np.ndarray | float, width_px: float) -> np.ndarray:
        """Signed CoC radius at planar `depth`, in pixels of a picture so wide: negative in front of focus.

        `depth` from `BACKGROUND` on, and what is not in front of the lens, is infinitely far.
        """
        depth = np.asarray(depth, np.float64)
        is_hit = (depth > 0.0) & (depth < BACKGROUND)
        inverse = np.where(is_hit, 1.0 / np.where(is_hit, depth, 1.0), 0.0)
        in_focus = 0.0 if self.focus_distance is None else 1.0 / self.focus_distance
        return self.coc_scale_px(width_px) * (in_focus - inverse)

    def for_merging(self) -> Lens:
        """The lens by which samples are merged: this one, but at least as wide as f/2 and focused somewhere."""
        f_number = min(self.f_number, MERGING_F_NUMBER)
        return replace(self, f_number=f_number, focus_distance=self.focus_distance or math.inf)


def sensor_width_mm(fit: str, width_mm: float, height_mm: float, frame: tuple[float, float]) -> float:
    """Width of the part of the sensor that the frame's width shows, in mm.

    `fit` is the side that the sensor's size is measured along: "horizontal" (`width_mm`), "vertical" (`height_mm`),
    or "auto": the longer side of the frame, with `width_mm`. `frame` is the frame's width and height, in units of one
    length: pixels times their aspect.
    """
    width, height = frame
    match fit.lower():
        case "horizontal":
            return width_mm
        case "vertical":
            return height_mm * width / height
        case "auto":
            return width_mm if width >= height else width_mm * width / height
    raise ValueError(f"no sensor fit {fit}: horizontal, vertical or auto")


def overscan_px(depth: np.ndarray, frame: tuple[int, int], margin_px: int, lens: Lens) -> int:
    """How far outside the frame something can be whose blur reaches in, in pixels of the frame; at most `margin_px`.

    `depth` is a planar depth picture, of any resolution, of the frame of `frame` pixels with a margin of `margin_px`
    on each side. Background reaches in as well. The distance is rounded up by one sample of `depth`.
    """
    width, height = frame
    rows, columns = depth.shape
    step = np.array([(width + 2 * margin_px) / columns, (height + 2 * margin_px) / rows])
    x = (np.arange(columns) + 0.5) * step[0] - margin_px
    y = (np.arange(rows) + 0.5) * step[1] - margin_px
    outside_x = np.maximum(np.maximum(-x, x - width), 0.0)
    outside_y = np.maximum(np.maximum(-y, y - height), 0.0)
    distance = np.hypot(outside_x[None, :], outside_y[:, None])
    reaches = (distance > 0.0) & (np.abs(lens.coc_radius_px(depth, width)) >= distance)
    if not reaches.any():
        return 0
    return min(margin_px, math.ceil(float(distance[reaches].max()) + float(step.max())))
