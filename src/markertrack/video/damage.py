"""Finds damaged pictures that no decoder reports: blocks in them differ from the picture before and from the one after.

Where noise takes the place of a picture's data, MJPEG and HEVC decoders show gray or wrong blocks, or blocks of an
earlier picture, and say nothing. The pictures around it agree with one another there, unless they are predicted from
it. Things that move fast differ from both neighbors as well, but in the pictures around, too; damage stands alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from av import VideoFrame
from numba import njit  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from markertrack.video.decoding import Picture

REPORTED = ("h264",)  # codecs whose decoder reports what is damaged
BLOCK = 16  # px, of a macroblock
BLOCKS = 5  # that a picture is judged by: those that differ most
RATIO = 5.0  # by which damage stands out of the pictures around it
LEAST = 10.0  # gray levels by which they differ in the mean, at least
EACH = 3.0  # and each of them
LONG = 1.5  # times the shortest step in time around: a picture is missing
NEAR = 4  # pictures on each side that damage stands out of; those right beside it are touched by it

Gray = NDArray[np.uint8]


class _Score(NamedTuple):
    """By how many gray levels the blocks differ that differ most: in the mean, and the one of them that does least."""

    mean: float
    least: float


def marked(pictures: Generator[Picture]) -> Generator[Picture]:
    """The same pictures, `odd` where one looks damaged. As many as `NEAR` are decoded ahead."""
    waiting: deque[Picture] = deque()  # not yet judged
    grays: deque[Gray] = deque(maxlen=3)
    stamps: deque[int | None] = deque(maxlen=2 * NEAR + 1)
    # around the picture that is judged next; None where there is none
    scores: deque[_Score | None] = deque([None] * NEAR, maxlen=2 * NEAR + 1)
    for picture in pictures:
        waiting.append(picture)
        grays.append(_gray(picture.stored))
        stamps.append(picture.stamp)
        if len(grays) > 1:  # the score is that of the picture before; the first has none
            scores.append(_score(*grays) if len(grays) == 3 and not _gap(stamps) else None)
        if len(scores) == 2 * NEAR + 1:
            yield _judged(waiting.popleft(), scores)
    while waiting:  # the last one has no score, nor has what would come after it
        scores.append(None)
        if len(scores) == 2 * NEAR + 1:
            yield _judged(waiting.popleft(), scores)


def _judged(picture: Picture, scores: Sequence[_Score | None]) -> Picture:
    """A picture with the scores around it, its own in the middle."""
    own = scores[NEAR]
    apart = [score.mean for i, score in enumerate(scores) if abs(i - NEAR) > 1 and score is not None]
    if own is None or len(apart) <= NEAR:
        return picture  # there is too little to compare it with
    odd = own.mean > max(LEAST, RATIO * max(apart)) and own.least > EACH
    return replace(picture, odd=True) if odd else picture


def _gap(stamps: Sequence[int | None]) -> bool:
    """True if pictures are missing right before or after the last but one, so that things have moved on by more."""
    known = [stamp for stamp in stamps if stamp is not None]
    steps = [after - before for before, after in pairwise(known)]
    return len(known) == len(stamps) and max(steps[-2:]) > LONG * min(steps)


def _score(before: Gray, now: Gray, after: Gray) -> _Score | None:
    """By how much a picture differs from both its neighbors, beyond what these do; None where it is unknown."""
    if not before.shape == now.shape == after.shape or min(now.shape) < BLOCKS * BLOCK:
        return None
    blocks = _differences(before, now, after) / (BLOCK * BLOCK / 2)
    most = np.partition(blocks, -BLOCKS, axis=None)[-BLOCKS:]
    return _Score(float(most.mean()), float(most.min()))


@njit(cache=True, nogil=True)
def _differences(before: Gray, now: Gray, after: Gray) -> NDArray[np.int64]:
    """Sums of each block, on every other line. Shape (H // BLOCK, W // BLOCK)."""
    rows, columns = now.shape[0] // BLOCK, now.shape[1] // BLOCK
    sums = np.zeros((rows, columns), dtype=np.int64)
    for row in range(rows):
        for y in range(row * BLOCK, (row + 1) * BLOCK, 2):
            for column in range(columns):
                total = 0
                for x in range(column * BLOCK, (column + 1) * BLOCK):
                    b, n, a = np.int32(before[y, x]), np.int32(now[y, x]), np.int32(after[y, x])
                    total += max(0, min(abs(n - b), abs(n - a)) - abs(a - b))
                sums[row, column] += total
    return sums


def _gray(stored: VideoFrame) -> Gray:
    """The picture's brightness, without a copy where it is stored as it is. Shape (H, W)."""
    if stored.format.name in ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "nv12", "gray"):
        plane: Any = stored.planes[0]
        lines = np.frombuffer(plane, dtype=np.uint8)[: plane.line_size * stored.height]
        return lines.reshape(stored.height, plane.line_size)[:, : stored.width]
    return np.asarray(stored.to_ndarray(format="gray"), dtype=np.uint8)
