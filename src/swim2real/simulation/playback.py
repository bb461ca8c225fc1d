"""The forward model of recordings: parameter values and recordings in, what the robot does under their controls out."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.errors import EngineError, TrialError
from swim2real.parameters import Values
from swim2real.robots.robot import Control, Robot, Sine
from swim2real.simulation.engine import Engine
from swim2real.simulation.forward_model import all_of, each_of, thread_count
from swim2real.simulation.pose import PoseFit
from swim2real.simulation.start import (
    MARKERS,
    REST,
    FirstFrames,
    start_at_joints,
    start_at_keyframe,
    start_at_markers,
)
from swim2real.simulation.stepper import roll
from swim2real.trials import MarkerTrack, Signals, Trial, TrialSet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rollout:
    """A request to the simulator: one recording to play back. `PlaybackSimulator.request` makes it.

    Attributes:
        trial: Recording whose time stamps, controls and start are played back.
        first: What its first frames show, where the playback starts by its markers; else None.
        guess: A pose near that start. Shape (nq,).
    """

    trial: Trial
    first: FirstFrames | None = None
    guess: Array | None = None


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
        self._published = robot.build(robot.space.published).compile()
        self._markers = len(robot.marker_names)
        self._sensors = {sensor.name: sensor_address(self._published, sensor.name) for sensor in self._about.sensors}
        if self._about.start not in (REST, MARKERS):
            start_at_keyframe(self._published, mujoco.MjData(self._published), self._about.start)

    def request(self, trial: Trial, weights: Array | None = None) -> Rollout:
        """Checks that a recording can be played back, and looks for its start.

        Args:
            trial: Real trial.
            weights: Weights for the start, 0 where a marker isn't believed; None believes all that are seen.
                Shape (T, M).

        Raises:
            TrialError: It lacks a control, its controls are on another clock, its start is another model's, or no
                marker shows where it starts.
            EngineError: The model has no such actuator.
        """
        times = trial.track.times
        driven(self._published, self._about.controls, trial, times)
        if trial.controls is not None and "table" in self._about.controls.values():
            try:
                trial.controls.check_clock(times[0], times[-1])
            except TrialError as error:
                raise TrialError(f"trial '{trial.name}': its controls don't drive it: {error}") from error
        start_at_joints(self._published, mujoco.MjData(self._published), trial)
        if self._about.start != MARKERS or trial.start or trial.start_velocities:
            return Rollout(trial)
        first = FirstFrames(trial, np.ones(trial.track.confidence.shape) if weights is None else weights)
        fit = PoseFit(self._published, self._markers, self.robot.plane)
        return Rollout(trial, first, fit.first(first.places, first.known).qpos)

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
        models = [self._model(values) for values in candidates]
        jobs = [partial(self._simulate, model, rollout) for model in models for rollout in rollouts]
        seconds = [rollout.trial.track.duration for rollout in rollouts] * len(models)
        trials, count = all_of(jobs, seconds, self._threads), len(rollouts)
        sets = [tuple(trials[c * count : (c + 1) * count]) for c in range(len(candidates))]
        return [TrialSet(each, self.robot.marker_names) for each in sets]

    def simulate_each(self, values: Values, rollouts: Sequence[Rollout]) -> Generator[Trial]:
        """Simulated trials for one candidate, each as soon as it and those before it are done.

        Closing the generator gives up the rest.
        """
        model = self._model(values)
        yield from each_of([partial(self._simulate, model, rollout) for rollout in rollouts], self._threads)

    def _model(self, values: Values) -> mujoco.MjModel | str:
        """The compiled robot, or why there is none."""
        try:
            return self.robot.build(values).compile()
        except (ValueError, mujoco.FatalError) as error:
            return f"the model can't be made: {' '.join(str(error).split())}"

    def _simulate(self, model: mujoco.MjModel | str, rollout: Rollout) -> Trial:
        trial, track = rollout.trial, rollout.trial.track
        if isinstance(model, str):
            return self._diverged(trial, model)
        step, names = float(model.opt.timestep), tuple(self._sensors)
        samples = track.times
        if trial.sensors is not None and names:
            samples = trial.sensors.between(track.times[0], track.times[-1]).times
        data, controls = self.begin(model, rollout)
        made = roll(model, data, controls)
        if made.failed_at is not None:
            return self._diverged(trial, f"the simulation diverged {made.failed_at:.3f} s after its start")
        markers = self._in_plane(sampled(made.sensors[:, -3 * self._markers :], step, track.times - track.times[0]))
        readings = sampled(made.sensors[:, list(self._sensors.values())], step, samples - track.times[0])
        return Trial(
            trial.name, MarkerTrack(track.times, markers), trial.nominal_frequency, provenance=self.engine.name,
            sensors=Signals(samples, names, readings) if names else None,
        )  # fmt: skip

    def begin(self, model: mujoco.MjModel, rollout: Rollout) -> tuple[mujoco.MjData, Array]:
        """Where a playback begins, and the controls of its every step. Shape (N, nu)."""
        track, step = rollout.trial.track, float(model.opt.timestep)
        times = track.times[0] + step * np.arange(int(np.ceil(track.duration / step - 1e-9)) + 1)
        controls = driven(model, self._about.controls, rollout.trial, times)
        data = mujoco.MjData(model)
        if self._about.start not in (REST, MARKERS):
            start_at_keyframe(model, data, self._about.start)
        start_at_joints(model, data, rollout.trial)
        if rollout.first is not None and rollout.guess is not None:
            fit = PoseFit(model, self._markers, self.robot.plane)
            simulated = partial(self._first_frames, model, mujoco.MjData(model), controls, rollout.first.times)
            data.qpos[:], data.qvel[:] = start_at_markers(fit, rollout.first, rollout.guess, simulated)
        return data, controls

    def _first_frames(
        self, model: mujoco.MjModel, data: mujoco.MjData, controls: Array, times: Array, qpos: Array, qvel: Array
    ) -> Array | None:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = qpos, qvel
        step = float(model.opt.timestep)
        made = roll(model, data, controls[: int(np.ceil(times[-1] / step - 1e-9)) + 1])
        if made.failed_at is not None:
            return None
        return self._in_plane(sampled(made.sensors[:, -3 * self._markers :], step, times))

    def _in_plane(self, positions: Array) -> Array:
        """Shape (T, 3 M) to (T, M, 2)."""
        return positions.reshape(len(positions), self._markers, 3)[:, :, list(self.robot.plane)]

    def _diverged(self, trial: Trial, why: str) -> Trial:
        nowhere = np.full(trial.track.positions.shape, np.nan)
        return Trial(trial.name, MarkerTrack(trial.track.times, nowhere), provenance="diverged", divergence=why)


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
    """Where a sensor's number is among all; `NAME[I]` is one number of a vector."""
    base, _, rest = name.partition("[")
    sensors = {model.sensor(i).name: model.sensor(i) for i in range(model.nsensor)}
    if base not in sensors:
        raise EngineError(f"sensor '{base}' is to be compared; the model has {', '.join(filter(None, sensors))}")
    size = int(sensors[base].dim[0])
    index = rest.removesuffix("]") or ("0" if size == 1 else "")
    if not index.isdecimal() or int(index) >= size:
        raise EngineError(f"sensor '{name}' isn't one number; name one of {base}[0] to {base}[{size - 1}]")
    return int(sensors[base].adr[0]) + int(index)


