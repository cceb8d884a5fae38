# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""What the extension adds to Blender, and how it goes again."""

from __future__ import annotations

import atexit

from . import live, operators, panel, post_step, preferences, properties

# Each has `register` and `unregister`; panels come after what they show.
_PARTS = (preferences, properties, operators, live, post_step, panel)


class _State:
    """Whether everything is there."""

    is_registered: bool = False


def register() -> None:
    """Adds everything."""
    for part in _PARTS:
        part.register()
    _State.is_registered = True
    # A script with the bpy module may end without `unregister`: Blender 4.5 hangs then.
    atexit.register(unregister)


def unregister() -> None:
    """Removes everything, in reverse order, and ends jobs that run; nothing where it is removed already.

    When a script ends by `sys.exit`, Python calls this first, then Blender does.
    """
    if not _State.is_registered:
        return
    _State.is_registered = False
    atexit.unregister(unregister)
    for part in reversed(_PARTS):
        part.unregister()
