"""The track overlay: what a person sees in it is what the track says."""

import av
import numpy as np
import pytest

from markertrack.overlay import ALERT, TRAIL_TIME, Inset, TrackOverlay, label_places, marker_colors
from markertrack.video import VideoReader
from swimbase.errors import ArgumentError, VideoError

WIDTH, HEIGHT = 960, 540
GRAY = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
NAMES = ("M0", "M1", "M2", "M3")
FISH = np.array([[430.0, 250.0], [480.0, 260.0], [530.0, 250.0], [580.0, 240.0]])
SURE = np.ones(4)
COLORS = marker_colors(4)


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


def like(pixels, color) -> np.ndarray:
    """Which pixels are rather of this color than gray, and of no other marker's color."""
    hue = np.array(color, float) - np.mean(color)
    tint = pixels - pixels.mean(axis=-1, keepdims=True)
    return (tint @ hue) / np.linalg.norm(hue) > 0.35 * np.linalg.norm(hue)


def ringed(image, center, color, radii=(6, 7, 8, 9)) -> float:
    """How much of a ring of this color is around a place, at the best radius."""
    shares = []
    for radius in radii:
        angles = np.linspace(0, 2 * np.pi, round(8 * radius), endpoint=False)
        around = np.asarray(center)[:, None] + radius * np.array([np.cos(angles), np.sin(angles)])
        x, y = np.round(around).astype(int)
        shares.append(like(image[y, x], color).mean())
    return max(shares)


def alerts(image) -> int:
    """Pixels of the alert's color in the strip below the film."""
    return int((np.abs(image[HEIGHT:] - np.array(ALERT)).max(axis=2) < 60).sum())


def test_the_film_stays_and_rings_have_their_color_at_their_place(tmp_path):
    film = np.kron(np.random.default_rng(0).integers(40, 200, (27, 48, 1)), np.ones((20, 20, 3))).astype(np.uint8)
    nothing = (0.0, np.full((4, 2), np.nan), np.zeros(4), {"image": film})
    bare, image = overlay(tmp_path / "o.mp4", [nothing, (0.1, FISH, SURE)])
    assert np.abs(bare[:HEIGHT] - film).mean() < 3
    for place, color in zip(FISH, COLORS, strict=True):
        assert ringed(image, place, color) > 0.9
        np.testing.assert_allclose(image[tuple(np.round(place).astype(int)[::-1])], 120, atol=12)  # the marker shows
        assert ringed(image, place + np.array([0, 60]), color) < 0.1


def test_lost_and_filled_markers_look_different(tmp_path):
    filled, lost = SURE.copy(), SURE.copy()
    filled[1] = lost[2] = 0
    seen, dotted, crossed = overlay(
        tmp_path / "o.mp4", [(0.0, FISH, SURE), (0.1, FISH, filled), (0.2, moved(2, np.nan), lost)]
    )
    assert ringed(dotted, FISH[1], COLORS[1]) < 0.75 < 0.9 < ringed(seen, FISH[1], COLORS[1])
    assert ringed(dotted, FISH[0], COLORS[0]) > 0.9
    assert ringed(crossed, FISH[2], COLORS[2], (6, 7, 8)) < 0.35
    x, y = FISH[2].astype(int)  # a lost marker stays where it was last
    assert crossed[y, x].min() > 180  # the cross
    assert np.abs(dotted[y, x] - 120).max() < 15
    between = ((FISH[1] + FISH[2]) / 2).astype(int)  # no line to a marker that isn't seen
    assert dotted[between[1], between[0]].min() > 150
    assert np.abs(crossed[between[1], between[0]] - 120).max() < 15


def test_a_refused_marker_is_drawn_as_lost_at_its_place(tmp_path):
    there = moved(3, (700.0, 120.0))
    refused = np.array([False, False, False, True])
    believed, image = overlay(tmp_path / "o.mp4", [(0.0, there, SURE), (0.1, there, SURE, {"refused": refused})])
    assert np.abs(believed[120, 700] - 120).max() < 25
    assert image[120, 700].min() > 180
    assert alerts(believed) < 20 < 400 < alerts(image)


