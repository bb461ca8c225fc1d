"""Start of a recording: at rest, in a keyframe, as its trial says, as its first frames show, or as a fit finds.

A fit finds the state whose simulation meets the first stretch best. Pose and velocities are then unknowns of the
playback, found anew for each candidate by a few Levenberg-Marquardt steps. They begin where the first frames, or joint
sensors, say, and may not leave the range that these allow.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from mujoco import rollout

from swim2real.robots.robot import Sensor, Trials
from swim2real.simulation.pose import SCALAR, PoseFit
from swim2real.simulation.stepper import PHYSICS, physics_state
from swim2real.trials import Trial
from swimbase.arrays import Array, Mask
from swimbase.errors import EngineError, TrialError

WINDOW = 0.1  # s of first frames that show how a recording starts
_FRAMES = 5  # at least
_TRIES = 6
_STILL = 1e-6  # m: a correction that is none
_UNMOVED = 1e12  # kg or kg·m²: inertia of a joint that commands don't move
_CHANGE = 1e-3  # of an activation, at least, to see what is left of it
REST, MARKERS, FITTED = "rest", "markers", "fitted"
STARTS = (REST, MARKERS, FITTED)
"""Starts by name, beside a keyframe's."""


class FirstFrames:
    """Start and velocity of each marker in the first frames of a track, by a straight line through them.

    Attributes:
        times: Times of the frames since the first one [s]. Shape (K,).
        known: Markers that are seen at least twice. Shape (M,).
        places: Positions at the first time stamp [m]. Shape (M, 2).
        velocities: Velocities of the markers [m/s]. Shape (M, 2).
    """

    def __init__(self, trial: Trial, weights: Array, least: int = _FRAMES) -> None:
        """Takes the frames of a trial that count.

        Args:
            trial: Real trial.
            weights: Weights, 0 where a marker isn't believed. Shape (T, M).
            least: Frames that it takes at least.

        Raises:
            TrialError: No marker is seen twice.
        """
        track = trial.track
        since = track.times - track.times[0]
        count = max(int(np.searchsorted(since, WINDOW, side="right")), min(least, len(since)))
        positions = track.positions[:count]
        self.times = since[:count]
        self._counted = (weights[:count] > 0) & np.isfinite(positions).all(axis=2)
        self.known: Mask = self._counted.sum(axis=0) > 1
        if not self.known.any():
            raise TrialError(
                f"trial '{trial.name}': no marker is seen twice in its first {self.times[-1]:.2f} s, so nothing tells "
                f"its start; cut the video, or write 'start' into reference.json"
            )
        self.places, self.velocities = self.lines(positions)

    def lines(self, positions: Array) -> tuple[Array, Array]:
        """Straight lines through the frames in which each marker counts. Shape (K, M, 2) to (M, 2) and (M, 2)."""
        weights = self._counted.astype(float)
        total = np.maximum(weights.sum(axis=0), 1.0)
        moments = weights * (self.times[:, None] - weights.T @ self.times / total)
        counted = np.where(self._counted[:, :, None], positions, 0.0)
        slopes = np.einsum("km,kmi->mi", moments, counted) / np.maximum(np.square(moments).sum(axis=0), 1e-12)[:, None]
        middle = counted.sum(axis=0) / total[:, None]
        return middle - slopes * (weights.T @ self.times / total)[:, None], slopes


