"""Where the times of a stream begin, how many rows it has per second, and how that is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from swim2real.checking import Positive

if TYPE_CHECKING:
    from swim2real.trials.trial import Trial

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


TABLES = "time 0 of the track"  # where the times of tables beside a track begin
_APART = 1.5  # ratio of durations from which recordings of one session hardly are whole
_LOGGED = 0.1  # of a table's duration: rows that are further apart are commands by hand, of which the last one holds


def by_stamps(origin: str, times: NDArray[np.float64]) -> Timebase | None:
    """The clock of time stamps [s], of shape (R,); None for a single one, which has no rate."""
    return Timebase(origin, round(1 / float(np.median(np.diff(times))), 6), "stamps") if len(times) > 1 else None


def described(trial: Trial) -> str:
    """The clocks of a trial's streams in one line; where nothing is on record of one, what its stamps say."""
    streams = {"track": trial.track, "controls": trial.controls, "sensors": trial.sensors}
    times = {kind: stream.times for kind, stream in streams.items() if stream is not None}
    found = {kind: by_stamps("first row, as nothing else is on record", stamps) for kind, stamps in times.items()}
    clocks = {kind: trial.timebases.get(kind) or found[kind] or "a single row" for kind in times}
    return "; ".join(f"{kind} {clock}" for kind, clock in clocks.items())


def contradictions(trial: Trial) -> list[str]:
    """A sentence where a track and a table beside it hardly are of one length in time.

    Recordings of one session may begin and end at different times, so this is a suspicion.
    """
    end, film = float(trial.track.times[-1]), trial.timebases.get("track")
    for kind, table in {"controls": trial.controls, "sensors": trial.sensors}.items():
        if not trial.track.marker_count or table is None or len(table.times) < 2:
            continue
        last = float(table.times[-1])
        if last <= 0 or np.diff(table.times).max() > _LOGGED * last or 1 / _APART < end / last < _APART:
            continue
        rate = (trial.fps if film is None else film.rate) * end / last
        return [
            f"the track lasts {end:.3g} s, its {kind} {last:.3g} s: {end / last:.3g} times as long; if both are of the "
            f"same motion, the film's true rate (--fps) is about {rate:.3g}"
        ]
    return []
