"""The forward model of recordings: parameter values and recordings in, what the robot does under their controls out."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import mujoco
import numpy as np

from markertrack.track import MarkerTrack
from swim2real.parameters import Values
from swim2real.robots.drives import commands
from swim2real.robots.robot import Robot, Sensor
from swim2real.robots.targets import Delays
from swim2real.simulation.forward_model import Engine, all_of, model_of, thread_count
from swim2real.simulation.pose import PoseFit
from swim2real.simulation.start import (
    FITTED,
    MARKERS,
    STARTS,
    UNIT_TIME,
    Attempt,
    FirstFrames,
    JointState,
    Stretch,
    fitted_start,
    nearest,
    remembered,
    sensed_start,
    start_at_joints,
    start_at_keyframe,
    start_at_markers,
)
from swim2real.simulation.stepper import physics_state, roll, roll_each
from swim2real.trials import Signals, Trial, TrialSet
from swim2real.trials.signals import MEMORY
from swimbase.arrays import Array
from swimbase.errors import EngineError, TrialError, about

_ROUNDING = 1e-9  # s


@dataclass(frozen=True)
class Rollout:
    """A request to the simulator: one recording to play back. `PlaybackSimulator.request` makes it.

    Attributes:
        trial: Recording whose time stamps, controls and start are played back; its readings are unwrapped.
        first: What its first frames show, where the playback starts by its markers; else None.
        guess: A pose near that start. Shape (nq,).
        stretch: What the start is fitted to; None where it isn't.
        pieces: Parts of the recording, each played back from a start of its own; empty for one that is played in one.
            Each begins with the frame that ends the one before it.
        whole: The recording that this one is a piece of; None for none.
        periods: After how much readings of sensors begin anew [unit], by the names of those that do.
        state: The start, where it is known already; None where it is to be found.
    """

    trial: Trial
    first: FirstFrames | None = None
    guess: Array | None = None
    stretch: Stretch | None = None
    pieces: tuple[Rollout, ...] = ()
    whole: Trial | None = None
    periods: Mapping[str, float] = field(default_factory=dict[str, float])
    state: JointState | None = None


class PlaybackSimulator:
    """Plays recordings back with a robot, for one or many candidates at once.

    Every playback is simulated by itself, so results don't depend on the number of threads or on what else is in the
    batch. The threads run without Python's lock.

    Attributes:
        robot: The robot that is simulated.
        engine: The physics engine that it is simulated with.
    """

    def __init__(self, robot: Robot, threads: int | None = None) -> None:
        """Makes a simulator.

        Args:
            robot: Robot whose trials are recordings.
            threads: Recordings played at a time; by default the number of cores.

        Raises:
            ArgumentError: The robot's trials are steady swims.
            EngineError: Too few threads, or the model hasn't the actuators, sensors or keyframe that the robot names.
        """
        self._threads = thread_count(threads)
        self.robot, self._about = robot, robot.recordings
        self.engine = Engine.of(robot)
        self._markers = len(robot.marker_names)
        self._addresses = {one.name: sensor_address(self.robot.model, one.name) for one in self._about.sensors}
        if self._about.start not in STARTS:
            start_at_keyframe(self.robot.model, mujoco.MjData(self.robot.model), self._about.start)

    def request(
        self, trial: Trial, weights: Array | None = None, pieces: float | None = None, start: str | None = None
    ) -> Rollout:
        """Checks that a recording can be played back, and looks for its start.

        Args:
            trial: Real trial.
            weights: Weights for the start, 0 where a marker isn't believed; None believes all that are seen.
                Shape (T, M).
            pieces: Length of the pieces into which it is cut, each with a fitted start of its own [s]; None doesn't
                cut it.
            start: Where it starts, `rest` or `fitted`, of a robot whose file doesn't say; None as the robot's are.

        Raises:
            TrialError: It lacks a control, its controls are on another clock, its start is another model's, no
                marker shows where it starts, or pieces are shorter than the time between frames.
            EngineError: The model has no such actuator.
        """
        times = trial.track.times
        commands(self.robot.model, self._about.controls, trial, times)
        if trial.controls is not None and any(drive.table for drive in self._about.controls.values()):
            with about(f"trial '{trial.name}': its controls don't drive it"):
                trial.controls.check_clock(times[0], times[-1])
        start_at_joints(self.robot.model, mujoco.MjData(self.robot.model), trial)
        believed = np.ones(trial.track.confidence.shape) if weights is None else weights
        ready, periods = self._about.unwrapped(trial)
        begun = Rollout(ready, periods=periods)
        if pieces is not None:
            return replace(begun, pieces=tuple(self._piece(begun, believed, part) for part in cut(trial, pieces)))
        begins = start or self._about.start
        if begins not in (MARKERS, FITTED) or trial.start or trial.start_velocities:
            return begun
        return self._shown(begun, believed, begins == FITTED)

    def _shown(self, begun: Rollout, weights: Array, fitted: bool) -> Rollout:
        """A recording whose markers, or joint sensors, show its start."""
        trial = begun.trial
        stretch = Stretch.of(trial, weights, self._about, begun.periods) if fitted else None
        if not self._markers:
            if not fitted:
                raise TrialError(
                    f"trial '{trial.name}' has no markers, and start is '{self._about.start}'; say "
                    f'start = "fitted" in the robot file'
                )
            return replace(begun, stretch=stretch)
        first = FirstFrames(trial, weights, 2) if fitted else FirstFrames(trial, weights)
        guess = PoseFit(self.robot.model, self._markers, self.robot.plane).first(first.places, first.known).qpos
        return replace(begun, first=first, guess=guess, stretch=stretch)

    def _piece(self, begun: Rollout, weights: Array, part: slice) -> Rollout:
        """A part of a recording, from one frame to another."""
        trial = begun.trial
        own = replace(trial, track=trial.track.frames(part), start={}, start_velocities={})
        return self._shown(replace(begun, trial=own, whole=trial), weights[part], fitted=True)

    def simulate(self, values: Values, rollouts: Sequence[Rollout]) -> TrialSet:
        """Simulated trials for one candidate, in the order of the recordings."""
        return self.simulate_many([values], rollouts)[0]

    def simulate_many(self, candidates: Sequence[Values], rollouts: Sequence[Rollout]) -> list[TrialSet]:
        """Simulated trials for several candidates, in one batch.

        A simulation that diverges, and a model that can't be made of a candidate's values, is a trial with a
        `divergence` that says why; it never raises.

        Returns:
            One set a candidate: markers in the plane of the camera [m] at the recordings' time stamps, sensors at those
            of the recordings' sensors that lie within the track, or at the track's.
        """
        made = [(model_of(self.robot, values), values) for values in candidates]
        jobs = [partial(self._simulate, model, values, rollout) for model, values in made for rollout in rollouts]
        seconds = [rollout.trial.track.duration for rollout in rollouts] * len(made)
        trials, count = all_of(jobs, seconds, self._threads), len(rollouts)
        sets = [tuple(trials[c * count : (c + 1) * count]) for c in range(len(candidates))]
        return [TrialSet(each, self.robot.marker_names) for each in sets]

    def _simulate(self, model: mujoco.MjModel | str, values: Values, rollout: Rollout) -> Trial:
        trial, track = rollout.trial, rollout.trial.track
        if isinstance(model, str):
            return self._diverged(trial, model)
        names, samples = tuple(self._addresses), track.times
        if trial.sensors is not None and names:
            samples = trial.sensors.between(track.times[0], track.times[-1]).times
        parts = rollout.pieces or (rollout,)
        markers: list[Array] = []
        readings: list[Array] = []
        for part in parts:
            frames, end = part.trial.track.times, part.trial.track.times[-1]
            if part is not parts[-1]:  # the last frame is the next one's first
                frames, end = frames[:-1], end - 2 * _ROUNDING
            read = samples[(samples >= frames[0] - _ROUNDING) & (samples <= end + _ROUNDING)]
            played = self._played(model, values, part, frames, read)
            if isinstance(played, str):
                return self._diverged(trial, played)
            markers.append(played[0])
            readings.append(played[1])
        return Trial(
            trial.name, MarkerTrack(track.times, np.concatenate(markers)), trial.nominal_frequency,
            provenance=self.engine.name, sensors=Signals(samples, names, np.concatenate(readings)) if names else None,
        )  # fmt: skip

    def _played(
        self, model: mujoco.MjModel, values: Values, rollout: Rollout, frames: Array, samples: Array
    ) -> tuple[Array, Array] | str:
        """Markers and readings at given times, or why there are none. Shapes (T, M, 2) and (R, S)."""
        step, begun = float(model.opt.timestep), rollout.trial.track.times[0]
        data, controls = self.begin(model, rollout, values)
        made = roll(model, data, controls)
        if made.failed_at is not None:
            return f"the simulation diverged {made.failed_at:.3f} s after its start"
        markers = self._in_plane(
            sampled(made.sensors[:, made.sensors.shape[1] - 3 * self._markers :], step, frames - begun)
        )
        readings = np.empty((len(samples), len(self._addresses)))
        late, real = self._late(self.robot.delays_of(values), rollout.trial), rollout.trial.sensors
        for column, sensor in zip(readings.T, self._about.sensors, strict=True):
            column[:] = self._read(sensor, made.sensors, step, samples - begun - late[sensor.name])
            if real is not None and sensor.name in rollout.periods:
                read = real.column(sensor.name)[np.isin(real.times, samples)]
                column[:] = nearest(column, read, rollout.periods[sensor.name])
        return markers, readings

    def _read(self, sensor: Sensor, sensors: Array, step: float, times: Array) -> Array:
        """Readings of a sensor at times of a simulation [unit]. Shapes (N, nsensordata) and (R,)."""
        return sensor.factor * sampled(sensors[:, [self._addresses[sensor.name]]], step, times)[:, 0]

    def begin(
        self, model: mujoco.MjModel, rollout: Rollout, values: Values | None = None
    ) -> tuple[mujoco.MjData, Array]:
        """State at the beginning of a playback, and the controls of its every step.

        Args:
            model: Compiled with these values.
            rollout: What is to be played back.
            values: Values of the parameters, some of which may be delays; None for the published ones.

        Returns:
            The engine's data, and controls of shape (N, nu).
        """
        track, step = rollout.trial.track, float(model.opt.timestep)
        times = track.times[0] + step * np.arange(int(np.ceil(track.duration / step - 1e-9)) + 1)
        delays = self.robot.delays_of(self.robot.space.published if values is None else values)
        controls = commands(model, self._about.controls, rollout.whole or rollout.trial, times, delays)
        data = mujoco.MjData(model)
        if self._about.start not in STARTS:
            start_at_keyframe(model, data, self._about.start)
        start_at_joints(model, data, rollout.trial)
        left = self._remember(model, data, rollout, delays)
        fit = PoseFit(model, self._markers, self.robot.plane)
        if rollout.state is not None:
            data.qpos[:], data.qvel[:], data.act[:] = rollout.state
        elif rollout.stretch is not None:
            stretch = rollout.stretch.read_late(self._late(delays, rollout.trial))
            guess = self._guess(fit, model, data, rollout, stretch)
            data.qpos[:], data.qvel[:], data.act[:] = self._fitted(model, data, fit, guess, left, controls, stretch)
        elif rollout.first is not None and rollout.guess is not None:
            simulated = partial(self._first_frames, model, data, controls, rollout.first.times)
            data.qpos[:], data.qvel[:] = start_at_markers(fit, rollout.first, rollout.guess, simulated)
        return data, controls

    def _remember(self, model: mujoco.MjModel, data: mujoco.MjData, rollout: Rollout, delays: Delays) -> Array:
        """Gives a start what commands before it leave; where the start is shown, also those before the table begins.

        Returns:
            What is left at the start of a change of each activation where the table begins. Shape (na,).
        """
        shown, whole = rollout.stretch is not None or rollout.first is not None, rollout.whole or rollout.trial
        if len(physics_state(model, data)) == 1 + model.nq + model.nv:  # it remembers nothing
            return np.zeros(0)
        begun, step, table = rollout.trial.track.times[0], float(model.opt.timestep), whole.controls
        since = begun - table.times[0] if table is not None else 0.0
        known = round(float(np.clip(since, 0.0, MEMORY)) / step)
        count = round(MEMORY / step) if shown else known
        times = begun - step * np.arange(count, 0, -1)
        return remembered(model, data, commands(model, self._about.controls, whole, times, delays), known)

    def _late(self, delays: Delays, trial: Trial) -> dict[str, float]:
        """Ages of the readings of a trial's sensors [s]."""
        return {name: delays.sensor(name, trial.name) for name in self._addresses}

    def _guess(
        self, fit: PoseFit, model: mujoco.MjModel, data: mujoco.MjData, rollout: Rollout, stretch: Stretch
    ) -> JointState:
        """Initial guess of a fit of the start: the markers' places; without any, the joint sensors' readings."""
        if rollout.first is None or rollout.guess is None:
            return sensed_start(model, (data.qpos.copy(), data.qvel.copy(), data.act.copy()), stretch)
        qpos = fit.pose(rollout.first.places, rollout.first.known, rollout.guess).qpos
        return qpos, fit.velocities(qpos, rollout.first.velocities, rollout.first.known), data.act.copy()

    def _fitted(
        self, model: mujoco.MjModel, data: mujoco.MjData, fit: PoseFit, guess: JointState, left: Array, controls: Array,
        stretch: Stretch,
    ) -> JointState:  # fmt: skip
        """The start that fits the first stretch best, with activations as far as commands before it leave them open."""
        step, free = float(model.opt.timestep), fit.free(guess[0])
        unknowns = free.shape[1]
        driving = controls[: int(np.ceil(stretch.seconds / step - 1e-9)) + 1]

        def move(start: JointState, change: Array) -> JointState:
            turned, faster, other = np.split(change, [unknowns, 2 * unknowns])
            return fit.moved(start[0], free @ turned), start[1] + free @ faster / UNIT_TIME, start[2] + left * other

        def simulate(starts: Sequence[JointState]) -> list[Attempt]:
            states: list[Array] = []
            for data.qpos[:], data.qvel[:], data.act[:] in starts:
                states.append(physics_state(model, data))
            rolled = roll_each(model, np.array(states), driving)
            return [self._attempt(start, sensors, step, stretch) for start, sensors in zip(starts, rolled, strict=True)]

        return fitted_start(guess, stretch.room, move, 2 * unknowns + model.na, simulate)

    def _attempt(self, start: JointState, sensors: Array | None, step: float, stretch: Stretch) -> Attempt:
        if sensors is None:
            return Attempt(start, None, np.inf)
        markers = self._in_plane(sampled(sensors[:, sensors.shape[1] - 3 * self._markers :], step, stretch.times))
        readings = [self._read(one.sensor, sensors, step, one.times) for one in stretch.sensors]
        return Attempt(start, stretch.residual(markers, readings), stretch.off(markers))

    def _first_frames(
        self, model: mujoco.MjModel, data: mujoco.MjData, controls: Array, times: Array, qpos: Array, qvel: Array
    ) -> Array | None:
        begun, step = copy.copy(data), float(model.opt.timestep)
        begun.qpos[:], begun.qvel[:] = qpos, qvel
        made = roll(model, begun, controls[: int(np.ceil(times[-1] / step - 1e-9)) + 1])
        if made.failed_at is not None:
            return None
        return self._in_plane(sampled(made.sensors[:, made.sensors.shape[1] - 3 * self._markers :], step, times))

    def _in_plane(self, positions: Array) -> Array:
        """Shape (T, 3 M) to (T, M, 2)."""
        return positions.reshape(len(positions), self._markers, 3)[:, :, list(self.robot.plane)]

    def _diverged(self, trial: Trial, why: str) -> Trial:
        nowhere = np.full(trial.track.positions.shape, np.nan)
        return Trial(trial.name, MarkerTrack(trial.track.times, nowhere), provenance="diverged", divergence=why)


