"""Changes of the parameters that the residual hardly answers to: what the trials can't tell.

A direction in the unit cube isn't seen when a change over the whole range alters the residual by little: against what
no change of the parameters explains, against the error of the measured differences, or against the direction that is
seen best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.physics.sensitivities import NO_EFFECT, Sensitivities

Array = NDArray[np.float64]

_UNEXPLAINED = 0.2  # of the residual that no change explains: errors of neighboring samples are alike, so not all of it
_CURVED = 0.5  # of a difference's width: by how much of itself it may be wrong
_MEMBER = 0.2  # of a direction's largest component: below, a parameter has no part in it


@dataclass(frozen=True)
class Unseen:
    """A direction that the residual hardly answers to.

    Attributes:
        members: Indices of the parameters that take part in it, in order.
        direction: Their changes, relative to the largest. Shape of `members`.
    """

    members: tuple[int, ...]
    direction: Array


def unseen(sensitivities: Sensitivities, residual: Array) -> tuple[Unseen, ...]:
    """Finds what can't be told near a point, each direction with as few parameters as may be.

    Args:
        sensitivities: Measured ones count.
        residual: At the point [m]. Shape (n,).
    """
    measured = sensitivities.measured
    curvature = np.einsum("in,jn->ij", measured, measured)
    squares, directions = np.linalg.eigh(curvature)
    seen = np.sqrt(np.maximum(squares, 0.0))
    wrong = np.sqrt(directions.T**2 @ (sensitivities.widths**2 * np.diag(curvature)))
    limit = np.maximum(_CURVED * wrong, max(_UNEXPLAINED * _unexplained(measured, residual), NO_EFFECT * seen[-1]))
    return tuple(_named(row) for row in _sparse(directions.T[seen <= limit]))


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


def _named(row: Array) -> Unseen:
    row = row / row[np.argmax(np.abs(row))]
    members = np.flatnonzero(np.abs(row) >= _MEMBER)
    return Unseen(tuple(int(i) for i in members), row[members])
