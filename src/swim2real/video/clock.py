"""Times that rise from frame to frame, whatever the time stamps of a file do."""

from __future__ import annotations

from fractions import Fraction

RESTART = Fraction(1, 2)  # s: a time stamp that falls back by more begins a new count
GAP = Fraction(1)  # s without a frame that a person should know of
LISTED = 4  # times that are listed one by one


class Tally:
    """Counts events, and keeps the first few of their times for a message."""

    def __init__(self) -> None:
        self.count = 0
        self._times: list[float] = []
        self._last = 0.0

    def add(self, time: float) -> None:
        self.count += 1
        self._last = time
        if len(self._times) < LISTED:
            self._times.append(time)

    @property
    def when(self) -> str:
        """When they happened, in words, such as `at 0.200 and 0.433 s`."""
        if self.count > LISTED:
            return f"from {self._times[0]:.3f} to {self._last:.3f} s"
        *others, last = (f"{time:.3f}" for time in self._times)
        return f"at {', '.join(others)} and {last} s" if others else f"at {last} s"

    def note(self, what: str, then: str = "") -> list[str]:
        """A sentence on so many frames; none where there are none."""
        return [f"{frames(self.count)} {what}, {self.when}{then}"] if self.count else []


class Clock:
    """Turns time stamps into times since the first frame, and mends what is wrong with them.

    A frame without a time stamp follows its predecessor by the usual interval; one that doesn't come after its
    predecessor is put half an interval after it, so that the frames that follow are right again. Where the stamps fall
    back by more than `RESTART`, a new count is joined to the old one.

    Attributes:
        interval: Usual time from one frame to the next [s].
        missing: Frames without a stamp.
        mended: Frames whose stamp does not come after the one before.
        restarts: Times at which the stamps began anew.
        gaps: Times at which stretches without frames begin.
    """

    def __init__(self, interval: Fraction) -> None:
        self.interval = interval
        self._origin: Fraction | None = None
        self._last: Fraction | None = None
        self.missing, self.mended, self.restarts, self.gaps = Tally(), Tally(), Tally(), Tally()

    def tick(self, stamp: Fraction | None) -> float:
        """Time of the next frame [s].

        Args:
            stamp: Time stamp of the frame [s]; None if the file has none.
        """
        self._last = self._next(stamp)
        return float(self._last)

    def skip(self) -> float:
        """Passes over a frame that has no stamp and is left out; the time where it would have been [s]."""
        if self._last is None:
            return -float(self.interval)
        self._last += self.interval
        return float(self._last)

    def place(self, stamp: Fraction) -> float:
        """Where a stamp lies in time [s]; below 0 before the first frame."""
        return -float(self.interval) if self._origin is None else float(stamp - self._origin)

    def notes(self) -> list[str]:
        """A sentence for each irregularity of the time stamps."""
        rate = f"; placed by the frame rate of {float(1 / self.interval):.2f} a second"
        notes = self.missing.note("without a time stamp", rate) if self._origin is not None else []
        notes += self.mended.note(
            "with a time stamp that doesn't come after the one before", "; placed half an interval after it"
        )
        if self.restarts.count:
            notes.append(f"the time stamps begin anew {self.restarts.when}; joined without a gap")
        if self.gaps.count:
            notes.append(f"no frames for more than {float(GAP):g} s after {self.gaps.when.removeprefix('at ')}")
        return notes

    def _next(self, stamp: Fraction | None) -> Fraction:
        expected = Fraction(0) if self._last is None else self._last + self.interval
        if stamp is None:
            self.missing.add(float(expected))
            return expected
        if self._origin is None:
            self._origin = stamp - expected
        time = stamp - self._origin
        if self._last is None or time > self._last:
            if self._last is not None and time - self._last > max(GAP, 5 * self.interval):
                self.gaps.add(float(self._last))
            return time
        if self._last - time > RESTART:
            self._origin = stamp - expected
            self.restarts.add(float(expected))
            return expected
        time = self._last + self.interval / 2
        self.mended.add(float(time))
        return time


def frames(count: int) -> str:
    """`1 frame` or `3 frames`."""
    return f"{count} frame{'' if count == 1 else 's'}"
