"""The toolbox's least squares in the unit cube, for method `mujoco-sysid`."""

from __future__ import annotations

import io
from typing import Any

from swim2real.calibration.refit import STEP
from swim2real.optimizers.callback import Residuals, Solve
from swim2real.optimizers.contract import Array
from swim2real.parameters import ParameterSpace
from swim2real.sysid.toolbox import toolbox


def least_squares(space: ParameterSpace) -> Solve:
    """`mujoco.sysid.optimize` with its default solver, MuJoCo's own.

    Its parameters have the names of the space and places in the unit cube for values. It takes Levenberg-Marquardt
    steps within the cube, and for each that it accepts a Jacobian of forward differences.

    Its settings are its own but for the width of the differences, which is that of our studies. Its own, 1.5e-8, sees
    where the search for a phase ends: at seed 1's first point it takes eight of the fish's 16 slopes for 140 m, which
    are 0.002 to 0.03 m.

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

        sysid.optimize(parameters, residual, verbose=False, eps=STEP, output=io.StringIO())

    return solve
