"""Decision over a whole film: which curve of each frame is the swimmer, which end its head, and where this is in doubt.

A shortest path through the frames' curves begins at the clicked one, forward and backward. A curve costs by how far its
length, area and widths are from the clicked swimmer's, a step by the square of how far the body moves, in its own
lengths: many short ones are likelier than one jump. Frames may be left out. What the second-best path costs more, with another curve in the frame, tells how sure the choice is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markertrack.midline.centerline import POINTS, Curve
from markertrack.tracking.tracker import DOUBT, Array, Mask

REASONS = (
    "its length is off", "its area is off", "its widths are off", "its head jumps against the body",
    "another shape is near", "it touches the edge of the picture", "another curve may be meant",
    "it jumps where there are other shapes",
)  # fmt: skip
SPREADS = 0.1, 0.15, 0.2  # usual shares by which length, area and widths of a swimmer vary
STEP = 0.02  # lengths by which a body moves from frame to frame, at least
NEVER = 1e9  # cost of what a click excludes
MOST_OFF = 8.0  # cost of one measure, at most
LEFT_OUT = 25.0  # cost of a frame without the swimmer
APART = 0.1  # lengths between the heads, or the tails, of two curves that aren't the same
MOST_GAP = 12  # frames with shapes that may be left out in a row
LIKELY = 5.0  # cost that the second best must have more
LEAST = 0.03, 0.05, 0.10, 0.02  # standard deviations that length, area, widths and head have at least
DOUBTED = 6.0  # standard deviations at which a confidence is a half
SUDDEN = 6.0  # times the steps before and after, from which a step is a jump
NEAR = 0.1  # lengths from the curve within which another shape may be mistaken for a part


@dataclass(frozen=True)
class Linked:
    """The swimmer's curve in each frame.

    Attributes:
        chosen: Number of the curve among those of the frame, -1 where none is the swimmer. Shape (T,).
        confidence: How sure it is, from 0 to 1. Shape (T,).
        reasons: Frames that are doubted, by `REASONS`. Each of shape (T,).
    """

    chosen: NDArray[np.int64]
    confidence: Array
    reasons: Mapping[str, Mask]


def link(found: Sequence[Sequence[Curve]], known: Mapping[int, int]) -> Linked:
    """Chooses a curve in each frame.

    Args:
        found: Curves of each frame.
        known: Number of the swimmer's curve in the frames that a person clicked in; of one at least.
    """
    swimmer = found[min(known)][known[min(known)]]
    filled = [t for t in range(len(found)) if found[t]]
    stops = [t in known for t in filled]
    off = [np.array([_off(curve, swimmer) for curve in found[t]]) for t in filled]
    steps = _steps([found[t] for t in filled], stops, swimmer.length)
    chosen, margin, spreads = np.full(len(found), -1), np.zeros(len(found)), np.array(SPREADS)
    for _ in range(2):  # the second time by how much this swimmer varies
        costs = [_costs(found[t], one, known.get(t), spreads) for t, one in zip(filled, off, strict=True)]
        path, totals = _path(costs, steps, stops)
        mine = np.array([off[k][one] for k, one in path])
        off = [one - np.median(mine, axis=0) for one in off]
        spreads = np.maximum(_spread(mine), LEAST[:3])
    best = min(float(total.min()) for total in totals)
    for k, one in path:
        t = filled[k]
        tips = np.array([curve.points[[0, -1]] for curve in found[t]])
        other = (np.linalg.norm(tips - tips[one], axis=2) > APART * swimmer.length).any(axis=1)
        chosen[t], margin[t] = one, totals[k][other].min(initial=np.inf) - best
    return _judged(found, chosen, margin, swimmer, known)


def along(curve: Curve, length: float, count: int = POINTS) -> Array:
    """Points at equal distances from the head over a length, NaN beyond the end [px]. Shape (count, 2)."""
    at, travel = np.linspace(0, length, count), np.linspace(0, curve.length, POINTS)
    return np.stack([np.interp(at, travel, curve.points[:, k], right=np.nan) for k in (0, 1)], axis=1)


def _off(curve: Curve, swimmer: Curve) -> Array:
    """By which share length, area and widths of a curve are off the swimmer's. Shape (3,)."""
    at = np.linspace(0, min(curve.length, swimmer.length), POINTS)
    mine, usual = (np.interp(at, np.linspace(0, one.length, POINTS), one.widths) for one in (curve, swimmer))
    wide = np.abs(mine - usual).mean() / usual.mean()
    return np.array([np.log(curve.length / swimmer.length), np.log(curve.area / swimmer.area), wide])


def _costs(curves: Sequence[Curve], off: Array, known: int | None, spreads: Array) -> Array:
    """Costs of the curves of a frame, by how far they are off (C, 3). Shape (C,).

    The best curve of each shape costs nothing: which shape is the swimmer is told by where it was, however long another
    one looks more like it.
    """
    if known is not None:
        return np.where(np.arange(len(off)) == known, 0.0, NEVER)
    costs = np.minimum(np.abs(off) / spreads, MOST_OFF).sum(axis=1)
    shapes = np.array([curve.shape for curve in curves])
    return costs - np.array([costs[shapes == shape].min() for shape in shapes])


