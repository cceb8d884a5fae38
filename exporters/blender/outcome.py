# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""How a job that ran beside Blender ended. No Blender here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

# So many last lines of a program that ended without an error of its own are shown.
LAST_LINES = 6
# So many different errors are shown.
MOST_ERRORS = 3


@dataclass(frozen=True)
class Outcome:
    """The end of a job."""

    is_done: bool
    # For the user: what was made, or the error.
    text: str
    # Lines that begin with "warning:".
    warnings: tuple[str, ...] = ()
    # The picture that was made, if one was.
    path: str = ""
    seconds: float = 0.0


def error_text(lines: Sequence[str], program: str, code: int) -> str:
    """The errors that a program printed among its `lines`, each once; its last lines if there are none.

    An error is a line that begins with "error:", with the indented lines after it.
    """
    errors: list[str] = []
    is_error = False
    for line in lines:
        if line.startswith("error:"):
            errors.append(line)
        elif is_error and line.startswith("  "):
            errors[-1] += f"\n{line}"
        is_error = line.startswith("error:") or (is_error and line.startswith("  "))
    different = list(dict.fromkeys(errors))
    if different:
        more = len(different) - MOST_ERRORS
        return "\n".join([*different[:MOST_ERRORS], *([f"and {more} other errors"] if more > 0 else [])])
    ended = f"error: {program} ended by signal {-code}" if code < 0 else f"error: {program} ended with code {code}"
    last = [line for line in lines if line.strip()][-LAST_LINES:]
    return "\n".join([ended, *(f"  {line}" for line in last)])


def warnings(lines: Sequence[str]) -> tuple[str, ...]:
    """The warnings among `lines`, each once."""
    return tuple(dict.fromkeys(line for line in lines if line.startswith("warning:")))
