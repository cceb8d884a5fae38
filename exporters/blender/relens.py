# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""When to render a stack again as its lens changes: one job at a time, the last change wins. No Blender here."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from enum import IntEnum
from typing import Any

from .outcome import Outcome
from .shared import ExportError

# A lens that did not change for so long is rendered at final quality, in seconds.
SETTLE_S = 0.5


class Level(IntEnum):
    """The quality of a picture."""

    NONE = 0
    # While the lens changes.
    DRAFT = 1
    # When it rests.
    FINAL = 2


# Starts a job for a lens at a level.
Start = Callable[[Any, Level], Any]


class Relens:
    """Follows a lens. `tick` is called again and again, with the lens as it is then."""

    def __init__(self, start: Start, settle_s: float = SETTLE_S) -> None:
        """`start` returns a job with `poll` and `stop`, or raises `ExportError`."""
        self._start, self._settle_s = start, settle_s
        self._seen: Hashable = None
        self._changed_s = 0.0
        self._job: Any = None
        # The lens and the level of the job, and of the last picture or failure.
        self._running: tuple[Hashable, Level] = (None, Level.NONE)
        self._shown: tuple[Hashable, Level] = (None, Level.NONE)

    @property
    def is_busy(self) -> bool:
        """Whether a job runs."""
        return self._job is not None

    def is_settled(self, lens: Hashable) -> bool:
        """Whether the final picture of `lens` is there, or failed."""
        return not self.is_busy and self._shown == (lens, Level.FINAL)

    def tick(self, lens: Hashable, now_s: float) -> Outcome | None:
        """Starts and ends jobs as the present `lens` needs; None is no lens. How a job ended, if one did."""
        if lens != self._seen:
            self._seen, self._changed_s = lens, now_s
        outcome = self._ended(lens)
        if self._job is None and lens is not None:
            failure = self._begin(lens, now_s)
            outcome = failure or outcome
        return outcome

    def stop(self) -> None:
        """Ends the job that runs."""
        if self._job is not None:
            self._job.stop()
            self._job = None

    def _ended(self, lens: Hashable) -> Outcome | None:
        """How the job ended, if it did. A final picture of a lens that is no more is given up.

        A draft is shown even so: while a lens changes all the time, pictures follow it.
        """
        if self._job is None:
            return None
        outcome = self._job.poll()
        if outcome is not None:
            self._job = None
            failed = (self._running[0], Level.FINAL)
            self._shown = self._running if outcome.is_done else failed
        elif lens is None or (self._running[1] is Level.FINAL and self._running[0] != lens):
            self.stop()
        return outcome

    def _begin(self, lens: Hashable, now_s: float) -> Outcome | None:
        wanted = Level.FINAL if now_s - self._changed_s >= self._settle_s else Level.DRAFT
        shown = self._shown[1] if self._shown[0] == lens else Level.NONE
        if shown >= wanted:
            return None
        try:
            self._job = self._start(lens, wanted)
        except ExportError as error:
            self._shown = (lens, Level.FINAL)
            return Outcome(False, str(error))
        self._running = (lens, wanted)
        return None
