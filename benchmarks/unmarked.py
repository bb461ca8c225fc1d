"""Calibration from films without markers, beside the same films with markers.

    python benchmarks/unmarked.py fish|snake FOLDER [BUDGET [SEED|hidden]]

Each swim of the demo's fish, or of the snake in `examples/snake`, is filmed with its markers and with a body of one
tone. Both films are tracked and calibrated with one BUDGET, without one until the search is done. Either result is then
simulated against the true motion of the markers, which no camera saw. A search begins where its SEED says, or at the
hidden values: the minimum near those tells what the films determine, however far a search comes. What is in the folder
already is used again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
sys.path[:0] = [str(EXAMPLES), str(EXAMPLES / "snake")]
import make_data
import swims
from pool import PoolCamera

from markertrack.points import load_points, save_points
from swim2real import (
    CalibrationSettings,
    Outcome,
    Robot,
    SyntheticCamera,
    TrackingSettings,
    TrialSet,
    calibrate,
    load_reference,
    synthetic_reference,
    track_videos,
)  # fmt: skip
from swim2real.calibration.problem import Problem
from swim2real.demo import FREQUENCIES, demo_settings, hidden_values
from swim2real.parameters import Values
from swim2real.robots.fish import FISH
from swimbase.errors import Swim2RealError
from swimbase.store import read_json, write_json


@dataclass(frozen=True)
class Case:
    """A robot with hidden parameters.

    Attributes:
        robot: As it is calibrated.
        hidden: Its true parameters.
        camera: Films it.
        film: Makes the films of a folder, of the robot or one that differs from it, with a camera.
        truth: Makes the trials without errors.
        settings: Makes the settings of a calibration, by the budget.
    """

    robot: Robot
    hidden: Values
    camera: PoolCamera
    film: Callable[[Path, PoolCamera, Robot], object]
    truth: Callable[[], TrialSet]
    settings: Callable[[int | None], CalibrationSettings]


def _film_fish(folder: Path, camera: PoolCamera, robot: Robot) -> None:
    placement = swims.PLACEMENT if camera.contrast else 1e-9  # m: without markers none is misplaced; headings stay
    swims.film_demo(folder, camera=camera, robot=robot, placement=placement)


def _fish_truth() -> TrialSet:
    exact = SyntheticCamera(timestep=swims.TIMESTEP)
    return synthetic_reference(FISH, hidden_values(), FREQUENCIES, swims.SECONDS, exact, swims.SEED)


def _snake_truth() -> TrialSet:
    return TrialSet(tuple(make_data.LAB.move(make_data.takes(), make_data.CAMERA.fps)), make_data.ROBOT.marker_names)


CASES = {
    "fish": Case(
        FISH, hidden_values(), swims.CAMERA,
        _film_fish, _fish_truth, demo_settings,
    ),
    "snake": Case(
        make_data.ROBOT, make_data.HIDDEN, make_data.CAMERA,
        lambda folder, camera, robot: make_data.LAB.film(make_data.takes(), camera, make_data.LINK_HALF_WIDTH, folder),
        _snake_truth, lambda budget: CalibrationSettings(budget=budget, seed=2),
    ),
}  # fmt: skip


def fitted(case: Case, folder: Path, unmarked: bool, settings: CalibrationSettings, run: Path) -> Outcome:
    """Films, tracks and calibrates."""
    camera = replace(case.camera, contrast=0.0, marker_radius=1e-4) if unmarked else case.camera
    heights = case.robot.marker_heights
    level = replace(case.robot, marker_heights=np.full_like(heights, heights[0]))  # clicks are on the body itself
    names, reference = case.robot.marker_names, folder / "reference"
    if not (folder / "camera.json").exists():
        case.film(folder, camera, level if unmarked else case.robot)
    films = sorted(folder.glob("*.mp4"))
    points = [film.with_suffix(".points.json") for film in films]
    if unmarked:
        ends = [film.with_suffix(".ends.json") for film in films]
        for every, two in zip(points, ends, strict=True):
            clicks = load_points(every, names, camera.width, camera.height).points[[0, -1]]
            save_points(two, clicks, (names[0], names[-1]), two.name, camera.width, camera.height)
        points = ends
    if not (reference / "reference.json").exists():
        how = TrackingSettings(camera=folder / "camera.json", midline=unmarked)
        for result in track_videos(films, points, case.robot, how, reference):
            if isinstance(result, Swim2RealError):
                raise result
    resume = (run / "settings.json").exists()
    return calibrate(load_reference(reference), case.robot, settings, run, resume=resume)


def main(name: str, out: Path, budget: int | None, search: str) -> None:
    """Prints what either kind of film determines."""
    case, start = CASES[name], out / "hidden.json"
    out.mkdir(parents=True, exist_ok=True)
    write_json(
        start, {"format": 1, "robot": case.robot.name, "parameters": case.hidden, "engine": "mujoco", "physics": {}}
    )
    settings = replace(case.settings(budget), budget=budget)
    settings = replace(settings, first=str(start)) if search == "hidden" else replace(settings, seed=int(search))
    space, truth = case.robot.space, Problem.with_settings(case.robot, case.truth(), settings)
    errors: dict[str, np.ndarray] = {}
    for kind in ("marked", "unmarked"):
        run = out / kind / f"run-{search}"
        outcome = fitted(case, out / kind, kind == "unmarked", settings, run)
        values = read_json(run / "best.json")["parameters"]
        figures = truth.evaluate(values).figures()
        print(f"{kind}: own loss {1e3 * outcome.fit.loss:.2f} mm, true loss {1e3 * figures['loss']:.2f} mm")
        print(", ".join(f"{n} {1e3 * one['loss']:.2f}" for n, one in figures["trials"].items()))
        off = np.abs(space.to_cube(values) - space.to_cube(case.hidden))
        errors[kind] = off
        print(f"within a tenth of the loss: {outcome.ranges}")
    print("off the hidden values, % of the range, with and without markers:")
    for one, *both in zip(space.names, *errors.values(), strict=True):
        print(f"{one:28s}", *(f"{100 * off:6.1f}" for off in both))


if __name__ == "__main__":
    given = sys.argv[3:]
    main(sys.argv[1], Path(sys.argv[2]), int(given[0]) if given else None, given[1] if len(given) > 1 else "2")
