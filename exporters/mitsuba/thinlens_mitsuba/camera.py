"""The sensor of a scene: its lens, its frame, and rays of the pinhole in the middle of its lens."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from thinlens_stack.errors import ExportError
from thinlens_stack.lens import Lens
from thinlens_stack.stack import Frame

# The sensors that have a lens or could have one.
PERSPECTIVE, THIN_LENS = "PerspectiveCamera", "ThinLensCamera"


@dataclass(frozen=True)
class Choice:
    """What the user says of the lens; None is as in the scene."""

    f_number: float | None = None
    # In scene units.
    focus_distance: float | None = None
    # Width of the sensor that the whole film shows.
    sensor_width_mm: float = 36.0
    metres_per_unit: float = 1.0


class Camera:
    """A perspective or thinlens sensor, used as a pinhole."""

    def __init__(self, sensor: mi.Sensor) -> None:
        """Raises `ExportError` for sensors without perspective."""
        kind = sensor.class_name()
        if kind not in (PERSPECTIVE, THIN_LENS):
            raise ExportError(
                "a lens needs a sensor with perspective", found=kind, wanted="a sensor of type perspective or thinlens"
            )
        self.sensor = sensor
        self.has_lens = kind == THIN_LENS
        self.parameters = mi.traverse(sensor)
        matrix = np.array(self.parameters["to_world"].matrix, np.float64).reshape(4, 4)
        self.place = matrix[:3, 3]
        # Unit vectors to the right, up, and towards the viewer, in rows. Mitsuba's cameras look along +z, with +x to
        # the left.
        axes = matrix[:3, :3].T / np.linalg.norm(matrix[:3, :3], axis=0)[:, None]
        self.axes = axes * np.array([[-1.0], [1.0], [-1.0]])
        # Multiplied by rows `x y z 1`, as OpenEXR has it.
        self.world_to_camera = np.eye(4)
        self.world_to_camera[:3, :3] = self.axes.T
        self.world_to_camera[3, :3] = -self.place @ self.axes.T
        self.time = sensor.shutter_open() + 0.5 * sensor.shutter_open_time()

    def frame(self, overscan: int) -> Frame:
        """The film's crop with so many pixels around it."""
        width, height = self.sensor.film().crop_size()
        return Frame(int(width), int(height), overscan)

    def lens(self, choice: Choice) -> Lens:
        """The lens for the frame's width."""
        field = math.radians(self._number("x_fov"))
        shown = self.frame(0).width / float(self.sensor.film().size()[0])
        focal_length = 0.5 * choice.sensor_width_mm / math.tan(0.5 * field)
        f_number, focus = choice.f_number, choice.focus_distance
        if self.has_lens:
            diameter_mm = 2e3 * choice.metres_per_unit * self._number("aperture_radius")
            own = focal_length / diameter_mm if diameter_mm > 0.0 else math.inf
            f_number = own if f_number is None else f_number
            focus = self._number("focus_distance") if focus is None else focus
        return Lens(
            focal_length_mm=focal_length,
            sensor_width_mm=choice.sensor_width_mm * shown,
            f_number=math.inf if f_number is None else f_number,
            focus_distance=focus,
            metres_per_unit=choice.metres_per_unit,
        )

    def _number(self, name: str) -> float:
        return float(np.array(self.parameters[name]).reshape(-1)[0])

    def ray(self, x: mi.Float, y: mi.Float) -> mi.RayDifferential3f:
        """The ray through the middle of the lens at the place `x, y` of the frame, in pixels; it may lie outside."""
        width, height = self.sensor.film().crop_size()
        place = mi.Point2f(x / int(width), y / int(height))
        # The middle of the square is the middle of the disc, which every place of the film sees in its true direction.
        ray, _ = self.sensor.sample_ray(self.time, 0.5, place, mi.Point2f(0.5, 0.5))
        return mi.RayDifferential3f(ray)

    def planar(self, points: np.ndarray) -> np.ndarray:
        """Distance of world points `[n][3]` from the plane of the lens."""
        return (points - self.place) @ -self.axes[2]


def regular(samples: int, phase: int) -> tuple[float, float]:
    """Place of sample `phase` of S × S in its pixel, from 0 to 1 along both axes: the middle of its cell."""
    return (phase % samples + 0.5) / samples, (phase // samples + 0.5) / samples


def rotated(samples: int, phase: int) -> tuple[float, float]:
    """As `regular`, but each sample has a column and a row of its own among the S² of the pixel.

    An upright or level edge then covers S² + 1 different shares of the pixel instead of S + 1.
    """
    row, column = divmod(phase, samples)
    return (column + (samples - row - 0.5) / samples) / samples, (row + (column + 0.5) / samples) / samples


def places(frame: Frame, rows: range, offset: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """The place `offset` of each pixel of some rows, row by row, in pixels of the frame.

    Row 0 and column 0 are the first of the margin.
    """
    width = frame.wide()[0]
    x = np.arange(width) - frame.overscan + offset[0]
    y = np.array(rows) - frame.overscan + offset[1]
    return np.tile(x, len(rows)), np.repeat(y, width)
