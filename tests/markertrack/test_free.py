"""Markers that nothing connects: what real films showed, drawn. Each of these was lost or mistaken without flow."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from test_bodies import FPS, HEIGHT, MIDDLE, RADIUS, SHEET, WIDTH, errors, silent

from markertrack.both_ways import both_ways
from markertrack.tracking.colors import OwnColors
from markertrack.tracking.markers import MarkerTracker

GROUND = np.random.default_rng(3).normal(0, 1, (HEIGHT // 6, WIDTH // 6)).repeat(6, 0).repeat(6, 1)


def painted(places, radius, color, ground=150.0, texture=0.0):
    """Pictures of discs of a radius and a color (3,) that change with the frame, on a ground that doesn't."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]

    def picture(frame):
        image = np.repeat((ground + texture * GROUND)[..., None], 3, axis=2)
        for x, y in places(frame):
            inside = np.clip(radius(frame) + 0.5 - np.hypot(columns - x, rows - y), 0, 1)[..., None]
            image = image * (1 - inside) + np.asarray(color(frame)) * inside
        noise = np.random.default_rng(frame).normal(0, 2, image.shape)
        return np.clip(image + noise, 0, 255).astype(np.uint8)

    return picture


@dataclass
class Shown:
    """A frame of a drawn film."""

    index: int
    picture: Callable[[int], NDArray[np.uint8]]
    intact: bool = True

    @property
    def image(self):
        return self.picture(self.index)

    @property
    def time(self):
        return self.index / FPS


def seen_both_ways(tracker, picture, picks, frames):
    """Positions (T, M, 2) and confidence (T, M)."""
    seen = both_ways(tracker, [Shown(frame, picture) for frame in range(frames)], picks)
    return tuple(np.array(part) for part in list(zip(*seen, strict=True))[1:])


def wandering(frame):
    return MIDDLE + np.array([[-90 + 1.5 * frame, 30 * np.sin(frame / 9)], [90 - 1.2 * frame, -60 + 0.4 * frame]])


@pytest.mark.parametrize(
    ("radius", "color"),
    [
        (lambda k: 5 + 0.3 * k, lambda k: (40 + 1.5 * k,) * 3),  # a dot on a balloon grows and fades
        (lambda k: 24 - 0.3 * k, lambda k: (60, 40, 40)),
        (lambda k: 8, lambda k: (200 - 3 * k, 40, 40 + 3 * k)),  # a ball that rolls onto its other color
        (lambda k: 3, lambda k: (250, 250 - 2 * k, 40)),  # a lamp
    ],
    ids=["grows and fades", "shrinks", "changes its color", "lamp"],
)
def test_a_marker_that_changes_is_followed(radius, color):
    picture = painted(wandering, radius, color, texture=12.0)
    off, confidence = errors(MarkerTracker(range(2)), wandering, 50, picture=picture)
    assert silent(off, confidence) == []
    assert (confidence >= 0.5).mean() > 0.95


@pytest.mark.parametrize("bodies", [(0, 1, 2), (0, 0, 0)], ids=["free", "on a body"])
def test_markers_that_touch_are_told_apart(bodies):
    def places(frame):
        turn, middle = frame / 15, MIDDLE + np.array([1.5 * frame, 10 * np.sin(frame / 9)])
        spokes = [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]] @ np.array([[0, 11, 40], [0, 3, 30]])
        return middle + spokes.T

    picture = painted(places, lambda k: RADIUS, lambda k: (240, 120, 30))
    truth = np.array([places(frame) for frame in range(40)])
    positions, confidence = seen_both_ways(MarkerTracker(bodies), picture, truth[0] + [1.5, -1], len(truth))
    assert (confidence >= 0.5).all()
    assert np.linalg.norm(positions - truth, axis=2).max() < 1


