import numpy as np
import pytest
from driving import drive, lowest, notes, points

from swim2real.optimizers import streams
from swim2real.optimizers.cma_es import CmaEs

D = 6


def bowl(point: np.ndarray) -> float:
    """Lowest at 0.3, with axes 1 to 10 long."""
    return float((np.linspace(1, 10, point.size) * np.square(point - 0.3)).sum())


def rosenbrock(point: np.ndarray) -> float:
    x = 4 * point - 2
    return float((100 * np.square(x[1:] - x[:-1] ** 2) + np.square(1 - x[:-1])).sum())


def failing(point: np.ndarray) -> float:
    """Half of the cube fails; the search leaves it."""
    return 1000.0 if point[0] > 0.5 else bowl(point)


def make(seed: int = 0, **settings) -> CmaEs:
    return CmaEs(D, streams(seed)[1], **settings)


@pytest.mark.parametrize(
    ("seed", "loss", "count", "found"),
    [(0, bowl, 1000, 1e-6), (1, np.sum, 700, 0.02), (2, rosenbrock, 1800, 1.0), (4, failing, 240, 0.01)],
)
def test_what_it_finds(seed, loss, count, found):
    told = drive(make(seed), count, loss)
    assert told[0].loss > 100 * found
    assert np.all((points(told) >= 0) & (points(told) <= 1))
    assert lowest(told) < found
    fails = [one.loss == 1000.0 for one in told]
    assert loss is not failing or np.mean(fails[:24]) > np.mean(fails[-24:])


def test_forty_evaluations_are_three_generations_and_four_candidates():
    found = notes(drive(make(), 40, bowl))
    assert [(note["generation"], note["number"]) for note in found[:13:12]] == [(1, 1), (2, 1)]
    assert [(note["generation"], note["number"]) for note in found[36:]] == [(4, k) for k in (1, 2, 3, 4)]
    assert {note["start"] for note in found} == {1}


def test_a_generation_depends_on_whole_generations_only():
    """What a cut-off generation was worth teaches nothing: its other candidates stay the same."""
    one, other = make(), make()
    drive(one, 24, bowl), drive(other, 24, bowl)
    after = [drive(one, 12, lambda point: 1.0), drive(other, 12, lambda point: point[0])]
    np.testing.assert_array_equal(points(after[0]), points(after[1]))
    assert not np.array_equal(points(drive(one, 12)), points(drive(other, 12)))


def test_when_all_losses_are_equal_another_start_is_made_and_noted():
    told = drive(make(), 360, bowl, failed=lambda i: True, worst=1000.0)
    starts = notes(told, "start")
    assert starts == sorted(starts)
    changes = np.flatnonzero(np.diff(starts)) + 1
    assert changes.size
    assert np.all(changes % 12 == 0)
    assert {told[i].candidate.note["number"] for i in changes} == {1}


def test_a_search_that_has_converged_begins_anew():
    told = drive(make(population=6), 1500, bowl)
    first, anew = ([one for one in told if one.candidate.note["start"] == start] for start in (1, 2))
    assert lowest(first) < 1e-6
    assert points(anew[:6]).std(axis=0).mean() > 0.05