def driven(model: mujoco.MjModel, controls: Mapping[str, Control], trial: Trial, times: Array) -> Array:
    """Controls at given times; what isn't named gets 0.

    Args:
        model: Compiled model of the robot.
        controls: Control of each actuator, by its name.
        trial: Trial whose table and frequency drive it.
        times: Times on the trial's clock [s]. Shape (N,).

    Returns:
        Shape (N, nu).

    Raises:
        EngineError: The model has no such actuator.
        TrialError: The trial has no such column, or no frequency.
    """
    names = [model.actuator(i).name for i in range(model.nu)]
    out = np.zeros((len(times), model.nu))
    for name, control in controls.items():
        if name not in names:
            raise EngineError(
                f"actuator '{name}' is to be driven; the model has {', '.join(names) or 'no actuators'}; "
                f"name one of these"
            )
        out[:, names.index(name)] = _one(name, control, trial, times)
    return out


def _one(name: str, control: Control, trial: Trial, times: Array) -> Array | float:
    if control == "table":
        return _held(name, trial, times)
    if control == "frequency":
        return 2 * np.pi * _frequency(name, trial)
    if isinstance(control, Sine):
        angles = 2 * np.pi * _frequency(name, trial) * (times - trial.track.times[0]) + control.phase
        return control.offset + control.amplitude * np.sin(angles)
    return float(control)


def _held(name: str, trial: Trial, times: Array) -> Array:
    if trial.controls is None:
        raise TrialError(
            f"trial '{trial.name}' has no controls; actuator '{name}' needs a table with a column of its name"
        )
    try:
        return trial.controls.held(name, times)
    except TrialError as error:
        raise TrialError(f"trial '{trial.name}': the controls don't drive actuator '{name}': {error}") from error


def _frequency(name: str, trial: Trial) -> float:
    if trial.nominal_frequency is None:
        raise TrialError(
            f"trial '{trial.name}' has no nominal frequency, which drives actuator '{name}'; write it into "
            f"reference.json"
        )
    return trial.nominal_frequency
