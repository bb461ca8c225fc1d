"""A calibration that takes seconds: the fish with four free parameters, and two short swims of hidden values."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from markertrack.track import MarkerTrack
from run_settings import settings_of
from swim2real.calibration import Problem, Progress, RunFolder, minimize
from swim2real.optimizers import BacktrackingLineSearch, Optimizer, RandomSearch, ScriptedAdvisor, first_point, streams
from swim2real.parameters import ParameterSpace
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, Trial, TrialSet, load_reference, save_reference

BOUNDS = {  # of fish that soon swim steadily
    "fluid_slender_drag": (3.0, 10.0),
    "fluid_kutta_lift": (2.0, 8.0),
    "motor_arm_length": (0.03, 0.05),
    "hinge_damping_0": (0.0, 0.02),
}
FREE = tuple(BOUNDS)
FREQUENCIES = {"f1_30": 1.3, "f1_70": 1.7}  # Hz
HIDDEN = {
    "fluid_slender_drag": 5.0, "fluid_kutta_lift": 5.0, "motor_arm_length": 0.036, "hinge_damping_0": 0.005
}  # fmt: skip

ROBOT = replace(
    FISH,
    space=ParameterSpace(tuple(replace(FISH.space[name], lower=low, upper=up) for name, (low, up) in BOUNDS.items())),
    build=lambda values: FISH.build({**FISH.space.published, **values}),
    trials=replace(FISH.trials, response=None),  # which is of sixteen parameters
)


def make_reference(folder: Path) -> TrialSet:
    """Films the hidden fish at 60 frames per second and saves the tracks."""
    simulator = Simulator(ROBOT, threads=2, sample_interval=1 / 60)
    swims = [Swim(name, Actuation(f, 1.0 + f, 0.1), 2.0) for name, f in FREQUENCIES.items()]
    rng = np.random.default_rng(0)
    trials = [
        Trial(
            trial.name,
            MarkerTrack(trial.track.times, trial.track.positions + rng.normal(0, 5e-4, trial.track.positions.shape)),
            trial.nominal_frequency,
        )
        for trial in simulator.simulate(HIDDEN, swims)
    ]
    save_reference(TrialSet(tuple(trials), ROBOT.marker_names), folder)
    return load_reference(folder)


def make_problem(reference: TrialSet, threads: int = 2) -> Problem:
    return Problem(ROBOT, reference, threads=threads)


def make_optimizer(method: str, seed: int = 0) -> Optimizer:
    dimension = len(ROBOT.space)
    first = first_point(dimension, seed)
    if method == "random":
        return RandomSearch(dimension, streams(seed)[1], first)
    return BacktrackingLineSearch(ScriptedAdvisor(list(streams(seed)[2].random((20, dimension)))), first)


def run(
    problem: Problem, reference: TrialSet, out: Path, method: str, budget: int, seed: int = 0,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> dict[str, object]:  # fmt: skip
    """Begins a run or goes on with it."""
    folder = RunFolder(out)
    settings = settings_of(problem, reference, method=method, seed=seed, budget=max(budget, 1))
    with folder.locked():
        if folder.exists:
            folder.resume(settings)
        else:
            folder.begin(settings)
        return minimize(problem, ROBOT.space, make_optimizer(method, seed), budget, folder, on_progress)[0]
