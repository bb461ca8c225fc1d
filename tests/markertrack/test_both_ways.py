"""What the two ways over a break tell together."""

import numpy as np
import pytest

from markertrack.gaps import joined

FRAMES = 40


def way(begin, end):
    """Positions (40, 1, 2) of a marker that is certain all the time, along a straight line [px], and confidence."""
    return np.linspace(begin, end, FRAMES)[:, None], np.ones((FRAMES, 1))


@pytest.mark.parametrize("beside", [0.0, 2.0, 9.0])
def test_where_both_ways_are_certain_of_different_places_nobody_knows(beside):
    forth, back = way([10.0, 10.0], [90.0, 10.0]), way([10.0, 10.0], [90.0, 10.0])
    back[0][15:25] += [0.0, beside]  # it followed something else for a while
    positions, confidence = joined(forth, back, np.array([5.0]))
    sure = confidence[:, 0] > 0.5
    assert np.array_equal(np.flatnonzero(~sure), np.arange(15, 25) if beside > 3 else [])
    assert np.array_equal(positions[sure], forth[0][sure])
