# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""How far outside the frame something can be whose blur reaches into it."""

from __future__ import annotations

import math
from typing import Any

from .camera import View, aim
from .passes import Job, Renderer
from .settings import Say
from .shared import lens as lenses

# Most overscan, as a share of the frame's width.
MOST_SHARE = 0.25
# Width in pixels of the small render that the overscan is found in.
PROBE_WIDTH = 240


def find(renderer: Renderer, camera_data: Any, view: View, lens: Any, say: Say) -> int:
    """Overscan in picture pixels for `lens`, from the distances in a small wide render."""
    most = math.ceil(MOST_SHARE * view.width)
    step = max(1, round((view.width + 2 * most) / PROBE_WIDTH))
    size = tuple(math.ceil((length + 2 * most) / step) for length in (view.width, view.height))
    aim(renderer.scene, camera_data, view, most, size)
    depth = renderer.render(Job("overscan")).depth()
    found = lenses.overscan_px(depth, (view.width, view.height), most, lens)
    if found == most:
        say(f"note: overscan stopped at {most} px, a quarter of the frame; near the edges some blur is estimated")
    return found
