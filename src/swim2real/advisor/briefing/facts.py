"""Facts about an evaluation's trials, real and simulated, and their differences, as a person would ask for them.

What a trial doesn't have is None or empty: a beat with its frequency and phases, a way that it has come, windows of
time, sensors. There are no kinds of trials here. None stands for what isn't known as well: a marker that was lost, a
simulation that diverged, a ratio to something that hardly moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal, TypeVar

import numpy as np

from swim2real.objective.figures import Figures, FitFigures, TrialFigures
from swim2real.optimizers import Evaluation, Situation
from swim2real.parameters import ParameterSpace
from swim2real.robots.drives import Drive
from swim2real.robots.robot import Robot, Sensor

MOVING = 0.05  # of the widest real amplitude of a trial: below it a marker's amplitude is noise and has no ratio
STILL = 1e-3  # m, below which a beat's amplitude is noise and has neither ratio nor phase
LEAST_SEEN = 0.3  # of the frames: a marker that is seen in fewer of them says nothing
_LEAST_YAW, _LEAST_SWAY = 0.01, 1e-3  # rad and m, below which a swing of the head has no ratio
_SLOW = 1e-3  # m/s, below which a speed has no ratio
_LEAST_SPAN = 0.05  # of the logarithm of frequency, for an exponent
_NEED_NO_SIMULATION = ("frequency", "left_out_share", "protocol", "horizon")
_ERRORS = {"paper": "marker_errors", "motion": "motion_marker_errors"}  # of markers, by protocol

Side = Literal["real", "simulated"]
Known = float | None
Ratio = Literal["speed_ratio", "amplitude_ratio", "yaw_ratio", "sway_ratio"]
T = TypeVar("T")
F = TypeVar("F", bound=Figures)


@dataclass(frozen=True)
class MarkerFacts:
    """A marker in one trial, or over all of them.

    Attributes:
        name: Name of the marker.
        error: Mean part of the loss [m].
        real: Real amplitude [m].
        simulated: Simulated amplitude [m].
        ratio: Of the amplitudes, simulated to real.
        ahead: Phase of the simulated beat less that of the real one, where they are compared [deg].
        offset: Mean difference of places, simulated minus real, along both axes [m].
        shape_error: Mean error in shape alone [m].
        windows: Mean differences of places in windows of time, as `offset`.
    """

    name: str
    error: Known
    real: Known
    simulated: Known
    ratio: Known
    ahead: Known
    offset: Sequence[float] | None
    shape_error: Known = None
    windows: Sequence[Sequence[float] | None] = ()


@dataclass(frozen=True)
class _SensorFacts:
    """A sensor in one trial, or over all of them: its mean error, and its mean differences in windows of time."""

    sensor: Sensor
    error: Known
    windows: Sequence[Known] = ()


@dataclass(frozen=True)
class TrialFacts:
    """One trial, and what differs in it.

    Attributes:
        name: Name of the trial.
        figures: Its figures; of a simulation that diverged only what needs none.
        divergence: Why the simulation failed, or None.
        velocity_real: Real forward speed [m/s].
        markers: All markers, in the robot's order.
        sensors: All sensors.
        edges: Edges of the windows of time [s]; empty without windows.
    """

    name: str
    figures: TrialFigures
    divergence: str | None
    velocity_real: Known
    markers: tuple[MarkerFacts, ...]
    sensors: tuple[_SensorFacts, ...]
    edges: Sequence[float]

    @property
    def error(self) -> Known:
        """The trial's part of the loss [m]."""
        return self.figures.loss

    @property
    def frequency(self) -> Known:
        """Frequency of the beat [Hz]; None without one."""
        return self.figures.frequency

    @property
    def speed_ratio(self) -> Known:
        """Simulated to real, negative where they go different ways."""
        real, simulated = self.velocity_real, self.figures.velocity_simulated
        return None if real is None or simulated is None or abs(real) < _SLOW else simulated / real

    @property
    def amplitude_ratio(self) -> Known:
        """The last marker's in a trial with a beat, the median over the markers in another one."""
        ratios = [marker.ratio for marker in self.markers]
        return median(ratios) if self.frequency is None else ratios[-1] if ratios else None

    @property
    def yaw_ratio(self) -> Known:
        return _ratio(self.figures.yaw_real, self.figures.yaw_simulated, _LEAST_YAW)

    @property
    def sway_ratio(self) -> Known:
        return _ratio(self.figures.sway_real, self.figures.sway_simulated, _LEAST_SWAY)

    @cached_property
    def off(self) -> list[Known]:
        """Error of the markers in each window of time, on average over them [m]."""
        places = [[marker.windows[w] for marker in self.markers] for w in range(len(self.edges) - 1)]
        return [mean(None if place is None else math.hypot(*place) for place in window) for window in places]

    @property
    def worst_window(self) -> tuple[float, float] | None:
        """When the markers are farthest off [s]."""
        return highest(pairwise(self.edges), self.off)

    @property
    def halves(self) -> tuple[Known, Known]:
        """Errors of the markers in the first and in the second half, on average [m]."""
        half = len(self.off) // 2
        return mean(self.off[:half]), mean(self.off[half:])


