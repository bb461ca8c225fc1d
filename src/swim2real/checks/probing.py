"""Effects of each parameter of a robot: by how much its bounds move the markers of a short simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from scipy.linalg import qr

from markertrack.track import MarkerTrack
from swim2real.checks.effects import ModelEffect, model_effects
from swim2real.checks.motion import Motion
from swim2real.parameters import Parameter, Values
from swim2real.robots.robot import Robot
from swim2real.simulation.simulator import Simulator, Swim
from swim2real.simulation.start import FITTED, MARKERS, REST
from swim2real.trials import Actuation, Signals, Trial, TrialSet
from swimbase.arrays import Array
from swimbase.errors import EngineError

NOISE = 1e-9  # m, by which markers may move where a parameter has no effect
FAINT = 1e-5  # m, less than which no camera sees
_STRENGTHS = (1.0, 0.1, 0.01, 0.001)
_ROOM = 3.0  # of the robot's size that a marker may move; more is a robot that is thrown about
TRIALS = 4  # real ones that are tried, the first

SECONDS = 2.0
FREQUENCY = 1.0  # Hz, of all that swings
_RATE = 100.0  # Hz
_SWING = 0.25  # of an actuator's range
_POSITION = 0.5  # rad or m, of a position servo without a range
_ANGLE = 0.3  # rad
_SHIFT = 0.1  # of the robot's size
_EDGE = 0.1  # of a joint's range, which the start keeps away from its ends
_STEP, _INSIDE = 0.1, 0.7  # of a parameter's range: for slopes; how far one that the model doesn't have is moved
_WAYS = 4  # random directions in which all parameters are changed at once
_LITTLE, _MORE = 0.01, 0.1  # of their ranges
_GROWN, _CALM = 0.2, 0.12  # share of the larger change's motion in the smaller one's, 0.1 where nothing grows
_SHORTEST = 0.3  # s of a trial, from which on its motion says something
_OWN = 0.004  # of the motion: a parameter whose own part is less is made up for by others

Simulate = Callable[[Sequence[Values]], list[TrialSet]]


@dataclass(frozen=True)
class Shift:
    """Effect of a parameter at one of its bounds, the others as published.

    Attributes:
        distance: Distance of the markers from where they are with the published value, mean over markers and time,
            and what the sensors' differences count as [m]; NaN where there is no simulation.
        failure: Why there is no simulation; None where there is one.
    """

    distance: float
    failure: str | None = None


@dataclass(frozen=True)
class Probe:
    """Effects of a parameter.

    Attributes:
        effect: What it does to the model.
        lower: What it does at its lower bound.
        upper: What it does at its upper bound.
    """

    effect: ModelEffect
    lower: Shift
    upper: Shift

    @property
    def parameter(self) -> Parameter:
        return self.effect.parameter

    @property
    def distance(self) -> float:
        """The larger one of its distances; NaN where neither bound can be simulated [m]."""
        return float(np.fmax(self.lower.distance, self.upper.distance))

    @property
    def idle(self) -> bool:
        """True for a parameter that changes nothing that is measured."""
        return self.lower.failure is None and self.upper.failure is None and self.distance <= NOISE

    @property
    def refused(self) -> str | None:
        """Reason why the model doesn't compile at a bound; None where it does at both."""
        return self.effect.lower or self.effect.upper


def probe(robot: Robot, reference: TrialSet | None = None, threads: int | None = None) -> list[Probe]:
    """Effects of each parameter in the first seconds of a swim or recording.

    Args:
        robot: Robot whose parameters are probed.
        reference: Real trials, whose controls and starts are used; without any the robot is moved by made-up ones.
        threads: Simulations at a time; by default the number of cores.

    Raises:
        RobotError: The model doesn't compile with the published values.
        EngineError: It can't be simulated with them.
        TrialError: The reference doesn't fit the robot.
    """
    effects, published = model_effects(robot), robot.space.published
    refused = [why for effect in effects for why in (effect.lower, effect.upper)]
    ends = [{**published, p.name: value} for p in robot.space for value in (p.lower, p.upper)]
    nominal, simulate = _begun(robot, reference, threads)
    made = iter(simulate([end for end, why in zip(ends, refused, strict=True) if why is None]))
    shifts = [Shift(np.nan, why) if why else _shift(robot, nominal, next(made)) for why in refused]
    return [Probe(effect, *pair) for effect, *pair in zip(effects, shifts[::2], shifts[1::2], strict=True)]