def start_at_keyframe(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> None:
    """Puts the model into one of its keyframes.

    Raises:
        EngineError: It has none of this name.
    """
    names = [model.key(i).name for i in range(model.nkey)]
    if name not in names:
        raise EngineError(f"start is '{name}'; it must be one of {', '.join((*STARTS, *names))}")
    mujoco.mj_resetDataKeyframe(model, data, names.index(name))
    data.time = 0.0


def start_at_joints(model: mujoco.MjModel, data: mujoco.MjData, trial: Trial) -> None:
    """Moves the joints that a trial names to where it says.

    Raises:
        TrialError: The model has no such joint, or not a sliding or turning one.
    """
    for name, value in _scalar(model, trial, trial.start).items():
        data.qpos[model.joint(name).qposadr[0]] = value
    for name, value in _scalar(model, trial, trial.start_velocities).items():
        data.qvel[model.joint(name).dofadr[0]] = value


def remembered(model: mujoco.MjModel, data: mujoco.MjData, controls: Array, known: int) -> Array:
    """Drives what the engine remembers beside positions and velocities by the commands before a start.

    These are activations, delayed commands and readings, and states of plugins; the joints are held where they are.
    What the known commands begin with is where commands lead that hold forever, as far as they lead anywhere.

    Args:
        model: Compiled.
        data: At the start; gets the state, and its time goes on.
        controls: Controls of the steps before the start. Shape (N, nu).
        known: How many of the last of these are known.

    Returns:
        What is left at the start of a change of each activation where the known commands begin. Shape (na,).
    """
    held, scratch = copy.copy(model), mujoco.MjData(model)
    held.dof_armature[:] = held.dof_M0[:] = _UNMOVED
    held.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    pose, own = (data.qpos.copy(), data.qvel.copy()), data.act.copy()
    activations = slice(1 + model.nq + model.nv, 1 + model.nq + model.nv + model.na)

    def left(part: Array) -> Array:
        if not len(part):
            return np.ones(model.na)
        data.qvel[:] = 0.0
        states = np.tile(physics_state(model, data), (2, 1))
        change = np.where(np.abs(own - data.act) > _CHANGE, own - data.act, _CHANGE)
        states[1, activations] += change
        states[:] = rollout.rollout(held, scratch, states, part[None], nstep=len(part))[0][:, -1]
        mujoco.mj_setState(model, data, states[0], PHYSICS)
        return (states[1] - states[0])[activations] / change

    held.actuator_actlimited[:] = False  # or what integrates commands would seem to lead to its limit
    data.act[:] += left(controls[: len(controls) - known]) * (own - data.act)
    held.actuator_actlimited[:] = model.actuator_actlimited
    changed = left(controls[len(controls) - known :])
    data.qpos[:], data.qvel[:] = pose
    return changed


def start_at_markers(
    fit: PoseFit, first: FirstFrames, guess: Array, simulated: Callable[[Array, Array], Array | None]
) -> tuple[Array, Array]:
    """The state whose simulation has the same straight lines through its first frames as the recording.

    A line through a path that bends begins beside it, and has the slope of its middle. By how much is seen in the
    simulation and taken from the real lines, again and again (a fixed-point iteration with Anderson's acceleration).

    Args:
        fit: Fits poses of the model.
        first: First frames of the recording.
        guess: Pose to begin with. Shape (nq,).
        simulated: From a state, positions of the markers at the times of the first frames, (K, M, 2) m; None if it
            diverges.

    Returns:
        Positions and velocities of the joints. Shapes (nq,) and (nv,).
    """
    known, shape = first.known, first.places.shape
    real = _stacked(first.places, first.velocities)
    counted = np.tile(np.repeat(known, 2), (2, 1))
    wanted, qpos, qvel, least = real, guess, np.zeros(0), np.inf
    inputs: list[Array] = []
    outputs: list[Array] = []
    best = None
    for _ in range(_TRIES):
        qpos = fit.pose(wanted[0].reshape(shape), known, qpos).qpos
        qvel = fit.velocities(qpos, wanted[1].reshape(shape) / WINDOW, known)
        positions = simulated(qpos, qvel)
        if positions is None:
            break
        lines = _stacked(*first.lines(positions))
        missed = float(np.linalg.norm((lines - real)[counted]))
        if missed < least:
            best, least = (qpos, qvel), missed
        inputs.append(wanted)
        outputs.append(np.where(counted, real - lines + _stacked(*fit.motion(qpos, qvel)), real))
        wanted = _accelerated(inputs, outputs)
        if np.abs(wanted - inputs[-1]).max() < _STILL:
            break
    return best or (qpos, qvel)


def _stacked(places: Array, velocities: Array) -> Array:
    """Places, and ways in the time of the window [m]. Shape (2, 2 M)."""
    return np.stack([places.ravel(), WINDOW * velocities.ravel()])


def _accelerated(inputs: list[Array], outputs: list[Array]) -> Array:
    """Anderson's next point of the iteration outputs = f(inputs)."""
    if len(inputs) == 1:
        return outputs[-1]
    gaps = np.array([(g - x).ravel() for x, g in zip(inputs, outputs, strict=True)])
    images = np.array([g.ravel() for g in outputs])
    shares = np.linalg.lstsq(np.diff(gaps, axis=0).T, gaps[-1], rcond=1e-3)[0]
    return (images[-1] - shares @ np.diff(images, axis=0)).reshape(inputs[0].shape)


def _scalar(model: mujoco.MjModel, trial: Trial, given: Mapping[str, float]) -> Mapping[str, float]:
    names = [model.joint(j).name for j in range(model.njnt) if int(model.jnt_type[j]) in SCALAR]
    for name in given:
        if name not in names:
            raise TrialError(
                f"trial '{trial.name}' starts with joint '{name}', which isn't one of the model's sliding and turning "
                f"joints ({', '.join(names) or 'none'})"
            )
    return given


JointState = tuple[Array, Array, Array]
"""Positions and velocities of the joints, and activations of the actuators. Shapes (nq,), (nv,) and (na,)."""

STRETCH = 0.25  # s of a recording that its start is fitted to
_STRETCH_FRAMES = 8  # at least
_STEPS = 8  # of Levenberg and Marquardt, those included that gain nothing
_CONVERGED = 1e-3  # promised relative gain below which the fit ends
_DIFFERENCE = 1e-4  # rad or m of a joint, or so much within the time below
UNIT_TIME = 0.05  # s, that makes ways of velocities
_PULL = 1e-6  # toward the first guess, relative to what is seen: for joints that nothing shows
_ROUNDING = 1e-9  # s
_OF_JOINTS = (int(mujoco.mjtSensor.mjSENS_JOINTPOS), int(mujoco.mjtSensor.mjSENS_JOINTVEL))
_ROOM = 2.0  # of the largest way between two frames, by which a start may be off its first two frames


@dataclass(frozen=True)
class Reading:
    """A sensor of the first stretch.

    Attributes:
        sensor: What it is.
        times: Times since the start [s]. Shape (R,).
        readings: Readings, NaN where nothing was read [unit]. Shape (R,).
        period: After how much they began anew before they were unwrapped [unit]; 0 where they didn't.
    """

    sensor: Sensor
    times: Array
    readings: Array
    period: float = 0.0


def nearest(readings: Array, to: Array, period: float) -> Array:
    """Readings, moved by as many periods as bring them nearest to others where these begin.

    Args:
        readings: Readings [unit]. Shape (R,).
        to: Others at the same times, NaN where nothing was read [unit]. Shape (R,).
        period: After how much readings begin anew [unit]; 0 where they don't.
    """
    known = np.flatnonzero(np.isfinite(to))
    if not period or not known.size:
        return readings
    return readings + period * np.round((to - readings)[known[0]] / period)


@dataclass(frozen=True)
class Stretch:
    """Stretch of a recording that a start is fitted to.

    Attributes:
        times: Times of the frames since the first one [s]. Shape (K,).
        positions: Positions of the markers [m]. Shape (K, M, 2).
        weights: Weights, 0 where a marker doesn't count. Shape (K, M).
        sensors: Sensors that are compared.
    """

    times: Array
    positions: Array
    weights: Array
    sensors: tuple[Reading, ...]

    @classmethod
    def of(cls, trial: Trial, weights: Array, about: Trials, periods: Mapping[str, float]) -> Stretch:
        """The first stretch of a recording.

        Args:
            trial: The recording, its readings unwrapped.
            weights: Weights of its markers, 0 where one isn't believed. Shape (T, M).
            about: What a trial of its robot is.
            periods: After how much readings began anew before [unit], by the names of their sensors.
        """
        track = trial.track
        since = track.times - track.times[0]
        count = max(int(np.searchsorted(since, STRETCH, side="right")), min(_STRETCH_FRAMES, len(since)))
        positions = track.positions[:count]
        seen = np.isfinite(positions).all(axis=2)
        sensors: list[Reading] = []
        if trial.sensors is not None:
            rows = trial.sensors.times - track.times[0]
            within = (rows >= -_ROUNDING) & (rows <= since[count - 1] + _ROUNDING)
            sensors = [
                Reading(one, rows[within], trial.sensors.column(one.name)[within], periods.get(one.name, 0.0))
                for one in about.sensors if one.name in trial.sensors.names
            ]  # fmt: skip
        return cls(since[:count], np.nan_to_num(positions), np.where(seen, weights[:count], 0.0), tuple(sensors))

    def read_late(self, delays: Mapping[str, float]) -> Stretch:
        """The same with readings dated earlier, by the delays of sensors [s]."""
        if not any(delays.values()):
            return self
        sensors = tuple(replace(one, times=one.times - delays.get(one.sensor.name, 0.0)) for one in self.sensors)
        return replace(self, sensors=sensors)

    @property
    def seconds(self) -> float:
        """Length [s]."""
        return float(self.times[-1])

    @cached_property
    def room(self) -> float:
        """By how much a start may be off the first two frames [m]: twice the largest way between two frames."""
        both = np.minimum(self.weights[1:], self.weights[:-1]) > 0
        ways = np.linalg.norm(np.diff(self.positions, axis=0), axis=2)
        return _ROOM * float(np.where(both, ways, 0.0).max(initial=0.0))

    def off(self, positions: Array) -> float:
        """Largest distance of a simulated marker from the first two frames [m]. Shape (K, M, 2)."""
        ways = np.linalg.norm((positions - self.positions)[:2], axis=2)
        return float(np.where(self.weights[:2] > 0, ways, 0.0).max(initial=0.0))

    def residual(self, positions: Array, readings: Sequence[Array]) -> Array:
        """Residual that a start is to make small, such that the squares add up to mean squares [m].

        Args:
            positions: Simulated markers. Shape (K, M, 2).
            readings: Simulated readings of each sensor [unit].
        """
        share = self.weights / max(float(self.weights.sum()), 1e-12)
        parts = [(np.sqrt(share)[:, :, None] * (positions - self.positions)).ravel()]
        for one, simulated in zip(self.sensors, readings, strict=True):
            known = np.isfinite(one.readings)
            missed = nearest(simulated, one.readings, one.period) - np.nan_to_num(one.readings)
            share = one.sensor.meters_per_unit / np.sqrt(max(int(known.sum()), 1))
            parts.append(share * np.where(known, missed, 0.0))
        return np.concatenate(parts)


@dataclass(frozen=True)
class Attempt:
    """A start and its simulation.

    Attributes:
        start: Where it begins.
        residual: What it is to make small [m]; None when the simulation diverged. Shape (n,).
        off: How far it is from the first two frames [m].
    """

    start: JointState
    residual: Array | None
    off: float


def fitted_start(
    guess: JointState, room: float, move: Callable[[JointState, Array], JointState], unknowns: int,
    simulate: Callable[[Sequence[JointState]], list[Attempt]],
) -> JointState:  # fmt: skip
    """The start whose residual is least, near a guess.

    Args:
        guess: Where to begin.
        room: By how much it may be off the first two frames [m]; more where the guess is.
        move: A start that is a step farther: of the pose, and of the velocities times 50 ms. Shape (unknowns,).
        unknowns: How many there are.
        simulate: Simulates the first stretch from several starts.
    """
    (best,) = simulate([guess])
    limit, gone, damping, slopes = max(room, best.off), np.zeros(unknowns), 1e-3, np.zeros(0)
    for _ in range(_STEPS):
        if best.residual is None:
            break
        if not slopes.size:
            slopes = _slopes(best, best.residual, move, unknowns, simulate)
        squares = float(best.residual @ best.residual)
        pull = _PULL * max(float(np.square(slopes).sum()) / unknowns, 1e-12)
        normal = slopes @ slopes.T + pull * np.eye(unknowns)
        gradient = slopes @ best.residual + pull * gone
        step: Array = np.asarray(-np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient), dtype=float)
        if -float(2 * gradient @ step + step @ normal @ step) <= _CONVERGED * squares:
            break
        (moved,) = simulate([move(best.start, step)])
        if moved.residual is not None and moved.residual @ moved.residual < squares and moved.off <= limit:
            best, gone, damping, slopes = moved, gone + step, damping / 10, np.zeros(0)
        else:
            damping *= 10
    return best.start


