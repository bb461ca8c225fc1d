"""What a run has shown of how the residual answers to each parameter: a linear model around the incumbent.

It also says what the trials can't tell. A direction in the unit cube isn't identified when a change over the whole
range alters the residual by little: against what no change of the parameters explains, against the error of the
measured differences, or against the direction that is identified best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import AdvisorError
from swim2real.optimizers import Evaluation
from swim2real.optimizers.least_squares import box_step, updated

Array = NDArray[np.float64]

NO_EFFECT = 1e-3  # of the largest effect
_DAMPING = 1e-6  # of the mean curvature
_UNEXPLAINED = 0.2  # of the residual that no change explains: errors of neighboring samples are alike, so not all of it
_CURVED = 0.5  # of a difference's width: by how much of itself it may be wrong
_MEMBER = 0.2  # of a direction's largest component: below, a parameter has no part in it
_ROBUST = 0.2  # of the root mean square: residuals well below it weigh by their squares, well above by their size


@dataclass(frozen=True)
class Sensitivities:
    """How the residual changes over each parameter's whole range, were it linear.

    Attributes:
        gradients: Around the incumbent, as far as all evaluations have shown [m]. Shape (d, n).
        measured: Measured in the last steps along a single parameter each, 0 without any [m]. Shape (d, n).
        widths: Widths of those steps, in the unit cube. Shape (d,).
        place: Where the last of them began. Shape (d,).
    """

    gradients: Array
    measured: Array
    widths: Array
    place: Array

    def step(self, residual: Array, point: Array, radius: float) -> Array:
        """The step that the model expects most of, within a box around the point and the unit cube. Shape (d,)."""
        root = np.sqrt(_weights(residual))
        return box_step(self.gradients * root, residual * root, point, radius, _DAMPING)[0]

    def remaining(self, residual: Array, steps: Array) -> Array:
        """The share of the loss that the model expects to be left after each step. Shapes (n,), (N, d) to (N,)."""
        weights = _weights(residual)
        after = residual + np.einsum("ki,in->kn", steps, self.gradients)
        before = float(np.einsum("n,n,n->", weights, residual, residual))
        return np.sqrt(np.einsum("n,kn,kn->k", weights, after, after) / max(before, 1e-300))

    def slopes(self, residual: Array) -> Array:
        """Which way each parameter makes the residual larger. Shapes (n,) to (d,)."""
        return np.einsum("in,n,n->i", self.gradients, _weights(residual), residual)


def is_usable(evaluation: Evaluation) -> bool:
    """Whether an evaluation tells how the residual answers: one that diverged doesn't."""
    return not evaluation.failed


def residual_of(evaluation: Evaluation) -> Array:
    """Residual of a usable evaluation [m]. Shape (n,).

    Raises:
        AdvisorError: The evaluation was told without its residual.
    """
    if evaluation.residual is None:
        raise AdvisorError("an evaluation has no residual, which measured sensitivities need; tell it with the loss")
    return evaluation.residual


def learn_sensitivities(evaluations: Sequence[Evaluation]) -> Sensitivities:
    """Learns from each evaluation against the best one before it.

    A step of a single parameter is that parameter's doing. Others are put down to the parameters that had an effect.

    Args:
        evaluations: Usable evaluations in the order of the run, at least one.
    """
    base, *others = evaluations
    gradients = np.zeros((base.candidate.point.size, residual_of(base).size))
    measured, widths, place = np.zeros_like(gradients), np.zeros(len(gradients)), base.candidate.point
    effects = np.zeros(len(gradients))
    for evaluation in others:
        step = evaluation.candidate.point - base.candidate.point
        change = residual_of(evaluation) - residual_of(base)
        moved = np.flatnonzero(step)
        if moved.size == 1:
            measured[moved], widths[moved], place = change / step[moved], np.abs(step[moved]), base.candidate.point
            effects = np.linalg.norm(measured, axis=1)
        else:
            step = np.where(effects > NO_EFFECT * effects.max(), step, 0.0)
        gradients = updated(gradients, change, step)
        if evaluation.loss < base.loss:
            base = evaluation
    return Sensitivities(gradients, measured, widths, place)


def _weights(residual: Array) -> Array:
    """What squares must be weighed by so that less of them is a lower loss, which is a mean of lengths. Shape (n,)."""
    size = _ROBUST * float(np.sqrt(np.mean(residual**2))) + 1e-15
    return 1 / np.sqrt(residual**2 + size**2)


@dataclass(frozen=True)
class Unidentified:
    """A direction that the residual hardly answers to.

    Attributes:
        members: Indices of the parameters that take part in it, in order.
        changes: Changes of these parameters along the direction, relative to the largest. Shape of `members`.
    """

    members: tuple[int, ...]
    changes: Array


def unidentified_directions(sensitivities: Sensitivities, residual: Array) -> tuple[Unidentified, ...]:
    """Finds what the trials can't tell near a point, each direction with as few parameters as possible.

    Args:
        sensitivities: Measured sensitivities; steps along several parameters don't count.
        residual: Residual at the point [m]. Shape (n,).
    """
    measured = sensitivities.measured
    curvature = np.einsum("in,jn->ij", measured, measured)
    squares, directions = np.linalg.eigh(curvature)
    strength = np.sqrt(np.maximum(squares, 0.0))
    wrong = np.sqrt(directions.T**2 @ (sensitivities.widths**2 * np.diag(curvature)))
    limit = np.maximum(_CURVED * wrong, max(_UNEXPLAINED * _unexplained(measured, residual), NO_EFFECT * strength[-1]))
    return tuple(_unidentified(row) for row in _sparse(directions.T[strength <= limit]))


def _unexplained(measured: Array, residual: Array) -> float:
    """Length of what is left of a residual when all parameters are fitted to it [m]."""
    basis = np.linalg.svd(measured, full_matrices=False)[2]
    inside = np.einsum("in,n->i", basis, residual)
    return float(np.sqrt(max(np.einsum("n,n->", residual, residual) - float(inside @ inside), 0.0)))


def _sparse(rows: Array) -> Array:
    """Rows that span the same, each with a parameter of its own: Gauss and Jordan's elimination with full pivoting."""
    rows = rows.copy()
    for i in range(len(rows)):
        k, pivot = divmod(int(np.argmax(np.abs(rows[i:]))), rows.shape[1])
        rows[[i, i + k]] = rows[[i + k, i]]
        rows[i] /= rows[i, pivot]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, pivot], rows[i])
    return rows


def _unidentified(row: Array) -> Unidentified:
    row = row / row[np.argmax(np.abs(row))]
    members = np.flatnonzero(np.abs(row) >= _MEMBER)
    return Unidentified(tuple(int(i) for i in members), row[members])
