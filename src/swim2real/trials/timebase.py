"""Where the times of a stream begin, how many rows it has per second, and how that is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from swim2real.checking import Positive

KnownBy = Literal["stamps", "container", "given"]
_WORDS: dict[KnownBy, str] = {"stamps": "by its time stamps", "container": "by its container", "given": "as given"}


@dataclass(frozen=True)
class Timebase:
    """The clock of a film, a track table, a table of commands or one of readings.

    Attributes:
        origin: What its time 0 is, in words, such as `first frame of swim.mp4`.
        rate: Frames or rows per second, by the median interval [Hz].
        known_by: How that is known: by the rows' own `stamps`, by the film's `container`, or `given` by the user.
    """

    origin: str
    rate: Positive
    known_by: KnownBy

    def __str__(self) -> str:
        return f"{self.rate:.4g} Hz {_WORDS[self.known_by]}, from the {self.origin}"
