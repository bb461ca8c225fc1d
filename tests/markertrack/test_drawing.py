"""Drawing: that strokes are where they should be, as wide as they should be, and nowhere else."""

import io

import numpy as np
import pytest
from PIL import Image

from markertrack.drawing import DARK, PAGE, Canvas, contact_sheet, plain, to_pillow, to_png
from swimbase.errors import ArgumentError

GROUND, RED = (200, 200, 200), (200, 0, 0)
NAN = float("nan")
X, Y = np.meshgrid(np.arange(80), np.arange(60))


def drawn(paint) -> np.ndarray:
    """How much of each pixel is covered by what is painted in RED. Shape (60, 80)."""
    canvas = Canvas(plain(80, 60, GROUND))
    paint(canvas)
    return (200 - canvas.pixels()[:, :, 1].astype(float)) / 200


def centroid(cover) -> tuple[float, float]:
    return (X * cover).sum() / cover.sum(), (Y * cover).sum() / cover.sum()


@pytest.mark.parametrize("center", [(40, 30), (40.25, 30.5), (39.6, 29.9), (41.75, 31.25)])
def test_rings_are_where_they_should_be(center):
    cover = drawn(lambda canvas: canvas.ring(center, 12, RED, 2))
    np.testing.assert_allclose(centroid(cover), center, atol=0.15)
    away = np.hypot(X - center[0], Y - center[1])
    assert (away * cover).sum() / cover.sum() == pytest.approx(12, abs=0.15)
    assert cover.sum() == pytest.approx(2 * np.pi * 12 * 2, rel=0.06)
    assert cover[(away < 10) | (away > 14)].max() == 0
    assert len(np.unique(cover)) > 8  # its edges are smooth


def test_broken_rings_have_gaps_and_dots_and_crosses_fill_what_they_should():
    whole, broken = (drawn(lambda c, n=n: c.ring((40, 30), 12, RED, 2, dashes=n, share=0.6)) for n in (0, 6))
    assert broken.sum() / whole.sum() == pytest.approx(0.6, abs=0.05)
    angles = np.radians(np.arange(360))
    x, y = np.round(40 + 12 * np.cos(angles)).astype(int), np.round(30 + 12 * np.sin(angles)).astype(int)
    line = broken[y, x] > 0.5
    assert np.count_nonzero(line & ~np.roll(line, 1)) == 6
    dot = drawn(lambda canvas: canvas.dot((40.5, 30.25), 6, RED))
    np.testing.assert_allclose(centroid(dot), (40.5, 30.25), atol=0.15)
    assert dot.sum() == pytest.approx(np.pi * 36, rel=0.06)
    cross = drawn(lambda canvas: canvas.cross((40, 30), 10, RED, 2))
    assert cross[30, 40] == cross[25, 35] == cross[35, 35] == 1
    assert cross[30, 45] == cross[25, 40] == 0
    assert np.hypot(X - 40, Y - 30)[cross > 0.5].max() == pytest.approx(10, abs=1.5)


def test_an_edge_is_dark_and_outside():
    canvas = Canvas(plain(80, 60, GROUND))
    canvas.ring((40, 30), 12, RED, 2, edge=2)
    canvas.polyline([(5, 5), (75, 5)], RED, 2, edge=2)
    pixels = canvas.pixels().astype(int)
    between = 0.6 * np.array(DARK) + 0.4 * np.array(GROUND)
    for inside, outside in (((30, 52), (30, 54)), ((30, 28), (30, 30)), ((5, 40), (7, 40))):
        assert np.abs(pixels[inside] - RED).max() <= 70
        np.testing.assert_allclose(pixels[outside], between, atol=30)
    np.testing.assert_array_equal(pixels[30, 40], GROUND)


def test_lines_go_through_their_corners_stop_at_gaps_and_fade():
    cover = drawn(lambda c: c.polyline([(10, 10), (30, 10), (30, 50), (NAN, NAN), (50, 50), (70, 50)], RED, 4))
    assert cover[10, 20] == cover[30, 30] == cover[50, 60] == cover[10, 30] == 1
    assert cover[8:12, 20].sum() + cover[12, 20] == pytest.approx(4, abs=0.5)
    assert cover[45:56, 34:46].max() == 0
    for nothing in ([(10, 10), (NAN, NAN), (30, 10)], []):
        assert drawn(lambda c, points=nothing: c.polyline(points, RED, 4)).max() == 0
    line = [(float(x), 30.0) for x in range(10, 71, 10)]
    assert drawn(lambda c: c.polyline(line, RED, 6, opacity=0.5))[30, 40] == pytest.approx(0.5, abs=0.02)
    fading = drawn(lambda c: c.polyline(line, RED, 6, fade=True))[30, 15:70:10]
    np.testing.assert_allclose(fading, np.arange(1, 7) / 6, atol=0.02)


