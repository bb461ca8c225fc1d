"""The physics advisor of a robot that it knows nothing of, in worlds whose residual is a function of the point."""

from collections.abc import Callable

import numpy as np
import pytest

from swim2real.advisor.physics.sensitivity import SensitivityAdvisor
from swim2real.optimizers import BacktrackingLineSearch, Evaluation, first_point
from swim2real.optimizers.advisor import MEASUREMENT, recorded_advice
from swim2real.parameters import Parameter, ParameterSpace

Residual = Callable[[np.ndarray], np.ndarray]
NAMES = ("spring", "damper", "mass", "paint")
SPACE = ParameterSpace(tuple(Parameter(name, "N", 1.0, 9.0, f"what {name} does", 3.0) for name in NAMES), "linear")
GOAL = np.array([0.3, 0.8, 0.6, 0.5])
ROWS = 0.1 * np.random.default_rng(0).normal(size=(40, 4))
ROWS[:, 3] = 0.0  # paint has no effect


def bent(point: np.ndarray) -> np.ndarray:
    """Zero at the goal, whatever the paint, and no straight line on the way."""
    away = point - GOAL
    return ROWS @ (away + 0.4 * away**2)


def only_the_product(point: np.ndarray) -> np.ndarray:
    """Of damper and mass, whose values are 1 + 8 x, the product alone counts."""
    values = 1 + 8 * point
    return ROWS[:, 0] * (point[0] - GOAL[0]) + ROWS[:, 1] * (np.log(values[1] * values[2]) - 3.0)


def search(
    count: int, residual: Residual = bent, seed: int = 0, failed: Callable[[int], bool] = lambda i: False
) -> tuple[BacktrackingLineSearch, list[Evaluation]]:
    optimizer = BacktrackingLineSearch(SensitivityAdvisor(SPACE, seed), first_point(len(SPACE), seed))
    told: list[Evaluation] = []
    for i in range(count):
        candidate = optimizer.ask()
        vector = residual(candidate.point)
        loss = 1.0 if failed(i) else float(np.sqrt(np.sum(vector**2)))
        told.append(Evaluation(candidate, loss, failed(i), residual=vector))
        optimizer.tell(told[-1])
    return optimizer, told


def sources(told: list[Evaluation]) -> list[str]:
    return [str(e.candidate.note.get("parameter", e.candidate.note["source"])) for e in told]


def test_it_measures_each_parameter_at_the_best_place_and_then_steps():
    _, told = search(6)
    assert sources(told) == ["first point", *NAMES, "line search"]
    here = told[0]
    for i, one in enumerate(told[1:], start=1):
        if "parameter" in one.candidate.note:
            moved = np.flatnonzero(one.candidate.point - here.candidate.point)
            assert [NAMES[k] for k in moved] == [one.candidate.note["parameter"]]
        if one.loss < here.loss:
            here = told[i]


@pytest.mark.parametrize("seed", range(6))
def test_it_finds_what_has_an_effect(seed):
    _, told = search(24, seed=seed)
    best = min(told, key=lambda e: e.loss)
    np.testing.assert_allclose(best.candidate.point[:3], GOAL[:3], atol=0.01)
    assert best.loss < 0.02 * told[0].loss


def test_what_isnt_seen_is_named_alone_or_as_a_product():
    optimizer, told = search(24)
    first = optimizer.rounds[0]
    assert first.proposal.notes["not_identified"] == ["paint"]
    assert "It hardly answers to paint: these trials don't determine it so far." in first.proposal.diagnosis
    stepped = [e.candidate.point[3] for e in told if e.candidate.note["source"] == "line search"]
    assert set(stepped) == {first.incumbent.candidate.point[3]}
    optimizer, told = search(20, only_the_product)
    proposal = optimizer.rounds[0].proposal
    assert {"damper", "mass", "paint"} == set(proposal.notes["not_identified"])
    assert "Of damper and mass only the product is seen." in proposal.diagnosis
    assert min(e.loss for e in told) < 1e-3


@pytest.mark.parametrize("worst", [0, 2])
def test_simulations_that_fail_are_walked_round(worst):
    _, told = search(34, failed=lambda i: i <= worst or i == 6)
    best = min((e for e in told if not e.failed), key=lambda e: e.loss)
    np.testing.assert_allclose(best.candidate.point[:3], GOAL[:3], atol=0.02)


def test_a_parameter_whose_step_fails_is_tried_to_the_other_side_once():
    _, told = search(8, failed=lambda i: i == 1)
    assert sources(told)[:4] == ["first point", "spring", "spring", "damper"]
    here, one, other = (e.candidate.point[0] for e in told[:3])
    assert one - here == pytest.approx(here - other)


def test_the_same_run_again_is_the_same_and_its_record_holds_all_that_was_advised():
    (_, once), (_, again) = search(20, seed=3), search(20, seed=3)
    np.testing.assert_array_equal([e.candidate.point for e in once], [e.candidate.point for e in again])
    entries = [{"point": list(e.candidate.point), "note": dict(e.candidate.note)} for e in once]
    measured = sum(e.candidate.note["source"] == MEASUREMENT for e in once)
    proposals = sum("proposal" in e.candidate.note for e in once)
    assert len(recorded_advice(entries)) == measured + proposals
