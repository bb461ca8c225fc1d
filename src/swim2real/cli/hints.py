"""What a message tells to run next."""

from __future__ import annotations

DEFAULT_ROBOT = "fish"


def for_robot(robot: str) -> str:
    """The option that a command needs for this robot, with a space before it; nothing for the default."""
    return "" if robot == DEFAULT_ROBOT else f" --robot {robot}"