def test_what_is_outside_of_the_picture_does_no_harm():
    def paint(canvas):
        canvas.ring((-500, 30), 12, RED, 2, edge=1)
        canvas.ring((80, 30), 12, RED, 2, edge=1)
        canvas.cross((1e6, -1e6), 12, RED, 2)
        canvas.polyline([(-1e7, 1e7), (-2e7, 1e7)], RED, 2)
        canvas.polyline([(-1000.0, 20.0), (1000.0, 20.0)], RED, 4)
        canvas.text((-10, -10), "M0", RED, 20)

    cover = drawn(paint)
    assert cover[20].min() == 1
    assert cover[30, 68] > 0.9
    assert cover[40:, :60].max() == 0


def test_pictures_are_copied_and_written_as_they_are():
    image = np.full((60, 80, 3), 7, np.uint8)
    canvas = Canvas(to_pillow(image))
    canvas.fill((0, 0, 80, 60), RED)
    assert (image == 7).all()
    assert (canvas.pixels() == RED).all()
    turned = np.rot90(np.random.default_rng(0).integers(0, 255, (9, 16, 3), np.uint8))
    np.testing.assert_array_equal(Canvas(to_pillow(turned)).pixels(), turned)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(to_png(turned))).convert("RGB")), turned)
    assert to_png(turned) == to_png(turned.copy())


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4), "u1"), np.zeros((4, 4, 4), "u1"), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), "u1")]
)
def test_other_arrays_are_no_pictures(image):
    for take in (to_pillow, to_png):
        with pytest.raises(ArgumentError) as refused:
            take(image)
        assert f"{image.shape} of {image.dtype}; it must be (H, W, 3) of uint8" in str(refused.value)


def test_a_contact_sheet_shows_all_pictures_with_captions():
    colors = [(200, 0, 0), (0, 160, 0), (0, 0, 220), (190, 160, 0), (90, 0, 90)]
    shapes = [(90, 160), (45, 80), (160, 90), (90, 160), (90, 160)]
    images = [np.full((*shape, 3), color, np.uint8) for shape, color in zip(shapes, colors, strict=True)]
    sheet = contact_sheet(images, [f"frame {k}" for k in range(5)], columns=2, width=120)
    found = [np.argwhere((sheet == color).all(axis=2)) for color in colors]
    for where, (height, width) in zip(found, shapes, strict=True):
        np.testing.assert_array_equal(np.ptp(where, axis=0) + 1, (round(120 * height / width), 120))
    tops, lefts = (np.array([where.min(axis=0)[i] for where in found]) for i in (0, 1))
    assert tops[0] == tops[1] < tops[2] == tops[3] < tops[4]
    assert lefts[0] == lefts[2] == lefts[4] < lefts[1] == lefts[3]
    assert tops[2] > tops[0] + 68 + 11  # room for a caption
    for where in found:
        (_, left), (bottom, right) = where.min(axis=0), where.max(axis=0)
        assert sheet[bottom + 1 : bottom + 18, left : right + 1].min() < 90
        assert (sheet[bottom + 1] == PAGE).all(axis=-1)[left : right + 1].all()
    assert (sheet[0] == PAGE).all()


@pytest.mark.parametrize(
    ("count", "captions", "columns", "width", "words"),
    [(0, [], 1, 100, "0 pictures"), (1, ["a", "b"], 1, 100, "2 captions"), (1, ["a"], 0, 100, "0 columns"),
     (1, ["a"], 2, 15, "15 px")],
)  # fmt: skip
def test_a_contact_sheet_says_what_it_needs(count, captions, columns, width, words):
    with pytest.raises(ArgumentError, match=words):
        contact_sheet([np.zeros((9, 16, 3), np.uint8)] * count, captions, columns, width)
