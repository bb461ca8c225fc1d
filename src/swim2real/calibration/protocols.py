"""Protocols, by which real and simulated trials are compared: the one place that distinguishes kinds of trials.

A protocol says how a real trial is prepared (what is asked of the simulator, from which start, for how long; which
marker-frames count; the real side of the comparison, worked out once) and how a simulated trial is matched with it.
Steady swims are compared by `motion`, `aligned` or `paper`, recordings by `playback`.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from markertrack.quality import (
    LostMarkers,
    TrackQuality,
    check_lost,
    check_plausible,
    doubled_rate,
)
from swim2real.calibration.from_rest import FromRest, from_rest
from swim2real.checks.resting import better_starts
from swim2real.objective import ComparedTrial, Target, compare_playback, compare_steady, playback_target, steady_target
from swim2real.objective.comparison import rounded
from swim2real.parameters import Values
from swim2real.robots.robot import Robot
from swim2real.settings import ProtocolName, Start, chooses_start
from swim2real.simulation import ForwardModel, PlaybackSimulator, Simulator
from swim2real.trials import Actuation, Trial, TrialSet
from swim2real.trials.beat import Beat, identify_beat
from swim2real.trials.timebase import contradictions
from swimbase.errors import ArgumentError, TrialError

Model = TypeVar("Model", bound=ForwardModel[Any])

_ROUNDING = 1e-3  # s, of a table's time stamps
_GAP = 0.35  # share by which frequencies of trials may differ
_CLEARLY = 5.0  # standard errors of a speed


@dataclass(frozen=True)
class PreparedTrial:
    """A real trial, ready to be compared with simulated ones.

    Attributes:
        trial: The real trial.
        target: Its side of the comparison.
        request: What is asked of the simulator.
        examination: What was found in the trial, ready for JSON: quality (`usable`, `findings`, …) and what drove it.
    """

    trial: Trial
    target: Target
    request: Any
    examination: Mapping[str, Any]


class Protocol(ABC, Generic[Model]):
    """A way to compare trials.

    Attributes:
        start: Where steady swims begin; `speed` where there is nothing to choose.
    """

    name: ClassVar[ProtocolName]
    start: Start = "speed"

    @abstractmethod
    def simulator(self, robot: Robot, threads: int | None = None) -> Model:
        """Makes the simulator of the robot's trials, that many at a time; None for all cores."""

    @abstractmethod
    def prepare(
        self, reference: TrialSet, robot: Robot, simulator: Model, horizon: float | None
    ) -> tuple[PreparedTrial, ...]:
        """Checks real trials and works out all that doesn't depend on a candidate.

        Args:
            reference: The real trials.
            robot: The robot that is calibrated.
            simulator: A simulator of this protocol.
            horizon: Seconds of each trial that are compared, None for all.

        Raises:
            TrialError: The trials aren't the robot's, or a trial lacks what the protocol needs.
        """

    @abstractmethod
    def compare(self, target: Target, simulated: Trial) -> ComparedTrial:
        """Matches a simulated trial with its real one."""

    def known_head_first(self, robot: Robot) -> dict[str, float]:
        """Frequencies of swims from rest that no trial shows, but that are known to go head first, by name [Hz]."""
        del robot
        return {}

    def check_fit(self, simulator: Model, values: Values, prepared: Sequence[PreparedTrial]) -> dict[str, FromRest]:
        """Swims from rest that a fit is tried on when a run ends, by name; none for trials without a beat."""
        del simulator, values, prepared
        return {}


@dataclass(frozen=True)
class RealSwim:
    """A real swim with what was found in it.

    Attributes:
        trial: The real trial.
        quality: What was lost in its track.
        beat: What drove it.
    """

    trial: Trial
    quality: TrackQuality
    beat: Beat

    def summary(self, marker_names: tuple[str, ...]) -> dict[str, Any]:
        """Quality and beat, ready for JSON."""
        beat = self.beat
        driven = {
            "frequency": beat.frequency,
            "frequency_std": beat.frequency_std,
            "phase": beat.phase,
            "phase_std": beat.phase_std,
            "start_speed": beat.start_speed,
            "start_speed_std": beat.start_speed_std,
            "amplitude": beat.amplitude,
            "explained": beat.explained,
        }
        spreads = {"head_spread": self.quality.head_spread, "body_spread": self.quality.body_spread}
        doubts = [doubled_rate(self.beat.frequency, self.trial.nominal_frequency)]
        if self.beat.start_speed < -_CLEARLY * self.beat.start_speed_std:
            doubts.append(
                f"it goes tail first at {-1e3 * self.beat.start_speed:.0f} mm/s: its markers may have been clicked "
                f"from tail to head, or the film runs backward"
            )
        told = [doubt for doubt in doubts if doubt is not None]
        return _summary(self.trial, driven, self.quality, spreads, marker_names, told)


