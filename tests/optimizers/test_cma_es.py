import sys

import numpy as np
import pytest

from swim2real.errors import MissingExtraError, OptimizerError
from swim2real.optimizers import Candidate, Evaluation, Optimizer, first_point, streams
from swim2real.optimizers.cma_es import CmaEs

D = 6


def bowl(candidate: Candidate) -> float:
    """Lowest at 0.3, with axes 1 to 10 long."""
    return float((np.linspace(1, 10, candidate.point.size) * np.square(candidate.point - 0.3)).sum())


def drive(optimizer: Optimizer, count: int, loss=bowl, failed=lambda i: False) -> list[Evaluation]:
    told = []
    for i in range(count):
        candidate = optimizer.ask()
        lost = failed(i)
        told.append(Evaluation(candidate, 1000.0 if lost else loss(candidate), lost))
        optimizer.tell(told[-1])
    return told


def points(told: list[Evaluation]) -> np.ndarray:
    return np.array([one.candidate.point for one in told])


def make(seed: int = 0, **settings) -> CmaEs:
    return CmaEs(D, streams(seed)[1], **settings)


def test_a_bowl_is_solved():
    told = drive(make(), 1000)
    assert min(one.loss for one in told) < 1e-6


def test_a_minimum_in_a_corner_is_found_within_the_cube():
    told = drive(make(1), 700, lambda candidate: float(candidate.point.sum()))
    assert np.all((points(told) >= 0) & (points(told) <= 1))
    assert min(one.loss for one in told) < 0.02


def test_rosenbrocks_valley_is_followed():
    def rosenbrock(candidate: Candidate) -> float:
        x = 4 * candidate.point - 2
        return float((100 * np.square(x[1:] - x[:-1] ** 2) + np.square(1 - x[:-1])).sum())

    told = drive(make(2), 1800, rosenbrock)
    assert told[0].loss > 100
    assert min(one.loss for one in told) < 1.0


def test_the_start_is_random_and_its_own():
    told = points(drive(make(3), 12))
    assert not np.any(np.all(told == first_point(D, 3), axis=1))
    np.testing.assert_allclose(told.std(axis=0).mean(), 0.2, atol=0.08)


def test_forty_evaluations_are_three_generations_and_four_candidates():
    notes = [one.candidate.note for one in drive(make(), 40)]
    assert [(note["generation"], note["number"]) for note in notes[:13:12]] == [(1, 1), (2, 1)]
    assert [note["number"] for note in notes[36:]] == [1, 2, 3, 4]
    assert {note["generation"] for note in notes[36:]} == {4}
    assert {note["start"] for note in notes} == {1}


def test_a_generation_depends_on_whole_generations_only():
    """What a cut-off generation was worth teaches nothing: its other candidates stay the same."""
    one, other = make(), make()
    drive(one, 24), drive(other, 24)
    after = [drive(one, 12, lambda c: 1.0), drive(other, 12, lambda c: float(c.point[0]))]
    np.testing.assert_array_equal(points(after[0]), points(after[1]))
    assert not np.array_equal(points(drive(one, 12)), points(drive(other, 12)))


def test_failed_evaluations_push_the_search_away():
    """Half of the cube fails; the search leaves it."""

    def loss(candidate: Candidate) -> float:
        return 1000.0 if candidate.point[0] > 0.5 else bowl(candidate)

    told = drive(make(4), 240, loss)
    assert np.mean([one.loss == 1000.0 for one in told[:24]]) > np.mean([one.loss == 1000.0 for one in told[-24:]])
    assert min(one.loss for one in told) < 0.01


def test_when_all_losses_are_equal_another_start_is_made_and_noted():
    told = drive(make(), 360, failed=lambda i: True)
    starts = [one.candidate.note["start"] for one in told]
    assert starts == sorted(starts)
    assert starts[-1] > 1
    changes = np.flatnonzero(np.diff(starts)) + 1
    assert np.all(changes % 12 == 0)
    assert [told[i].candidate.note["number"] for i in changes] == [1] * len(changes)


def test_a_search_that_has_converged_begins_anew():
    told = drive(make(population=6), 1500)
    first = [one for one in told if one.candidate.note["start"] == 1]
    assert len(first) < 1500
    assert min(one.loss for one in first) < 1e-6
    anew = points([one for one in told if one.candidate.note["start"] == 2])[:6]
    assert anew.std(axis=0).mean() > 0.05


def test_the_same_losses_give_the_same_points_to_the_last_bit():
    recorded = drive(make(7), 60)
    again = make(7)
    for one in recorded:
        candidate = again.ask()
        assert candidate.point.tobytes() == one.candidate.point.tobytes()
        assert candidate.note == one.candidate.note
        again.tell(Evaluation(candidate, one.loss))
    assert not np.array_equal(points(drive(make(8), 12)), points(recorded[:12]))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dimension": 1}, "dimension is 1; CMA-ES needs at least 2"),
        ({"population": 3}, "population is 3; it must be at least 4"),
        ({"sigma": 0.0}, "sigma is 0.0; it must be above 0 and at most 1"),
        ({"sigma": np.nan}, "sigma is nan; it must be above 0 and at most 1"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(OptimizerError) as caught:
        CmaEs(**{"dimension": D, "rng": streams(0)[1], **settings})
    assert str(caught.value) == message


def test_without_pycma_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(MissingExtraError) as caught:
        make()
    assert str(caught.value) == "method cma-es needs pycma; install it with: pip install 'swim2real[compare]'"
