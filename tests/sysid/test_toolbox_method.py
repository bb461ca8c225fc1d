"""Method mujoco-sysid: the toolbox's own least squares, and nothing else."""

import io
import sys

import mujoco
import numpy as np
import pytest
from mujoco import sysid

import pools
from swim2real.calibration import RunFolder
from swim2real.errors import MissingExtraError
from swim2real.optimizers import Evaluation, first_point, streams
from swim2real.optimizers.callback import CallbackSolver
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.pipeline import calibrate, make_optimizer
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings
from swim2real.sysid import least_squares

D = 4
GOAL = np.array([0.3, 0.8, 0.55, 0.1])
SPACE = ParameterSpace(tuple(Parameter(f"p{i}", "-", 0.0, 2.0, "A number.", 1.0) for i in range(D)), "linear")


def residual_of(point: np.ndarray) -> np.ndarray:
    x = point - GOAL
    return np.concatenate([10 * (x[1:] - x[:-1] ** 2), x])


def drive(optimizer: CallbackSolver, count: int) -> np.ndarray:
    points = []
    for _ in range(count):
        candidate = optimizer.ask()
        points.append(candidate.point)
        residual = residual_of(candidate.point)
        optimizer.tell(Evaluation(candidate, float(np.linalg.norm(residual)), residual=residual))
    return np.array(points)


def make(seed: int = 0) -> CallbackSolver:
    return CallbackSolver(first_point(D, seed), streams(seed)[1], least_squares(SPACE), "mujoco.sysid")


def test_its_candidates_are_those_of_the_toolbox_left_alone():
    first, seen = first_point(D, 0), []

    def residual(columns, _):
        seen.extend(columns.T.copy())
        return [np.array([residual_of(column) for column in columns.T]).T], [], []

    parameters = sysid.ParameterDict()
    for name, place in zip(SPACE.names, first, strict=True):
        parameters.add(sysid.Parameter(name, place, 0.0, 1.0))
    best, _ = sysid.optimize(parameters, residual, verbose=False, output=io.StringIO())
    np.testing.assert_allclose(best.as_vector(), GOAL, atol=1e-6)
    points = drive(make(), len(seen) + 1)
    np.testing.assert_array_equal(points[:-1], seen)
    assert np.abs(points[-1] - GOAL).max() > 0.01  # a new start


def test_it_says_nothing_on_its_own(capfd):
    drive(make(), 60)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_a_run_with_all_of_the_fishs_parameters_goes_on_as_if_never_stopped(tmp_path):
    def entries(folder) -> list[dict]:
        return [{key: value for key, value in one.items() if key != "seconds"} for one in RunFolder(folder).record()]

    def go(folder, budget: int, resume: bool = False) -> None:
        calibrate(
            swims, FISH, CalibrationSettings(method="mujoco-sysid", budget=budget, threads=2), folder, resume=resume
        )

    swims = pools.film(frequencies=(1.6,), seconds=1.5)
    go(tmp_path / "whole", 20)
    go(tmp_path / "parts", 18)
    go(tmp_path / "parts", 20, resume=True)
    assert entries(tmp_path / "parts") == entries(tmp_path / "whole")
    losses = [one["loss"] for one in entries(tmp_path / "whole")]
    assert min(losses[17:]) < losses[0]  # after a Jacobian, steps that go down
    assert {one["note"]["source"] for one in entries(tmp_path / "whole")} == {"first point", "mujoco.sysid"}


def test_without_its_libraries_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setattr(mujoco, "sysid", mujoco.sysid)  # is put back afterwards
    for name in [name for name in sys.modules if name.startswith("mujoco.sysid")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "tabulate", None)  # one of them
    with pytest.raises(MissingExtraError) as caught:
        make_optimizer("mujoco-sysid", FISH, FISH.space, 0, 40)
    assert str(caught.value) == (
        "MuJoCo's identification toolbox isn't installed; install it with: pip install 'swim2real[sysid]'"
    )
