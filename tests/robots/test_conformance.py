"""The fish against stored trajectories: those of the published model, and our own."""

import numpy as np
import pytest
from make_trajectories import DURATION, INTERVAL, PLACE, swim

from swim2real.robots.fish import FISH

MOVING = (0, 1)  # parameter sets of the reference that swim; the other two hardly do


@pytest.fixture(scope="module")
def rollouts(shared):
    place = shared / "reference" / "fish_rollouts.npz"
    if not place.is_file():
        pytest.skip(f"no reference rollouts at {place}")
    with np.load(place) as stored:
        return dict(stored)


QUICK = [(0, 1.5), (1, 1.0), (3, 2.0)]
SLOW = [(0, 0.5), (0, 1.0), (1, 0.5), (1, 1.5), (1, 2.0), (2, 1.0), (3, 1.5)]


@pytest.mark.parametrize(
    ("number", "frequency"), [*QUICK, *(pytest.param(*pair, marks=pytest.mark.slow) for pair in SLOW)]
)
def test_the_fish_swims_as_the_published_model(rollouts, new_fluid_law, number, frequency):
    values = dict(zip(FISH.space.names, map(float, rollouts["parameters"][number]), strict=True))
    column = int(np.flatnonzero(rollouts["frequencies"] == frequency)[0])
    expected = rollouts["markers"][number, column]
    np.testing.assert_allclose(rollouts["times"], np.arange(301) / 100)
    markers = swim(values, frequency, duration=3.0, interval=10)
    error = np.linalg.norm(markers - expected, axis=2).mean()
    if not new_fluid_law:
        assert error < 1e-3
    else:  # another fluid law: as stable, and another swim
        assert error < 0.1
        assert number not in MOVING or error > 1e-3


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("column", range(2))
def test_the_fish_swims_as_it_did(new_fluid_law, number, column):
    with np.load(PLACE) as stored:
        values = dict(zip(FISH.space.names, map(float, stored["parameters"][number]), strict=True))
        frequency, expected = float(stored["frequencies"][column]), stored["markers"][number, column]
    markers = swim(values, frequency, DURATION, INTERVAL)
    error = np.linalg.norm(markers - expected, axis=2).mean()
    assert np.linalg.norm(np.ptp(expected[:, 8], axis=0)) > 0.02  # it does move
    if new_fluid_law:
        assert 1e-4 < error < 0.1
    else:
        assert error < 1e-4
