"""Corrections: what a click changes of a track, and what it leaves as it was; on the pictures of `test_bodies`."""

import numpy as np
import pytest
from test_bodies import FPS, ROW, drawn

from markertrack.corrections import corrected, gaps_to_correct
from markertrack.points import Anchor
from markertrack.quality import DOUBTFUL
from markertrack.track import MarkerTrack

FRAMES, FIRST, LAST = 44, 12, 31  # of the track, and of the stretch that is wrong: 20 frames
BODIES = [1, 1, 1, 1, 0, 0, 0]
OTHER = 5  # the marker that the corrected one is mistaken for
WRONG = 2


def truth(frame):
    """A row that swings by up to 5 px a frame; it is more than one body."""
    phase = 2 * np.pi * frame / 40
    return ROW + np.array([30 * (1 - np.cos(phase)), 60 + 20 * np.sin(phase)])


TRUTH = np.array([truth(frame) for frame in range(FRAMES)])
PICTURES = [drawn(truth, seed=frame)(frame) for frame in range(FRAMES)]


def track(*changes):
    """The true track, a little beside it; each change is a marker (or all), frames, a place (or None), a confidence."""
    positions = TRUTH + np.random.default_rng(1).normal(0, 0.05, TRUTH.shape)
    confidence = np.random.default_rng(2).uniform(0.8, 1.0, TRUTH.shape[:2])
    for marker, first, last, place, sure in changes:
        part = np.s_[first : last + 1, marker]
        positions[part], confidence[part] = positions[part] if place is None else place, sure
    return MarkerTrack(np.arange(FRAMES) / FPS, positions, confidence)


def lost(marker=WRONG, first=FIRST, last=LAST):
    return marker, first, last, np.nan, 0.0


DOUBTED = np.s_[:], FIRST, LAST, None, 0.4


def click(frame, off=(0.0, 0.0), markers=(WRONG,), hidden=()):
    points = np.full((len(ROW), 2), np.nan)
    points[list(markers)] = TRUTH[frame, list(markers)] + off
    return Anchor(frame, points, np.isin(np.arange(len(ROW)), hidden))


def after(before, *anchors, bodies=BODIES):
    """The corrected track, and the gaps."""
    cleaned, gaps = gaps_to_correct(before, anchors, bodies)
    for gap in gaps:
        frames = range(max(gap.begin, 0), min(gap.end + 1, FRAMES))
        for frame in frames:
            gap.forth.see(PICTURES[frame], frame, frame)
        for frame in reversed(frames):
            gap.back.see(PICTURES[frame], frame, -frame)
    return corrected(cleaned, gaps), gaps


def off(found, marker=WRONG):
    return np.linalg.norm(found.positions[:, marker] - TRUTH[:, marker], axis=1)


@pytest.mark.parametrize("frame", [FIRST, 20, LAST])
def test_a_lost_stretch_is_restored_from_one_click_and_the_rest_stays(frame):
    before = track(lost())
    found, gaps = after(before, click(frame, off=(0.3, -0.2)))
    assert [(gap.marker, gap.first, gap.last) for gap in gaps] == [(WRONG, FIRST, LAST)]
    assert off(found).max() < 0.5
    assert (found.confidence[:, WRONG] >= DOUBTFUL).all()
    assert found.confidence[frame, WRONG] == 1.0
    kept = np.ones(TRUTH.shape[:2], dtype=bool)
    kept[FIRST : LAST + 1, WRONG] = False
    np.testing.assert_array_equal(found.positions[kept], before.positions[kept])
    np.testing.assert_array_equal(found.confidence[kept], before.confidence[kept])
    np.testing.assert_array_equal(found.times, before.times)
    assert np.isnan(before.positions[FIRST, WRONG]).all()  # what is given isn't written to


