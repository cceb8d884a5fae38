"""Errors as thinlens prints them: what was wanted, where, what was found, and what to do."""

from __future__ import annotations


class ExportError(Exception):
    """An export that cannot go on. Its text is complete: print it as it is."""

    def __init__(self, what: str, *, where: str = "", found: str = "", wanted: str = "", help: str = "") -> None:
        """`what` is a sentence without a full stop; the other parts are left out where empty."""
        lines = [f"error: {what}"]
        if where:
            lines.append(f"  in {where}")
        lines += [f"  {name}: {text}" for name, text in (("found", found), ("wanted", wanted), ("help", help)) if text]
        super().__init__("\n".join(lines))
