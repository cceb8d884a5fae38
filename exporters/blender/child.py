# SPDX-License-Identifier: MIT OR Apache-2.0 OR GPL-3.0-or-later
"""A program that runs beside Blender: its lines as they come, its end, and stopping it. No Blender here."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence

from .program import hidden
from .shared import ExportError

# How long a program may take to end after it was asked to, in seconds.
END_TIMEOUT_S = 2.0


class Child:
    """A running program. Its standard error is read line by line, its standard output is left out."""

    def __init__(self, arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
        """Starts `arguments[0]`, without a shell. Raises `ExportError` if it cannot be started.

        `environment` holds further variables.
        """
        try:
            self._process = subprocess.Popen(
                arguments,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
                env={**os.environ, **(environment or {})},
                creationflags=hidden(),
                # A group of its own, so that what it starts ends with it.
                start_new_session=True,
            )
        except OSError as error:
            raise ExportError(
                f"a program cannot be started: {error.strerror}", where=arguments[0], found=" ".join(arguments)
            ) from error
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        with self._process.stderr as lines:
            for line in lines:
                self._lines.put(line.rstrip("\n"))

    def lines(self) -> list[str]:
        """The lines since the last call."""
        out = []
        while not self._lines.empty():
            out.append(self._lines.get())
        return out

    def code(self) -> int | None:
        """The exit code when the program has ended and all its lines are there, else None."""
        if self._process.poll() is None:
            return None
        # A program of its own that it left running may keep the pipe open.
        self._reader.join(END_TIMEOUT_S)
        return self._process.returncode

    def stop(self) -> None:
        """Ends the program, if it runs, with all that it started."""
        for number in ("SIGTERM", "SIGKILL"):
            if self._process.poll() is not None:
                return
            self._signal(number)
            try:
                self._process.wait(END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                continue

    def _signal(self, name: str) -> None:
        if not hasattr(os, "killpg"):
            self._process.kill()
            return
        try:
            os.killpg(self._process.pid, getattr(signal, name))
        except ProcessLookupError:
            return