def test_a_sure_stretch_that_a_click_contradicts_is_replaced():
    """For 20 frames a marker was taken for another, with no doubt: what is sure around the click goes with it."""
    there_and_back = [(WRONG, frame, frame, None, 0.3) for frame in (FIRST - 1, LAST + 1)]
    before = track((WRONG, FIRST, LAST, TRUTH[FIRST : LAST + 1, OTHER], 0.9), *there_and_back)
    found, gaps = after(before, click(20))
    assert [(gap.first, gap.last) for gap in gaps] == [(FIRST - 1, LAST + 1)]
    assert off(found).max() < 0.5
    assert (found.confidence[:, WRONG] >= DOUBTFUL).all()
    np.testing.assert_array_equal(np.delete(found.positions, WRONG, 1), np.delete(before.positions, WRONG, 1))


def test_a_click_that_agrees_with_a_doubted_place_confirms_the_body():
    before = track(DOUBTED)
    jumping = track(DOUBTED, (WRONG, 26, LAST, TRUTH[26 : LAST + 1, WRONG + 1], 0.4))  # over to the next one at once
    sure = after(jumping, click(20))[0].confidence[:, WRONG] >= DOUBTFUL
    assert sure[: 25 + 1].all()
    assert not sure[26 : LAST + 1].any()
    found, gaps = after(before, click(20, off=(1.0, 0.5)))
    assert not gaps
    np.testing.assert_array_equal(found.positions, before.positions)
    same = np.array(BODIES) == BODIES[WRONG]
    assert (found.confidence[:, same] >= DOUBTFUL).all()
    assert (found.confidence[FIRST : LAST + 1, ~same] < DOUBTFUL).all()


def test_a_click_on_a_marker_that_moves_by_itself_says_nothing_of_doubted_places_beside_it():
    """They drift away from it steadily: it is followed anew."""
    drift = TRUTH[FIRST : LAST + 1, WRONG] + 2.0 * (np.arange(FIRST, LAST + 1) - 20)[:, None]
    found, (gap,) = after(track((WRONG, FIRST, LAST, drift, 0.4)), click(20), bodies=range(len(ROW)))
    assert (gap.first, gap.last) == (FIRST, LAST)
    assert off(found).max() < 0.5
    assert (found.confidence[:, WRONG] >= DOUBTFUL).all()


def test_hidden_loses_the_marker_around_its_frame_only():
    before = track()
    found, gaps = after(before, click(20, markers=(), hidden=(WRONG,)))
    gone = np.zeros(TRUTH.shape[:2], dtype=bool)
    gone[15:26, WRONG] = True
    assert not gaps
    assert np.isnan(found.positions[gone]).all()
    assert not found.confidence[gone].any()
    np.testing.assert_array_equal(found.positions[~gone], before.positions[~gone])
    np.testing.assert_array_equal(found.confidence[~gone], before.confidence[~gone])


def test_a_marker_isnt_followed_through_a_frame_in_which_it_is_hidden():
    found, (gap,) = after(track(lost()), click(16), click(26, markers=(), hidden=(WRONG,)))
    assert gap.hidden == {26}
    assert np.isnan(found.positions[26, WRONG]).all()
    assert found.confidence[26, WRONG] == 0.0
    assert np.nanmax(off(found)) < 0.5
    assert (found.confidence[FIRST:24, WRONG] >= DOUBTFUL).all()


@pytest.mark.parametrize(("first", "last"), [(0, 9), (0, FRAMES - 1)])
def test_a_stretch_at_an_end_of_the_film_is_followed_from_clicks_alone(first, last):
    before = track(lost(WRONG, first, last))
    middle = (first + last) // 2
    found, gaps = after(before, click(middle), click(min(middle + 4, last)))
    assert [(gap.first, gap.last) for gap in gaps] == [(first, last)]
    assert off(found)[middle : middle + 5].max() < 0.5
    assert np.nanmax(np.where(found.confidence[:, WRONG] >= DOUBTFUL, off(found), 0)) < 3.0


def test_two_markers_are_corrected_in_the_same_frame_each_by_itself():
    before = track(lost(), lost(OTHER, 18, 24))
    found, gaps = after(before, click(21, markers=(WRONG, OTHER)))
    assert [(gap.marker, gap.first, gap.last) for gap in gaps] == [(WRONG, FIRST, LAST), (OTHER, 18, 24)]
    assert max(off(found).max(), off(found, OTHER).max()) < 0.5
    assert (found.confidence >= DOUBTFUL).all()
