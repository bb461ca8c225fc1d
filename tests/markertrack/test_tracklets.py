"""Which of the things that are seen is a marker that was lost."""

import numpy as np
import pytest
from test_free import BLACK, MIDDLE, hidden, painted, tracked

from markertrack.tracking.colors import OwnColors
from markertrack.tracklets import Motion, Tracklet, belonging

ROOM = 640 * 480 * 60.0


def moving(first, last, start=(100.0, 200.0), step=(6.0, 1.0), marker=-1):
    """Something that moves evenly, by its place in frame 0."""
    return Tracklet(first, [np.array(start) + frame * np.array(step) for frame in range(first, last + 1)], marker)


KNOWN = moving(0, 10, marker=0)
STILL = [moving(first, first + 20, (40.0 * n, 30.0 * n), (0.0, 0.0)) for n, first in enumerate(range(0, 36, 4))]


@pytest.mark.parametrize("gap", [1, 5, 15])
def test_a_thing_that_moves_on_as_a_marker_did_is_it(gap):
    again = moving(10 + gap, 55)
    (found,) = belonging([KNOWN, *STILL, again], 0, 6.0, Motion(), ROOM, 0.9)
    assert (found.first, found.last) == (again.first, again.last)
    assert np.allclose(found.places, again.places)


def test_what_bounces_unseen_is_found():
    bounced = moving(14, 55, (100.0, 200.0 + 2 * 12.0), (6.0, -1.0))
    assert [one.first for one in belonging([KNOWN, *STILL, bounced], 0, 6.0, Motion(), ROOM, 0.9)] == [14]


def test_what_breaks_into_pieces_is_found():
    pieces = [moving(12, 19), moving(21, 30), moving(31, 33), moving(36, 55)]
    beside = [moving(18, 22, (100.0, 208.0)), moving(36, 38, (100.0, 209.0))]  # of its streak
    found = belonging([KNOWN, *STILL, *pieces, *beside], 0, 6.0, Motion(), ROOM, 0.9)
    assert [one.first for one in found] == [39, 21, 12, 31]  # it passes a still one


@pytest.mark.parametrize(
    "others",
    [
        [moving(15, 55, (100.0, 185.0)), moving(15, 55, (100.0, 215.0))],  # two that may be
        [moving(5, 55, (100.0, 260.0))],  # it was there when the marker was elsewhere
        [moving(15, 55, (400.0, 20.0))],  # too far away
        [moving(12, 20), moving(22, 55, marker=1)],  # it becomes another one
    ],
    ids=["two", "there before", "far", "another"],
)
def test_what_may_be_something_else_isnt_believed(others):
    assert belonging([KNOWN, *STILL, *others], 0, 6.0, Motion(), ROOM, 0.9) == []


def test_a_marker_that_was_hidden_is_found_among_others_like_it():
    def truth(frame):
        still = MIDDLE + np.array([[-120.0, 60.0], [30.0, 70.0], [110.0, -70.0]])
        return np.vstack([still, MIDDLE + np.array([4.0 * frame - 120, 0.0])])

    sure = tracked(truth, hidden(truth, range(15, 30), [3]), 50)
    assert sure[:, :3].all()
    assert not sure[15:30, 3].any()
    assert sure[32:, 3].all()


def test_places_of_a_markers_colors_are_found_but_not_areas_of_them():
    places = np.array([[100.0, 80.0], [180.0, 120.0]])
    image = painted(lambda _: places, lambda _: 7, lambda _: BLACK, texture=12.0)(0)
    image[200:280, 20:140] = BLACK
    found, clear = OwnColors(image, places, np.full(2, 7.0)).peaks(
        image, 0, 7.0, np.array([[20.0, 20.0], [100.0, 80.0]])
    )
    assert clear[0] < 0.1
    assert clear[1] > 0.9
    assert (np.linalg.norm(places[:, None] - found, axis=2).min(axis=1) < 1).all()
    assert not ((found > [30, 210]) & (found < [130, 270])).all(axis=1).any()
