"""Ctrl-C as a note that is read at the next safe moment, so that nothing is cut in two.

An interrupt in the middle of a call of the physics engine would come out as some error of its bindings, and in the
middle of an exchange with the motor it would leave half a packet on the wire.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from types import FrameType, TracebackType
from typing import Any


class Interruption:
    """A context manager that notes signals instead of letting them interrupt.

    A second signal raises `KeyboardInterrupt` at once, and so does the first one while `impatient` is set, as where
    nothing happens but waiting. What was there before is restored at the end. In other threads than the main one
    nothing is noted, and Ctrl-C stays as it is.

    Attributes:
        name: Name of the signal that came; empty before.
        impatient: Whether a signal interrupts at once.
    """

    def __init__(self, signals: Sequence[str] = ("SIGINT",), *, raise_second: bool = True) -> None:
        """Prepares the notes.

        Args:
            signals: Names of those that are noted; the ones that the system hasn't are left out.
            raise_second: Whether a second signal raises `KeyboardInterrupt`; without it all are only noted.
        """
        self.name = ""
        self.impatient = False
        self._signals, self._raise_second = tuple(signals), raise_second
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            for name in self._signals:
                if number := getattr(signal, name, None):
                    self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __bool__(self) -> bool:
        return bool(self.name)

    def check(self) -> None:
        """Raises `KeyboardInterrupt` where a signal was noted: called when all is on the disk."""
        if self.name:
            raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:
        again, self.name = bool(self.name), self.name or signal.Signals(number).name
        if self.impatient or (again and self._raise_second):
            raise KeyboardInterrupt
