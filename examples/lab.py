"""A lab: recordings of a robot whose parameters are hidden, as markers or as films, as a user would bring them home.

What moves there differs from the model that is calibrated in what real robots differ in: its friction, its servos'
lag, where its markers sit, its sensors' noise; and it is simulated in finer steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from pool import PoolCamera, film, scene

from markertrack.camera_file import CameraFile, write_camera
from markertrack.points import save_points
from markertrack.track import MarkerTrack
from swim2real.demo.synthetic import turned
from swim2real.parameters import Values
from swim2real.robots.drives import TABLE, commands
from swim2real.robots.robot import Robot, Trials
from swim2real.simulation import PlaybackSimulator, Rollout
from swim2real.trials import Signals, Trial, TrialSet
from swim2real.trials.signals import write_signals
from swimbase.errors import ArgumentError, RunError

Array = NDArray[np.float64]

SETTLE = 2.0  # s before a recording, in which the robot holds its first command
FINER = 4  # samples of the motion to a frame of the film
COMMAND_RATE = 1000.0  # Hz, at which a lagging servo is worked out
BOARD = 0.35  # of the picture's sides: how far from its middle the four points of the camera file lie
CLICK_ERROR = 1.0  # px, standard deviation of where a person clicks


@dataclass(frozen=True)
class Take:
    """A recording to make.

    Attributes:
        name: Of the trial and its files.
        seconds: How long it is [s].
        frequency: Of what is driven by a frequency [Hz].
        controls: Commands from 0 s on, for what is driven by a table.
    """

    name: str
    seconds: float
    frequency: float | None = None
    controls: Signals | None = None


@dataclass(frozen=True)
class Lab:
    """A robot in the lab, and what records it.

    Attributes:
        robot: As it is calibrated; its trials are recordings.
        hidden: Its true parameters.
        differs: Changes the model to what really stands there.
        lag: Time constant with which all actuators follow their commands [s].
        sensor_noise: Standard deviation by sensor [unit].
        marker_noise: Standard deviation of a marker that is recorded without a film [m].
        heading: By which the robot is turned before the camera [rad].
        seed: Of everything random.
    """

    robot: Robot
    hidden: Values
    differs: Callable[[mujoco.MjSpec], None]
    lag: float = 0.0
    sensor_noise: Mapping[str, float] = field(default_factory=dict[str, float])
    marker_noise: float = 1e-4
    heading: float = 0.0
    seed: int = 0

    def move(self, takes: Sequence[Take], rate: float) -> list[Trial]:
        """What the robot really does, with readings of its sensors.

        Args:
            takes: What is asked of it.
            rate: Samples a second [Hz].
        """
        trials = [self._asked(take, rate) for take in takes]
        actuators = [actuator.name for actuator in self._build(self.hidden).actuators]
        pose = Trials(dict.fromkeys(actuators, TABLE), self.robot.recordings.sensors)
        simulator = PlaybackSimulator(replace(self.robot, build=self._build, trials=pose))
        rng = np.random.default_rng([self.seed, 1])
        done: list[Trial] = []
        made = simulator.simulate(self.hidden, [Rollout(trial) for trial in trials])
        for trial, take, moved in zip(trials, takes, made, strict=True):
            if moved.divergence:
                raise ArgumentError(f"take '{take.name}': {moved.divergence}; ask less of the robot")
            kept = trial.track.times >= -1e-9
            track = MarkerTrack(trial.track.times[kept], turned(moved.track.positions[kept], self.heading))
            readings = None if moved.sensors is None else self._read(moved.sensors, rng)
            done.append(Trial(take.name, track, take.frequency, controls=take.controls, sensors=readings))
        return done

    def record(self, takes: Sequence[Take], fps: float = 60.0) -> TrialSet:
        """Recordings without a film: noisy markers."""
        rng = np.random.default_rng([self.seed, 2])
        trials: list[Trial] = []
        for trial in self.move(takes, fps):
            positions = trial.track.positions + rng.normal(0, self.marker_noise, trial.track.positions.shape)
            trials.append(replace(trial, track=MarkerTrack(trial.track.times, positions)))
        return TrialSet(tuple(trials), self.robot.marker_names)

    def film(self, takes: Sequence[Take], camera: PoolCamera, half_width: float, folder: str | Path) -> list[Path]:
        """Films in a folder; beside each `NAME.points.json`, its tables, and for all `camera.json`.

        Args:
            takes: What is asked of the robot.
            camera: With the world point in its middle.
            half_width: Of the robot's links [m].
            folder: To write.

        Raises:
            RunError: It can't be written.
        """
        place = Path(folder)
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"can't write folder '{place}': {error.strerror or error}") from error
        write_camera(place / "camera.json", CameraFile(points=_board(camera)))
        heights = np.zeros(len(self.robot.marker_names))
        films: list[Path] = []
        for number, trial in enumerate(self.move(takes, FINER * camera.fps)):
            path, seed = place / f"{trial.name}.mp4", self.seed + number
            swim = scene(trial.track, heights, camera, seed, body_half_width=half_width, links=self.robot.links)
            truth = film(swim, path).truth.positions[0]
            clicks = truth + np.random.default_rng([seed, 3]).normal(0, CLICK_ERROR, truth.shape)
            save_points(
                path.with_suffix(".points.json"), clicks, self.robot.marker_names, path.name, camera.width,
                camera.height,
            )  # fmt: skip
            for kind, signals in (("controls", trial.controls), ("sensors", trial.sensors)):
                if signals is not None:
                    write_signals(signals, path.with_suffix(f".{kind}.csv"))
            films.append(path)
        return films

    def _build(self, values: Values) -> mujoco.MjSpec:
        spec = self.robot.build(values)
        self.differs(spec)
        return spec

    def _asked(self, take: Take, rate: float) -> Trial:
        """A take as the player takes it: from before its beginning on, with the commands that the servos follow."""
        recordings, model = self.robot.recordings, self._build(self.hidden).compile()
        nowhere = np.full((2, len(self.robot.marker_names), 2), np.nan)
        times = np.arange(0.0, take.seconds, 1 / COMMAND_RATE)
        asked = Trial(take.name, MarkerTrack([0.0, take.seconds], nowhere), take.frequency, controls=take.controls)
        asked_for = commands(model, recordings.controls, asked, times)
        followed = asked_for.copy()
        share = 1.0 if self.lag == 0 else 1 - np.exp(-1 / (COMMAND_RATE * self.lag))
        for i in range(1, len(times)):
            followed[i] = followed[i - 1] + share * (asked_for[i] - followed[i - 1])
        samples = np.arange(-round(SETTLE * rate), round(take.seconds * rate) + 1) / rate
        track = MarkerTrack(samples, np.full((len(samples), *nowhere.shape[1:]), np.nan))
        names = [model.actuator(i).name for i in range(model.nu)]
        return replace(asked, track=track, controls=Signals(times, names, followed), sensors=self._clock(take))

    def _clock(self, take: Take) -> Signals | None:
        """When the sensors are read."""
        names = [sensor.name for sensor in self.robot.recordings.sensors]
        times = np.arange(0.0, take.seconds, 0.01)
        return Signals(times, names, np.zeros((len(times), len(names)))) if names else None

    def _read(self, sensors: Signals, rng: np.random.Generator) -> Signals:
        noise = np.array([self.sensor_noise.get(name, 0.0) for name in sensors.names])
        return Signals(sensors.times, sensors.names, sensors.values + rng.normal(0, 1, sensors.values.shape) * noise)


def _board(camera: PoolCamera) -> tuple[Array, Array]:
    """Four points that a person measured: pixels and meters. Shapes (4, 2)."""
    if camera.center is None:
        raise ArgumentError("the camera has no center; give the world point in the middle of its picture")
    sides = BOARD * camera.meters_per_pixel * np.array([camera.width, camera.height])
    meters = np.array(camera.center) + np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * sides
    return np.round(camera.project(meters, 0.0, camera.center)[0], 1), meters
