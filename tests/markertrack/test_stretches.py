import numpy as np
import pytest

from markertrack.corrections import expected_places, find_stretches
from markertrack.track import MarkerTrack

NAN = float("nan")
GRID = np.array([[100.0, 100.0], [130.0, 100.0], [160.0, 100.0], [400.0, 100.0]])  # M3 is far from the others
FRAMES = 60


def track(*failures, places=GRID):
    """Markers that move together on a circle; each failure is a marker, its first and last frame, its confidence."""
    phase = np.linspace(0, 4 * np.pi, FRAMES)
    positions = places + 20 * np.stack([np.cos(phase), np.sin(phase)], axis=1)[:, None]
    confidence = np.ones(positions.shape[:2])
    for marker, first, last, sure in failures:
        confidence[first : last + 1, marker] = sure
        positions[first : last + 1, marker] += 5.0 if sure else NAN
    return MarkerTrack(np.arange(FRAMES) / 30, positions, confidence)


def found(*failures):
    return [(s.markers, s.first, s.last, s.reason, s.failures) for s in find_stretches(track(*failures))]


@pytest.mark.parametrize(
    ("failures", "stretches"),
    [
        ([], []),
        ([(1, 10, 19, 0.0)], [((1,), 10, 19, "lost", 10)]),
        ([(1, 10, 19, 0.49)], [((1,), 10, 19, "doubtful", 10)]),
        ([(1, 10, 19, 0.5)], []),
        ([(1, 0, 59, 0.0)], [((1,), 0, 59, "lost", 60)]),
        ([(1, 0, 0, 0.0), (1, 59, 59, 0.3)], [((1,), 0, 0, "lost", 1), ((1,), 59, 59, "doubtful", 1)]),
        ([(1, 10, 12, 0.0), (1, 18, 20, 0.3)], [((1,), 10, 20, "lost", 6)]),  # 5 good frames between them
        ([(1, 10, 12, 0.0), (1, 19, 21, 0.3)], [((1,), 10, 12, "lost", 3), ((1,), 19, 21, "doubtful", 3)]),
        ([(1, 10, 19, 0.0), (2, 12, 22, 0.3)], [((1, 2), 10, 22, "doubtful", 21)]),  # near one another, at once
        ([(2, 10, 19, 0.0), (3, 10, 20, 0.0)], [((3,), 10, 20, "lost", 11), ((2,), 10, 19, "lost", 10)]),
        ([(1, 10, 19, 0.0), (2, 10, 59, 0.0)], [((2,), 10, 59, "lost", 50), ((1,), 10, 19, "lost", 10)]),
    ],
)
def test_stretches(failures, stretches):
    assert found(*failures) == stretches


def test_a_lost_marker_is_expected_where_it_moves_with_its_neighbors():
    whole = track().positions
    for failures in ([(1, 5, 50, 0.0)], [(1, 5, 50, 0.3)], [(1, 20, 59, 0.0)], [(1, 0, 40, 0.0), (2, 5, 9, 0.0)]):
        np.testing.assert_allclose(expected_places(track(*failures))[:, 1], whole[:, 1], atol=5.0)  # a turn is 40 px
    np.testing.assert_allclose(expected_places(track((1, 5, 50, 0.0)))[:, 1], whole[:, 1], atol=1e-9)


def test_markers_that_were_never_sure():
    doubted, never = track((1, 0, 59, 0.3)), track((1, 0, 59, 0.0))
    np.testing.assert_allclose(expected_places(doubted), doubted.positions, atol=1e-9)
    assert np.isnan(expected_places(never)[:, 1]).all()
    assert np.isfinite(expected_places(never)[:, [0, 2, 3]]).all()
    alone = track((0, 10, 19, 0.0), places=GRID[:1])
    assert [s.markers for s in find_stretches(alone)] == [(0,)]
    np.testing.assert_allclose(np.diff(expected_places(alone)[9:21, 0], n=2, axis=0), 0, atol=1e-9)  # a straight line
