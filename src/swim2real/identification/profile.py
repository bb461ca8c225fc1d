"""The profile of a parameter: fixed at values across its range, all others re-fitted, and what the loss makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.identification.gauss_newton import EvaluatedPoint, Evaluator, broyden_update, refit, step_toward

Array = NDArray[np.float64]

DISTANCES = (0.05, 0.15, 0.4, 1.0)  # from the best fit, of the range, cut at the bound
ENOUGH = 3.0  # times the rise that counts, at which a side ends
IDENTIFIED = 0.25  # of the range: the widest interval of a parameter that is identified
_MADE_UP = 0.05  # of the range: the least move of another parameter that is reported
_AT_BOUND = 0.02  # of the range: an interval that ends nearer to a bound is open there


@dataclass(frozen=True)
class ProfilePoint:
    """The parameter fixed, the others re-fitted.

    Attributes:
        at: The parameter's coordinate in the cube.
        loss: The lowest loss, after the re-fit or before it [m]. A re-fit lowers the misfit, a sum of squares, and may
            leave a lower loss, a mean of distances.
        fixed_loss: The loss with the others where they were at the value before [m].
        point: The point with the lowest loss. Shape (d,).
    """

    at: float
    loss: float
    fixed_loss: float
    point: Array

    def as_dict(self) -> dict[str, Any]:
        return {"at": self.at, "loss": self.loss, "fixed_loss": self.fixed_loss, "point": self.point.tolist()}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> ProfilePoint:
        return cls(content["at"], content["loss"], content["fixed_loss"], np.array(content["point"], dtype=float))


def profile(
    evaluate: Evaluator, best: EvaluatedPoint, slopes: Array, index: int, rise: float, steps: int
) -> list[ProfilePoint]:
    """Walks from the best fit to both ends of a parameter's range, until the loss has clearly risen.

    Args:
        evaluate: Evaluates points.
        best: The best fit, where the walk begins.
        slopes: Jacobian there [m]. Shape (n, d).
        index: Index of the parameter.
        rise: Rise of the loss that counts [m].
        steps: Most steps of each re-fit.

    Returns:
        Points in the order of the parameter's value, the best fit among them.
    """
    free = np.arange(len(best.point)) != index
    points = [ProfilePoint(float(best.point[index]), best.loss, best.loss, best.point)]
    for sign in (-1.0, 1.0):
        at, updated = best, slopes
        for value in _values(float(best.point[index]), sign):
            at, updated, alone = _fixed(evaluate, at, updated, index, value, free, rise, steps)
            lowest = min((at, alone, *evaluate([_with(best.point, index, value)])), key=lambda point: point.loss)
            points.append(ProfilePoint(value, lowest.loss, alone.loss, lowest.point))
            if lowest.loss > best.loss + ENOUGH * rise:
                break
    return sorted(points, key=lambda point: point.at)


def _values(start: float, sign: float) -> list[float]:
    """Where to fix a parameter on one side, the bound included."""
    room = start if sign < 0 else 1.0 - start
    if room < 1e-9:
        return []
    inner = [start + sign * distance for distance in DISTANCES if distance < 0.8 * room]
    return [*inner, 0.0 if sign < 0 else 1.0]


def _fixed(
    evaluate: Evaluator, before: EvaluatedPoint, slopes: Array, index: int, value: float, free: NDArray[np.bool_],
    rise: float, steps: int,
) -> tuple[EvaluatedPoint, Array, EvaluatedPoint]:  # fmt: skip
    """One value: the others as they were, then as the slopes predict them, then re-fitted.

    Returns:
        The re-fitted point, the updated slopes, and the point with the others as they were.
    """
    shift = value - before.point[index]
    alone = _with(before.point, index, value)
    predicted = -(before.residual + slopes[:, index] * shift)
    first = evaluate([alone, *(step_toward(alone, predicted, slopes, free, abs(shift) * k) for k in (3.0, 1.0, 1 / 3))])
    best = min(first, key=lambda point: point.misfit)
    slopes = broyden_update(slopes, before, first if abs(shift) < 0.2 else [])
    best, slopes = refit(evaluate, best, slopes, free, steps, min(abs(shift), 0.1), enough=0.02 * rise)
    return best, slopes, first[0]


def _with(point: Array, index: int, value: float) -> Array:
    out = point.copy()
    out[index] = value
    return out


def summarize(points: Sequence[ProfilePoint], index: int, names: Sequence[str], rise: float) -> dict[str, Any]:
    """What a profile says of its parameter.

    Args:
        points: The profile, in the order of the parameter's value.
        index: Index of the parameter.
        names: Names of all parameters.
        rise: Rise of the loss that counts, above the profile's own lowest [m].

    Returns:
        `verdict`; `interval`, the cube's coordinates within the rise, interpolated; `open`, whether the interval ends
        at a bound, below and above; `largest_rise` [m]; `made_up_by`, how far others moved at the interval's ends, of
        their range, the largest first.
    """
    middle = min(range(len(points)), key=lambda i: points[i].loss)
    best = points[middle].loss
    inside = [i for i, point in enumerate(points) if point.loss <= best + rise]
    first, last = inside[0], inside[-1]
    low = points[first].at if first == 0 else _crossing(points[first], points[first - 1], best, rise)
    high = points[last].at if last == len(points) - 1 else _crossing(points[last], points[last + 1], best, rise)
    is_open = [low <= _AT_BOUND, high >= 1 - _AT_BOUND]
    if all(is_open):
        verdict = "not identified"
    elif high - low <= IDENTIFIED:
        verdict = "identified"
    else:
        verdict = "weak"
    moves: dict[str, float] = {}
    for point in (points[first], points[last]):
        for i, move in enumerate(point.point - points[middle].point):
            if i != index and abs(move) > max(_MADE_UP, abs(moves.get(names[i], 0.0))):
                moves[names[i]] = float(move)
    return {
        "verdict": verdict,
        "interval": [low, high],
        "open": is_open,
        "largest_rise": max(point.loss for point in points) - best,
        "made_up_by": dict(sorted(moves.items(), key=lambda item: -abs(item[1]))),
    }


def _crossing(inside: ProfilePoint, outside: ProfilePoint, best: float, rise: float) -> float:
    """Where the loss has risen by the rise, between two points; the root of the rise is taken as straight."""
    near, far = (np.sqrt(max(point.loss - best, 0.0)) for point in (inside, outside))
    share = float((np.sqrt(rise) - near) / (far - near)) if far > near else 0.0
    return inside.at + min(max(share, 0.0), 1.0) * (outside.at - inside.at)
