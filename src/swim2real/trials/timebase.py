"""Clocks of streams: the origin of their times, their rows per second, and how these are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from swimbase.checking import Positive

if TYPE_CHECKING:
    from markertrack.track import MarkerTrack
    from swim2real.trials.signals import Signals
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


def by_stamps(origin: str, **streams: MarkerTrack | Signals | None) -> dict[str, Timebase]:
    """The clocks of streams by their time stamps; of one that isn't there, or has a single row, there is none."""
    return {
        kind: Timebase(origin, round(1 / float(np.median(np.diff(stream.times))), 6), "stamps")
        for kind, stream in streams.items()
        if stream is not None and len(stream.times) > 1
    }


def described(trial: Trial) -> str:
    """The clocks of a trial's streams in one line; where nothing is on record of one, what its stamps say."""
    streams = {"track": trial.track, **trial.signals}
    clocks = by_stamps("first row, as nothing else is on record", **streams) | dict(trial.timebases)
    return "; ".join(f"{kind} {clocks.get(kind, 'a single row')}" for kind in streams)


def contradictions(trial: Trial) -> list[str]:
    """A sentence where a track and a table beside it hardly are of one length in time.

    Recordings of one session may begin and end at different times, so this is a suspicion.
    """
    end, film = float(trial.track.times[-1]), trial.timebases.get("track")
    for kind, table in trial.signals.items() if trial.track.marker_count else ():
        last, gap = float(table.times[-1]), np.diff(table.times).max(initial=0.0)
        if last > 0 < gap <= _LOGGED * last and not 1 / _APART < end / last < _APART:
            rate = (trial.fps if film is None else film.rate) * end / last
            return [
                f"the track lasts {end:.3g} s, its {kind} {last:.3g} s: {end / last:.3g} times as long; if both are of "
                f"the same motion, the film's true rate (--fps) is about {rate:.3g}"
            ]
    return []
