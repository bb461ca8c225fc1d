"""A study that takes seconds: one parameter that counts, two that make up for one another, one without effect.

It is the double pendulum of `recorded`, released from a raised pose; its shoulder has two dampings that add up.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from recorded import PENDULUM, blank, build_pendulum, recorded, telling
from run_settings import settings_of
from swim2real.calibration import Problem, RunFolder, conclude, minimize
from swim2real.optimizers import MultiStart, RandomSearch, streams
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.settings import IdentifiabilitySettings
from swim2real.trials import TrialSet

HIDDEN = {"mass": 0.1, "damping_a": 0.004, "damping_b": 0.003, "nothing": 0.3}
START = {"mass": 0.085, "damping_a": 0.0033, "damping_b": 0.0033, "nothing": 0.5}
SECONDS = 1.2
STUDY = IdentifiabilitySettings(rounds=3)


def build(values):
    shoulder = values["damping_a"] + values["damping_b"]
    return build_pendulum({"shoulder_damping": shoulder, "elbow_damping": 0.001, "lower_mass": values["mass"]})


SPACE = ParameterSpace(
    (
        Parameter("mass", "kg", 0.04, 0.16, "Mass of the lower arm.", 0.1),
        Parameter("damping_a", "N·m·s/rad", 0.001, 0.006, "One half of the damping.", 0.003),
        Parameter("damping_b", "N·m·s/rad", 0.001, 0.006, "The other half.", 0.003),
        Parameter("nothing", "-", 0.0, 1.0, "Does nothing.", 0.5),
    )
)
ROBOT = replace(
    telling(PENDULUM, controls={}, sensors=(), start="raised"), name="toy", space=SPACE, build=build
)  # fmt: skip


def make_reference(noise: float = 1e-3) -> TrialSet:
    """The hidden pendulum's swing with noise on its markers [m]."""
    return recorded(ROBOT, HIDDEN, [blank(ROBOT, "released", SECONDS)], noise)


def make_run(reference: TrialSet, out: Path, budget: int | None = 3, seed: int = 0, start: Mapping[str, float] = START
) -> RunFolder:  # fmt: skip
    """A short run that begins near the hidden values; without a budget a search until it is done."""
    problem = Problem(ROBOT, reference, threads=2)
    folder = RunFolder(out)
    with folder.locked():
        folder.begin(replace(settings_of(problem, reference, budget=budget, seed=seed), reference="the toy's"))
        first, rng = SPACE.to_cube(start), streams(seed)[1]
        optimizer = MultiStart([first], rng) if budget is None else RandomSearch(len(SPACE), rng, first)
        best, search = minimize(problem, SPACE, optimizer, budget, folder)
        if budget is None:
            conclude(folder, problem, None, best.values, search=search)
    return folder
