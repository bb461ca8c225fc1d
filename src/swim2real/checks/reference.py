"""Where real trials don't fit a robot: its markers, what drives it, its sensors, the place in which they begin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend

from swim2real.checks.probing import growing
from swim2real.checks.resting import in_motion
from swim2real.errors import Swim2RealError, TrialError
from swim2real.robots.robot import Robot, Trials
from swim2real.settings import EvaluationSettings
from swim2real.simulation.playback import PlaybackSimulator
from swim2real.simulation.start import FITTED, MARKERS, STRETCH, FirstFrames
from swim2real.trials import Trial, TrialSet
from swim2real.trials.frames import to_body

_WINDOWS = 10  # of first frames that show how fast a recording moves
_MOTION = 0.9  # of the motion's power, above noise
_LEAST = 10  # frames that tell a frequency
_SWINGS = 5.0  # in which a parameter that is off by a tenth puts a swing out of phase
_PIECE = 3.0  # swings of a piece
_SHORTEST = 0.3  # s, of a piece
_FAR = 1 / 3  # of the robot's size
_FAR_OFF = 12.0  # times, by which no parameter is off
_FAR_BEYOND = 3.0  # times an actuator's range
_NEAR_UNIT = 2.5  # times, within which a factor is taken for a unit's
_UNITS = {"degrees in place of radians": 180 / np.pi, "radians in place of degrees": np.pi / 180,
          "thousandths (mm, mN, mA)": 1e3, "thousands": 1e-3}  # fmt: skip


def reference_warnings(robot: Robot, reference: TrialSet, settings: EvaluationSettings) -> list[str]:
    """What may be wrong with the starts and lengths of trials, a sentence each.

    Raises:
        TrialError: A trial can't be played back.
        EngineError: The robot itself can't be simulated.
    """
    lines = in_motion(robot, reference)
    if settings.pieces is None:
        lines += [*warn_fast_starts(robot, reference), *long_swings(robot, reference, settings.horizon)]
        lines += growing(robot, reference, settings.horizon)
    return lines


def misfits(robot: Robot, reference: TrialSet) -> list[str]:
    """A sentence for each thing that keeps trials from being compared with a robot; none where they can be.

    Raises:
        EngineError: The robot itself can't be simulated.
    """
    if reference.marker_names != robot.marker_names:
        return [
            f"the reference has the markers {', '.join(reference.marker_names)}; robot '{robot.name}' has "
            f"{', '.join(robot.marker_names)}; name them alike, in the same order"
        ]
    if robot.trials.swims is not None:
        return []
    simulator = PlaybackSimulator(robot)
    return [sentence for trial in reference for sentence in _of(simulator, robot.trials, trial)]


@dataclass(frozen=True)
class StartOff:
    """How far the simulation of a recording, with the parameters as published, is from it where it starts.

    Attributes:
        name: Name of the trial.
        first: Simulated minus real markers at the first frame, NaN where one isn't seen [m]. Shape (M, 2).
        stretch: Mean distance in the first quarter of a second [m].
    """

    name: str
    first: NDArray[np.float64]
    stretch: float


def starts(robot: Robot, reference: TrialSet) -> list[StartOff]:
    """How recordings start, in the frame of comparison where that isn't fitted; nothing of swims.

    Raises:
        TrialError: A trial can't be played back.
        EngineError: The robot itself can't be simulated.
    """
    about = robot.trials
    if about.swims is not None or not robot.marker_names:
        return []
    frame = None if about.start in (MARKERS, FITTED) else about.frame
    simulator, made = PlaybackSimulator(robot), list[StartOff]()
    for trial in reference:
        request, begun = simulator.request(trial), trial.cut(STRETCH)
        played = simulator.simulate(robot.space.published, [replace(request, trial=begun)])[trial.name]
        places = (played.track.positions, begun.track.positions)
        made_so, seen = places if frame is None else (to_body(one, frame) for one in places)
        off = made_so - seen
        ways = np.linalg.norm(off, axis=2)
        mean = float(ways[np.isfinite(ways)].mean()) if np.isfinite(ways).any() else np.nan
        made.append(StartOff(trial.name, off[0], mean))
    return made


def warn_fast_starts(robot: Robot, reference: TrialSet) -> list[str]:
    """A warning for each recording that moves too fast for a start by straight lines through its first frames."""
    if robot.trials.swims is not None or robot.trials.start != MARKERS:
        return []
    lines: list[str] = []
    for trial in reference:
        if not trial.start and not trial.start_velocities:
            warnings = too_fast(trial, np.ones(trial.track.confidence.shape))
            lines += [f"trial '{trial.name}': {warning}" for warning in warnings]
    return lines


def long_swings(robot: Robot, reference: TrialSet, horizon: float | None) -> list[str]:
    """A warning for each recording that nothing drives and that swings too often to be simulated in one.

    Args:
        robot: The robot.
        reference: Real trials.
        horizon: Seconds of each trial that are compared; None for all.
    """
    if robot.trials.swims is not None or robot.trials.controls:
        return []
    lines: list[str] = []
    for trial in reference:
        compared = trial.cut(horizon)
        fastest = fastest_frequency(compared, np.ones(compared.track.confidence.shape), compared.track.duration)
        if fastest is not None and fastest * compared.track.duration > _SWINGS:
            lines.append(
                f"trial '{trial.name}' swings freely {fastest * compared.track.duration:.0f} times; a frequency that "
                f"is a little off is out of phase by then, and hardly a method finds the way down: add --pieces "
                f"{max(_PIECE / fastest, _SHORTEST):.1g}"
            )
    return lines


def _of(simulator: PlaybackSimulator, about: Trials, trial: Trial) -> list[str]:
    sentences: list[str] = []
    try:
        simulator.request(trial)
    except Swim2RealError as error:
        sentences.append(str(error))
    track = trial.track
    columns = () if trial.sensors is None else trial.sensors.names
    missing = [sensor.name for sensor in about.sensors if sensor.name not in columns]
    if missing:
        there = ", ".join(columns) or "none"
        sentences.append(
            f"trial '{trial.name}' has no readings of {', '.join(missing)}; it has {there}; add columns of these "
            f"names to its table of sensors, or take the sensors out of the robot file"
        )
    elif trial.sensors is not None and about.sensors:
        try:
            trial.sensors.between(track.times[0], track.times[-1])
        except TrialError as error:
            sentences.append(f"trial '{trial.name}': its sensors can't be compared: {error}")
    return sentences


def too_fast(trial: Trial, weights: NDArray[np.float64]) -> list[str]:
    """A warning where first frames take longer than a quarter of the period of the fastest motion; else nothing.

    Args:
        trial: Recording whose start is shown by its markers.
        weights: Weights, 0 where a marker isn't believed. Shape (T, M).
    """
    window = float(FirstFrames(trial, weights).times[-1])
    fastest = fastest_frequency(trial, weights, _WINDOWS * window)
    if fastest is None or window <= 1 / (4 * fastest):
        return []
    return [
        f"its start is a straight line through its first {window:.2g} s, more than a quarter of the period of its "
        f'motion ({fastest:.2g} Hz), so it may be wrong; say start = "fitted" in the robot file'
    ]


def fastest_frequency(trial: Trial, weights: NDArray[np.float64], seconds: float) -> float | None:
    """Frequency below which nine tenths of the markers' motion are [Hz]; None where it is too short or mostly noise.

    Args:
        trial: A recording.
        weights: Weights, 0 where a marker isn't believed. Shape (T, M).
        seconds: How much of it is looked at, from its first frame on [s].
    """
    track = trial.track
    count = int(np.searchsorted(track.times - track.times[0], seconds, side="right"))
    if count < _LEAST:
        return None
    times = track.times[:count]
    even = np.linspace(times[0], times[-1], count)
    power = np.zeros(count // 2 + 1)
    for marker in range(track.marker_count):
        counted = weights[:count, marker] > 0
        for axis in range(2):
            known = counted & np.isfinite(track.positions[:count, marker, axis])
            if 2 * known.sum() > count:
                way = np.interp(even, times[known], track.positions[:count, marker, axis][known])
                power += np.square(np.abs(np.fft.rfft(detrend(way) * np.hanning(count))))
    above = np.maximum(power - 2 * np.median(power), 0.0)
    if not above.sum() > power.sum() / 2:
        return None
    frequencies = np.fft.rfftfreq(count, float(even[1] - even[0]))
    return float(frequencies[np.searchsorted(np.cumsum(above), _MOTION * above.sum())])