@dataclass(frozen=True)
class EvaluationFacts:
    """All trials of an evaluation, and what differs over them. Medians and means are over trials.

    Attributes:
        figures: Figures over all trials; of a simulation that diverged only what needs none.
        trials: Trials, by rising frequency, or in the order of the reference where they have none.
    """

    figures: FitFigures
    trials: tuple[TrialFacts, ...]

    @classmethod
    def of(cls, evaluation: Evaluation, robot: Robot) -> EvaluationFacts:
        """Collects the facts of an evaluation of a robot's simulator."""
        figures = FitFigures.model_validate(evaluation.detail or {})
        trials = [_trial(name, found, figures.protocol, robot) for name, found in figures.trials.items()]
        known = _without_simulation(figures) if evaluation.failed else figures
        return cls(known, tuple(sorted(trials, key=lambda trial: trial.frequency or 0.0)))

    def ratio(self, name: Ratio) -> Known:
        """The median of a ratio."""
        return median(getattr(trial, name) for trial in self.trials)

    def exponent(self, side: Side) -> Known:
        """Exponent of frequency with which speed grows, over the trials where both robots go forward."""
        speeds = [(trial.frequency, trial.velocity_real, trial.figures.velocity_simulated) for trial in self.trials]
        forward = [(f, v, u) for f, v, u in speeds if f is not None and (v or 0.0) >= _SLOW and (u or 0.0) >= _SLOW]
        logs = np.log(np.array(forward, dtype=float).reshape(-1, 3))
        if len(logs) < 2 or np.ptp(logs[:, 0]) < _LEAST_SPAN:
            return None
        return float(np.polyfit(logs[:, 0], logs[:, 2 if side == "simulated" else 1], 1)[0])

    @cached_property
    def markers(self) -> list[MarkerFacts]:
        """Each marker over all trials: medians, since it may be hardly seen in one of them."""
        return [_over_trials(markers) for markers in zip(*(trial.markers for trial in self.trials), strict=True)]

    @property
    def sensors(self) -> list[_SensorFacts]:
        """Each sensor over all trials."""
        readings = zip(*(trial.sensors for trial in self.trials), strict=True)
        return [_SensorFacts(one[0].sensor, mean(reading.error for reading in one)) for one in readings]

    @property
    def worst_trial(self) -> TrialFacts | None:
        return highest(self.trials, [trial.error for trial in self.trials])

    @property
    def worst_marker(self) -> MarkerFacts | None:
        return highest(self.markers, [marker.error for marker in self.markers])

    @property
    def halves(self) -> tuple[Known, Known]:
        """Errors of the markers in the first and in the second half of a trial, on average [m]."""
        first, second = zip(*(trial.halves for trial in self.trials), strict=True)
        return mean(first), mean(second)

    @property
    def other_way(self) -> list[TrialFacts]:
        """Trials in which the simulated robot goes the other way."""
        return [trial for trial in self.trials if (trial.speed_ratio or 0.0) < 0]

    @property
    def has_head(self) -> bool:
        """True if the motion of the head is compared."""
        return any("yaw_real" in trial.figures.model_fields_set for trial in self.trials)

    def mean_of(self, figure: str) -> Known:
        """Mean of a figure over trials."""
        return mean(getattr(trial.figures, figure) for trial in self.trials)


@dataclass(frozen=True)
class Axes:
    """The axes of the frame of comparison in words.

    Attributes:
        directions: Of a difference of places.
        ways: Of each axis, which way a positive and which way a negative difference leads.
        picture: How a picture lies.
    """

    directions: str
    ways: tuple[tuple[str, str], tuple[str, str]]
    picture: str


