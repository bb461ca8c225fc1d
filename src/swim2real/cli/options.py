"""Options that several commands have, declared once with their help, and their checks.

An option of one command alone is explained in that command's docstring.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from swimbase.errors import ArgumentError

DEFAULT_ROBOT = "fish"
PUBLISHED = "published"  # the prior work's values, in place of a parameters file

From = Annotated[tuple[float, ...], arg(name="from")]  # which Python doesn't take as a name
Until = Annotated[
    tuple[float, ...],
    arg(help="Up to this time [s], on the same clock as --from; one for all, or one for each."),
]
CalibratedRobot = Annotated[
    str,
    arg(
        aliases=["--parameters"],
        help="What is calibrated: your robot's FILE.toml, which `swim2real init` writes, or a fish. fish: the paper's "
        "16 parameters. fish-extended: two more, for the water that the hull accelerates and for damping at the "
        "surface. fish-rolling: twelve more, for a hull that floats and rolls.",
    ),
]
RobotOfMarkers = Annotated[str, arg(help="Robot whose markers they are: fish, or a robot file (.toml).")]
RobotOfRun = Annotated[str | None, arg(help="Robot file, if it has moved since the run was written.")]
RobotOfValues = Annotated[
    str | None,
    arg(
        help="Robot file, if it has moved since the run or the parameters file was written; with 'published', the "
        "robot whose own values are used."
    ),
]
ValuesPath = Annotated[Path, arg(help="Run folder or parameters file; 'published' for the prior work's values.")]
Reference = Annotated[Path, arg(help="Folder with the real trials.")]
ToReference = Annotated[Path, arg(help="Reference folder to add the trials to.")]
Frequencies = Annotated[tuple[float, ...], arg(help="Motor command in each trial [Hz].")]
ControlTables = Annotated[
    tuple[Path, ...],
    arg(
        help="Tables of what drove the robot in each trial, in order: time_s on the video's clock (0 is its first "
        "frame), then a column per actuator."
    ),
]
SensorTables = Annotated[
    tuple[Path, ...],
    arg(
        help="Tables of what was measured in each trial, in order: time_s on the same clock, then a column per sensor."
    ),
]
Policy = Annotated[Path, arg(help="Folder that `train` wrote.")]
Which = Annotated[Literal["best", "last"], arg(help="best: in the evaluations during training. last: at its end.")]
Threads = Annotated[int, arg(help="Simulations in parallel; 0 for all cores. Results don't depend on it.")]
Resume = Annotated[bool, arg(help="Continue what is in --out.")]
Anyway = Annotated[bool, arg(help="Go on even with a run that isn't usable.")]
Json = Annotated[bool, arg(help="Print the result as JSON, in SI units.")]
Quiet = Annotated[bool, arg(help="Print the result, but no progress.")]
Verbose = Annotated[bool, arg(help="Also print every figure of every trial, as on the page.")]


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
