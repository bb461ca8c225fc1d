"""A linear model of the residual: how it learns from an evaluation, and where it is least.

Sums over the residual avoid BLAS, whose order of summation hangs on the number of threads.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from swim2real.optimizers.contract import Array


def updated(gradients: Array, change: Array, step: Array) -> Array:
    """Broyden's update: the smallest change by which the model would have foretold how the residual changes.

    Along a single coordinate it replaces that coordinate's gradient by the difference quotient.

    Args:
        gradients: Of the residual, by coordinate. Shape (d, n).
        change: Of the residual, seen at the step. Shape (n,).
        step: In the unit cube; nothing is learned from none at all. Shape (d,).
    """
    length = float(step @ step)
    if length == 0:
        return gradients
    missed = change - np.einsum("in,i->n", gradients, step)
    return gradients + np.multiply.outer(step, missed) / length


def box_step(gradients: Array, residual: Array, point: Array, radius: float, damping: float) -> tuple[Array, float]:
    """The step that minimizes the model's squares within the box and the cube, and what it promises to gain.

    Args:
        gradients: Of the residual, by coordinate. Shape (d, n).
        residual: At the point. Shape (n,).
        point: In the unit cube. Shape (d,).
        radius: Of the box around it.
        damping: Of the mean curvature: coordinates without effect stay where they are.
    """
    curvature = np.einsum("in,jn->ij", gradients, gradients)
    slope = np.einsum("in,n->i", gradients, residual)
    damping = damping * float(np.trace(curvature)) / point.size
    if damping == 0:
        return np.zeros(point.size), 0.0
    root = np.linalg.cholesky(curvature + damping * np.eye(point.size))
    bounds = (np.maximum(-point, -radius), np.minimum(1 - point, radius))
    found = lsq_linear(root.T, -np.linalg.solve(root, slope), bounds, method="bvls")
    step = np.clip(found.x, *bounds)
    return step, -float(2 * slope @ step + step @ curvature @ step)
