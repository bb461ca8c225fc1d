"""The classes that carry marker tracks: one for real and simulated trials alike."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from markertrack.span import Span
from markertrack.track import MarkerTrack
from swim2real.formatting import html_table, listed, number
from swim2real.trials.signals import MEMORY, Signals
from swim2real.trials.timebase import TABLES, Timebase
from swimbase.checking import Number, Positive, did_you_mean
from swimbase.errors import TrialError, about
from swimbase.names import composed, file_name_fault, label_fault, quoted

if TYPE_CHECKING:
    import pandas as pd

_SHORTEST, _LONGEST = 1e-6, 10.0  # s from one row to the next, on average
Share = Annotated[Number, Field(ge=-0.5, le=0.5)]


@dataclass(frozen=True)
class Actuation:
    """Drive of a trial: the motor turns at a constant speed.

    Attributes:
        frequency: Frequency of the motor [Hz].
        phase: Motor angle at the first time stamp [rad].
        start_speed: Forward speed at which a simulation starts [m/s]; None starts from rest and is not
            brought to a steady cycle.
    """

    frequency: float
    phase: float = 0.0
    start_speed: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.frequency) and self.frequency > 0):
            raise TrialError(f"frequency is {self.frequency} Hz; it must be finite and above 0")

    @property
    def period(self) -> float:
        """Time of one turn [s]."""
        return 1.0 / self.frequency


@dataclass(frozen=True)
class Perspective:
    """Effect of a camera above on a track, where nothing corrected it when the film was tracked.

    A marker that stands nearer to the camera by a share of its distance is seen farther from the point below the camera
    by that share.

    Attributes:
        below: Position of the point below the camera [m].
        nearness: How much nearer than the first two each of the M markers is, as a share of the camera's distance.
        tilt: By which share the picture of a camera that doesn't look straight down is smaller for each meter along
            world x and y from the point below it [1/m].
        scale: By which the track is scaled, where its own scale is known to be off.
    """

    below: tuple[Number, Number]
    nearness: tuple[Share, ...]
    tilt: tuple[Share, Share] = (0.0, 0.0)
    scale: Positive = 1.0

    def removed(self, track: MarkerTrack) -> MarkerTrack:
        """The track as a camera would see it that looks straight down from very far above.

        Raises:
            TrialError: It has another number of markers, or goes so far that the tilt leaves no picture.
        """
        if track.marker_count != len(self.nearness):
            raise TrialError(f"perspective: nearness has {len(self.nearness)} numbers for {track.marker_count} markers")
        apart = track.positions - self.below
        size = 1 - apart @ self.tilt
        if np.nanmin(size) <= 0:
            raise TrialError(f"perspective: with a tilt of {self.tilt} per meter there is no picture where markers are")
        apart = apart / size[..., None] / (1 + np.array(self.nearness))[:, None]
        return MarkerTrack(track.times, self.below + self.scale * apart, track.confidence)


@dataclass(frozen=True)
class Trial:
    """One swim at one frequency, or one recording.

    Attributes:
        name: Name, unique within its set.
        track: Positions of the markers over time.
        nominal_frequency: Frequency that the motor was commanded to turn at [Hz]; None if it isn't known.
        meters_per_pixel: Scale of the video [m]; None for a simulation.
        provenance: Where the trial comes from, in words.
        divergence: Why and when a simulation failed; None if it didn't.
        video: Video that the trial was tracked in; None without one. The file may have been moved since.
        video_begin: Time of that video at which the trial's time is 0 [s].
        controls: Commands that drove the robot, one column per actuator; each row holds until the next.
        sensors: Readings that were recorded beside the markers.
        start: Positions of joints at the first time stamp [m or rad]; empty if they aren't known.
        start_velocities: Velocities of joints at the first time stamp [m/s or rad/s]; a joint that isn't named is at
            rest.
        perspective: What the camera did to the track; None where nothing is known of it, or it is corrected.
        timebases: Clocks of its streams, by `track`, `controls` and `sensors`, as far as they are known.
        midline: Whether its markers are places along the midline of a swimmer without markers.
        first_beats: Forward speed of a simulated steady swim over its first two beats from rest, as far as it was
            simulated [m/s]; None where it didn't begin at rest.
    """

    name: str
    track: MarkerTrack
    nominal_frequency: float | None = None
    meters_per_pixel: float | None = None
    provenance: str = ""
    divergence: str | None = None
    video: Path | None = None
    video_begin: float = 0.0
    controls: Signals | None = None
    sensors: Signals | None = None
    start: Mapping[str, float] = field(default_factory=dict[str, float])
    start_velocities: Mapping[str, float] = field(default_factory=dict[str, float])
    perspective: Perspective | None = None
    timebases: Mapping[str, Timebase] = field(default_factory=dict[str, Timebase])
    midline: bool = False
    first_beats: float | None = None

    def __repr__(self) -> str:
        return f"<Trial {self.name}: {self.track.duration:.2f} s, {self.track.frame_count} frames>"

    @property
    def fps(self) -> float:
        """Frames a second, from the median interval of the time stamps."""
        return float(1.0 / np.median(np.diff(self.track.times)))

    @property
    def signals(self) -> dict[str, Signals]:
        """Its tables `controls` and `sensors`, as far as there are any."""
        tables = {"controls": self.controls, "sensors": self.sensors}
        return {kind: table for kind, table in tables.items() if table is not None}

    @property
    def film_rate(self) -> float | None:
        """Frames per second that the user gave for the trial's film; None where the film's own hold."""
        clock = self.timebases.get("track")
        return clock.rate if clock is not None and clock.known_by == "given" else None

    def seen_from_afar(self) -> Trial:
        """The trial without what the camera's perspective did to it, where that is known.

        Raises:
            TrialError: No camera can have done that to this track.
        """
        if self.perspective is None:
            return self
        with about(f"trial '{self.name}'"):
            return replace(self, track=self.perspective.removed(self.track), perspective=None)

    def cut(self, horizon: float | None) -> Trial:
        """The first `horizon` seconds of the track; all of it for None."""
        if horizon is None:
            return self
        return replace(self, track=self.track.frames(self.track.times - self.track.times[0] <= horizon + 1e-9))

    def within(self, span: Span) -> Trial:
        """The trial within a stretch of time, its times counted from its first frame.

        Commands of the last seconds before it stay, at times below 0, since actuators may remember them. A known start
        stays only where nothing is cut off before it.

        Raises:
            TrialError: The stretch isn't within the trial, or holds fewer than 2 frames.
        """
        if span.whole:
            return self
        track = span.of_track(self.track, f"trial '{self.name}'")
        first, last = float(track.times[0]), float(track.times[-1])
        clocks = dict(self.timebases)
        for kind, clock in clocks.items() if first else ():
            if clock.origin != TABLES:
                clocks[kind] = replace(clock, origin=f"{clock.origin} plus {first:.10g} s")
        trial = replace(self, start={}, start_velocities={}) if first > self.track.times[0] else self
        before = {"controls": MEMORY, "sensors": None}
        tables = {kind: table.cut(first, last, before=before[kind]) for kind, table in self.signals.items()}
        shifted = MarkerTrack(track.times - first, track.positions, track.confidence)
        words = ", ".join(filter(None, (self.provenance, span.words)))
        begin = self.video_begin + first
        return replace(trial, track=shifted, provenance=words, video_begin=begin, timebases=clocks, **tables)


@dataclass(frozen=True)
class TrialSet:
    """Trials with the same markers, by name."""

    trials: tuple[Trial, ...]
    marker_names: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        if not self.trials:
            raise TrialError("a set of trials needs at least one trial")
        seen: set[str] = set()
        for trial in self.trials:
            check_trial_name(trial.name)
            if composed(trial.name) in seen:
                raise TrialError(f"two trials are named '{trial.name}'; give each its own name")
            seen.add(composed(trial.name))
        counts = {trial.name: trial.track.marker_count for trial in self.trials}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{name} has {count}" for name, count in counts.items())
            raise TrialError(f"all trials must have the same markers: {listed}")
        count = self.trials[0].track.marker_count
        if not self.marker_names:
            object.__setattr__(self, "marker_names", tuple(f"M{i}" for i in range(count)))
        if len(self.marker_names) != count:
            raise TrialError(f"{len(self.marker_names)} marker names for {count} markers")
        for name in self.marker_names:
            if fault := label_fault(name):
                raise TrialError(f"marker name {quoted(name)} {fault}; give it another name")

    def __repr__(self) -> str:
        return f"<TrialSet of {len(self)} trials ({listed(self.names)}), {len(self.marker_names)} markers>"

    def _repr_html_(self) -> str:
        rows = [
            (
                one.name, f"{one.track.duration:.2f}", str(one.track.frame_count), number(one.nominal_frequency, 2),
                listed(list(one.signals)) or "–",
            )
            for one in self
        ]  # fmt: skip
        return html_table(repr(self), ("trial", "s", "frames", "nominal Hz", "tables"), rows)

    def __iter__(self) -> Iterator[Trial]:
        return iter(self.trials)

    def __len__(self) -> int:
        return len(self.trials)

    def __getitem__(self, name: str) -> Trial:
        for trial in self.trials:
            if composed(trial.name) == composed(name):
                return trial
        near = did_you_mean(name, self.names)
        raise TrialError(f"no trial is named '{name}'; there are {', '.join(self.names)}{near}")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(trial.name for trial in self.trials)

    def to_dataframe(self) -> pd.DataFrame:
        """The tracks, a row for each trial, time [s] and marker: `x`, `y` [m] and `confidence`."""
        import pandas as pd

        tables: dict[str, pd.DataFrame] = {}
        for one in self:
            rows = pd.MultiIndex.from_product([one.track.times, self.marker_names], names=["time", "marker"])
            cells = np.concatenate([one.track.positions, one.track.confidence[..., None]], axis=2)
            tables[one.name] = pd.DataFrame(cells.reshape(-1, 3), rows, ["x", "y", "confidence"])
        return pd.concat(tables, names=["trial"])

    def split(self, held_out: Iterable[str]) -> tuple[TrialSet, TrialSet | None]:
        """The set without the named trials, and the set of them (None when no name is given).

        Raises:
            TrialError: A name is unknown, or nothing would be left to fit.
        """
        out = {self[name].name for name in held_out}
        if len(out) == len(self):
            raise TrialError(f"all {len(self)} trials are held out; leave at least one to fit")
        kept = TrialSet(tuple(t for t in self if t.name not in out), self.marker_names)
        return kept, TrialSet(tuple(t for t in self if t.name in out), self.marker_names) if out else None


def check_trial_name(name: str) -> None:
    """Checks that a trial can have a name: its tables, films and run folders are called after it.

    Raises:
        TrialError: It can't be the name of a file on every system.
    """
    if fault := file_name_fault(name):
        raise TrialError(f"trial name {quoted(name)} can't be the name of a file: it {fault}; give it another")


def check_motion(trial: Trial, table: Path) -> Trial:
    """The trial of a table.

    Raises:
        TrialError: Nothing moves in it, or its rows lie too near or too far apart in time.
    """
    positions, interval = trial.track.positions, trial.track.duration / (trial.track.frame_count - 1)
    if not _SHORTEST <= interval <= _LONGEST:  # what is simulated would have nothing to do with the table's size
        raise TrialError(
            f"{table}: {trial.track.frame_count} rows in {trial.track.duration:g} s, {interval:g} s from one to the "
            f"next; allowed are {_SHORTEST:g} to {_LONGEST:g} s on average: check the time stamps, and say their unit, "
            f"as in --time COLUMN:us or, of days, COLUMN:d"
        )
    shown = positions if trial.sensors is None or trial.track.marker_count else trial.sensors.values
    if not np.any(np.fmax.reduce(shown) > np.fmin.reduce(shown)):
        what = "marker moves" if shown is positions else "reading changes"
        raise TrialError(f"{table}: no {what}; is this the right file?")
    return trial
