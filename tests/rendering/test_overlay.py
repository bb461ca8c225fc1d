"""The track overlay: what a person sees in it is what the track says."""

import re

import av
import numpy as np
import pytest

from swim2real.errors import ArgumentError, VideoError
from swim2real.rendering.overlay import ALERT, STOPS, TRAIL_TIME, TrackOverlay, marker_colors
from swim2real.rendering.overlay_inset import Inset, label_places
from swim2real.video import VideoReader

WIDTH, HEIGHT = 960, 540
GRAY = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
NAMES = ("M0", "M1", "M2", "M3")
FISH = np.array([[430.0, 250.0], [480.0, 260.0], [530.0, 250.0], [580.0, 240.0]])
SURE = np.ones(4)
LOST = np.array([np.nan, np.nan])


def overlay(path, steps, names=NAMES, size=(WIDTH, HEIGHT), **options) -> list[np.ndarray]:
    """Frames of an overlay of `steps`: times, positions, confidence and what else `add` takes."""
    with TrackOverlay(path, *size, 30, names, **options) as video:
        for time, positions, confidence, *more in steps:
            options = {"image": GRAY, "scale": 1.0, **(more[0] if more else {})}
            video.add(time=time, positions=positions, confidence=confidence, **options)
    with VideoReader(path) as reader:
        return [frame.image.astype(int) for frame in reader]


def moved(marker: int, place) -> np.ndarray:
    positions = FISH.copy()
    positions[marker] = place
    return positions


def circle(image, center, radius: float) -> np.ndarray:
    """Pixels on a circle. Shape (N, 3)."""
    angles = np.linspace(0, 2 * np.pi, round(8 * radius), endpoint=False)
    x, y = np.round(np.asarray(center)[:, None] + radius * np.array([np.cos(angles), np.sin(angles)])).astype(int)
    return image[y, x]


def like(pixels, color) -> np.ndarray:
    """Which pixels are rather of this color than gray, and of no other marker's color."""
    hue = np.array(color, float) - np.mean(color)
    tint = pixels - pixels.mean(axis=-1, keepdims=True)
    return (tint @ hue) / np.linalg.norm(hue) > 0.35 * np.linalg.norm(hue)


def ringed(image, center, color, radii=(6, 7, 8, 9)) -> float:
    """How much of a ring of this color is around a place, at the best radius."""
    return max(float(like(circle(image, center, radius), color).mean()) for radius in radii)


def test_rings_have_their_color_at_their_place(tmp_path):
    (image,) = overlay(tmp_path / "o.mp4", [(0.0, FISH, SURE)])
    for place, color in zip(FISH, marker_colors(4), strict=True):
        assert ringed(image, place, color) > 0.9
        np.testing.assert_allclose(image[tuple(np.round(place).astype(int)[::-1])], 120, atol=12)  # the marker shows
        assert ringed(image, place + np.array([0, 60]), color) < 0.1