def cut(trial: Trial, seconds: float) -> list[slice]:
    """Frames of the pieces of a recording, as long as asked for or a little shorter; they share the frames at cuts.

    Raises:
        TrialError: Fewer than three frames would be in a piece.
    """
    times = trial.track.times
    count = max(int(np.ceil((times[-1] - times[0]) / seconds - 1e-9)), 1)
    cuts = np.searchsorted(times, np.linspace(times[0], times[-1], count + 1) - _ROUNDING)
    if np.diff(cuts).min() < 2:
        raise TrialError(
            f"trial '{trial.name}': pieces of {seconds:g} s would have fewer than three of its frames, "
            f"{1 / trial.fps:.3g} s apart; cut it into longer ones"
        )
    return [slice(first, last + 1) for first, last in pairwise(cuts)]


def sampled(values: Array, interval: float, times: Array) -> Array:
    """Values between steps of a simulation, on straight lines.

    Args:
        values: Values at times 0, interval, 2 interval, … Shape (N, C).
        interval: Time between the values [s].
        times: Times within them [s]. Shape (T,).

    Returns:
        Shape (T, C).
    """
    place = np.clip(times / interval, 0.0, len(values) - 1)
    before = np.minimum(place.astype(int), max(len(values) - 2, 0))
    share = (place - before)[:, None]
    return (1 - share) * values[before] + share * values[np.minimum(before + 1, len(values) - 1)]


def sensor_address(model: mujoco.MjModel, name: str) -> int:
    """Index of a sensor's number among all; `NAME[I]` is one number of a vector."""
    base, _, rest = name.partition("[")
    sensors = {model.sensor(i).name: model.sensor(i) for i in range(model.nsensor)}
    if base not in sensors:
        raise EngineError(f"sensor '{base}' is to be compared; the model has {', '.join(filter(None, sensors))}")
    size = int(sensors[base].dim[0])
    index = rest.removesuffix("]") or ("0" if size == 1 else "")
    if not index.isdecimal() or int(index) >= size:
        raise EngineError(f"sensor '{name}' isn't one number; name one of {base}[0] to {base}[{size - 1}]")
    return int(sensors[base].adr[0]) + int(index)