@dataclass(frozen=True)
class RoundFacts:
    """Facts that a VLM may get at a round.

    Attributes:
        situation: Situation as an advisor gets it.
        robot: The robot whose simulator is calibrated.
        space: Its parameters, as the optimizer uses them.
        from_rest: Forward speeds of the incumbent from rest, by trial, where that is known [m/s]: once it has settled,
            and over the first two beats.
        budget: Evaluations that the run has; None where that isn't known.
    """

    situation: Situation
    robot: Robot
    space: ParameterSpace
    from_rest: Mapping[str, tuple[Known, Known]]
    budget: int | None = None

    @cached_property
    def here(self) -> EvaluationFacts:
        """The best evaluation so far."""
        return self.of(self.situation.incumbent)

    @property
    def beats(self) -> bool:
        """True if the robot's trials have a steady beat."""
        return self.robot.trials.steady

    @property
    def found(self) -> int:
        """The round in which the best point was found; 0 for the first point."""
        rounds = enumerate(self.situation.rounds, start=1)
        return max((number for number, finished in rounds if finished.accepted), default=0)

    @property
    def axis(self) -> tuple[str, str] | None:
        """The markers between which the frame of comparison has its x axis; None for the world."""
        frame, names = self.robot.trials.frame, self.robot.marker_names
        return None if frame is None else (names[frame[0]], names[frame[1]])

    @property
    def axes(self) -> Axes:
        """The axes of the frame of comparison in words."""
        if self.axis is None:
            right, up = ("xyz"[axis] for axis in self.robot.plane)
            directions = f"first to the right (the world's {right}), then up (the world's {up})"
            return Axes(directions, (("to the right", "to the left"), ("up", "down")), f"{right} right, {up} up")
        origin, ahead = self.axis
        behind = " (being behind counts as well)" if self.robot.trials.score_progress else ""
        return Axes(
            f"first from {origin} toward {ahead}{behind}, then to the left of that line",
            ((f"from {origin} toward {ahead}", f"from {ahead} toward {origin}"), ("to the left", "to the right")),
            f"{origin} at the origin, {ahead} to its right",
        )

    @property
    def drives(self) -> dict[str, list[str]]:
        """Drives of a playback in words, and the actuators that each drives."""
        drives: dict[str, list[str]] = {}
        for actuator, drive in self.robot.trials.controls.items():
            drives.setdefault(_command(drive), []).append(actuator)
        return drives

    @property
    def from_rest_ways(self) -> tuple[list[TrialFacts], list[TrialFacts]]:
        """Trials in which the simulated robot goes forward and backward when it is started at rest."""
        speeds = [(trial, self.from_rest.get(trial.name, (None, None))[0]) for trial in self.here.trials]
        forward = [trial for trial, speed in speeds if speed is not None and speed > 0]
        return forward, [trial for trial, speed in speeds if speed is not None and speed <= 0]

    @cached_property
    def _known(self) -> dict[int, EvaluationFacts]:
        return {}

    def of(self, evaluation: Evaluation) -> EvaluationFacts:
        """Facts of one of the run's evaluations, collected once."""
        known = self._known.get(id(evaluation)) or EvaluationFacts.of(evaluation, self.robot)
        return self._known.setdefault(id(evaluation), known)

    @property
    def before_measurements(self) -> Evaluation:
        """The best evaluation before those that were measured for this round."""
        return self.situation.rounds[-1].result if self.situation.rounds else self.situation.first


def mean(values: Iterable[Known]) -> Known:
    """Mean of those that are known; None where none is."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def median(values: Iterable[Known]) -> Known:
    """Median of those that are known; None where none is."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def highest(things: Iterable[T], values: Iterable[Known]) -> T | None:
    """The first of the things whose value is highest; None where none is known."""
    known = [(thing, value) for thing, value in zip(things, values, strict=True) if value is not None]
    return max(known, key=lambda pair: pair[1])[0] if known else None


def _command(drive: Drive) -> str:
    if drive.table:
        return "as recorded"
    if drive.speed:
        return "a steady speed at the trial's own rate"
    if drive.amplitude:
        around = f" around {drive.offset:g}" if drive.offset else ""
        return f"a sine of {drive.amplitude:g}{around} at the trial's own rate"
    return f"always {drive.offset:g}"