def test_every_film_pixel_is_where_it_was(tmp_path):
    rng = np.random.default_rng(0)
    film = np.kron(rng.integers(40, 200, (HEIGHT // 20, WIDTH // 20, 1)), np.ones((20, 20, 3))).astype(np.uint8)
    (image,) = overlay(tmp_path / "o.mp4", [(0.0, np.full((4, 2), np.nan), np.zeros(4), {"image": film})])
    assert np.abs(image[:HEIGHT] - film).mean() < 3


def test_lost_and_filled_markers_look_different(tmp_path):
    filled, lost = SURE.copy(), SURE.copy()
    filled[1] = lost[2] = 0
    seen, dotted, crossed = overlay(
        tmp_path / "o.mp4", [(0.0, FISH, SURE), (0.1, FISH, filled), (0.2, moved(2, LOST), lost)]
    )
    colors = marker_colors(4)
    assert ringed(dotted, FISH[1], colors[1]) < 0.75 < 0.9 < ringed(seen, FISH[1], colors[1])
    assert ringed(dotted, FISH[0], colors[0]) > 0.9
    assert ringed(crossed, FISH[2], colors[2], (6, 7, 8)) < 0.35
    x, y = FISH[2].astype(int)
    assert crossed[y, x].min() > 180  # the cross
    assert np.abs(dotted[y, x] - 120).max() < 15
    between = ((FISH[1] + FISH[2]) / 2).astype(int)  # no line to a marker that isn't seen
    assert dotted[between[1], between[0]].min() > 150
    assert np.abs(crossed[between[1], between[0]] - 120).max() < 15


def test_a_lost_marker_stays_where_it_was_last(tmp_path):
    away = FISH - [40, 0]
    away[3] = LOST
    _, later = overlay(tmp_path / "o.mp4", [(0.0, FISH, SURE), (0.1, away, np.isfinite(away[:, 0]).astype(float))])
    assert later[240, 580].min() > 180
    assert ringed(later, away[0], marker_colors(4)[0]) > 0.9


def test_a_refused_marker_is_drawn_as_lost_at_its_place(tmp_path):
    place = np.array([700.0, 120.0])
    refused = np.array([False, False, False, True])
    believed, image = overlay(
        tmp_path / "o.mp4", [(0.0, moved(3, place), SURE), (0.1, moved(3, place), SURE, {"refused": refused})]
    )
    assert np.abs(believed[120, 700] - 120).max() < 25
    assert image[120, 700].min() > 180
    assert reddish(believed) < 20 < 400 < reddish(image)


def reddish(image) -> int:
    """Pixels of the alert's color in the strip below the film."""
    return int((np.abs(image[HEIGHT:] - np.array(ALERT)).max(axis=2) < 60).sum())


def test_the_strip_says_how_many_are_lost(tmp_path):
    one, two = (np.where(np.arange(4)[:, None] < count, np.nan, FISH) for count in (1, 2))
    steps = [(t / 30, p, np.isfinite(p[:, 0]).astype(float)) for t, p in enumerate((FISH, one, two, FISH))]
    images = overlay(tmp_path / "o.mp4", steps)
    assert all(image.shape == (HEIGHT + 34, WIDTH, 3) for image in images)
    alerts = [reddish(image) for image in images]
    assert max(alerts[0], alerts[3]) < 20  # edges of other colors
    assert 400 < alerts[1] < alerts[2]
    frame, time = images[1][HEIGHT:, :110], images[1][HEIGHT:, 130:230]
    assert frame.max() > 200
    assert time.max() > 200
    for part, other in ((frame, images[2][HEIGHT:, :110]), (time, images[2][HEIGHT:, 130:230])):
        assert np.abs(part - other).max() > 60  # both count


def test_the_tail_draws_its_last_half_second(tmp_path):
    times = np.arange(11) / 10
    steps = [(t, moved(3, (580 + 200 * t, 140)), SURE) for t in times]
    image = overlay(tmp_path / "o.mp4", steps)[-1]
    color = marker_colors(4)[3]
    row = like(image[138:143].max(axis=0).astype(float), color)
    fresh, old = 580 + 200 * (1 - 0.3 * TRAIL_TIME), 580 + 200 * (1 - 1.3 * TRAIL_TIME)
    assert row[round(fresh) - 5 : round(fresh) + 5].all()
    assert not row[round(old) - 5 : round(old) + 5].any()


def test_the_file_plays_in_browsers(tmp_path):
    path, times = tmp_path / "o.mp4", [0.0, 0.02, 0.05, 0.31]
    with TrackOverlay(path, 333, 187, 50, NAMES) as video:
        film = np.zeros((187, 333, 3), np.uint8)
        for time in times:
            video.add(film, 1.0, time, FISH / 3, SURE)
        assert not path.exists()
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert stream.width % 2 == stream.height % 2 == 0
        assert (stream.width, video.width, video.height) == (332, 332, 188)
    with VideoReader(path) as reader:
        assert [frame.time for frame in reader] == pytest.approx(times, abs=1e-3)


@pytest.mark.parametrize(
    ("size", "options", "expected"),
    [((3840, 2160), {}, (1280, 720)), ((2160, 3840), {}, (720, 1280)), ((640, 360), {}, (640, 360)),
     ((3840, 2160), {"longest_side": 640}, (640, 360)), ((1000, 20), {"longest_side": 64}, (64, 2))],
)  # fmt: skip
def test_large_films_are_scaled_down(tmp_path, size, options, expected):
    with TrackOverlay(tmp_path / "o.mp4", *size, 30, NAMES, **options) as video:
        assert (video.width, video.height) == expected
        film = np.zeros((size[1] // 2, size[0] // 2, 3), np.uint8)
        video.add(film, 0.5, 0.0, FISH, SURE)


def test_positions_are_those_of_the_film_whatever_the_image(tmp_path):
    size = (2 * WIDTH, 2 * HEIGHT)
    film = np.full((2 * HEIGHT, 2 * WIDTH, 3), 120, np.uint8)
    places = 2 * FISH + 0.5  # the same places, measured in pixels half as large
    steps = [(0.0, places, SURE, {"image": GRAY, "scale": 0.5}), (0.1, places, SURE, {"image": film, "scale": 1.0})]
    for image in overlay(tmp_path / "o.mp4", steps, size=size, longest_side=WIDTH):
        for place, color in zip(FISH, marker_colors(4), strict=True):
            assert ringed(image, place, color) > 0.9


def test_one_marker_and_none_at_all_can_be_drawn(tmp_path):
    steps = [(0.0, FISH[:1] * np.nan, np.zeros(1)), (0.1, FISH[:1], np.ones(1)), (0.2, FISH[:1] * np.nan, np.zeros(1))]
    nothing, seen, lost = overlay(tmp_path / "o.mp4", steps, names=("nose",))
    assert np.abs(nothing[:HEIGHT] - 120).max() < 10
    assert ringed(seen, FISH[0], STOPS[0]) > 0.8
    assert lost[250, 430].min() > 180


@pytest.mark.parametrize("size", [(64, 64), (16, 16), (200, 1000)])
def test_any_size_and_any_names_can_be_drawn(tmp_path, size):
    names = ("the tip of the nose of the fish", *NAMES)
    places = np.linspace((0, 0), size, 5)
    with TrackOverlay(tmp_path / "o.mp4", *size, 30, names) as video:
        for k in range(3):
            video.add(np.zeros((size[1], size[0], 3), np.uint8), 1.0, k / 30, places + 30 * k, np.ones(5))


def test_what_does_not_fit_is_refused(tmp_path):
    with TrackOverlay(tmp_path / "o.mp4", WIDTH, HEIGHT, 30, NAMES) as video:
        video.add(GRAY, 1.0, 0.0, FISH, SURE)
        for arguments, message in (
            (
                (GRAY, 1.0, 0.1, FISH[:3], SURE),
                "positions have shape (3, 2) and confidence (4,); for 4 markers they must have (4, 2) and (4,)",
            ),
            (
                (GRAY, 0.5, 0.1, FISH, SURE),
                "the image is 960 x 540 px and scale is 0.5; at this scale the film of 960 x 540 px is 480 x 270 px",
            ),
            (
                (GRAY[:, :, 0], 1.0, 0.1, FISH, SURE),
                "the picture has shape (540, 960) of uint8; it must be (H, W, 3) of uint8",
            ),
        ):
            with pytest.raises(ArgumentError, match=re.escape(message)):
                video.add(*arguments)
        with pytest.raises(ArgumentError, match=re.escape("refused has shape (3,); for 4 markers it must have (4,)")):
            video.add(GRAY, 1.0, 0.1, FISH, SURE, refused=np.zeros(3, bool))
        with pytest.raises(VideoError, match=re.escape("the time of a picture is 0.0 s; it must be 0 or later")):
            video.add(GRAY, 1.0, 0.0, FISH, SURE)
    with VideoReader(tmp_path / "o.mp4") as reader:
        assert len(list(reader)) == 1


@pytest.mark.parametrize(
    ("size", "names", "options", "message"),
    [
        (
            (1, 540),
            NAMES,
            {},
            "the film is 1 x 540 px and longest_side 1280 px; both sides of the film must be at least",
        ),
        ((960, 540), NAMES, {"longest_side": 10}, "longest_side 10 px; .* longest_side at least 64"),
        ((960, 540), (), {}, "names is empty; an overlay needs the name of every marker"),
    ],
)
def test_an_overlay_says_what_it_needs(tmp_path, size, names, options, message):
    with pytest.raises(ArgumentError, match=message):
        TrackOverlay(tmp_path / "o.mp4", *size, 30, names, **options)
    assert not list(tmp_path.iterdir())


def test_after_an_error_no_file_is_left(tmp_path):
    with pytest.raises(KeyError), TrackOverlay(tmp_path / "o.mp4", WIDTH, HEIGHT, 30, NAMES) as video:  # noqa: PT012
        video.add(GRAY, 1.0, 0.0, FISH, SURE)
        raise KeyError
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("count", [2, 5, 9, 14])
def test_colors_get_lighter_toward_the_tail(count):
    colors = np.array(marker_colors(count), float)
    lightness = (colors / 255) ** 2.2 @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness) > 0).all()
    assert lightness[-1] > 3.5 * lightness[0]
    assert tuple(map(tuple, colors[[0, -1]].astype(int))) == (STOPS[0], STOPS[-1])


@pytest.mark.parametrize("picture", [(1280, 720), (720, 1280)])
def test_the_inset_never_hides_the_fish_and_stays_when_it_can(picture):
    rng = np.random.default_rng(1)
    for _ in range(20):
        fish = rng.uniform(-90, 90, (6, 2)) * [1.0, 0.3]
        start, end = (rng.uniform(100, np.array(picture) - 100) for _ in range(2))
        inset = Inset(fish + start, picture)
        size, corners = np.array(inset.size), []
        for step in range(60):
            points = fish + start + (end - start) * step / 59
            inset.follow(points, step / 30)
            if inset.corner is None:
                continue
            corner = np.array(inset.corner)
            assert ((corner >= 0) & (corner + size <= picture)).all()
            assert not ((points > corner) & (points < corner + size)).all(axis=1).any()
            corners.append(inset.corner)
        assert 1.3 <= inset.zoom <= 3
        assert len(corners) > 45
        assert sum(a != b for a, b in zip(corners[1:], corners[:-1], strict=True)) <= 3


@pytest.mark.parametrize("factor", [1, 3])
def test_the_inset_shows_what_is_there_and_larger(factor):
    picture = (640, 360)
    film = np.full((360 * factor, 640 * factor, 3), 90, np.uint8)
    points = np.array([[200.0, 170.0], [230.0, 180.0], [262.0, 175.0]])
    for x, y in ((points + 0.5) * factor).astype(int):
        film[y - 2 * factor : y + 2 * factor, x - 2 * factor : x + 2 * factor] = 250  # around the corner of four pixels
    inset = Inset(points, picture)
    inset.follow(points, 0.0)
    image = np.asarray(inset.cut(film)).astype(float)[:, :, 0]
    assert image.shape == inset.size[::-1]
    assert inset.zoom == 3
    bright = (image - 90) / 160
    assert bright.sum() == pytest.approx(3 * 16 * 9, rel=0.03)
    columns, rows = np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0]))
    for place in inset.places(points - 0.5 / factor):  # where the squares' middles are
        near = bright * (np.abs(columns - place[0]) < 15) * (np.abs(rows - place[1]) < 15)
        middle = np.array([(columns * near).sum(), (rows * near).sum()]) / near.sum()
        np.testing.assert_allclose(middle, place, atol=0.1)


