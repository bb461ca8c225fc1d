"""Finds the markers in a first frame without a click: round blobs that lie as the robot's markers do, head to tail.

The body may be bent, so what is compared are the distances of neighbors, up to one scale, and how much the line through
them turns; the head is straight. Distances differ along the robot, so its two ends can't be mistaken. All that differs
counts in its own standard deviations. When something else is nearly as likely, or nothing likely, it says so: a person
then picks the points. It can't notice that the first or last marker is hidden while a look-alike of its size and color
lies where it might be.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from markertrack.tracking.tracker import Array, Image
from swimbase.errors import TrackingError

Index = NDArray[np.intp]

# standard deviations
PLACEMENT = 0.0035  # m, of a distance of two markers, and
STRETCH = 0.04  # share of it
RAISED_PLACEMENT = 0.012  # m, of distances to a marker that stands higher: the published tracks have up to twice that
SLANT = 0.4  # tangent of the angle under which a camera sees the robot
HEAD_TURN, TAIL_TURN = np.radians(4), np.radians(15)  # of the line through markers at the second one, and at others
SIZE = 0.12  # logarithm of a marker's radius
COLOR, SHADE = 10.0, 0.1  # 8-bit steps of a marker's color, and share of its contrast

SURE = 0.99  # of the right labelings that are looked at, and probability of one against any other that is believed
WORKING_SIZE = 1920  # px of the longer side of a frame, for the search
SMALLEST = 1.6  # px, radius of a blob there
MOST_CHAINS = 20000  # that are followed at once
PICK = "pick the points with `swim2real pick`"


@dataclass(frozen=True)
class Blobs:
    """Blobs, the most prominent first.

    Attributes:
        points: Centers [px]. Shape (N, 2).
        radii: Radii of discs with the same area [px]. Shape (N,).
        colors: RGB inside. Shape (N, 3).
        contrasts: RGB inside minus RGB around. Shape (N, 3).
    """

    points: Array
    radii: Array
    colors: Array
    contrasts: Array

    def __len__(self) -> int:
        return len(self.points)


def find_blobs(image: Image) -> Blobs:
    """Finds round blobs by OpenCV's detector, in each color, at one size and smoothed by a pixel: jags aren't round.

    Args:
        image: RGB. Shape (H, W, 3).
    """
    factor = max(image.shape[:2]) / WORKING_SIZE
    small = cv2.resize(cv2.GaussianBlur(image, (0, 0), max(factor, 1.0)), None, fx=1 / factor, fy=1 / factor)
    how = cv2.SimpleBlobDetector.Params()
    how.minThreshold, how.maxThreshold = 0.0, 255.0
    how.filterByColor = how.filterByConvexity = False
    how.filterByCircularity = True
    how.minArea, how.maxArea, how.minDistBetweenBlobs = np.pi * SMALLEST**2, small[..., 0].size / 4, 2 * SMALLEST
    detector = cv2.SimpleBlobDetector.create(how)
    found = [spot for channel in cv2.split(small) for spot in detector.detect(channel)]
    points = (np.array([spot.pt for spot in found]).reshape(-1, 2) + 0.5) * factor - 0.5
    radii, colors, contrasts = _measured(image, points, np.array([spot.size / 2 * factor for spot in found]))
    order = np.argsort(-np.linalg.norm(contrasts, axis=1), kind="stable")
    near = np.linalg.norm(points[:, None] - points, axis=2) < np.maximum(radii[:, None], radii)
    kept: list[int] = []
    for blob in order.tolist():  # the same one is found in several colors
        if not near[blob, kept].any():
            kept.append(blob)
    return Blobs(points[kept], radii[kept], colors[kept], contrasts[kept])


def label_markers(image: Image, rest_markers: Array, heights: Array | None = None) -> Array:
    """Finds the markers of a frame and says which is which.

    Args:
        image: RGB, upright. Shape (H, W, 3).
        rest_markers: Marker positions of the straight robot, head first [m]. Shape (M, 2).
        heights: Heights of the markers [m]; a slanted view displaces higher ones. None where they are all the same.
            Shape (M,).

    Returns:
        Points, head to tail [px]. Shape (M, 2).

    Raises:
        TrackingError: Too few blobs, no labeling that fits, or more than one.
    """
    return label_blobs(find_blobs(image), rest_markers, heights)


def label_blobs(blobs: Blobs, rest_markers: Array, heights: Array | None = None) -> Array:
    """Says which of some blobs are which markers; as `label_markers`."""
    count = len(rest_markers)
    raised = np.zeros(count) if heights is None else heights - _most_common(heights)
    if len(blobs) < count:
        raise TrackingError(f"{len(blobs)} round blobs were found in the frame, of {count} markers; {PICK}")
    markers = np.argsort(raised != 0, kind="stable")  # the raised ones come last, when the line is known
    chains, costs = np.arange(len(blobs))[:, None], np.zeros(len(blobs))
    for k in range(2, count + 1):
        chains, costs = _extended(blobs, chains, rest_markers, raised, markers[:k])
        if len(chains) > MOST_CHAINS:
            raise TrackingError(
                f"{len(blobs)} round blobs in the frame look alike, too many to tell which are markers; {PICK}"
            )
    if not len(chains):
        raise TrackingError(
            f"of {len(blobs)} round blobs in the frame no {count} lie as the robot's markers do; {PICK}"
        )
    order = np.argsort(costs, kind="stable")
    best, others = chains[order[0]], chains[order[1:2]]
    off = _lie(blobs.points[best][None], rest_markers, raised)
    unusual = np.sqrt((off**2).sum() / float(chdtri(off.size - 1, 0.5)))
    if unusual > 1:
        raise TrackingError(
            f"of {len(blobs)} round blobs in the frame the {count} that lie most like the robot's markers are off by "
            f"{unusual:.1f} times what is usual, too much to be sure; {PICK}"
        )
    if len(others) and costs[order[1]] < costs[order[0]] + 2 * np.log(SURE / (1 - SURE)):
        differ = ", ".join(map(str, np.flatnonzero(others[0] != best)))
        raise TrackingError(
            f"{len(blobs)} round blobs were found in the frame, and two ways to label {count} of them fit about "
            f"equally well; they differ in marker {differ} from the head, counted from 0; {PICK}"
        )
    return blobs.points[best]


def _most_common(heights: Array) -> float:
    values, counts = np.unique(heights, return_counts=True)
    return float(values[np.argmax(counts)])


def _measured(image: Image, points: Array, rough: Array) -> tuple[Array, Array, Array]:
    """Radii of blobs from the area that is nearer to their color than what is around them is; colors, contrasts.

    Shapes (N,), (N, 3), (N, 3).
    """
    radii, colors, contrasts = np.zeros(len(points)), *np.zeros((2, len(points), 3))
    for k, ((x, y), radius) in enumerate(zip(points, rough, strict=True)):
        left, top = max(int(x - 2 * radius - 2), 0), max(int(y - 2 * radius - 2), 0)
        part = image[top : int(y + 2 * radius) + 4, left : int(x + 2 * radius) + 4]
        rows, columns = np.ogrid[top : top + part.shape[0], left : left + part.shape[1]]
        away = np.hypot(columns - x, rows - y)
        colors[k] = np.median(part[away <= max(0.7 * radius, 1.0)], axis=0)
        contrasts[k] = colors[k] - np.median(part[away > 1.3 * radius + 1], axis=0)
        own = np.linalg.norm(part - colors[k], axis=2) < np.linalg.norm(contrasts[k]) / 2
        radii[k] = np.sqrt(max((own & (away <= 1.5 * radius)).sum(), 1) / np.pi)
    return radii, colors, contrasts


def _extended(blobs: Blobs, chains: Index, rest: Array, raised: Array, markers: Index) -> tuple[Index, Array]:
    """Each chain with each blob that may be the last of some markers, head to tail, and what it costs.

    Args:
        blobs: All blobs.
        chains: Blobs of the markers before, head to tail. Shape (K, m - 1).
        rest: Positions of the straight robot's markers [m]. Shape (M, 2).
        raised: By how much they are higher than most [m]. Shape (M,).
        markers: Which ones are placed. Shape (m,).

    Returns:
        Chains that aren't worse than nearly all right ones are, shape (L, m), and their costs, shape (L,).
    """
    of = np.sort(markers)
    place = int(np.flatnonzero(of == markers[-1])[0])
    grown, costs = [np.empty((0, len(of)), dtype=np.intp)], [np.empty(0)]
    size = max(1, 2**18 // len(blobs))
    for start in range(0, len(chains), size):
        part = chains[start : start + size]
        which, blob = np.nonzero((part[:, None] != np.arange(len(blobs))[:, None]).all(axis=2))
        new = np.insert(part[which], place, blob, axis=1)
        lie, look = _lie(blobs.points[new], rest[of], raised[of]), _look(blobs, new)
        cost, differ = ((off**2).sum(axis=1) for off in (lie, look))
        fits = (cost < chdtri(max(lie.shape[1] - 1, 1), 1 - SURE)) & (differ < chdtri(look.shape[1], 1 - SURE))
        grown.append(new[fits])
        costs.append((cost + differ)[fits])
    return np.concatenate(grown), np.concatenate(costs)


def _lie(points: Array, rest: Array, raised: Array) -> Array:
    """By how many standard deviations chains differ from the robot, at their likeliest scale and slant. Shape (K, R).

    Args:
        points: Of chains [px]. Shape (K, m, 2).
        rest: Of the straight robot [m]. Shape (m, 2).
        raised: By how much they are higher than most [m]. Shape (m,).
    """
    gaps, lifted = np.linalg.norm(np.diff(rest, axis=0), axis=1), np.diff(raised) != 0
    sigma = np.sqrt(PLACEMENT**2 + (STRETCH * gaps) ** 2 + lifted * RAISED_PLACEMENT**2)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2) / sigma
    scale = lengths @ (gaps / sigma) / np.maximum((lengths**2).sum(axis=1), 1e-12)  # m/px
    places = points * scale[:, None, None]
    slant = _slant(places, rest, raised)
    steps = np.diff(places - raised[:, None] * slant[:, None], axis=1)
    distances = (np.linalg.norm(steps, axis=2) - gaps) / sigma
    ways = steps[..., 0] + 1j * steps[..., 1]
    aside = sigma / gaps  # what a displaced marker does to the line
    usual = np.where(np.arange(len(gaps) - 1) == 0, HEAD_TURN, TAIL_TURN)
    turns = np.angle(ways[:, 1:] * ways[:, :-1].conj()) / np.hypot(usual, np.hypot(aside[:-1], aside[1:]))
    return np.concatenate([distances, turns, slant / SLANT] if raised.any() else [distances, turns], axis=1)


def _look(blobs: Blobs, chains: Index) -> Array:
    """By how many standard deviations the sizes and colors of blobs differ from the chain's usual ones. Shape (K, R).

    What is around them doesn't count: the last marker may have water around it, the others the hull.
    """
    sizes, colors = np.log(blobs.radii[chains]), blobs.colors[chains]
    strength = np.median(np.linalg.norm(blobs.contrasts[chains], axis=2), axis=1)[:, None]
    shades = np.linalg.norm(colors - np.median(colors, axis=1, keepdims=True), axis=2) / (COLOR + SHADE * strength)
    return np.concatenate([(sizes - np.median(sizes, axis=1, keepdims=True)) / SIZE, shades], axis=1)


def _slant(places: Array, rest: Array, raised: Array) -> Array:
    """The likeliest slant of the view, which puts raised markers onto the line through two others. Shape (K, 2).

    Args:
        places: Of chains [m]. Shape (K, m, 2).
        rest: Of the straight robot [m]. Shape (m, 2).
        raised: By how much they are higher than most [m]. Shape (m,).
    """
    level = np.flatnonzero(raised == 0)
    total, weight = np.zeros((len(places), 2)), 1 / SLANT**2
    for m in np.flatnonzero(raised).tolist():
        first = int(np.clip(np.searchsorted(level, m) - 1, 0, len(level) - 2))
        a, b = level[first : first + 2]
        share = (rest[m, 0] - rest[a, 0]) / (rest[b, 0] - rest[a, 0])
        beyond = max(share - 1, -share, 0.0) * abs(rest[b, 0] - rest[a, 0])  # the line may turn
        sigma = np.hypot(RAISED_PLACEMENT, TAIL_TURN * beyond)
        total += raised[m] / sigma**2 * (places[:, m] - (1 - share) * places[:, a] - share * places[:, b])
        weight += raised[m] ** 2 / sigma**2
    return total / weight
