"""Doubt of a linked midline, from evidence of the whole film.

A confidence falls with how far length, area, widths and the head's jumps are off their course, in standard deviations
of most frames. What was lost sight of, in a jump or beside another shape, stays in doubt until there is evidence anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from markertrack.midline.centerline import POINTS, Curve
from markertrack.midline.linking import LEAST, MOST, STEP, Linked, along, deviations, spread, usual
from markertrack.tracking.tracker import DOUBT
from swimbase.arrays import Array, Mask

REASONS = (
    "its length is off", "its area is off", "its widths are off", "its head jumps against the body",
    "something else is near", "it touches the edge of the picture", "another curve may be meant",
    "its other end may be the head", "it jumps or meets another shape, and isn't alone since",
)  # fmt: skip
DOUBTED = 6.0  # standard deviations at which a confidence is a half
SHORT = 0.5  # weight of lengths, and areas, that are too small: a tail fades, and what is seen of it is right
MERGED = 0.25  # logarithm of its area by the usual one, from which it has met another shape
JUMP = 0.008, 0.03  # lengths that the head's jumps have as a standard deviation, at least and at most
LIKELY = 5.0  # cost that the second best path must have more
NEAR, FORE = 0.08, POINTS * 3 // 4  # lengths within which something else may be a part of it, except at the tail
TURNED = 0.15  # share of widths by which a curve must be more, or less, like the swimmer than the other way round
SUDDEN = 6.0  # times the steps before and after, from which a step is a jump


def judge(
    found: Sequence[Sequence[Curve]], linked: Linked, known: Mapping[int, int]
) -> tuple[Array, dict[str, Mask]]:  # fmt: skip
    """Confidence in the curves that were chosen, from 0 to 1, and the frames that are doubted for each reason.

    Args:
        found: Curves of each frame.
        linked: Those that were chosen.
        known: Number of the swimmer's curve in the frames that a person clicked in.

    Returns:
        Confidence of shape (T,), and frames of shape (T,) by `REASONS`.
    """
    swimmer, frames = found[min(known)][known[min(known)]], np.flatnonzero(linked.chosen >= 0)
    curves = [found[t][linked.chosen[t]] for t in frames.tolist()]
    off = np.array([deviations(curve, swimmer) for curve in curves])
    ahead = np.array([deviations(curve.turned, swimmer)[2] for curve in curves]) - off[:, 2]
    off -= usual(off)
    points = np.array([along(curve, swimmer.length) for curve in curves]) / swimmer.length
    body = np.nanmean(points[:, POINTS // 10 : POINTS // 2], axis=1)
    values = np.column_stack([off, np.hypot(*(_bent(points[:, 0]) - _bent(body)).T)])
    scores = (
        np.where(values < 0, SHORT, 1.0) * np.abs(values) / np.clip(spread(values), (*LEAST, JUMP[0]), (*MOST, JUMP[1]))
    )

    step = np.hypot(*np.diff(body, axis=0).T)
    around = np.maximum(np.append(step[1:], 0), np.append(0, step[:-1])) + STEP
    merged = off[:, 1] > MERGED
    alone = np.array([len({curve.shape for curve in found[t]}) < 2 for t in frames.tolist()])
    whole = np.array([along(curve, curve.length) for curve in curves])
    stays, swaps = (np.linalg.norm(one - whole[:-1], axis=2).mean(axis=1) for one in (whole[1:], whole[1:, ::-1]))
    near = np.array([(curve.apart - curve.widths / 2)[:FORE].min() for curve in curves]) < NEAR * swimmer.length
    turned = (ahead < -TURNED) | _after(swaps < stays, ahead > TURNED, frames, known)
    lost = _after((step > SUDDEN * around) | merged[1:] | merged[:-1], alone & ~merged, frames, known)
    cut = np.array([curve.cut for curve in curves])
    doubts = np.column_stack([scores > DOUBTED, near, cut, linked.margin[frames] < LIKELY, turned, lost])

    confidence = np.zeros(len(found))
    confidence[frames] = np.prod(1 / (1 + (scores / DOUBTED) ** 4), axis=1)
    confidence[frames[doubts.any(axis=1)]] = np.minimum(confidence[frames[doubts.any(axis=1)]], DOUBT)
    reasons = {name: np.zeros(len(found), dtype=bool) for name in REASONS}
    for name, column in zip(REASONS, doubts.T, strict=True):
        reasons[name][frames] = column
    return confidence, reasons


def _bent(places: Array) -> Array:
    """Distance of each place from the middle of those before and after it. Shape (K, 2)."""
    padded = np.concatenate([places[:1], places, places[-1:]])
    return places - (padded[:-2] + padded[2:]) / 2


def _after(breaks: Mask, sure: Mask, frames: NDArray[np.int64], known: Mapping[int, int]) -> Mask:
    """Frames beyond a break, as seen from the first known one, up to one that is sure. Shapes (K - 1,), (K,)."""
    sure = sure | np.isin(frames, list(known))
    out = np.zeros(len(frames), dtype=bool)
    start = int(np.searchsorted(frames, min(known)))
    for k in range(start + 1, len(frames)):
        out[k] = not sure[k] and (out[k - 1] or breaks[k - 1])
    for k in range(start - 1, -1, -1):
        out[k] = not sure[k] and (out[k + 1] or breaks[k])
    return out