def made_up_for(robot: Robot, threads: int | None = None) -> dict[str, str]:
    """Parameters that others can compensate for, with the reason.

    Slopes about the published values show what is left of one's change beside those that change more; never all are
    named.

    Raises:
        EngineError: The robot can't be simulated with its own values.
    """
    space, (nominal, simulate) = robot.space, _begun(robot, None, threads)
    middle = space.to_cube(space.published)
    up = np.where(middle < _STEP, _INSIDE, np.minimum(middle + _STEP, 1.0))  # hardly anything changes near 0
    ends = [np.where(own, end, middle) for own in np.eye(len(space)) > 0 for end in (np.maximum(middle - _STEP, 0), up)]
    made, scales = simulate([space.to_values(end) for end in ends]), robot.trials.scales
    slopes: dict[str, Array] = {}
    for k, name in enumerate(space.names):
        before, after = made[2 * k : 2 * k + 2]
        if not any(trial.divergence for trial in (*before, *after)):
            change = _numbers(after, scales) - _numbers(before, scales)
            slopes[name] = change.ravel() / np.sqrt(change.size) / float(np.sum(ends[2 * k + 1] - ends[2 * k]))
    if not slopes:
        return {}
    left, order = qr(np.stack(list(slopes.values()), axis=1), mode="r", pivoting=True)
    own, limit = np.abs(np.diag(left)), _OWN * float(np.std(_numbers(nominal, scales), axis=0).max(initial=0.0))
    why = "others make up for it: over its range it alone changes the motion by {:.2g} mm"
    return {[*slopes][order[k]]: why.format(1e3 * own[k]) for k in range(1, len(own)) if own[k] <= limit}


def growing(robot: Robot, reference: TrialSet, horizon: float | None) -> list[str]:
    """A warning where changes don't grow in proportion, as of contacts and swings out of phase: no search follows that.

    Args:
        robot: The robot; of one whose trials are swims nothing is said.
        reference: Real trials.
        horizon: Seconds of each trial that are compared; None for all.
    """
    if robot.trials.steady:
        return []
    space, scales, motion = robot.space, robot.trials.scales, Motion(robot)
    rollouts = [motion.request(trial, horizon) for trial in reference.trials[:TRIALS]]
    middle = space.to_cube(space.published)
    ways = np.where(middle < 0.5, 1.0, -1.0) * np.random.default_rng(0).uniform(0.5, 1.0, (_WAYS, len(space)))
    points = middle + np.concatenate([_LITTLE * ways, _MORE * ways])
    nominal, *made = motion.player.simulate_many([space.published, *map(space.to_values, points)], rollouts)
    if any(trial.divergence for one in (nominal, *made) for trial in one):
        return []
    squares = [np.square(_numbers(one, scales) - _numbers(nominal, scales)).mean(axis=1) for one in made]
    little, more = np.sqrt(np.cumsum(squares, axis=1)).reshape(2, _WAYS, -1)
    shares = np.median(little / np.maximum(more, NOISE), axis=0)
    if not shares[-1] > _GROWN:
        return []
    times = _since(nominal)
    calm = max(float(times[np.flatnonzero(shares <= _CALM)[-1]]) if (shares <= _CALM).any() else 0.0, _SHORTEST)
    digit = 10.0 ** math.floor(math.log10(calm))
    return [
        f"a search can't follow trials of {times[-1]:.3g} s to their ends: parameters changed by a hundredth of their "
        f"ranges move them by {shares[-1]:.0%} of what a tenth does (contacts, limits of joints, and swings that get "
        f"out of phase do that): try --{'horizon' if robot.trials.controls else 'pieces'} "
        f"{digit * math.floor(calm / digit + 1e-9):g}"
    ]


