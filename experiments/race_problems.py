"""Calibration problems whose answer is known or bounded, by name: what search methods race on.

    python experiments/race_problems.py --list                  # all of them, each with its hidden values' loss
    python experiments/race_problems.py --list demo finger

In Python, from beside this file:

    from race_problems import NAMES, Missing, load

    race = load("hidden-3", threads=1)  # raises Missing, with the reason, where a package or data isn't there
    race.problem.evaluate(race.space.to_values(point)).loss  # point: of the unit cube; loss in m
    race.target, race.truth  # loss to reach [m]; hidden values, None for real tracks

- `demo`: the embedded example's fish. As tracked where `swim2real demo` has been (`demo`: its folder `reference`), else
  simulated markers with noise. One trial is held out, as there.
- `hidden-0` … `hidden-9`: fish drawn at random from the logarithmic box, of those that swim forward in all trials and
  whose swims their own values explain to 10 mm (a swim that depends on how it began isn't). Four trials of 4 s, markers
  placed to 2 mm, with 0.5 mm of noise.
- `fish`, `fish-extended`: the published tracks, in `$SWIM2REAL_SHARED/data/fishsim-markers`; the target is the best of
  earlier runs.
- `finger`, `snake`, `arm`: the examples' labs, whose robots have what the models lack.
- `swimmer`, `suite-fish`: models of gymnasium and dm_control with four hidden parameters, as in strangers.py.

Seconds are those of one evaluation at the hidden values, or at the model's own, after a first one.
"""

import argparse
import importlib.util
import os
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

from recover import hidden
from strangers import CASES, recorded, robot_of

from swim2real.calibration import Problem
from swim2real.demo import FREQUENCIES, HELD_OUT, SyntheticCamera, hidden_values, synthetic_reference
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH
from swim2real.trials import load_reference

NAMES = (
    "demo", *(f"hidden-{number}" for number in range(10)), "fish", "fish-extended", "finger", "snake", "arm",
    "swimmer", "suite-fish",
)  # fmt: skip
BEST_KNOWN = {"fish": 0.0160, "fish-extended": 0.0125}  # m
EXPLAINED = 0.01  # m
CAMERA = SyntheticCamera(noise=5e-4, placement=2e-3)
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
# package, file and case of a model that others wrote
STRANGERS = {
    "swimmer": ("gymnasium", "envs/mujoco/assets/swimmer.xml", "swimmer"),
    "suite-fish": ("dm_control", "suite/fish.xml", "fish"),
}


class Missing(Exception):  # noqa: N818
    """What a problem needs isn't on this computer."""


@dataclass(frozen=True)
class RaceProblem:
    """A problem and what is known of its answer.

    Attributes:
        name: Of the problem.
        problem: Evaluates values.
        space: Parameters on the logarithmic scale, where they have one.
        truth: Hidden values; None for real tracks.
        target: Loss of the hidden values, or the lowest known [m].
    """

    name: str
    problem: Problem
    space: ParameterSpace
    truth: Values | None
    target: float


def load(name, threads=1, demo=None):
    """The problem of a name.

    Args:
        name: One of `NAMES`.
        threads: Trials simulated at a time, None for all cores.
        demo: Folder `reference` of a demo that was filmed and tracked; None simulates its markers.

    Raises:
        Missing: A package or data isn't there.
    """
    robot, reference, truth = _posed(name, demo)
    problem = Problem(robot, reference, threads=threads)
    target = BEST_KNOWN[name] if truth is None else problem.evaluate(truth).loss
    return RaceProblem(name, problem, replace(robot.space, scale="log"), truth, target)


def _posed(name, demo):
    """Robot, reference and hidden values of a problem."""
    kind, _, number = name.partition("-")
    if name == "demo":
        reference = load_reference(demo) if demo else _simulated_demo()
        fitted, _ = reference.split((HELD_OUT,))
        return FISH, fitted, hidden_values()
    if kind == "hidden":
        return FISH, *_hidden(int(number))
    if name in BEST_KNOWN:
        tracks = Path(os.environ.get("SWIM2REAL_SHARED", "../shared")) / "data" / "fishsim-markers"
        if not tracks.is_dir():
            raise Missing(f"no tracks at '{tracks}'; set SWIM2REAL_SHARED")
        return load_robot(name), load_reference(tracks), None
    if name in STRANGERS:
        return _stranger(*STRANGERS[name])
    code = _code(EXAMPLES / name / "make_data.py")
    return code.ROBOT, code.LAB.record(code.takes()), code.HIDDEN


def _simulated_demo():
    camera = replace(CAMERA, placement=3e-3)
    return synthetic_reference(FISH, hidden_values(), FREQUENCIES, 4.0, camera, 0)


def _hidden(number):
    """The swims of a hidden fish, and its values, which explain them."""
    fish = number
    while True:
        point, reference = hidden(fish, FREQUENCIES, 4.0, CAMERA)
        values = FISH.space.to_values(point)
        if Problem(FISH, reference, threads=1).evaluate(values).loss < EXPLAINED:
            return reference, values
        fish += 10


def _stranger(package, file, case):
    spec = importlib.util.find_spec(package)
    if spec is None:
        raise Missing(f"{package} isn't installed")
    model = Path(spec.submodule_search_locations[0]) / file
    with tempfile.TemporaryDirectory() as folder:
        robot, driven = robot_of(case, CASES[case], model, Path(folder))
        truth, reference = recorded(CASES[case], robot, driven)
        return robot, reference, truth


def _code(path):
    spec = importlib.util.spec_from_file_location(f"lab_of_{path.parent.name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def row(race):
    """Name, parameters, trials, target and seconds of an evaluation, in a line."""
    values = race.truth or race.space.published
    began, rounds = time.perf_counter(), 3
    for _ in range(rounds):
        race.problem.evaluate(values)
    seconds = (time.perf_counter() - began) / rounds
    counts = f"{len(race.space):11d}{len(race.problem.trials):8d}"
    known = "hidden values" if race.truth else "best known"
    return f"{race.name:14s}{counts}{1e3 * race.target:12.3f}{seconds:12.3f}   {known}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", nargs="*", metavar="NAME", help="problems to show; all by default", required=True)
    parser.add_argument("--demo", type=Path, help="folder `reference` of a demo")
    parser.add_argument("--threads", type=int, default=1)
    a = parser.parse_args()
    print(f"{'problem':14s}{'parameters':>11s}{'trials':>8s}{'target mm':>12s}{'seconds':>12s}   target of")
    for name in a.list or NAMES:
        try:
            print(row(load(name, a.threads, a.demo)), flush=True)
        except Missing as reason:
            print(f"{name:14s}  skipped: {reason}", file=sys.stderr)


if __name__ == "__main__":
    main()
