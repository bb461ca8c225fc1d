"""The toolbox's least squares in the unit cube, for method `mujoco-sysid`."""

from __future__ import annotations

import io
from typing import Any

from swim2real.optimizers.callback import Residuals, Solve
from swim2real.optimizers.contract import Array
from swim2real.parameters import ParameterSpace
from swim2real.sysid.toolbox import toolbox


def least_squares(space: ParameterSpace) -> Solve:
    """`mujoco.sysid.optimize` with its default solver, MuJoCo's own, and with its own settings.

    Its parameters have the names of the space and places in the unit cube for values. It takes Levenberg-Marquardt
    steps within the cube, and for each that it accepts a Jacobian of forward differences, 1.5e-8 wide.

    Its sums go through BLAS, whose last digits may change with the number of threads; the command line sets one.

    Raises:
        MissingExtraError: The toolbox isn't installed.
    """
    sysid = toolbox()

    def solve(first: Array, residuals: Residuals) -> None:
        parameters = sysid.ParameterDict()
        for name, place in zip(space.names, first, strict=True):
            parameters.add(sysid.Parameter(name, place, 0.0, 1.0))

        def residual(columns: Array, _: Any) -> tuple[list[Array], list[Any], list[Any]]:
            return [residuals(columns.T).T], [], []

        sysid.optimize(parameters, residual, verbose=False, output=io.StringIO())

    return solve
