"""Trials that a robot could be filmed in: the commands of its actuators, as `deploy` sends it and as it is simulated.

They ask for no more than the filmed ones did, or than the robot file allows a policy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from markertrack.track import MarkerTrack
from motorline.commands import FISH, RATE
from swim2real.calibration.problem import Problem
from swim2real.parameters import Values
from swim2real.robots.robot import CommandLimits, Robot
from swim2real.simulation import Rollout, Swim
from swim2real.trials import Signals, Trial
from swimbase.arrays import Array
from swimbase.errors import RunError

_FREQUENCIES, _SLOWER, _FASTER = 12, 0.7, 1.4  # of beats; times the lowest and the highest one that was filmed
_CYCLES = (2.0, 6.0, 18.0)  # of the sines in a trial
_HIGHEST = RATE / 8  # Hz, of a sine
_LEVELS = (1.0, -1.0, 0.0, 1.0, 0.5, -0.5)  # of the steps, in half ranges about the middle
_NAME = "next"
_ROUNDING = 1e-9


@dataclass(frozen=True)
class PossibleTrial:
    """A trial that could be filmed.

    Attributes:
        label: What it is, in a few words.
        trial: Its time stamps, controls and frequency; where its markers will be isn't known.
        request: What is asked of the simulator.
        columns: Commands at 50 Hz, by actuator [its unit]. Shapes (K,).
    """

    label: str
    trial: Trial
    request: Any
    columns: Mapping[str, Array]


def possible_trials(problem: Problem, values: Values) -> list[PossibleTrial]:
    """Trials that could be filmed next: new ones, then a repetition of each that was filmed.

    Beats between and beyond the frequencies that were filmed; of actuators that follow tables sines, a chirp, steps,
    and a start and stop, one actuator at a time, within what was recorded, while the others rest where the first
    recording begins. All are as long as the first trial, with its frame rate and its start.

    Args:
        problem: With the filmed trials.
        values: Parameters with which starts are found that only markers or sensors show.

    Raises:
        RunError: Nothing drives the robot, or its controls never changed.
    """
    robot = problem.robot
    repeats = [
        PossibleTrial(f"repeat {one.trial.name}", one.trial, one.request, _columns(robot, one.trial, _frequency(one)))
        for one in problem.prepared
    ]
    if any(drive.table for drive in robot.trials.controls.values()):
        new = list(_tables(problem, values))
    elif any(drive.speed or drive.amplitude for drive in robot.trials.controls.values()):
        new = list(_beats(problem, values))
    else:
        new = []
    if not new:
        raise RunError(
            f"nothing drives robot '{robot.name}' in its {len(repeats)} trials, or always in the same way, so there is "
            f"no other trial to command; film one that begins elsewhere"
        )
    return new + repeats


def column_names(robot: Robot, actuators: Mapping[str, Array]) -> dict[str, Array]:
    """Columns under the names that a table of commands for `deploy` gives them, with units."""
    if robot.motor_joint is not None:
        return {FISH: next(iter(actuators.values()))}
    return {f"{name}_{_unit(robot, name).replace('/', '_')}": values for name, values in actuators.items()}


def _frequency(prepared: Any) -> float:
    """Frequency of a filmed trial [Hz]; 0 where nothing has one."""
    if isinstance(prepared.request, Swim):
        return prepared.request.actuation.frequency
    return prepared.trial.nominal_frequency or 0.0


def _columns(robot: Robot, trial: Trial, frequency: float) -> dict[str, Array]:
    """Commands of a trial's actuators at 50 Hz."""
    since = np.arange(max(1, round(trial.track.duration * RATE))) / RATE
    return {
        name: drive.commands(since, frequency)
        if not drive.table or trial.controls is None
        else trial.controls.at(name, trial.track.times[0] + since, interpolated=drive.interpolated)
        for name, drive in robot.trials.controls.items()
    }


def _allowed(robot: Robot, columns: Mapping[str, Array], filmed: Sequence[Mapping[str, Array]]) -> bool:
    """True if no command is beyond both the robot file's limits of a policy and what was filmed."""
    limits: Mapping[str, CommandLimits] = {} if robot.policy is None else robot.policy.actuators
    for name, limit in limits.items():
        if name not in columns:
            continue
        known = np.concatenate([one[name] for one in filmed])
        rate = max(limit.rate, *(_steepest(one[name]) for one in filmed))
        inside = np.clip(columns[name], min(limit.lower, known.min()), max(limit.upper, known.max()))
        if np.abs(inside - columns[name]).max() > _ROUNDING or _steepest(columns[name]) > rate + _ROUNDING:
            return False
    return True


def _steepest(column: Array) -> float:
    return float(np.abs(np.diff(column)).max(initial=0.0)) * RATE


def _unit(robot: Robot, actuator: str) -> str:
    """Unit of an actuator's commands: the policy's, else what the model's kind of actuator takes."""
    if robot.policy is not None and actuator in robot.policy.actuators:
        return robot.policy.actuators[actuator].unit
    model = robot.model
    number = model.actuator(actuator).id
    on_joint = model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_JOINT
    turns = on_joint and model.jnt_type[model.actuator_trnid[number, 0]] == mujoco.mjtJoint.mjJNT_HINGE
    if model.actuator_biastype[number] != mujoco.mjtBias.mjBIAS_AFFINE:
        return "Nm" if turns else "N"
    of_position = model.actuator_biasprm[number, 1] != 0
    return ("rad" if turns else "m") + ("" if of_position else "/s")


