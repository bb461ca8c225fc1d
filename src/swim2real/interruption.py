"""Ctrl-C as a note that is read at the next safe moment, so that nothing is cut in two.

An interrupt in the middle of a call of the physics engine would come out as some error of its bindings.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any


class Interruption:
    """A context manager that notes Ctrl-C instead of letting it interrupt.

    A second one raises `KeyboardInterrupt` at once, and so does the first one while `impatient` is set, as where
    nothing happens but waiting. What was there before is restored at the end. In other threads than the main one
    nothing is noted, and Ctrl-C stays as it is.

    Attributes:
        impatient: Whether Ctrl-C interrupts at once.
    """

    def __init__(self) -> None:
        self.impatient = False
        self._noted = False
        self._before: Any = None

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def __bool__(self) -> bool:
        return self._noted

    def check(self) -> None:
        """Raises `KeyboardInterrupt` where Ctrl-C was noted: called when all is on the disk."""
        if self._noted:
            raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:
        again, self._noted = self._noted, True
        if self.impatient or again:
            raise KeyboardInterrupt
