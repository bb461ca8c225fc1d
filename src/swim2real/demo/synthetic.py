"""Swims of a robot with known parameters, as a camera and a person would have them: as tracks, or as films of a pool.

A synthetic reference differs from the simulator that is calibrated in all that real tracks differ in: a finer time
step, another motor angle at the start, another place and heading in the pool, camera noise, markers placed by hand,
lost tracks.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from pool import PoolCamera, film, scene

from markertrack.points import save_points
from markertrack.track import MarkerTrack
from swim2real.parameters import Values
from swim2real.processes import ProcessPool
from swim2real.robots.robot import Robot
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, Trial, TrialSet
from swimbase.errors import RunError

Array = NDArray[np.float64]

SAMPLE_INTERVAL = 0.004  # s, of the swims that are filmed
TIMESTEP = 5e-4  # s, half of that of the simulator that will be calibrated
PLACEMENT = 3e-3  # m, standard deviation of where markers sit beside their places
_CLICK_ERROR = 1.0  # px, standard deviation of where a person clicks
_WIDEST_HEADING = 0.3  # rad off the long side of the pool


@dataclass(frozen=True)
class SyntheticCamera:
    """What stands between a swim and its track.

    Attributes:
        fps: Frames a second.
        noise: Standard deviation of a marker position [m].
        placement: Standard deviation of each marker's static offset on the body [m].
        timestep: Timestep of the physics [s]; None for the robot's own.
        lost: Trial name to (marker, neighbor that it collapses onto, time from which on [s]).
    """

    fps: float = 60.0
    noise: float = 0.0
    placement: float = 0.0
    timestep: float | None = None
    lost: Mapping[str, tuple[int, int, float]] | None = None


def synthetic_reference(
    robot: Robot, values: Values, frequencies: Sequence[float], seconds: float, camera: SyntheticCamera, seed: int,
    threads: int | None = None,
) -> TrialSet:  # fmt: skip
    """Steady swims of a robot with known parameters, as tracks.

    Args:
        robot: What swims.
        values: Its parameters.
        frequencies: Frequencies of the motor [Hz].
        seconds: Length of each trial [s].
        camera: Noise and losses.
        seed: Seed of everything random.
        threads: Swims simulated at a time.

    Returns:
        Trials named after their frequencies, such as `f1_50`.
    """
    rng = np.random.default_rng([seed, 1])
    simulated = steady_swims(robot, values, frequencies, seconds, 1 / camera.fps, rng, camera.timestep, threads)
    return TrialSet(tuple(_seen(trial, camera, rng) for trial in simulated), robot.marker_names)


def steady_swims(
    robot: Robot, values: Values, frequencies: Sequence[float], seconds: float, sample_interval: float,
    rng: np.random.Generator, timestep: float | None = None, threads: int | None = None,
) -> TrialSet:  # fmt: skip
    """Steady swims from random motor angles on, named after their frequencies.

    Args:
        robot: What swims.
        values: Its parameters.
        frequencies: Frequencies of the motor [Hz].
        seconds: Length of each swim [s].
        sample_interval: Longest time between samples [s].
        rng: Draws the angles.
        timestep: Timestep of the physics [s]; None for the robot's own.
        threads: Swims simulated at a time.
    """
    body = replace(robot, build=_with_timestep(robot, timestep))
    angles = rng.uniform(0, 2 * np.pi, len(frequencies))
    swims = [
        Swim(f"f{f:.2f}".replace(".", "_"), Actuation(f, angle, 0.1), seconds)
        for f, angle in zip(frequencies, angles, strict=True)
    ]
    return Simulator(body, threads, sample_interval).simulate(values, swims)


def turned(positions: Array, angle: float) -> Array:
    """World positions turned about the origin [m]. Shape (T, M, 2)."""
    return positions @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def placed_by_hand(positions: Array, placement: float, rng: np.random.Generator) -> Array:
    """Markers beside their places: a static offset each on its part of the body [m]. Shape (T, M, 2)."""
    if not placement:
        return positions
    axes = np.gradient(positions, axis=1)
    axes[:, :2] = (positions[:, 1] - positions[:, 0])[:, None]  # the head is rigid
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    sideways = np.stack([-axes[..., 1], axes[..., 0]], axis=-1)
    offsets = rng.normal(0, placement, (positions.shape[1], 2))
    offsets[:2, 0] = 0.0  # lengthwise the head markers set the scale; sideways they turn the body frame
    return positions + offsets[:, :1] * axes + offsets[:, 1:] * sideways


def film_swims(
    robot: Robot, values: Values, cameras: Sequence[tuple[float, PoolCamera]], seconds: float, seed: int,
    folder: str | Path, *, workers: int | None = None, on_done: Callable[[Path], None] = lambda path: None,
) -> list[Path]:  # fmt: skip
    """Films steady swims, several at a time, and picks the markers in their first frames; films that are there stay.

    Args:
        robot: What swims.
        values: Its parameters.
        cameras: Frequency of the motor [Hz] and camera of each film.
        seconds: Length of each film [s].
        seed: Seed of everything random.
        folder: Folder of the films, which are named after their frequencies, such as `f1_50.mp4`.
        workers: Processes at a time; None for as many as there are cores.
        on_done: Called after each film.

    Returns:
        The films. Beside each, `f1_50.points.json` has the markers as a person might click them.

    Raises:
        RunError: The folder can't be written.
    """
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"can't write folder '{place}': {error.strerror or error}") from error
    rng = np.random.default_rng([seed, 2])
    frequencies = [frequency for frequency, _ in cameras]
    swims = steady_swims(robot, values, frequencies, seconds + 2 / min(frequencies), SAMPLE_INTERVAL, rng, TIMESTEP)
    jobs: list[tuple[MarkerTrack, Robot, PoolCamera, Path, int]] = []
    paths: list[Path] = []
    for number, (swim, (_, camera)) in enumerate(zip(swims, cameras, strict=True)):
        heading = rng.uniform(-_WIDEST_HEADING, _WIDEST_HEADING) + np.pi * rng.integers(2)
        positions = placed_by_hand(turned(swim.track.positions, heading), PLACEMENT, rng)
        kept = swim.track.times <= seconds + SAMPLE_INTERVAL
        paths.append(place / f"{swim.name}.mp4")
        if not paths[-1].exists():
            track = MarkerTrack(swim.track.times[kept], positions[kept])
            jobs.append((track, robot, camera, paths[-1], seed + number))
    with ProcessPool(min(max(len(jobs), 1), workers or os.cpu_count() or 1), tries=1) as pool:
        for made in [pool.submit(_film, job) for job in jobs]:
            on_done(made.result())
    return paths


def points_file(video: Path) -> Path:
    """Where the points picked in a film are."""
    return video.with_suffix(".points.json")


def _with_timestep(robot: Robot, timestep: float | None):
    def build(values: Values) -> mujoco.MjSpec:
        spec = robot.build(values)
        if timestep is not None:
            spec.option.timestep = timestep
        return spec

    return build


def _seen(trial: Trial, camera: SyntheticCamera, rng: np.random.Generator) -> Trial:
    times = np.arange(int(np.floor(trial.track.duration * camera.fps + 1e-6)) + 1) / camera.fps
    samples = np.round(times / np.diff(trial.track.times)[0]).astype(int)
    positions = trial.track.positions[np.minimum(samples, trial.track.frame_count - 1)]
    positions = turned(positions, rng.uniform(-np.pi, np.pi)) + rng.uniform(-0.5, 0.5, 2)  # where in the pool
    positions = placed_by_hand(positions, camera.placement, rng)
    positions = positions + rng.normal(0, camera.noise, positions.shape) if camera.noise else positions
    lost = (camera.lost or {}).get(trial.name)
    if lost is not None:
        marker, neighbor, start = lost
        late = times >= start
        positions[late, marker] = positions[late, neighbor] + rng.normal(0, 1e-3, (int(late.sum()), 2))
    return replace(
        trial, track=MarkerTrack(times, positions), provenance=f"synthetic, {camera.fps:g} fps, hidden parameters"
    )


def _film(job: tuple[MarkerTrack, Robot, PoolCamera, Path, int]) -> Path:
    track, robot, camera, path, seed = job
    part = path.with_name(f"part_{path.name}")  # a film counts only once its points are picked
    truth = film(scene(track, robot.marker_heights, camera, seed), part).truth.positions[0]
    clicks = truth + np.random.default_rng([seed, 3]).normal(0, _CLICK_ERROR, truth.shape)
    save_points(points_file(path), clicks, robot.marker_names, path.name, camera.width, camera.height)
    part.replace(path)
    return path
