"""Types and checks of options that several commands have."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from swimbase.errors import ArgumentError

Positional = tyro.conf.Positional
RobotOption = Annotated[str, tyro.conf.arg(aliases=["--parameters"])]
From = Annotated[tuple[float, ...], tyro.conf.arg(name="from")]  # which Python doesn't take as a name
DEFAULT_ROBOT = "fish"
PUBLISHED = "published"  # the prior work's values, in place of a parameters file


def word(path: str | Path) -> str:
    """A path as a shell takes it in a suggested command, in quotes where it needs them."""
    return shlex.quote(str(path))


def for_robot(robot: str) -> str:
    """The option that a suggested command needs for this robot, with a space before it; nothing for the default."""
    return "" if robot == DEFAULT_ROBOT else f" --robot {word(robot)}"


def one_each(option: str, values: Sequence[object], count: int, things: str) -> None:
    """Checks that an option was given once for every thing, or not at all.

    Raises:
        ArgumentError: It was given for some.
    """
    if values and len(values) != count:
        raise ArgumentError(f"--{option} has {len(values)} values for {count} {things}; give one for each, or none")


def finite_above_0(option: str, *values: float, unit: str = "") -> None:
    """Checks numbers of an option.

    Raises:
        ArgumentError: One isn't finite and above 0.
    """
    for value in values:
        if not 0 < value < float("inf"):
            raise ArgumentError(f"--{option} is {value:g}{unit}; it must be finite and above 0")