@pytest.mark.parametrize("others", [0, 1])
def test_one_that_was_hidden_for_long_is_found_where_it_alone_can_be(others):
    """It comes back elsewhere, and stays doubtful where another one like it comes as well."""

    def shown(frame):
        if not frame:
            return wandering(0)
        away = [wandering(30)[1], wandering(30)[1] + [0, 60]][: 1 + others]
        return wandering(0)[[0]] if frame < 30 else np.array([wandering(0)[0], *away])

    picture = painted(shown, lambda k: 7, lambda k: (30, 30, 30), texture=12.0)
    positions, confidence = seen_both_ways(MarkerTracker(range(2)), picture, wandering(0), 45)
    assert (confidence[1:30, 1] < 0.5).all()
    assert (confidence[40:, 1] >= 0.5).all() == (not others)
    assert others or np.hypot(*(positions[-1, 1] - wandering(30)[1])) < 1
    assert (confidence[:, 0] >= 0.5).all()


def test_a_body_that_turns_out_to_be_soft_is_followed():
    """Each dot goes its own way by several radii, though the robot file says that they are on one body."""

    def places(frame):
        own = 5 * RADIUS * np.sin(np.clip(frame, 0, 40) / 40 * np.pi / 2)
        return SHEET + own * np.stack([np.sin(3.0 * np.arange(12)), np.cos(5.0 * np.arange(12))], axis=1) / 2

    off, confidence = errors(MarkerTracker([1] * 12), places, 45)
    assert silent(off, confidence) == []
    assert (confidence >= 0.5).mean() > 0.9


BLACK = (30, 30, 30)


def hidden(truth, frames, markers):
    """What is shown of places at a frame, if some markers aren't within some frames."""

    def shown(frame):
        places = truth(frame)
        return np.delete(places, markers, axis=0) if frame in frames else places

    return shown


def tracked(truth, shown, frames, radius=7, texture=0.0):
    """Whether each marker is usable in each frame; no silent error is."""
    picture = painted(shown, lambda k: radius, lambda k: BLACK, texture=texture)
    found, confidence = seen_both_ways(MarkerTracker(range(len(truth(0)))), picture, truth(0), frames)
    off = np.linalg.norm(found - np.array([truth(frame) for frame in range(frames)]), axis=2)
    assert silent(off, confidence) == []
    return confidence >= 0.5


def test_one_that_was_hidden_for_long_is_found_again():
    """Nothing like it is near, and it isn't farther away than it may have moved."""
    sure = tracked(wandering, hidden(wandering, range(8, 23), [1]), 40)
    assert sure[:, 0].all()
    assert not sure[8:23, 1].any()
    assert sure[30:, 1].all()


def test_two_alike_that_cross_while_they_are_hidden_stay_doubtful():
    def truth(frame):
        return MIDDLE + np.array([[2.0 * (frame - 16), -4.0], [-2.0 * (frame - 16), 4.0]])

    sure = tracked(truth, hidden(truth, range(8, 23), [0, 1]), 45)
    assert sure[:8].all()
    assert not sure[8:].any()


@pytest.mark.parametrize("speed", [14.0, 20.0, 26.0])
def test_a_repeated_picture_and_the_doubled_step_after_it_are_followed(speed):
    def truth(frame):
        moved = speed * (frame - (frame % 5 == 4))
        return MIDDLE + np.array([[moved - 190, 10.0], [moved - 190, -60.0]])

    assert tracked(truth, truth, int(370 / speed), radius=4, texture=12.0).all()


@pytest.mark.parametrize("color", [(40, 150, 60), (30, 30, 30), (250, 250, 250)])
def test_a_place_without_the_colors_of_a_marker_isnt_its(color):
    """Neither the ground beside it, nor a marker of another color; in other light it still is, once that is learned."""
    image = painted(wandering, lambda k: 7, lambda k: color, texture=12.0)(0)
    here, radii = wandering(0), np.full(2, 7.0)
    image[int(here[1, 1]) - 9 : int(here[1, 1]) + 10, int(here[1, 0]) - 9 : int(here[1, 0]) + 10] = (200, 60, 90)
    colors = OwnColors(image, here, radii)
    assert colors.are_at(image, 0, here[0], 7.0)
    assert not colors.are_at(image, 0, here[0] + [0, 30], 7.0)
    assert not colors.are_at(image, 0, here[1], 7.0)
    darker = (image * 0.7).astype(np.uint8)
    for _ in range(40):
        colors.learn(darker, 0, here[0], 7.0)
    assert colors.are_at(darker, 0, here[0], 7.0)
