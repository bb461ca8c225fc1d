"""What markers look like: of any size and shape in one picture, and what isn't taken for one."""

import cv2
import numpy as np
import pytest
from test_tags import PLACES
from test_tags import picture as tagged

from markertrack.tracking.looks import Looks, squares
from swimbase.errors import TrackingError

HEIGHT, WIDTH = 180, 310
GRID = np.array(
    [[50.3, 50.8], [120.6, 49.4], [190.1, 52.2], [260.7, 50.0], [85.2, 130.5], [155.9, 128.3], [225.4, 131.7]]
)
PAPER, INK = 0.7, 0.02  # linear light
SIZES = np.array([4.0, 12.0, 7.0, 9.0, 5.0, 10.5, 6.0])
CLICKS = np.random.default_rng(4).uniform(-1.2, 1.2, GRID.shape)
FINE = 3  # times as many pixels are drawn each way


def away(place, axes=(1.0, 1.0), angle=0.0):
    """Distance of each fine pixel from a place in half axes, and the way there along both of them."""
    rows, columns = (np.mgrid[: FINE * HEIGHT, : FINE * WIDTH] + 0.5) / FINE - 0.5
    x, y = columns - place[0], rows - place[1]
    u, v = (x * np.cos(angle) + y * np.sin(angle)) / axes[0], (y * np.cos(angle) - x * np.sin(angle)) / axes[1]
    return np.hypot(u, v), u, v


