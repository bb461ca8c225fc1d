"""Models compiled, and their numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from swim2real.errors import RobotError


def compiled(spec: mujoco.MjSpec, where: str) -> mujoco.MjModel:
    """A model of a spec, which then holds what the compiler made of it.

    Args:
        spec: It is changed.
        where: File and place, for the message.

    Raises:
        RobotError: It doesn't compile.
    """
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise RobotError(f"{where}: the model doesn't compile: {said(error)}") from error


def said(error: Exception) -> str:
    """What MuJoCo says of a model, in one line."""
    return " ".join(str(error).split())


def numbers(model: mujoco.MjModel) -> Iterator[tuple[str, Any]]:
    """Every array of a model and its options, by name."""
    for where, of in (("", model), ("opt.", model.opt)):
        for name in dir(of):
            value = None if name.startswith("_") else getattr(of, name)
            if isinstance(value, np.ndarray) or (where and isinstance(value, float | int)):
                yield f"{where}{name}", value


def same(first: mujoco.MjModel, second: mujoco.MjModel) -> bool:
    """Whether two models of one spec have the same numbers."""
    return all(
        name == other and np.array_equal(a, b, equal_nan=isinstance(a, np.ndarray) and a.dtype.kind == "f")
        for (name, a), (other, b) in zip(numbers(first), numbers(second), strict=True)
    )


def largest_difference(first: mujoco.MjModel, second: mujoco.MjModel) -> tuple[str, float]:
    """The array in which two models differ most, by a share of its largest number; infinite for other shapes."""
    found = ("", 0.0)
    for (name, a), (_, b) in zip(numbers(first), numbers(second), strict=True):
        one, other = np.asarray(a), np.asarray(b)
        if one.dtype.kind != "f" or not one.size:
            continue
        if one.shape != other.shape:
            return name, np.inf
        gap = float(np.nanmax(np.abs(one - other)) / max(float(np.nanmax(np.abs(one))), 1e-300))
        if gap > found[1]:
            found = (name, gap)
    return found
