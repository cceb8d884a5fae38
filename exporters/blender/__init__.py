# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""thinlens in Blender: depth of field after the render."""


def register() -> None:
    """Adds the panel. Blender calls this; the command line does without it."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Removes all that `register` added."""
    from . import registration

    registration.unregister()