def examine_swims(reference: TrialSet, robot: Robot) -> tuple[RealSwim, ...]:
    """Checks the tracks of steady swims and identifies what drove each of them.

    Raises:
        TrialError: The markers aren't the robot's, or a trial shows no beat.
    """
    robot.check_trials(reference)
    swims: list[RealSwim] = []
    for filmed in reference:
        trial = filmed.seen_from_afar() if robot.swims.from_afar else filmed
        check_plausible(trial.track, robot.rest_markers, robot.marker_names, trial.name)
        quality = check_lost(trial.track, robot.layout, trial.midline)
        assert isinstance(quality, TrackQuality)  # swims have chains
        swims.append(
            RealSwim(trial, quality, identify_beat(trial.track, robot.swims.tail_markers, quality, trial.name))
        )
    return tuple(swims)


class _Steady(Protocol[Simulator]):
    """Parts that both protocols of steady swims share."""

    fit_phase: ClassVar[bool]
    whole_motion: ClassVar[bool] = False

    def simulator(self, robot: Robot, threads: int | None = None) -> Simulator:
        return Simulator(robot, threads)

    def prepare(
        self, reference: TrialSet, robot: Robot, simulator: Simulator, horizon: float | None
    ) -> tuple[PreparedTrial, ...]:
        return tuple(self._prepared(swim, robot, simulator, horizon) for swim in examine_swims(reference, robot))

    def compare(self, target: Target, simulated: Trial) -> ComparedTrial:
        return compare_steady(target, simulated, fit_phase=self.fit_phase)

    def check_fit(self, simulator: Simulator, values: Values, prepared: Sequence[PreparedTrial]) -> dict[str, FromRest]:
        """Simulates how each trial's beat swims from rest, and beats between those of two trials that lie far apart."""
        frequencies = {one.trial.name: one.request.actuation.frequency for one in prepared}
        return from_rest(simulator, values, frequencies | _between(frequencies))

    @abstractmethod
    def actuation(self, swim: RealSwim) -> Actuation:
        """Drive of the simulated motor, and the speed from which it starts."""

    def _prepared(self, swim: RealSwim, robot: Robot, simulator: Simulator, horizon: float | None) -> PreparedTrial:
        trial, actuation = swim.trial, self.actuation(swim)
        lead = actuation.period if self.fit_phase else 0.0  # a phase is looked for within one period
        target = steady_target(
            trial, swim.quality.weights, actuation.frequency, swim.beat.frequency, horizon, self.whole_motion
        )
        request = simulator.request(trial, actuation, lead)
        if target.head is not None:
            request = replace(request, turn_rate=target.head.turn_rate)
        return PreparedTrial(trial, target, request, swim.summary(robot.marker_names))


@dataclass(frozen=True)
class Aligned(_Steady):
    """The frequency at which the tail beats, a steady cycle, phase and registration fitted, lost markers left out.

    Attributes:
        start: Where the simulation starts to look for its steady cycle: at the real `speed`, or at `rest`.
    """

    name: ClassVar[ProtocolName] = "aligned"
    fit_phase: ClassVar[bool] = True

    start: Start = "speed"

    def actuation(self, swim: RealSwim) -> Actuation:
        actuation = swim.beat.actuation
        return replace(actuation, start_speed=0.0) if self.start == "rest" else actuation


@dataclass(frozen=True)
class Motion(Aligned):
    """As `Aligned`, but in the frame of the path, so that the recoil of the head counts.

    From rest by default, or from the real speed where a robot names frequencies at which it swims head first from rest:
    those are then simulated as well, and trials that begin at speed settle sooner and don't turn around.
    """

    name: ClassVar[ProtocolName] = "motion"
    whole_motion: ClassVar[bool] = True

    start: Start = "rest"

    def known_head_first(self, robot: Robot) -> dict[str, float]:
        return {f"unfilmed_{f:g}": f for f in robot.swims.head_first}


class _Paper(_Steady):
    """As the paper's text has it: the nominal frequency, from rest, nothing fitted, every marker counts."""

    name: ClassVar[ProtocolName] = "paper"
    fit_phase: ClassVar[bool] = False

    def actuation(self, swim: RealSwim) -> Actuation:
        if swim.trial.nominal_frequency is None:
            raise TrialError(
                f"trial '{swim.trial.name}' has no nominal frequency, which protocol 'paper' needs; "
                f"write it into reference.json or use protocol 'aligned'"
            )
        return Actuation(swim.trial.nominal_frequency)