def test_the_strip_says_how_many_are_lost(tmp_path):
    one, two = (np.where(np.arange(4)[:, None] < count, np.nan, FISH) for count in (1, 2))
    steps = [(t / 30, p, np.isfinite(p[:, 0]).astype(float)) for t, p in enumerate((FISH, one, two, FISH))]
    images = overlay(tmp_path / "o.mp4", steps)
    assert all(image.shape == (HEIGHT + 34, WIDTH, 3) for image in images)
    none, few, more, again = (alerts(image) for image in images)
    assert max(none, again) < 20 < 400 < few < more  # 20: edges of other colors
    for columns in (slice(0, 110), slice(130, 230)):  # frame and time
        part, other = (image[HEIGHT:, columns] for image in images[1:3])
        assert part.max() > 200
        assert np.abs(part - other).max() > 60  # both count


def test_the_tail_draws_its_last_half_second(tmp_path):
    times = np.arange(11) / 10
    image = overlay(tmp_path / "o.mp4", [(t, moved(3, (580 + 200 * t, 140)), SURE) for t in times])[-1]
    row = like(image[138:143].max(axis=0).astype(float), COLORS[3])
    fresh, old = 580 + 200 * (1 - 0.3 * TRAIL_TIME), 580 + 200 * (1 - 1.3 * TRAIL_TIME)
    assert row[round(fresh) - 5 : round(fresh) + 5].all()
    assert not row[round(old) - 5 : round(old) + 5].any()


