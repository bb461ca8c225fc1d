"""A stretch of time that is cut out of a film, a table or a recording; times are counted anew from its first frame."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from markertrack.track import MarkerTrack
from swimbase.errors import ArgumentError, TrialError

ROUNDING = 5e-4  # s: times are given to a millisecond, as overlays and tables show them


@dataclass(frozen=True)
class Span:
    """A stretch of time, both ends included.

    Attributes:
        begin: Its beginning [s].
        until: Its end [s]; None for the end of what it is cut out of.
    """

    begin: float = 0.0
    until: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.begin < math.inf:
            raise ArgumentError(f"--from is {self.begin:g} s; it must be finite and 0 or above")
        if self.until is not None and not self.begin < self.until < math.inf:
            after = f"it must be finite and after --from, which is {self.begin:g} s"
            raise ArgumentError(f"--until is {self.until:g} s; {after}")

    @property
    def whole(self) -> bool:
        """True where nothing is cut off."""
        return self.begin == 0 and self.until is None

    @property
    def words(self) -> str:
        """The stretch, in words, such as `from 2 s to 5 s`; empty where nothing is cut off."""
        end = "the end" if self.until is None else f"{self.until:g} s"
        return "" if self.whole else f"from {self.begin:g} s to {end}"

    def before(self, time: float) -> bool:
        """True for a time before the stretch [s]."""
        return time < self.begin - ROUNDING

    def after(self, time: float) -> bool:
        """True for a time after the stretch [s]."""
        return self.until is not None and time > self.until + ROUNDING

    def check(self, last: float, what: str) -> None:
        """Checks that the stretch lies within what it is cut out of.

        Args:
            last: Time of the last frame, or an end that is surely not before it [s].
            what: What is cut, such as "video 'swim.mp4'".

        Raises:
            TrialError: It doesn't.
        """
        for option, time in (("--from", self.begin), ("--until", self.until)):
            if time is not None and time > last + ROUNDING:
                raise TrialError(f"{what} ends at {last:.3f} s; {option} is {time:g} s, so give a time before the end")

    def of_track(self, track: MarkerTrack, what: str) -> MarkerTrack:
        """The frames of a track within the stretch, on the track's own clock.

        Raises:
            TrialError: The stretch isn't within the track, or holds fewer than 2 frames.
        """
        self.check(float(track.times[-1]), what)
        kept = [not (self.before(time) or self.after(time)) for time in track.times.tolist()]
        if sum(kept) < 2:
            raise TrialError(f"{what} has {sum(kept)} frames {self.words}; a trial needs at least 2, so cut off less")
        return track.frames(kept)


WHOLE = Span()


def spans(begins: tuple[float, ...], untils: tuple[float, ...], count: int, things: str) -> list[Span]:
    """The stretches of several films or tables; one value counts for all of them.

    Args:
        begins: One beginning for all, one for each, or none [s].
        untils: Likewise their ends [s].
        count: Number of films or tables.
        things: What they are, for a message.

    Raises:
        ArgumentError: Another number of values was given, or a stretch is none.
    """

    def each(option: str, values: tuple[float, ...]) -> Iterable[float | None]:
        if len(values) not in (0, 1, count):
            raise ArgumentError(f"--{option} has {len(values)} values for {count} {things}; give one for all or each")
        return values if len(values) == count else (values or (None,)) * count

    pairs = zip(each("from", begins), each("until", untils), strict=True)
    return [Span(begin or 0.0, until) for begin, until in pairs]
