"""The tracker of rigid bodies, on rows of equal dots that are drawn with the light of a whole exposure."""

import numpy as np
import pytest

from markertrack.tracking.body import Body
from markertrack.tracking.markers import MarkerTracker
from markertrack.tracking.rigid import LEAD, Expected, label, pairs_of
from swimbase.errors import TrackingError

WIDTH, HEIGHT, RADIUS, SPACING, FPS = 420, 240, 6, 32, 60
MOMENTS = 8  # of an exposure
ROW = np.stack([60 + SPACING * np.arange(7.0), np.full(7, 60.0)], axis=1)
FIXED = ROW + np.array([0, 120])
SHEET = np.stack(np.meshgrid(90 + 70 * np.arange(4.0), 60 + 60 * np.arange(3.0)), axis=2).reshape(-1, 2)
MIDDLE = np.array([WIDTH, HEIGHT]) / 2


def drawn(places, shutter=0.5, seed=0, radius=lambda frame: RADIUS, ground=lambda frame: 0.75):
    """Pictures of dark dots on light ground; `places` gives them at a time in frames. Shape (M, 2)."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]

    def picture(frame):
        coverage, size = np.zeros((HEIGHT, WIDTH)), radius(frame)
        reach = int(size) + 3
        for moment in (np.arange(MOMENTS) + 0.5) / MOMENTS - 0.5:
            for x, y in places(frame + shutter * moment):
                part = tuple(np.s_[max(int(v) - reach, 0) : max(int(v) + reach + 1, 0)] for v in (y, x))
                disc = np.hypot(columns[part] - x, rows[part] - y)
                coverage[part] += np.clip(size + 0.5 - disc, 0, 1) / MOMENTS
        light = ground(frame) * (1 - coverage) + 0.02 * coverage + rng.normal(0, 0.01, coverage.shape)
        return np.repeat((255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)[..., None], 3, axis=2)

    return picture


def followed(tracker, picture, picks, frames):
    """Positions (T, M, 2) and confidence (T, M)."""
    found = [tracker.start(picture(0), picks, 0.0)]
    found += [tracker.follow(picture(frame), frame / FPS) for frame in range(1, frames)]
    return tuple(np.array(part) for part in zip(*found, strict=True))


def errors(tracker, places, frames, shown=None, picture=None, **options):
    """Distance of what is found from the truth, and confidence. Shapes (T, M) each."""
    found, confidence = followed(tracker, picture or drawn(shown or places, **options), places(0), frames)
    return np.linalg.norm(found - np.array([places(frame) for frame in range(frames)]), axis=2), confidence


def silent(off, confidence):
    return np.argwhere((off > 3) & (confidence >= 0.5)).tolist()


def turned(points, angle, middle):
    return points @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]] + np.asarray(middle)


def swinging(frame):
    """A row that swings along itself from frame 5 on, by up to 19 px a frame, above one that stays."""
    phase = max(frame - 5, 0) * 2 * np.pi / 20
    return np.concatenate([ROW + np.array([60 * (1 - np.cos(phase)), 18 * np.sin(phase)]), FIXED])


def drifting(frame):
    """The camera drifts by 24 px, so a body that can't move does too."""
    return np.concatenate([ROW, FIXED]) + 24 * np.array([0.8, -0.6]) * np.clip(frame / 24, 0, 1)


def struck(frame):
    """Two equal markers on a link, from rest to 40 px a frame within four, beside two that stay."""
    link = turned(np.array([[120.0, 0.0], [180.0, 0.0]]), 0.08 * max(frame - 5, 0) ** 1.5, (0, 0))
    return np.concatenate([link, [[0.0, 0.0], [-40.0, 0.0]]]) + np.array([60.0, 40.0])


def stretched(frame):
    """A sheet that becomes 25 % longer and 15 % narrower, and bends, within 20 frames."""
    share = (1 - np.cos(np.pi * np.clip(frame / 20, 0, 1))) / 2
    places = MIDDLE + (SHEET - MIDDLE) * (1 + share * np.array([0.25, -0.15]))
    return places + share * np.stack([np.zeros(12), 6 * np.sin(places[:, 0] / 50)], axis=1)


def tilted(count):
    """Markers of a card that tilts by up to 69° out of the picture's plane, and back."""
    card = np.array([[-70.0, -30.0], [70.0, -30.0], [70.0, 30.0], [-70.0, 30.0]])[:count]

    def places(frame):
        return MIDDLE + card * [np.cos(1.2 * np.sin(frame * np.pi / 40)), 1.0] + [0.3 * frame, 0.0]

    return places


def growth(frame):
    return 2 ** np.clip(frame / 42, 0, 1)


def zoomed(frame):
    return MIDDLE + 0.5 * (SHEET - MIDDLE) * growth(frame)