def _steps(found: Sequence[Sequence[Curve]], known: Sequence[bool], length: float) -> list[list[tuple[int, Array]]]:
    """For each frame the earlier ones that a path may come from, and what each step costs. Shapes (C, D)."""
    points = [np.array([along(one, length) for one in curves]) for curves in found]

    def apart(one: int, other: int) -> Array:
        away = np.linalg.norm(points[one][:, None] - points[other], axis=3)
        seen = np.isfinite(away)
        return np.where(seen, away, 0.0).sum(axis=2) / seen.sum(axis=2) / length

    usual = [float(apart(k - 1, k).min()) for k in range(1, len(found))]
    step = max(STEP, float(np.median(usual)) if usual else 0.0)
    steps: list[list[tuple[int, Array]]] = []
    for k in range(len(found)):
        froms: list[tuple[int, Array]] = []
        for one in range(k - 1, max(k - 2 - MOST_GAP, -1), -1):
            cost = (apart(one, k) / step) ** 2 / (k - one)
            froms.append((one, cost + LEFT_OUT * (k - one - 1)))
            if known[one]:
                break
        steps.append(froms)
    return steps


def _path(
    costs: Sequence[Array], steps: Sequence[list[tuple[int, Array]]], known: Sequence[bool]
) -> tuple[list[tuple[int, int]], list[Array]]:
    """The cheapest path, as frames and curves, and what the cheapest one through each curve costs."""
    first, last = known.index(True), len(known) - 1 - known[::-1].index(True)
    before = [cost + (LEFT_OUT * k if k <= first else NEVER) for k, cost in enumerate(costs)]
    after = [cost + (LEFT_OUT * (len(costs) - 1 - k) if k >= last else NEVER) for k, cost in enumerate(costs)]
    origins = [[(-1, -1)] * len(cost) for cost in costs]
    for k, froms in enumerate(steps):
        for one, step in froms:
            sums = before[one][:, None] + step + costs[k]
            rows = sums.argmin(axis=0)
            for c in np.flatnonzero(sums.min(axis=0) < before[k]).tolist():
                before[k][c], origins[k][c] = sums[rows[c], c], (one, int(rows[c]))
    for k in range(len(steps) - 1, -1, -1):
        for one, step in steps[k]:
            after[one] = np.minimum(after[one], (step + after[k]).min(axis=1) + costs[one])
    end = min(range(last, len(costs)), key=lambda k: float(before[k].min()) + LEFT_OUT * (len(costs) - 1 - k))
    path = [(end, int(before[end].argmin()))]
    while (origin := origins[path[-1][0]][path[-1][1]])[0] >= 0:
        path.append(origin)
    return path[::-1], [one + other - cost for one, other, cost in zip(before, after, costs, strict=True)]


def _judged(
    found: Sequence[Sequence[Curve]], chosen: NDArray[np.int64], margin: Array, swimmer: Curve, known: Mapping[int, int]
) -> Linked:
    """Confidence in the curves that were chosen, by evidence of the whole film."""
    seen = chosen >= 0
    curves = [found[t][chosen[t]] for t in np.flatnonzero(seen)]
    off = np.array([_off(curve, swimmer) for curve in curves])
    off -= np.median(off, axis=0)
    points = np.array([along(curve, swimmer.length) for curve in curves]) / swimmer.length
    nose, body = points[:, 0], np.nanmean(points[:, POINTS // 10 : POINTS // 2], axis=1)
    jump = np.hypot(*(_bent(nose) - _bent(body)).T)
    values = np.column_stack([off, jump])
    scores = np.abs(values) / np.maximum(_spread(values), LEAST)
    step = np.hypot(*np.diff(body, axis=0).T)
    around = np.maximum(np.append(step[1:], 0), np.append(0, step[:-1])) + STEP
    alone = np.array([len({curve.shape for curve in found[t]}) < 2 for t in np.flatnonzero(seen)])
    lost_touch = _since_jump(step > SUDDEN * around, alone, np.flatnonzero(seen), known)
    near = np.array([_near(found[t], chosen[t], NEAR * swimmer.length) for t in np.flatnonzero(seen)])
    cut = np.array([curve.cut for curve in curves])
    doubts = np.column_stack([scores > DOUBTED, near, cut, margin[seen] < LIKELY, lost_touch])
    trust = np.prod(1 / (1 + (scores / DOUBTED) ** 4), axis=1)
    confidence = np.zeros(len(found))
    confidence[seen] = np.where(doubts.any(axis=1), np.minimum(trust, DOUBT), trust)
    reasons = {name: np.zeros(len(found), dtype=bool) for name in REASONS}
    for name, column in zip(REASONS, doubts.T, strict=True):
        reasons[name][seen] = column
    return Linked(chosen, confidence, reasons)


def _spread(values: Array) -> Array:
    """Standard deviation of most of some values (K, N), by their median distance from the median. Shape (N,)."""
    return 1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)


def _bent(places: Array) -> Array:
    """By how much each place is off the middle of those before and after it. Shape (K, 2)."""
    padded = np.concatenate([places[:1], places, places[-1:]])
    return places - (padded[:-2] + padded[2:]) / 2


def _near(curves: Sequence[Curve], chosen: int, reach: float) -> bool:
    """Whether the curve of another shape comes near to the chosen one."""
    own = curves[chosen]
    return any(
        np.linalg.norm(own.points[:, None] - one.points, axis=2).min() < reach + own.widths.max() / 2
        for one in curves
        if one.shape != own.shape
    )


def _since_jump(jumps: Mask, alone: Mask, frames: NDArray[np.int64], known: Mapping[int, int]) -> Mask:
    """Frames after a jump, as seen from a known one, until there is one shape only. Shapes (K - 1,), (K,)."""
    doubted = np.zeros(len(frames), dtype=bool)
    sure = alone | np.isin(frames, list(known))
    for k in range(1, len(frames)):
        doubted[k] = not sure[k] and (doubted[k - 1] or jumps[k - 1])
    back = np.zeros(len(frames), dtype=bool)
    for k in range(len(frames) - 2, -1, -1):
        back[k] = not sure[k] and (back[k + 1] or jumps[k])
    start = np.searchsorted(frames, min(known))
    return np.where(np.arange(len(frames)) >= start, doubted, back)