def _since(trials: TrialSet) -> Array:
    """Times since the first frame of the first trial, as long as all of them last [s]."""
    times = trials.trials[0].track.times - trials.trials[0].track.times[0]
    return times[times <= min(trial.track.duration for trial in trials)]


def _numbers(trials: TrialSet, scales: Mapping[str, float]) -> Array:
    """Numbers of trials that are compared, at the same times since the first frame of each [m]. Shape (T, N)."""
    since, columns = _since(trials), list[Array]()
    for trial in trials:
        track, sensors, times = trial.track, trial.sensors, trial.track.times[0] + since
        columns += [np.interp(times, track.times, place) for place in track.positions.reshape(len(track.times), -1).T]
        if sensors is not None:
            columns += [scale * np.interp(times, sensors.times, sensors.column(name)) for name, scale in scales.items()]
    return np.stack(columns, axis=1)


def made_up_motion(robot: Robot) -> str:
    """Motion by which `probe` moves a robot without real trials, as a part of a sentence."""
    if robot.trials.steady:
        return f"by its {'motor' if robot.motor_joint else 'servo'} at {FREQUENCY:g} Hz, from rest"
    by = f"by what drives a trial, at {FREQUENCY:g} Hz and with sines for tables, " if robot.trials.controls else ""
    return by + ("from a pose off its rest" if _shown(robot) else "from where trials start")


def _shown(robot: Robot) -> bool:
    """True where recordings may start in any pose."""
    return robot.trials.start in (MARKERS, FITTED) or not robot.trials.start_named


def moved(robot: Robot, threads: int | None = None) -> TrialSet:
    """The published robot in the trials by which parameters are distinguished.

    Raises:
        EngineError: It can't be simulated.
    """
    return _begun(robot, None, threads)[0]


def _begun(robot: Robot, reference: TrialSet | None, threads: int | None) -> tuple[TrialSet, Simulate]:
    """The published robot's trials, and what simulates others."""
    if robot.trials.steady:
        return _checked(robot, partial(Simulator(robot, threads).simulate_many, swims=_swims(reference)))
    if reference is None:
        return _excited(robot, threads)
    motion = Motion(robot, threads)
    rollouts = [motion.request(trial, SECONDS) for trial in reference.trials[:TRIALS]]
    return _checked(robot, partial(motion.player.simulate_many, rollouts=rollouts))


def _excited(robot: Robot, threads: int | None) -> tuple[TrialSet, Simulate]:
    """The same for made-up recordings, as strong as the robot bears."""
    # a start off the rest pose is in the trial itself
    player = Motion(robot.starting(REST) if _shown(robot) else robot, threads).player
    rollouts = [player.request(excitation(robot, strength)) for strength in _STRENGTHS]
    made = [player.simulate(robot.space.published, [rollout]).trials[0] for rollout in rollouts]
    reached = [np.linalg.norm(one.track.positions - one.track.positions[0], axis=2).max(initial=0.0) for one in made]
    room = _ROOM * max(robot.size, robot.model.stat.extent)
    borne = [k for k, one in enumerate(made) if one.divergence is None]
    chosen = next((k for k in borne if reached[k] < room), (borne or [-1])[0])
    return _checked(robot, partial(player.simulate_many, rollouts=[rollouts[chosen]]))


def _checked(robot: Robot, simulate: Simulate) -> tuple[TrialSet, Simulate]:
    nominal = simulate([robot.space.published])[0]
    for trial in nominal:
        if trial.divergence:
            raise EngineError(
                f"robot '{robot.name}' can't be simulated with its own values: trial '{trial.name}': "
                f"{trial.divergence}; mend the model or the parameters' values"
            )
    return nominal, simulate