@pytest.mark.parametrize(
    ("places", "bodies", "frames", "close"),
    [
        pytest.param(swinging, [1] * 7 + [0] * 7, 30, 1.5, marks=pytest.mark.slow),
        (drifting, [1] * 7 + [0] * 7, 30, 1.0), (struck, [1, 1, 0, 0], 11, 1.0),
        (stretched, [1] * 12, 26, 0.5), (stretched, range(12), 26, 0.5),
        pytest.param(zoomed, [1] * 12, 46, 0.5, marks=pytest.mark.slow), (zoomed, range(12), 46, 0.5),
    ],
)  # fmt: skip
def test_markers_are_followed(places, bodies, frames, close):
    options = {"radius": lambda frame: 4 * growth(frame)} if places is zoomed else {}
    off, confidence = errors(
        MarkerTracker(bodies, fixed=0 if list(bodies).count(0) > 1 else None), places, frames, **options
    )
    assert np.nanmax(off) < close
    assert (confidence >= 0.5).mean() > 0.95


def test_a_push_by_most_of_a_spacing_is_never_mistaken_silently():
    """The row's two ends are hidden, so it might as well have gone the other way, and not as far."""

    def truth(frame):
        return np.concatenate([ROW + np.array([20.0 if frame > 7.5 else 0, 0]), FIXED])

    def places(frame):
        return np.concatenate([truth(frame)[1 if frame > 3.5 else 0 : 6 if frame > 3.5 else 7], FIXED])

    tracker = MarkerTracker([1] * 7 + [0] * 7, fixed=0)
    off, confidence = errors(tracker, truth, 14, places, shutter=0.1)
    assert (confidence[:8, 1:6] > 0.5).all()
    assert (confidence[:, 7:] > 0.5).all()
    assert not ((off > 1) & (confidence >= 0.5)).any()
    assert (confidence[8:, 1:6] < 0.5).all()


def test_a_plate_that_turns_quickly_is_found_again():
    plate = np.array([[-60.0, -30.0], [50.0, -20.0], [0.0, 45.0]])

    def places(frame):
        return turned(plate, np.radians(25) * np.clip((frame - 5) / 5, 0, 1), (200, 120))

    off, confidence = errors(MarkerTracker([4] * 3), places, 20)
    assert (confidence[10:] > 0.5).all()
    assert np.nanmax(off[confidence > 0.5]) < 1


@pytest.mark.parametrize("count", [2, 4])
def test_markers_of_a_card_that_tilts_are_followed_though_its_shape_does_not_fit(count):
    off, confidence = errors(MarkerTracker([0] * count), tilted(count), 50)
    assert (confidence > 0.5).all()
    assert off.max() < 0.5


def test_a_marker_that_was_hidden_while_its_card_tilted_is_found_where_the_tilt_brought_it():
    places = tilted(4)
    off, confidence = errors(MarkerTracker([0] * 4), places, 30, lambda k: places(k)[: 3 if 3.5 < k < 14.5 else 4])
    assert (confidence[4:15, 3] < 0.5).all()
    assert (confidence[19:] > 0.5).all()
    assert off[confidence > 0.5].max() < 0.5


def test_markers_are_followed_while_their_ground_turns_away_from_the_light():
    def places(frame):
        return tilted(4)(0) + np.array([2.0 * frame, 0.5 * frame])

    off, confidence = errors(MarkerTracker([0] * 4), places, 26, ground=lambda frame: 0.75 * 0.9**frame)
    assert (confidence > 0.5).mean() > 0.98
    assert off.max() < 1.0


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_markers_are_followed_and_found_again(count):
    def places(frame):
        phase = 2 * np.pi * frame / 40
        bobs = np.array([[200 + 60 * np.sin(phase), 100 + 20 * np.cos(phase)], [300, 60 + 30 * np.sin(phase)]])
        return bobs[:count]

    picture = drawn(places)
    blank = drawn(lambda frame: np.empty((0, 2)))
    tracker = MarkerTracker(range(count))
    off, confidence = errors(tracker, places, 40, picture=lambda k: blank(k) if 10 <= k < 15 else picture(k))
    assert (confidence[:10] > 0.5).all()
    assert (confidence[10:15] < 0.5).all()
    assert (confidence[24:] > 0.5).all()
    assert off[confidence > 0.5].max() < 1.5


def test_a_marker_on_a_round_puck_is_no_larger_than_itself():
    puck = np.full((HEIGHT, WIDTH, 3), 100, np.uint8)
    away = np.hypot(*np.mgrid[-100 : HEIGHT - 100, -200 : WIDTH - 200])
    puck[away < 24], puck[away < 10] = 210, 130
    found, confidence = MarkerTracker([1]).start(puck, np.array([[201.0, 100.5]]), 0.0)
    np.testing.assert_allclose(found, [[200, 100]], atol=0.1)
    assert confidence[0] > 0.5