def test_the_file_plays_in_browsers(tmp_path):
    path, times = tmp_path / "o.mp4", [0.0, 0.02, 0.05, 0.31]
    with TrackOverlay(path, 333, 187, 50, NAMES) as video:
        for time in times:
            video.add(np.zeros((187, 333, 3), np.uint8), 1.0, time, FISH / 3, SURE)
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
     ((3840, 2160), {"longest_side": 640}, (640, 360)), ((1000, 20), {"longest_side": 64}, (64, 2)),
     ((16, 16), {}, (16, 16)), ((200, 1000), {}, (200, 1000))],
)  # fmt: skip
def test_films_of_any_size_are_drawn_and_large_ones_scaled_down(tmp_path, size, options, expected):
    names = ("the tip of the nose of the fish", *NAMES)
    with TrackOverlay(tmp_path / "o.mp4", *size, 30, names, **options) as video:
        assert (video.width, video.height) == expected
        film = np.zeros((size[1] // 2, size[0] // 2, 3), np.uint8)
        for k in range(3):
            video.add(film, 0.5, k / 30, np.linspace((0, 0), size, 5) + 30 * k, np.ones(5))


def test_positions_are_those_of_the_film_whatever_the_image(tmp_path):
    film = np.full((2 * HEIGHT, 2 * WIDTH, 3), 120, np.uint8)
    places = 2 * FISH + 0.5  # the same places, measured in pixels half as large
    steps = [(0.0, places, SURE, {"image": GRAY, "scale": 0.5}), (0.1, places, SURE, {"image": film, "scale": 1.0})]
    for image in overlay(tmp_path / "o.mp4", steps, size=(2 * WIDTH, 2 * HEIGHT), longest_side=WIDTH):
        for place, color in zip(FISH, COLORS, strict=True):
            assert ringed(image, place, color) > 0.9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [((GRAY, 1.0, 0.1, FISH[:3], SURE), "for 4 markers"), ((GRAY, 0.5, 0.1, FISH, SURE), "scale is 0.5"),
     ((GRAY[:, :, 0], 1.0, 0.1, FISH, SURE), "of uint8"), ((GRAY, 1.0, 0.0, FISH, SURE), "is 0.0 s")],
)  # fmt: skip
def test_what_does_not_fit_is_refused(tmp_path, arguments, message):
    with TrackOverlay(tmp_path / "o.mp4", WIDTH, HEIGHT, 30, NAMES) as video:
        video.add(GRAY, 1.0, 0.0, FISH, SURE)
        with pytest.raises((ArgumentError, VideoError), match=message):
            video.add(*arguments)
    with VideoReader(tmp_path / "o.mp4") as reader:
        assert len(list(reader)) == 1


@pytest.mark.parametrize(
    ("size", "names", "options", "message"),
    [((1, 540), NAMES, {}, "1 x 540 px"), ((960, 540), NAMES, {"longest_side": 10}, "longest_side 10 px"),
     ((960, 540), (), {}, "names is empty")],
)  # fmt: skip
def test_an_overlay_says_what_it_needs_and_leaves_no_file_after_an_error(tmp_path, size, names, options, message):
    with pytest.raises(ArgumentError, match=message):
        TrackOverlay(tmp_path / "o.mp4", *size, 30, names, **options)
    with pytest.raises(KeyError), TrackOverlay(tmp_path / "o.mp4", WIDTH, HEIGHT, 30, NAMES) as video:  # noqa: PT012
        video.add(GRAY, 1.0, 0.0, FISH, SURE)
        raise KeyError
    assert not list(tmp_path.iterdir())


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
    film = np.full((360 * factor, 640 * factor, 3), 90, np.uint8)
    points = np.array([[200.0, 170.0], [230.0, 180.0], [262.0, 175.0]])
    for x, y in ((points + 0.5) * factor).astype(int):
        film[y - 2 * factor : y + 2 * factor, x - 2 * factor : x + 2 * factor] = 250  # around the corner of four pixels
    inset = Inset(points, (640, 360))
    inset.follow(points, 0.0)
    bright = (np.asarray(inset.cut(film)).astype(float)[:, :, 0] - 90) / 160
    assert (bright.shape, inset.zoom) == (inset.size[::-1], 3)
    assert bright.sum() == pytest.approx(3 * 16 * 9, rel=0.03)
    columns, rows = np.meshgrid(np.arange(bright.shape[1]), np.arange(bright.shape[0]))
    for place in inset.places(points - 0.5 / factor):  # where the squares' middles are
        near = bright * (np.abs(columns - place[0]) < 15) * (np.abs(rows - place[1]) < 15)
        middle = np.array([(columns * near).sum(), (rows * near).sum()]) / near.sum()
        np.testing.assert_allclose(middle, place, atol=0.1)


@pytest.mark.parametrize("turn", [False, True])
def test_labels_do_not_hide_one_another(turn):
    rng = np.random.default_rng(2)
    corners = np.array([10.0, 10.0]), np.array([630.0, 200.0])
    for _ in range(30):
        places = rng.uniform(*corners, (9, 2))
        places[2:7, 0] = 300 + rng.uniform(-30, 30, 5)
        places[8] = np.nan
        low, high = (corner[::-1] if turn else corner for corner in corners)
        at = label_places(places[:, ::-1] if turn else places, [(30, 20)] * 9, low, high)
        assert np.isnan(at[8]).all()
        at, half = at[:8], np.array([15, 10])
        assert ((at - half >= low - 1e-9) & (at + half <= high + 1e-9)).all()
        apart = np.abs(at[:, None] - at[None]) - [30, 20]
        assert (apart.max(axis=2)[~np.eye(8, dtype=bool)] > -1e-9).all()


@pytest.mark.parametrize(("fps", "step"), [(30, 1), (25, 1), (60, 2), (50, 2), (120, 4), (29.97, 1)])
def test_a_fast_film_is_drawn_at_30_frames_a_second_and_wherever_a_marker_is_lost(tmp_path, fps, step):
    seen, lost = np.ones(2), np.array([1.0, 0.0])
    with TrackOverlay(tmp_path / "o.mp4", WIDTH, HEIGHT, fps, NAMES[:2]) as video:
        assert [number for number in range(17) if video.wants(number / fps, seen)] == list(range(0, 17, step))
        assert all(video.wants(number / fps, lost) for number in range(17, 23))
        video.add(np.zeros((HEIGHT, WIDTH, 3), np.uint8), 1.0, 1.0, np.full((2, 2), 50.0), seen)