def test_the_inset_follows_without_shaking():
    points = np.array([[200.0, 170.0], [230.0, 180.0], [262.0, 175.0]])
    inset = Inset(points, (640, 360))
    inset.follow(points, 0.0)
    start, later = inset.places(points), points + np.array([10, 0])
    inset.follow(later, 1 / 60)
    assert 8 * inset.zoom < (inset.places(later) - start)[0, 0] < 10 * inset.zoom
    inset.follow(later, 2.0)
    np.testing.assert_allclose(inset.places(later), start, atol=0.1)
    inset.follow(np.empty((0, 2)), 2.1)
    np.testing.assert_allclose(inset.places(later), start, atol=0.1)


def test_there_is_no_inset_of_a_fish_that_fills_the_picture():
    points = np.array([[40.0, 170.0], [300.0, 180.0], [600.0, 175.0]])
    inset = Inset(points, (640, 360))
    inset.follow(points, 0.0)
    assert inset.corner is None


def test_labels_do_not_hide_one_another():
    rng = np.random.default_rng(2)
    low, high = np.array([10.0, 10.0]), np.array([630.0, 200.0])
    for turn in (False, True):
        for _ in range(30):
            places = rng.uniform(low, high, (9, 2))
            places[2:7, 0] = 300 + rng.uniform(-30, 30, 5)
            places[8] = np.nan
            sizes = np.array([(30, 20)] * 9)
            corners = low, high
            if turn:
                places, corners = places[:, ::-1], (low[::-1], high[::-1])
            at = label_places(places, [(w, h) for w, h in sizes.tolist()], *corners)
            assert np.isnan(at[8]).all()
            at, inside = at[:8], sizes[:8] / 2
            assert ((at - inside >= corners[0] - 1e-9) & (at + inside <= corners[1] + 1e-9)).all()
            apart = np.abs(at[:, None] - at[None]) - [30, 20]
            assert (apart.max(axis=2)[~np.eye(8, dtype=bool)] > -1e-9).all()


