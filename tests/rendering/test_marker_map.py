"""The map of a robot's markers: dots, links, names and the scale bar."""

import numpy as np
import pytest

from swim2real.rendering.marker_map import DOT, GROUND, LINE, marker_map
from swimbase.errors import ArgumentError

NAMES = ("nose", "fin", "tail")


def colored(picture, color) -> np.ndarray:
    return np.argwhere((picture == color).all(axis=2))


def test_markers_stand_as_the_camera_sees_them_with_lines_between():
    picture = marker_map([[0.0, 0.0], [0.3, 0.1], [0.6, 0.0]], NAMES, [], ("x", "z"), "a fish")
    assert picture.dtype == np.uint8
    assert picture.shape[1:] == (1000, 3)
    rows, columns = colored(picture, DOT).T
    left, right = columns < 400, columns > 600
    middle = ~left & ~right
    assert rows[middle].mean() < rows[left].mean() - 50  # z is up
    assert rows[left].mean() == pytest.approx(rows[right].mean(), abs=1)
    scale = (columns[right].mean() - columns[left].mean()) / 0.6
    assert (rows[left].mean() - rows[middle].mean()) / scale == pytest.approx(0.1, abs=0.002)
    positions = [[0.0, 0.0], [0.3, 0.2], [0.6, 0.0]]
    without = marker_map(positions, NAMES, [], ("x", "y"), "")
    linked = marker_map(positions, NAMES, [(0, 2)], ("x", "y"), "")
    assert len(colored(without, LINE)) == 0
    rows, columns = colored(linked, LINE).T
    assert np.ptp(rows) < 10
    assert np.ptp(columns) > 600


def test_names_stand_beside_markers_and_not_on_one_another():
    crowd = np.array([[0.02 * i, 0.0] for i in range(12)])
    names = [f"marker{i}" for i in range(12)]
    picture = marker_map(crowd, names, [(i, i + 1) for i in range(11)], ("x", "y"), "")
    dots = colored(picture, DOT)
    whole = colored(marker_map(crowd, [" "] * 12, [], ("x", "y"), ""), DOT)
    assert len(dots) == len(whole)  # no name covers a marker
    above = (picture[: int(dots[:, 0].min())] != GROUND).any(axis=2)
    below = (picture[int(dots[:, 0].max()) + 1 :] != GROUND).any(axis=2)
    assert above.any()
    assert below.any()


@pytest.mark.parametrize(
    ("positions", "names", "width", "says"),
    [([[0.0, 0.0]], NAMES, 1000, "3 names"), ([[np.nan, 0.0]], ["nose"], 1000, "finite"),
     ([[0.0, 0.0]], ["nose"], 10, "width is 10 px")],
)  # fmt: skip
def test_what_cannot_be_drawn_is_refused(positions, names, width, says):
    with pytest.raises(ArgumentError, match=says):
        marker_map(positions, names, [], ("x", "y"), "", width)