def _swims(reference: TrialSet | None) -> list[Swim]:
    """From rest, at the frequencies of real trials or at a usual one."""
    trials = () if reference is None else reference.trials[:TRIALS]
    rates = {trial.name: trial.nominal_frequency or FREQUENCY for trial in trials} or {"excitation": FREQUENCY}
    return [Swim(name, Actuation(rate), SECONDS) for name, rate in rates.items()]


def _shift(robot: Robot, nominal: TrialSet, made: TrialSet) -> Shift:
    failure = next((f"{trial.name}: {trial.divergence}" for trial in made if trial.divergence), None)
    if failure is not None:
        return Shift(np.nan, failure)
    return Shift(float(np.mean([_distance(robot, a, b) for a, b in zip(nominal, made, strict=True)])))


def _distance(robot: Robot, nominal: Trial, made: Trial) -> float:
    ways = np.linalg.norm(made.track.positions - nominal.track.positions, axis=2)
    moved = float(ways.mean()) if ways.size else 0.0
    if made.sensors is None or nominal.sensors is None:
        return moved
    apart = np.abs(made.sensors.values - nominal.sensors.values).mean(axis=0)
    return moved + float(apart @ [robot.trials.scales[name] for name in made.sensors.names])


def excitation(robot: Robot, strength: float) -> Trial:
    """A trial whose controls and start move a robot.

    Actuators that trials give a table for swing within their ranges, one after the other. Where trials start in any
    pose (start `markers` or `fitted`), the joints are off their rest and moving; elsewhere the start is the robot's.

    Args:
        robot: Whose trials are recordings.
        strength: 1, or less for a robot that diverges.
    """
    times = np.arange(round(SECONDS * _RATE) + 1) / _RATE
    names = [name for name, drive in robot.trials.controls.items() if drive.table]
    columns = [swing(robot.model.actuator(name), times, i, strength, FREQUENCY) for i, name in enumerate(names)]
    controls = Signals(times, names, np.stack(columns, axis=1)) if names else None
    start, velocities = _start(robot.model, strength) if _shown(robot) else ({}, {})
    track = MarkerTrack(times, np.zeros((len(times), len(robot.marker_names), 2)))
    return Trial("excitation", track, FREQUENCY, controls=controls, start=start, start_velocities=velocities)


def swing(actuator: Any, times: Array, number: int, strength: float, frequency: float) -> Array:
    """A sine within an actuator's range. Shape (T,).

    Args:
        actuator: As the engine names it, by `MjModel.actuator`.
        times: Times [s]. Shape (T,).
        number: Number of the actuator, each of which is later than the one before.
        strength: 1 for a quarter of its range, to either side of the middle.
        frequency: How often it swings [Hz].
    """
    middle, swing = 0.0, _POSITION if actuator.biasprm[1] else 1.0
    if actuator.ctrllimited[0]:
        low, high = map(float, actuator.ctrlrange)
        middle, swing = (low + high) / 2, _SWING * (high - low)
    return middle + strength * swing * np.sin(2 * np.pi * frequency * times - number)


def _start(model: mujoco.MjModel, strength: float) -> tuple[dict[str, float], dict[str, float]]:
    """Positions and velocities of the sliding and turning joints that have names."""
    start, velocities = dict[str, float](), dict[str, float]()
    sizes = {mujoco.mjtJoint.mjJNT_HINGE: _ANGLE, mujoco.mjtJoint.mjJNT_SLIDE: _SHIFT * float(model.stat.extent)}
    for joint in map(model.joint, range(model.njnt)):
        size = sizes.get(mujoco.mjtJoint(int(joint.type[0])))
        if size is None or not joint.name:
            continue
        velocities[joint.name] = strength * size  # per second
        start[joint.name] = float(model.qpos0[joint.qposadr[0]]) + strength * size
        if joint.limited[0]:
            (low, high), edge = map(float, joint.range), _EDGE * float(np.ptp(joint.range))
            start[joint.name] = float(np.clip(start[joint.name], low + edge, high - edge))
    return start, velocities