def test_labels_stand_at_their_markers_where_there_is_room():
    low, high = np.zeros(2), np.array([400.0, 100.0])
    places = np.array([[50.0, 40.0], [100.0, 50.0], [200.0, 60.0], [500.0, 50.0]])
    at = label_places(places, [(30, 20)] * 4, low, high)
    np.testing.assert_allclose(at[:3], [[50, 10], [100, 90], [200, 10]])
    assert np.isnan(at[3]).all()
    assert np.isnan(label_places(places, [(300, 20)] * 4, low, high)[[0, 2]]).all()  # a row of 600 px


@pytest.mark.parametrize(("fps", "step"), [(30, 1), (25, 1), (60, 2), (50, 2), (120, 4), (29.97, 1)])
def test_a_fast_film_is_drawn_at_30_frames_a_second_and_wherever_a_marker_is_lost(tmp_path, fps, step):
    seen, lost = np.ones(2), np.array([1.0, 0.0])
    with TrackOverlay(tmp_path / "o.mp4", WIDTH, HEIGHT, fps, NAMES[:2]) as video:
        assert [number for number in range(17) if video.wants(number / fps, seen)] == list(range(0, 17, step))
        assert all(video.wants(number / fps, lost) for number in range(17, 23))
        video.add(np.zeros((HEIGHT, WIDTH, 3), np.uint8), 1.0, 1.0, np.full((2, 2), 50.0), seen)
