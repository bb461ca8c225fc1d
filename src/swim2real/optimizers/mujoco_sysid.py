"""MuJoCo's identification toolbox, `mujoco.sysid`, where it is installed, and its least squares for ask and tell."""

from __future__ import annotations

import importlib
import io
from typing import Any

from swim2real.optimizers.callback import Residuals, Solve
from swim2real.optimizers.contract import Array
from swim2real.parameters import ParameterSpace
from swimbase.errors import MissingExtraError


def _toolbox() -> Any:
    """The module.

    Raises:
        MissingExtraError: It isn't installed. MuJoCo then has it without content.
    """
    module = importlib.import_module("mujoco.sysid")
    if not hasattr(module, "optimize"):
        raise MissingExtraError(
            "MuJoCo's identification toolbox isn't installed; install it with: pip install 'swim2real[sysid]'"
        )
    return module


def least_squares(space: ParameterSpace) -> Solve:
    """`mujoco.sysid.optimize` with its default solver, MuJoCo's own, and with its own settings.

    Its parameters have the names of the space and places in the unit cube for values. It takes Levenberg-Marquardt
    steps within the cube, and for each that it accepts a Jacobian of forward differences, 1.5e-8 wide.

    Its sums go through BLAS, whose last digits may change with the number of threads; the command line sets one.

    Raises:
        MissingExtraError: The toolbox isn't installed.
    """
    sysid = _toolbox()

    def solve(first: Array, residuals: Residuals) -> None:
        parameters = sysid.ParameterDict()
        for name, place in zip(space.names, first, strict=True):
            parameters.add(sysid.Parameter(name, place, 0.0, 1.0))

        def residual(columns: Array, _: Any) -> tuple[list[Array], list[Any], list[Any]]:
            return [residuals(columns.T).T], [], []

        sysid.optimize(parameters, residual, verbose=False, output=io.StringIO())

    return solve
