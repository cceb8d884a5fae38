# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""The journal of an export: every change to the open file, so that each is undone in reverse order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .shared import ExportError


class Journal:
    """Undoes what it knows of when its `with` block ends, also after an error."""

    def __init__(self) -> None:
        self._undo: list[Callable[[], None]] = []

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        failures = self.restore()
        if not failures:
            return
        failure = ExportError(
            "the scene could not be restored", found="; ".join(failures), help="do not save it; open the file again"
        )
        if error is None:
            raise failure
        error.add_note(str(failure))

    def on_restore(self, undo: Callable[[], None]) -> None:
        """Calls `undo` when the journal is restored, before all that was journalled earlier."""
        self._undo.append(undo)

    def set(self, thing: Any, name: str, value: Any) -> None:
        """Sets the attribute `name` of `thing`; a property that this version of Blender lacks is left alone."""
        if not hasattr(thing, name):
            return
        old = _value(getattr(thing, name))
        if old == value:
            return
        self.on_restore(lambda: setattr(thing, name, old))
        setattr(thing, name, value)

    def remember(self, thing: Any, *names: str) -> None:
        """Restores these attributes of `thing`, whoever changes them until then."""
        for name in names:
            if hasattr(thing, name):
                old = _value(getattr(thing, name))
                self.on_restore(lambda name=name, old=old: setattr(thing, name, old))

    def set_custom(self, thing: Any, key: str, value: float) -> None:
        """Sets the custom property `key` of `thing`."""
        if key in thing:
            old = thing[key]
            self.on_restore(lambda: thing.__setitem__(key, old))
        else:
            self.on_restore(lambda: thing.pop(key, None))
        thing[key] = value

    def made(self, collection: Any, thing: Any) -> Any:
        """Returns `thing`, a datablock that was made in `collection`, and removes it in the end."""
        self.on_restore(lambda: collection.remove(thing))
        return thing

    def restore(self) -> list[str]:
        """Undoes everything. Returns the texts of the steps that failed: one does not stop the others."""
        failures = []
        while self._undo:
            undo = self._undo.pop()
            try:
                undo()
            except Exception as error:  # Each step is undone by itself.
                failures.append(f"{type(error).__name__}: {error}")
        return failures


def _value(value: Any) -> Any:
    """A property's value, of its own where it is an array."""
    is_array = hasattr(value, "__len__") and not isinstance(value, str | bytes | set)
    return tuple(value) if is_array else value
