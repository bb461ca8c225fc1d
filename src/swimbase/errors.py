"""Everything that swim2real raises on purpose.

A message names the thing, its value, what is allowed and what to do. The command line prints the message and
leaves with `exit_code`; only `--debug` shows a traceback.
"""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import contextmanager

_LONG = re.compile(r"(\S{400})\S{800,}")  # a text from a file, not a path


class Swim2RealError(Exception):
    """Root of the tree: catch it to catch all that swim2real raises on purpose."""

    exit_code = 1

    def __init__(self, message: object = "") -> None:
        super().__init__(_LONG.sub(r"\1…", str(message)))


class ArgumentError(Swim2RealError):
    """An argument of a call or of the command line is outside what is allowed."""

    exit_code = 2


class ParameterError(Swim2RealError):
    """A simulator parameter is unknown, missing, not finite or out of bounds."""

    exit_code = 2


class RobotError(Swim2RealError):
    """A robot file can't be read, or doesn't fit its model."""

    exit_code = 2


class ConsentError(Swim2RealError):
    """A file from elsewhere would run code or read files outside of its folder, which nobody has allowed."""

    exit_code = 2


class VideoError(Swim2RealError):
    """A video can't be read or written."""


class TrackingError(Swim2RealError):
    """Markers can't be tracked as asked: wrong points, no camera calibration, a marker that isn't seen."""


class TrialError(Swim2RealError):
    """Marker tracks can't be read or don't make a trial."""


class EngineError(Swim2RealError):
    """The physics engine can't simulate what was asked, or differs from the one that a result was made with."""


class OptimizerError(Swim2RealError):
    """The ask/tell contract was broken."""


class AdvisorError(Swim2RealError):
    """An advisor could not give a usable proposal."""


class WaitingForReply(AdvisorError):  # noqa: N818 - nothing went wrong
    """A person's reply is due; the run can go on as soon as it is there."""

    exit_code = 0


class RunError(Swim2RealError):
    """A run folder can't be written, resumed or read."""


class MissingExtraError(Swim2RealError):
    """An optional library isn't installed."""


@contextmanager
def about(what: object, remedy: str = "") -> Generator[None]:
    """Puts the thing that it is about before the message of an error of this tree, and what to do behind it."""
    try:
        yield
    except Swim2RealError as error:
        raise type(error)(f"{what}: {error}{remedy}") from error
