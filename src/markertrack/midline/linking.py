"""Decision over a whole film: which curve of each frame is the swimmer, and which of its ends the head.

A shortest path goes through the frames' curves by way of the clicked ones. A curve costs by how far its length, area
and widths are from the swimmer's, against other curves of its shape; a step by the square of how far the body moves, in
its own lengths: many short ones are likelier than one jump. Frames may be left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markertrack.midline.centerline import POINTS, Curve
from swimbase.arrays import Array

SPREADS = 0.1, 0.15, 0.2  # shares by which length, area and widths of swimmers vary, before this one's is known
LEAST = 0.01, 0.03, 0.05  # that they vary by at least, and
MOST = 0.04, 0.10, 0.15  # at most: a film of many wrong curves would excuse them
STEP = 0.02  # lengths by which a body moves from frame to frame, at least
MOST_OFF = 8.0  # cost of one measure, at most
NEVER = 1e9  # cost of what a click excludes
LEFT_OUT = 25.0  # cost of a frame without the swimmer
MOST_GAP = 12  # frames with shapes that may be left out in a row
APART = 0.1  # lengths between the heads, or the tails, of two curves that aren't the same


@dataclass(frozen=True)
class Linked:
    """The swimmer's curve in each frame.

    Attributes:
        chosen: Number of the curve among those of the frame, -1 where none is the swimmer. Shape (T,).
        margin: Cost that the best path through another curve of the frame has more. Shape (T,).
    """

    chosen: NDArray[np.int64]
    margin: Array


def link(found: Sequence[Sequence[Curve]], known: Mapping[int, int]) -> Linked:
    """Chooses a curve in each frame.

    Args:
        found: Curves of each frame.
        known: Number of the swimmer's curve in the frames that a person clicked in; of one at least.
    """
    swimmer = found[min(known)][known[min(known)]]
    filled = [t for t in range(len(found)) if found[t]]
    stops = [t in known for t in filled]
    off = [np.array([deviations(curve, swimmer) for curve in found[t]]) for t in filled]
    steps = _steps([found[t] for t in filled], stops, swimmer.length)

    def best(off: Sequence[Array], spreads: Array) -> tuple[list[tuple[int, int]], list[Array]]:
        costs = [_costs(found[t], one, known.get(t), spreads) for t, one in zip(filled, off, strict=True)]
        return _path(costs, steps, stops)

    mine = np.array([off[k][one] for k, one in best(off, np.array(SPREADS))[0]])
    path, totals = best([one - usual(mine) for one in off], np.clip(spread(mine), LEAST, MOST))
    least = min(float(total.min()) for total in totals)
    chosen, margin = np.full(len(found), -1), np.zeros(len(found))
    for k, one in path:
        t = filled[k]
        tips = np.array([curve.points[[0, -1]] for curve in found[t]])
        other = (np.linalg.norm(tips - tips[one], axis=2) > APART * swimmer.length).any(axis=1)
        chosen[t], margin[t] = one, totals[k][other].min(initial=np.inf) - least
    return Linked(chosen, margin)


def along(curve: Curve, length: float) -> Array:
    """Points at equal distances from the head over a length, NaN beyond the end [px]. Shape (P, 2)."""
    at, travel = np.linspace(0, length, POINTS), np.linspace(0, curve.length, POINTS)
    return np.stack([np.interp(at, travel, curve.points[:, k], right=np.nan) for k in (0, 1)], axis=1)


def deviations(curve: Curve, swimmer: Curve) -> Array:
    """Shares by which length, area and widths of a curve are off the clicked swimmer's. Shape (3,)."""
    at = np.linspace(0, min(curve.length, swimmer.length), POINTS)
    mine, clicked = (np.interp(at, np.linspace(0, one.length, POINTS), one.widths) for one in (curve, swimmer))
    wrong = np.abs(mine - clicked) / clicked.mean()
    wide = max(wrong.mean(), wrong[: POINTS // 6].mean())  # a head that is cut off is too wide where it ends
    return np.array([np.log(curve.length / swimmer.length), np.log(curve.area / swimmer.area), wide])


def usual(off: Array) -> Array:
    """Usual deviations of a film's curves (K, 3), as far as they can differ from the clicked swimmer's. Shape (3,)."""
    return np.clip(np.median(off, axis=0), -2 * np.array(MOST), 2 * np.array(MOST))


def spread(values: Array) -> Array:
    """Standard deviations of most of some values (K, N), by their median distance from the median. Shape (N,)."""
    return 1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)


def _costs(curves: Sequence[Curve], off: Array, known: int | None, spreads: Array) -> Array:
    """Costs of the curves of a frame, by how far they are off (C, 3). Shape (C,).

    The best curve of each shape costs nothing: where it was tells which shape is the swimmer, however long another one
    looks more like it.
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

    step = max([STEP, float(np.median([apart(k - 1, k).min() for k in range(1, len(found))] or [0.0]))])
    steps: list[list[tuple[int, Array]]] = []
    for k in range(len(found)):
        froms: list[tuple[int, Array]] = []
        for one in range(k - 1, max(k - 2 - MOST_GAP, -1), -1):
            froms.append((one, (apart(one, k) / step) ** 2 / (k - one) + LEFT_OUT * (k - one - 1)))
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