@pytest.mark.parametrize(
    ("point", "says"), [((500.0, 20.0), "in the frame of 420 x 240 px"), ((200.0, 100.0), r"stands out at .*\(200, ")]
)
def test_points_outside_and_on_nothing_are_refused(point, says):
    with pytest.raises(TrackingError, match=says):
        MarkerTracker([1]).start(np.full((HEIGHT, WIDTH, 3), 120, np.uint8), np.array([point]), 0.0)


def test_a_free_marker_that_was_hidden_is_found_where_it_went_with_the_others():
    def places(frame):
        phase, own = 2 * np.pi * frame / 50, 4 * np.sin(0.1 * frame + np.arange(12)) - 4 * np.sin(np.arange(12))
        return SHEET + np.stack([20 * np.sin(phase) + own, 15 * (1 - np.cos(phase)) + 0 * own], axis=1)

    off, confidence = errors(
        MarkerTracker(range(12)), places, 32, lambda k: np.delete(places(k), 5 if 9 < k < 16 else [], 0)
    )
    assert np.linalg.norm(places(16)[5] - places(9)[5]) > 10
    assert silent(off, confidence) == []
    assert (np.delete(confidence, 5, axis=1) >= 0.5).all()
    assert (confidence[10:16, 5] < 0.5).all()
    assert (confidence[20:, 5] >= 0.5).all()


@pytest.mark.parametrize(("gap", "turning"), [(1.0, False), (1.5, True)])  # radii
def test_equal_free_markers_that_meet_are_not_swapped_silently(gap, turning):
    """They pass each other, or turn back where they are closest."""

    def places(frame):
        along = 3.0 * (frame - 14)
        half = np.array([np.hypot(along, gap * RADIUS / 2), 0.0] if turning else [along, gap * RADIUS / 2])
        return np.concatenate([MIDDLE + np.array([-half, half]), SHEET[[0, 3, 8, 11]]])

    off, confidence = errors(MarkerTracker(range(6)), places, 29)
    assert silent(off, confidence) == []
    assert (confidence[[*range(10), *range(19, 29)]] >= 0.5).mean() > 0.95


def test_a_marker_is_never_reported_at_the_place_of_another_one():
    """One goes behind another that is equal, stays there for a while, and comes out on the other side."""

    def places(frame):
        hidden = np.interp(frame, [0, 12, 18, 30], [-48, 0, 0, 48])
        return np.concatenate([[MIDDLE, MIDDLE + np.array([hidden, 0.0])], SHEET[[0, 3, 8, 11]]])

    picture = drawn(lambda k: np.delete(places(k), 1 if abs(places(k)[1, 0] - MIDDLE[0]) < 2 * RADIUS else [], 0))
    found, confidence = followed(MarkerTracker(range(6)), picture, places(0), 31)
    off = np.linalg.norm(found - np.array([places(frame) for frame in range(31)]), axis=2)
    apart = np.linalg.norm(found[:, 0] - found[:, 1], axis=1)
    assert not (apart < RADIUS).any()
    assert silent(off, confidence) == []
    assert (confidence[12:18, 1] < 0.5).all()
    assert (confidence[:, 0] >= 0.5).all()


def test_a_body_that_was_pushed_is_not_expected_to_be_pushed_again():
    places = np.array([[0.0, 0.0], [40.0, 10.0]])
    body = Body(np.arange(2), False, places, 0.0)
    for time, x in ((1.0, 10.0), (2.0, 7.0)):
        body.follow(places + np.array([x, 0.0]), time)
    # it goes on as in the last frame
    np.testing.assert_allclose(body.predicted(3.0), places + np.array([4.0, 0.0]), atol=1e-9)


def labeled(places, held, centers):
    """A row, certain at `held` and since then assumed at `places`, laid over spots that look like its dots."""
    row = Expected(places, held, pairs_of(ROW), 300.0, 3.0, 0.1, 900.0, 900.0, 3.0, lost=True)
    return label([row], centers, [np.ones((len(ROW), len(centers)))], (2 * WIDTH, 2 * HEIGHT))[0]


def test_labels_that_were_assumed_are_no_evidence_for_themselves():
    other = ROW + np.array([0, 200])
    found = labeled(other, ROW, np.concatenate([ROW, other]))
    np.testing.assert_array_equal(found.spots, np.arange(7, 14))  # as before
    assert found.lead < LEAD
    assert found.apart == pytest.approx(200)


def test_two_dots_of_a_row_are_as_well_two_others():
    found = labeled(ROW, ROW, np.concatenate([ROW[2:4], ROW[2:4] + np.array([0, 40])]))
    assert (found.spots >= 0).sum() == 2
    assert found.lead < LEAD