@dataclass(frozen=True)
class Playback(Protocol[PlaybackSimulator]):
    """Recordings, simulated from their own start under their own controls and compared at the same times.

    Attributes:
        pieces: Length of the pieces into which they are cut, each with a fitted start of its own [s]; None for whole
            recordings.
    """

    name: ClassVar[ProtocolName] = "playback"

    pieces: float | None = None

    def simulator(self, robot: Robot, threads: int | None = None) -> PlaybackSimulator:
        return PlaybackSimulator(robot, threads)

    def prepare(
        self, reference: TrialSet, robot: Robot, simulator: PlaybackSimulator, horizon: float | None
    ) -> tuple[PreparedTrial, ...]:
        robot.check_trials(reference)
        named = robot.trials.start_named or self.pieces is not None
        starts = {} if named else {name: one.start for name, one in better_starts(robot, reference).items()}
        return tuple(self._prepared(trial, robot, simulator, horizon, starts.get(trial.name)) for trial in reference)

    def compare(self, target: Target, simulated: Trial) -> ComparedTrial:
        return compare_playback(target, simulated)

    def _prepared(
        self, trial: Trial, robot: Robot, simulator: PlaybackSimulator, horizon: float | None, start: str | None
    ) -> PreparedTrial:
        check_plausible(trial.track, robot.rest_markers, robot.marker_names, trial.name)
        lost = check_lost(trial.track, robot.layout, trial.midline)
        trials, cut = robot.trials, trial.cut(horizon)
        weights = lost.weights[: cut.track.frame_count]
        request = simulator.request(cut, weights, self.pieces, start)
        target = playback_target(request.trial, weights, trials.frame, trials.score_progress, trials.scales)
        recorded = {
            "controls": [] if trial.controls is None else list(trial.controls.names),
            "sensors": [] if trial.sensors is None else list(trial.sensors.names),
        }
        driven = any(drive.table for drive in trials.controls.values())
        summary = _summary(trial, recorded, lost, {}, robot.marker_names, [])
        if driven:
            summary["findings"] += [*contradictions(trial), *_uncommanded(trial)]
        return PreparedTrial(trial, target, request, summary)


def _between(frequencies: Mapping[str, float]) -> dict[str, float]:
    """Frequencies between those of trials, where a fit to them may still swim tail first: at most 35 % apart [Hz]."""
    found: dict[str, float] = {}
    ascending = sorted(frequencies.items(), key=lambda one: one[1])
    for (first, low), (last, high) in itertools.pairwise(ascending):
        steps = math.ceil(math.log(high / low) / math.log(1 + _GAP))
        for k in range(1, steps):
            found[f"{k} of {steps} between {first} and {last}"] = low * (high / low) ** (k / steps)
    return found


def protocol_for(
    robot: Robot, name: ProtocolName, start: Start | None = None, pieces: float | None = None
) -> Protocol[Any]:
    """The protocol of a name, for the trials of a robot; all but `paper` mean `playback` where trials are recordings.

    Args:
        robot: The robot that is calibrated.
        name: Name of the protocol.
        start: Start of steady swims under the protocols `motion` and `aligned`; None for the protocol's own.
        pieces: Length of the pieces into which recordings are cut [s]; None for whole recordings.

    Raises:
        ArgumentError: The robot's trials can't be compared like that.
    """
    allowed = robot.trials.protocols
    if name not in allowed:
        if not chooses_start(name):
            raise ArgumentError(
                f"protocol is '{name}'; the trials of robot '{robot.name}' are {robot.trials.description}, which are "
                f"compared by protocol {' or '.join(allowed)}"
            )
        name = allowed[0]
    if pieces is not None and name != "playback":
        raise ArgumentError(
            f"pieces is {pieces:g} s, which is for recordings; the trials of robot '{robot.name}' are "
            f"{robot.trials.description}"
        )
    if chooses_start(name):
        if name == "aligned":
            return Aligned(start or "speed")
        return Motion(start or ("speed" if robot.swims.head_first else "rest"))
    if start == "rest":
        raise ArgumentError(
            f"start is '{start}', which is for steady swims under protocol motion or aligned, not {name}"
        )
    return _Paper() if name == "paper" else Playback(pieces)


def _summary(
    trial: Trial,
    driven: Mapping[str, Any],
    lost: LostMarkers,
    more: Mapping[str, Any],
    names: tuple[str, ...],
    doubts: list[str],
) -> dict[str, Any]:
    """Findings in a real trial, ready for JSON."""
    return rounded(
        {
            "nominal_frequency": trial.nominal_frequency,
            "meters_per_pixel": trial.meters_per_pixel,
            "duration": trial.track.duration,
            "frames": trial.track.frame_count,
            **driven,
            "lost_share": lost.lost_share,
            "left_out_share": lost.left_out_share,
            **more,
            "usable": lost.usable and not doubts,
            "findings": [*lost.findings(names), *doubts],
            "doubts": doubts,
        }
    )


def _uncommanded(trial: Trial) -> list[str]:
    """A sentence for each end of a trial that its controls don't reach, where they hold longer than between rows."""
    if trial.controls is None:
        return []
    rows, stamps, sentences = trial.controls.times, trial.track.times, list[str]()
    if rows[0] > stamps[1]:
        sentences.append(
            f"its controls begin at {rows[0]:g} s, its frames at {stamps[0]:g} s; the first value is held until then"
        )
    if len(rows) > 1 and stamps[-1] - rows[-1] > np.diff(rows).max() + _ROUNDING:
        sentences.append(
            f"its controls end at {rows[-1]:g} s, its frames at {stamps[-1]:g} s; the last value is held from there on"
        )
    return sentences