def _slopes(
    base: Attempt, residual: Array, move: Callable[[JointState, Array], JointState], unknowns: int,
    simulate: Callable[[Sequence[JointState]], list[Attempt]],
) -> Array:  # fmt: skip
    """Derivatives of the residual, 0 where they aren't known. Shape (unknowns, n)."""
    made = simulate([move(base.start, step) for step in _DIFFERENCE * np.eye(unknowns)])
    none = np.zeros_like(residual)
    return np.array([none if one.residual is None else (one.residual - residual) / _DIFFERENCE for one in made])


def sensed_start(model: mujoco.MjModel, start: JointState, stretch: Stretch) -> JointState:
    """A start whose joints are where their sensors say, by straight lines through the first readings.

    Joints without a sensor of their own stay as they are.

    Args:
        model: Compiled.
        start: What is known of the others.
        stretch: First stretch of a recording.
    """
    qpos, qvel = start[0].copy(), start[1].copy()
    for one in stretch.sensors:
        first = np.isfinite(one.readings) & (one.times <= max(WINDOW, float(one.times[min(1, len(one.times) - 1)])))
        sensor = model.sensor(one.sensor.name.partition("[")[0])
        joint, kind = int(sensor.objid[0]), int(sensor.type[0])
        if not first.any() or kind not in _OF_JOINTS:
            continue
        times, address = one.times[first] - one.times[0], model.jnt_qposadr[joint]
        readings = one.readings[first] / one.sensor.factor
        if kind == _OF_JOINTS[1]:
            qvel[model.jnt_dofadr[joint]] = readings[0]
            continue
        readings = nearest(readings, np.full_like(readings, qpos[address]), one.period / one.sensor.factor)
        qpos[address] = readings[0]
        if len(times) > 1:
            slope, place = np.polyfit(times, readings, 1)
            qpos[address], qvel[model.jnt_dofadr[joint]] = place, slope
    return qpos, qvel, start[2]
