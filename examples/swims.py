"""Films of steady swims in the synthetic pool, with the markers as a person would click them.

    python examples/swims.py [FOLDER]

makes the films that `swim2real demo` has: of a fish with hidden parameters, with finer time steps, markers placed by
hand, and glare in the last film.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from pool import Glare, PoolCamera, film, scene

from markertrack.camera_file import CameraFile, write_camera
from markertrack.points import save_points
from markertrack.track import MarkerTrack
from swim2real.demo import FREQUENCIES, MORE_FREQUENCIES, hidden_values
from swim2real.demo.synthetic import placed_by_hand, steady_swims, turned
from swim2real.parameters import Values
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Robot

SAMPLE_INTERVAL = 0.004  # s, of the swims that are filmed
TIMESTEP = 5e-4  # s, half of that of the simulator that will be calibrated
PLACEMENT = 3e-3  # m
_CLICK_ERROR = 1.0  # px, standard deviation of where a person clicks
_WIDEST_HEADING = 0.3  # rad off the long side of the pool
SECONDS = 4.0
CAMERA = PoolCamera(width=1280, height=720, view=2.4, camera_height=3.5, glints=3.0)
GLARE = Glare(1.0, 1.15, over=(4, 5))
SEED = 2026


def film_swims(
    robot: Robot, values: Values, cameras: Sequence[tuple[float, PoolCamera]], seconds: float, seed: int,
    folder: str | Path, placement: float = PLACEMENT,
) -> list[Path]:  # fmt: skip
    """Films steady swims, several at a time, and picks the markers in their first frames; films that are there stay.

    Args:
        robot: What swims.
        values: Its parameters.
        cameras: Frequency of the motor [Hz] and camera of each film.
        seconds: Length of each film [s].
        seed: Seed of everything random.
        folder: Folder of the films, which are named after their frequencies, such as `f1_50.mp4`.
        placement: Standard deviation of where markers sit beside their places [m].

    Returns:
        The films. Beside each, `f1_50.points.json` has the markers as a person might click them.
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, 2])
    frequencies = [frequency for frequency, _ in cameras]
    swims = steady_swims(robot, values, frequencies, seconds + 2 / min(frequencies), SAMPLE_INTERVAL, rng, TIMESTEP)
    jobs: list[tuple[MarkerTrack, Robot, PoolCamera, Path, int]] = []
    paths: list[Path] = []
    for number, (swim, (_, camera)) in enumerate(zip(swims, cameras, strict=True)):
        heading = rng.uniform(-_WIDEST_HEADING, _WIDEST_HEADING) + np.pi * rng.integers(2)
        positions = placed_by_hand(turned(swim.track.positions, heading), placement, rng)
        kept = swim.track.times <= seconds + SAMPLE_INTERVAL
        paths.append(place / f"{swim.name}.mp4")
        if not paths[-1].exists():
            track = MarkerTrack(swim.track.times[kept], positions[kept])
            jobs.append((track, robot, camera, paths[-1], seed + number))
    with ProcessPoolExecutor() as pool:
        list(pool.map(_film, jobs))
    return paths


def _points_file(video: Path) -> Path:
    """Where the points picked in a film are."""
    return video.with_suffix(".points.json")


def film_demo(
    folder: str | Path,
    frequencies: Sequence[float] = FREQUENCIES,
    seconds: float = SECONDS,
    camera: PoolCamera = CAMERA,
    robot: Robot = FISH,
    placement: float = PLACEMENT,
) -> None:
    """Makes films of the demo's fish, the last one with glare, and the camera file that goes with them."""
    cameras = [(f, replace(camera, glares=(GLARE,)) if f == frequencies[-1] else camera) for f in frequencies]
    film_swims(robot, hidden_values(), cameras, seconds, SEED, folder, placement)
    # what a person can measure: how high the camera hangs over the head's markers
    known = CameraFile(camera_height=camera.camera_height - float(robot.marker_heights[0]))
    write_camera(Path(folder) / "camera.json", known)


def _film(job: tuple[MarkerTrack, Robot, PoolCamera, Path, int]) -> Path:
    track, robot, camera, path, seed = job
    part = path.with_name(f"part_{path.name}")  # a film counts only once its points are picked
    truth = film(scene(track, robot.marker_heights, camera, seed), part).truth.positions[0]
    clicks = truth + np.random.default_rng([seed, 3]).normal(0, _CLICK_ERROR, truth.shape)
    save_points(_points_file(path), clicks, robot.marker_names, path.name, camera.width, camera.height)
    part.replace(path)
    return path


def _points_file(video: Path) -> Path:
    return video.with_suffix(".points.json")


if __name__ == "__main__":
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "src" / "swim2real" / "demo" / "films"
    film_demo(out)
    film_demo(out, MORE_FREQUENCIES)
