"""How markers move from one picture to the next, by the flow of points on them.

Flow is OpenCV's, by Lucas and Kanade: every point is followed there and back. The half of them that comes back closest
to where it began tells the marker's step and by how much it grew (Kalal, Mikolajczyk, Matas: Forward-backward error,
ICPR 2010).
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.tracker import DETAIL, EXACT, Array, Image, Mask

ACROSS = 7  # points on a marker's diameter
RIM = 1.1  # radii around its center in which its points lie
WINDOWS = 9, 13, 21  # px sides of the windows that are compared, for radii of up to half as much and above
LEVELS, ROUNDS, CLOSE = 3, 20, 0.03  # of the pyramid, and when an estimate is done
MOST_GROWTH = 1.1  # by which a marker may grow or shrink in a frame

Picture = NDArray[np.uint8]


class Moves(NamedTuple):
    """How markers moved.

    Attributes:
        steps: Way of each [px]. Shape (M, 2).
        growths: By how much each has grown. Shape (M,).
        errors: By how much its points disagree, there and back and with one another; inf if none was followed [px].
            Shape (M,).
    """

    steps: Array
    growths: Array
    errors: Array

    def agree(self, radii: Array) -> Mask:
        """Whether the points of each agree, by the markers' radii (M,) [px]. Shape (M,)."""
        return self.errors < np.maximum(EXACT[0], EXACT[1] * radii)


class Flow:
    """Follows the markers from the last picture to the next."""

    def __init__(self, image: Image) -> None:
        self._last = {1: _gray(image)}
        across = np.linspace(-RIM, RIM, ACROSS)
        grid = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
        self._disc = grid[np.hypot(*grid.T) <= RIM]

    def follow(self, image: Image, places: Array, radii: Array, steps: Array) -> Moves:
        """Takes the next picture.

        Args:
            image: RGB. Shape (H, W, 3).
            places: Where the markers were in the last one, NaN for those that aren't followed [px]. Shape (M, 2).
            radii: Their radii [px]. Shape (M,).
            steps: How they may have moved; standing still is tried as well [px]. Shape (M, 2).
        """
        now = {1: _gray(image)}
        best = Moves(np.zeros_like(places), np.ones(len(places)), np.full(len(places), np.inf))
        shares = 2 ** np.maximum(np.ceil(np.log2(radii / DETAIL)), 0).astype(np.int64)
        asked = np.isfinite(places[:, 0])
        for share in np.unique(shares[asked]).tolist():
            for pictures in (self._last, now):
                if share not in pictures:
                    pictures[share] = _smaller(pictures[1], share)
            of = np.flatnonzero((shares == share) & asked)
            moving = of[np.hypot(*steps[of].T) > EXACT[0]]  # else its last step tells nothing about the next one
            guesses = np.concatenate([np.zeros((len(of), 2)), steps[moving]])
            self._improve(best, now, share, np.concatenate([of, moving]), places, radii, guesses)
        self._last = now
        return best

    def _improve(
        self, best: Moves, now: dict[int, Picture], share: int, of: NDArray[np.int64], places: Array, radii: Array,
        guesses: Array,
    ) -> None:  # fmt: skip
        """Puts in what is better than the moves that are known, by pictures of a share of the size.

        Markers (K,) may have moved as is guessed (K, 2); one of which two things are guessed is there twice.
        """
        shift = (share - 1) / 2  # between the centers of the pixels
        window = WINDOWS[int(np.searchsorted(WINDOWS[:-1], 2 * radii[of].max() / share))]
        points = ((places[of, None] + radii[of, None, None] * self._disc - shift) / share).astype(np.float32)
        guess = (guesses[:, None] / share).astype(np.float32)
        first, second = self._last[share], now[share]
        there, seen = _flow(first, second, points, points + guess, window)
        back, again = _flow(second, first, there, there - guess, window)
        off = np.where(seen & again, share * np.linalg.norm(back - points, axis=2), np.inf)
        points, there = share * points + shift, share * there + shift
        for marker, before, after, errors in zip(of.tolist(), points, there, off, strict=True):
            middle = float(np.median(errors))
            if not np.isfinite(middle):
                continue
            good = errors <= middle
            step, growth, spread = _median_move(before[good], after[good], places[marker])
            if middle + spread < best.errors[marker]:
                best.steps[marker], best.growths[marker], best.errors[marker] = step, growth, middle + spread


def _gray(image: Image) -> Picture:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _smaller(picture: Picture, share: int) -> Picture:
    smaller = cv2.resize(picture, None, fx=1 / share, fy=1 / share, interpolation=cv2.INTER_AREA)
    return np.asarray(smaller, dtype=np.uint8)


def _flow(
    first: Picture, second: Picture, points: NDArray[np.float32], guesses: NDArray[np.float32], window: int
) -> tuple[NDArray[np.float32], Mask]:
    """Where points (K, N, 2) of the first picture are in the second, and which of them were found (K, N).

    Only the part of both that they are in is compared, with as much around it as the coarsest level sees.
    """
    pixel, size = 2**LEVELS, np.array(first.shape[::-1])  # of the coarsest level
    both = np.concatenate([points, guesses]).reshape(-1, 2)
    low = ((both.min(axis=0) - 2 * window * pixel).clip(0, size - 1) // pixel * pixel).astype(np.int64)
    high = (both.max(axis=0) + 2 * window * pixel).clip(low + 1, size).astype(np.int64)
    part, corner = np.s_[low[1] : high[1], low[0] : high[0]], low.astype(np.float32)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        first[part], second[part], (points - corner).reshape(-1, 1, 2), (guesses - corner).reshape(-1, 1, 2),
        winSize=(window, window), maxLevel=LEVELS, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ROUNDS, CLOSE),
    )  # fmt: skip
    there = np.asarray(found, dtype=np.float32).reshape(points.shape) + corner
    return there, status.reshape(points.shape[:2]) > 0


def _median_move(before: Array, after: Array, place: Array) -> tuple[Array, float, float]:
    """Median step (2,) and growth of points (N, 2), and how far their median one is off it [px]."""
    steps = after - before
    step = np.median(steps, axis=0)
    first, second = np.triu_indices(len(before), 1)
    lengths = np.linalg.norm(before[first] - before[second], axis=1)
    growth = np.median(np.linalg.norm(after[first] - after[second], axis=1) / np.maximum(lengths, 1e-6))
    growth = float(np.clip(growth, 1 / MOST_GROWTH, MOST_GROWTH))
    off = np.linalg.norm(steps - step - (growth - 1) * (before - place), axis=1)
    return step, growth, float(np.median(off))