def picture(*layers):
    """Layers of light, each where its mask is, on paper; as a camera shows it. RGB."""
    light = np.full((FINE * HEIGHT, FINE * WIDTH), PAPER)
    for mask, value in layers:
        light = np.where(mask, value, light)
    light = cv2.GaussianBlur(cv2.resize(light, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    light += np.random.default_rng(0).normal(0, 0.006, light.shape)
    return np.repeat((255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)[..., None], 3, axis=2)


def discs(radius):
    return [(away(place)[0] < radius, INK) for place in GRID]


def unequal():
    return [(away(place)[0] < size, INK) for place, size in zip(GRID, SIZES, strict=True)], SIZES


def elliptic(ratio):
    """Each second one is long, at any angle; the others are nearly round."""
    stretches = np.sqrt(np.where(np.arange(len(GRID)) % 2, ratio, 1.0 + (ratio - 1) / 4))
    axes = 7.5 * np.column_stack([stretches, 1 / stretches])
    angles = np.linspace(0, 2.5, len(GRID))
    return [(away(*one)[0] < 1, INK) for one in zip(GRID, axes, angles, strict=True)], 7.5


def middles(radius, share, light):
    """Discs with another color in the middle: a screw, or paper through a hole."""
    return [*discs(radius), *((away(place)[0] < share * radius, light) for place in GRID)], radius


def balls(radius, light):
    """Lit from the upper left: a highlight there, the other side dark."""
    layers = []
    for place in GRID:
        out, u, v = away(place, (radius, radius))
        facing = 0.8 * np.sqrt(np.clip(1 - out**2, 0, None)) - 0.42 * (u + v)
        shine = np.exp(-((u + 0.3) ** 2 + (v + 0.3) ** 2) / (2 * 0.16**2))
        layers.append((out < 1, light * (0.35 + 0.65 * np.clip(facing, 0, None)) + shine))
    return layers, radius


@pytest.mark.parametrize(
    ("markers", "given", "close"),
    [
        (unequal, (), 0.3),
        (elliptic, (2.5,), 0.3),
        pytest.param(middles, (9.0, 0.4, 0.3), 0.3, id="bright hub"),
        pytest.param(middles, (6.0, 0.3, PAPER), 0.3, id="ring"),
        (balls, (7.0, 0.1), 2.0),
    ],
)
def test_centers_and_areas_are_right_whatever_a_marker_looks_like(markers, given, close):
    layers, radii = markers(*given)
    image = picture(*layers)
    for clicks in (GRID, GRID + CLICKS):
        looks = Looks(image, clicks)
        assert looks.plain.all()
        assert np.linalg.norm(looks.points - GRID, axis=1).max() < close
        np.testing.assert_allclose((looks.radii / radii) ** 2, 1.0, atol=0.2)


def test_half_of_something_larger_isnt_like_a_marker():
    looks = Looks(picture(*discs(7.0)), GRID)
    larger = picture(*discs(7.0)[1:], (away(GRID[0], (14.0, 7.0), 0.4)[0] < 1, INK))
    spots = looks.find(larger, squares(GRID, 20.0))
    likeness = looks.likeness(spots, GRID, np.zeros(len(GRID)))
    near = np.linalg.norm(spots.centers - GRID[0], axis=1) < 20
    assert near.any()
    assert likeness[0, near].max() < 0.5 < likeness[0, ~near].min()


def block(top, half_width=30.0):
    """A dark object below the sixth marker."""
    rows, columns = (np.mgrid[: FINE * HEIGHT, : FINE * WIDTH] + 0.5) / FINE - 0.5
    place = GRID[5]
    return (rows > place[1] + top) & (rows < place[1] + top + 40) & (abs(columns - place[0]) < half_width), INK


@pytest.mark.parametrize(("radius", "gap"), [(6.0, -1.0), (6.0, 1.0), (9.0, -3.0)])
def test_a_marker_that_touches_a_dark_object_is_known_by_its_picture_at_least(radius, gap):
    looks = Looks(picture(*discs(radius), block(radius + gap)), GRID + 0.5 * CLICKS)
    off = np.linalg.norm(looks.points - GRID, axis=1)
    assert not looks.plain[5] or off[5] < 1
    assert np.delete(looks.plain, 5).all()
    assert np.delete(off, 5).max() < 0.3
    assert not looks.plain[5] or gap > 0


@pytest.mark.parametrize(
    ("family", "named"),
    [("4X4_50", "4X4"), ("6X6_250", "6X6"), ("APRILTAG_36h11", "APRILTAG_36h11")],
)
def test_points_on_tags_are_refused_with_what_reads_them(family, named):
    with pytest.raises(TrackingError, match=rf"lie on tags of {named}\w*; .*--tracker aruco --tags {named}"):
        Looks(tagged(family=f"DICT_{family}"), np.add(PLACES, [[3.0, 4.0], [-5.0, 2.0], [2.0, -3.0]]))


@pytest.mark.parametrize(("shift", "far"), [((20, 0), 20), ((-18, 24), 30)])
def test_points_beside_the_markers_are_refused_with_the_nearest_one(shift, far):
    with pytest.raises(TrackingError, match=rf"radius of 8 px and is {far} px away, at \(50, 51\)"):
        Looks(picture(*discs(8.0)), GRID + shift)


@pytest.mark.parametrize("noise", [0.0, 4.0])
def test_an_even_picture_is_refused(noise):
    even = np.random.default_rng(0).normal(120, noise, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    with pytest.raises(TrackingError, match=r"[5-7] of 7 points.* \(50, 51\).*: the picture is even there"):
        Looks(even, GRID)


def test_a_faint_marker_on_a_narrow_body_isnt_taken_for_the_body():
    rows, columns = np.mgrid[:160, :420]
    image = np.full((160, 420, 3), (200.0, 225.0, 230.0))  # water
    taper = 7 + 0.03 * columns
    image[np.abs(rows - 80) < taper] = (30, 34, 40)
    points = np.array([[60.0, 80.0], [130, 80], [200, 80], [270, 80], [340, 80]])
    for x, y in points:
        image[np.hypot(columns - x, rows - y) < 7] = (55, 61, 67)
    image = np.clip(image + np.random.default_rng(0).normal(0, 2, image.shape), 0, 255).astype(np.uint8)
    looks = Looks(image, points)
    assert np.abs(looks.radii - 7).max() < 1
