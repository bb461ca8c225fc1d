"""What is shown and how much of it: orders of detail, each with a budget."""

from __future__ import annotations

from dataclasses import dataclass

from swim2real.settings import DetailName

MOST_BYTES = 14_000_000  # of all media; as text they are a third longer, and many services stop at 20 MB
VIDEO_FRAME_TOKENS = 258  # the most that a service of today counts for a frame of a film
PIXELS_A_TOKEN = 750  # of a picture, likewise


@dataclass(frozen=True)
class Detail:
    """One order of detail.

    Attributes:
        name: As on the command line.
        fps: Of films [Hz], raised where a beat would have fewer than five frames.
        width: Of films and pictures [px].
        moments: Of a beat on a sheet.
        trials: That are shown in pictures, those that fit worst first; None for all.
        rounds: Of the history that are told in full; None for all.
        tokens: Most that the media may take, by estimate.
    """

    name: str
    fps: float
    width: int
    moments: int
    trials: int | None
    rounds: int | None
    tokens: int


_LEAST = Detail("least", 10.0, 320, 4, 1, 1, 8_000)
DETAILS: dict[DetailName, Detail] = {
    "low": Detail("low", 10.0, 480, 4, 3, 3, 40_000),
    "medium": Detail("medium", 12.0, 640, 8, None, 6, 120_000),
    "high": Detail("high", 24.0, 960, 12, None, None, 300_000),
}


def shorter(detail: Detail) -> Detail:
    """The next order down."""
    order = [_LEAST, *DETAILS.values()]
    return order[max(order.index(detail) - 1, 0)]
