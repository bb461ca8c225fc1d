"""Films of a robot with hidden parameters in a synthetic pool: what a user would bring home from the lab."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from swim2real.demo.synthetic import placed_by_hand, steady_swims, turned
from swim2real.errors import RunError
from swim2real.parameters import Values
from swim2real.processes import ProcessPool
from swim2real.rendering.pool import PoolCamera, film
from swim2real.robots.robot import Robot
from swim2real.tracking.points import save_points
from swim2real.trials import MarkerTrack

SAMPLE_INTERVAL = 0.004  # s, of the swims that are filmed
TIMESTEP = 5e-4  # s, half of that of the simulator that will be calibrated
PLACEMENT = 3e-3  # m, standard deviation of where markers sit beside their places
CLICK_ERROR = 1.0  # px, standard deviation of where a person clicks
WIDEST_HEADING = 0.3  # rad off the long side of the pool


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
        heading = rng.uniform(-WIDEST_HEADING, WIDEST_HEADING) + np.pi * rng.integers(2)
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


def _film(job: tuple[MarkerTrack, Robot, PoolCamera, Path, int]) -> Path:
    track, robot, camera, path, seed = job
    part = path.with_name(f"part_{path.name}")  # a film counts only once its points are picked
    truth = film(track, robot.marker_heights, camera, part, seed).truth.positions[0]
    clicks = truth + np.random.default_rng([seed, 3]).normal(0, CLICK_ERROR, truth.shape)
    save_points(points_file(path), clicks, robot.marker_names, path.name, camera.width, camera.height)
    part.replace(path)
    return path