def _trial(name: str, found: TrialFigures, protocol: str, robot: Robot) -> TrialFacts:
    """One trial. Of a simulation that diverged nothing is known."""
    diverged, windows = found.divergence is not None, found.windows
    return TrialFacts(
        name=name,
        figures=_without_simulation(found) if diverged else found,
        divergence=found.divergence,
        velocity_real=found.velocity_real,
        markers=_markers(found, protocol, robot.marker_names),
        sensors=tuple(
            _SensorFacts(
                sensor, None if diverged else found.sensor_errors.get(sensor.name),
                windows.sensors.get(sensor.name, ()) if windows else (),
            )
            for sensor in robot.trials.sensors
        ),
        edges=windows.edges if windows else (),
    )  # fmt: skip


def _markers(found: TrialFigures, protocol: str, names: Sequence[str]) -> tuple[MarkerFacts, ...]:
    """Each marker in one trial: its errors, how far it moves, and its phase or by how much it is off over time.

    Under the paper's protocol the simulation starts at motor angle 0, wherever the real motor stood, so that a
    difference of phases says nothing.
    """
    diverged, unknown = found.divergence is not None, [None] * len(names)
    seen = [(share or 0.0) >= LEAST_SEEN for share in found.seen_shares] or [True] * len(names)
    beats = found.beat_real, None if diverged else found.beat_simulated
    sizes = found.amplitude_real, [] if diverged else found.amplitude_simulated

    def of_seen(values: Sequence[T | None]) -> list[T | None]:
        return [value if there else None for value, there in zip(values or unknown, seen, strict=True)]

    real, simulated = (of_seen(beat.amplitude if beat else size) for beat, size in zip(beats, sizes, strict=True))
    angles = [beat.phase if beat else [] for beat in beats]
    phases = [of_seen([None if angle is None else math.degrees(angle) for angle in row]) for row in angles]
    said = [there and not diverged for there in seen]
    errors: Sequence[Known] = getattr(found, _ERRORS.get(protocol, "aligned_marker_errors")) or unknown
    windows = found.windows.markers if found.windows else []
    widest = max((size for size in real if size is not None), default=0.0)
    markers: list[MarkerFacts] = []
    for i, name in enumerate(names):
        least = STILL if found.beat_real else MOVING * widest
        ratio = _ratio(real[i], simulated[i], least, both=found.beat_real is not None)
        before, after = phases[0][i], phases[1][i]
        in_step = ratio is not None and protocol in ("motion", "aligned")
        markers.append(
            MarkerFacts(
                name, errors[i] if said[i] else None, real[i], simulated[i], ratio,
                (after - before + 180) % 360 - 180 if in_step and before is not None and after is not None else None,
                _complete(found.offset[i]) if found.offset and said[i] else None,
                (found.shape_marker_errors or unknown)[i] if said[i] else None,
                [_complete(places[i]) for places in windows],
            )
        )  # fmt: skip
    return tuple(markers)


def _over_trials(markers: Sequence[MarkerFacts]) -> MarkerFacts:
    both = [marker for marker in markers if None not in (marker.real, marker.simulated)] or markers
    offsets = [marker.offset for marker in markers if marker.offset is not None]
    return MarkerFacts(
        markers[0].name, mean(marker.error for marker in markers), median(marker.real for marker in both),
        median(marker.simulated for marker in both), median(marker.ratio for marker in markers),
        median(marker.ahead for marker in markers),
        [sum(parts) / len(offsets) for parts in zip(*offsets, strict=True)] if offsets else None,
    )  # fmt: skip


def _without_simulation(figures: F) -> F:
    """Figures of a simulation that diverged: only those that need no simulation are known."""
    names = [name for name in figures.model_fields_set if isinstance(getattr(figures, name), int | float | str)]
    return figures.model_copy(update=dict.fromkeys(name for name in names if name not in _NEED_NO_SIMULATION))


def _ratio(real: Known, simulated: Known, least: float, both: bool = False) -> Known:
    """Simulated to real; None where one isn't known, or where the real one, or either of both, is below the least."""
    if real is None or simulated is None or real <= 0 or (min(real, simulated) if both else real) < least:
        return None
    return simulated / real


def _complete(place: Sequence[Known]) -> Sequence[float] | None:
    known = [part for part in place if part is not None]
    return known if len(known) == len(place) else None