def _beats(problem: Problem, values: Values) -> Iterator[PossibleTrial]:
    """Beats at other frequencies."""
    first = problem.prepared[0]
    trial, filmed = first.trial, sorted(_frequency(one) for one in problem.prepared)
    told = [_columns(problem.robot, trial, frequency) for frequency in filmed]
    faster = np.geomspace(filmed[-1], _FASTER * filmed[-1], _FREQUENCIES)
    highest = max(f for f in faster if _allowed(problem.robot, _columns(problem.robot, trial, f), told))
    track = _nowhere(trial)
    for frequency in np.geomspace(_SLOWER * filmed[0], highest, _FREQUENCIES):
        asked = Trial(_NAME, track, float(frequency))
        if isinstance(first.request, Swim):
            request: Any = replace(first.request, actuation=replace(first.request.actuation, frequency=frequency))
        else:
            asked, request = _playback(problem, asked, values)
        columns = _columns(problem.robot, asked, float(frequency))
        yield PossibleTrial(f"{frequency:.2f} Hz", asked, request, columns)


def _tables(problem: Problem, values: Values) -> Iterator[PossibleTrial]:
    """Motions of one actuator at a time that follows a table."""
    robot, first = problem.robot, problem.trials[0].cut(problem.horizon)
    filmed = [
        _columns(robot, trial, _frequency(one)) for trial, one in zip(problem.trials, problem.prepared, strict=True)
    ]
    driven = [name for name, drive in robot.trials.controls.items() if drive.table]
    track, rows = _nowhere(first), max(2, round(first.track.duration * RATE))
    rest = {name: np.full(rows, filmed[0][name][0]) for name in driven}
    for name in driven:
        known = np.concatenate([one[name] for one in filmed])
        fastest = max(_steepest(one[name]) for one in filmed)
        if np.ptp(known) <= _ROUNDING:
            continue
        for label, column in _motions(float(known.min()), float(known.max()), float(rest[name][0]), rows):
            told = rest | {name: _slowed(column, float(rest[name][0]), fastest)}
            controls = Signals(np.arange(rows) / RATE, driven, np.column_stack([told[one] for one in driven]))
            asked = Trial(_NAME, track, first.nominal_frequency, controls=controls)
            asked, request = _playback(problem, asked, values)
            columns = _columns(robot, asked, first.nominal_frequency or 0.0)
            yield PossibleTrial(f"{name}: {label}", asked, request, columns)


def _motions(lowest: float, highest: float, rest: float, rows: int) -> Iterator[tuple[str, Array]]:
    """Motions between two values, in words and at 50 Hz. Shapes (rows,)."""
    times, seconds = np.arange(rows) / RATE, rows / RATE
    middle, half = (lowest + highest) / 2, (highest - lowest) / 2
    frequencies = sorted({min(cycles / seconds, _HIGHEST) for cycles in _CYCLES})
    for frequency in frequencies:
        for share in (1.0, 0.5):
            sine = middle + share * half * np.sin(2 * np.pi * frequency * times)
            yield f"sine of {frequency:.2g} Hz, {middle:.2g} ± {share * half:.2g}", sine
    slow, fast = frequencies[0] / 2, frequencies[-1]
    turns = slow * times + (fast - slow) * times**2 / (2 * seconds)
    yield f"chirp of {slow:.2g} to {fast:.2g} Hz, {middle:.2g} ± {half:.2g}", middle + half * np.sin(2 * np.pi * turns)
    levels = np.array(_LEVELS)[np.arange(rows) * len(_LEVELS) // rows]
    yield f"steps, {middle:.2g} ± {half:.2g}", middle + half * levels
    end = max((lowest, highest), key=lambda value: abs(value - rest))
    yield f"to {end:.2g}, then back to rest", np.where(times < seconds / 2, end, rest)


def _slowed(column: Array, rest: float, fastest: float) -> Array:
    """A column from rest on that changes no faster than allowed [unit/s]."""
    slowed, now = np.empty_like(column), rest
    for k, wanted in enumerate(column):
        now = slowed[k] = now + np.clip(wanted - now, -fastest / RATE, fastest / RATE)
    return slowed


def _playback(problem: Problem, asked: Trial, values: Values) -> tuple[Trial, Rollout]:
    """A recording as it will be compared, and as it is simulated: from where the first filmed one starts.

    Joints that neither slide nor turn about an axis start as in the model.
    """
    request: Rollout = problem.prepared[0].request
    request = request.pieces[0] if request.pieces else request
    if request.first is None and request.stretch is None:
        own = replace(asked, start=request.trial.start, start_velocities=request.trial.start_velocities)
        return own, Rollout(own)
    model = problem.robot.build(values).compile()
    data, _ = problem.simulator.begin(model, request, values)
    scalar = [mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE]
    joints = [model.joint(i) for i in range(model.njnt) if model.jnt_type[i] in scalar and model.joint(i).name]
    start = {joint.name: float(data.qpos[joint.qposadr[0]]) for joint in joints}
    velocities = {joint.name: float(data.qvel[joint.dofadr[0]]) for joint in joints}
    return asked, Rollout(replace(asked, start=start, start_velocities=velocities))


def _nowhere(trial: Trial) -> MarkerTrack:
    """Time stamps of a trial from 0 on, without markers' places."""
    times = trial.track.times - trial.track.times[0]
    return MarkerTrack(times, np.full(trial.track.positions.shape, np.nan))
