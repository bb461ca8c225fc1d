"""Times that rise from frame to frame, whatever the time stamps of a file do, and notes on when something happened."""

from __future__ import annotations

from fractions import Fraction

RESTART = Fraction(1, 2)  # s: a time stamp that falls back by more begins a new count
GAP = Fraction(1)  # s without a frame that a person should know of
LISTED = 4  # times that are listed one by one


class Notes:
    """Sentences on what happened to frames, with how many and when.

    A sentence is a pattern in which `{frames}` stands for so many frames, and `{when}` for their times.
    """

    def __init__(self) -> None:
        self._times: dict[str, list[float]] = {}

    def add(self, sentence: str, time: float | Fraction) -> None:
        """Something happened at a time [s]."""
        self._times.setdefault(sentence, []).append(float(time))

    def lines(self) -> list[str]:
        """The sentences, in the order in which things happened first."""
        return [text.format(frames=frames(len(t)), when=_when(t)) for text, t in self._times.items()]


class Clock:
    """Turns time stamps into times since the first frame, and mends what is wrong with them.

    A frame without a time stamp follows its predecessor by the usual interval; one that doesn't come after its
    predecessor is put half an interval after it, so that the frames that follow are right again. Where the stamps fall
    back by more than `RESTART`, a new count is joined to the old one.

    Attributes:
        interval: Usual time from one frame to the next [s].
    """

    def __init__(self, interval: Fraction) -> None:
        self.interval, self._notes = interval, Notes()
        self._origin: Fraction | None = None
        self._last: Fraction | None = None

    def tick(self, stamp: Fraction | None) -> float:
        """Time of the next frame [s].

        Args:
            stamp: Time stamp of the frame [s]; None if the file has none.
        """
        self._last = self._next(stamp)
        return float(self._last)

    def skip(self, count: int) -> None:
        """Passes over frames that have no stamp and are left out."""
        if self._last is not None:
            self._last += count * self.interval

    def place(self, stamp: Fraction) -> float:
        """Time of a stamp [s]; below 0 before the first frame."""
        return -float(self.interval) if self._origin is None else float(stamp - self._origin)

    def notes(self) -> list[str]:
        """A sentence for each irregularity of the time stamps; none of frames that are only counted."""
        return [] if self._origin is None else self._notes.lines()

    def _next(self, stamp: Fraction | None) -> Fraction:
        expected = Fraction(0) if self._last is None else self._last + self.interval
        if stamp is None:
            placed = f"; placed by the frame rate of {float(1 / self.interval):.2f} a second"
            self._notes.add("{frames} without a time stamp, {when}" + placed, expected)
            return expected
        if self._origin is None:
            self._origin = stamp - expected
        time = stamp - self._origin
        if self._last is None:
            return time
        if self._last - time > RESTART:
            self._origin = stamp - expected
            self._notes.add("the time stamps begin anew {when}; joined without a gap", expected)
            return expected
        if time > self._last:
            if time - self._last > max(GAP, 5 * self.interval):
                self._notes.add(f"no frames for more than {float(GAP):g} s after the one {{when}}", self._last)
            return time
        time = self._last + self.interval / 2
        what = "with a time stamp that doesn't come after the one before"
        self._notes.add(f"{{frames}} {what}, {{when}}; placed half an interval after it", time)
        return time


def frames(count: int) -> str:
    """`1 frame` or `3 frames`."""
    return f"{count} frame{'' if count == 1 else 's'}"


def _when(times: list[float]) -> str:
    """Times in words, such as `at 0.200 and 0.433 s`."""
    if len(times) > LISTED:
        return f"from {times[0]:.3f} to {times[-1]:.3f} s"
    *others, last = (f"{time:.3f}" for time in times)
    return f"at {', '.join(others)} and {last} s" if others else f"at {last} s"
