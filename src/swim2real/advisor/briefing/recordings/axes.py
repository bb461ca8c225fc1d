"""The axes of the plane in which a robot's recordings are compared, in words."""

from __future__ import annotations

from dataclasses import dataclass

from swim2real.robots.robot import Robot

_NAMES = "xyz"


@dataclass(frozen=True)
class Axes:
    """What the two parts of a place or a difference are.

    Attributes:
        words: Both axes in order.
        ways: Of each, which way a positive and which way a negative part leads.
        picture: How a picture of the plane lies, in a few words.
    """

    words: str
    ways: tuple[tuple[str, str], tuple[str, str]]
    picture: str


def axes_of(robot: Robot) -> Axes:
    """The axes of a robot whose trials are recordings: the world's, or those of two of its markers."""
    about = robot.recordings
    if about.frame is None:
        right, up = (_NAMES[axis] for axis in robot.plane)
        return Axes(
            f"first to the right (the world's {right}), then up (the world's {up})",
            (("to the right", "to the left"), ("up", "down")),
            f"{right} right, {up} up",
        )
    origin, ahead = (robot.marker_names[marker] for marker in about.frame)
    behind = " (being behind counts as well)" if about.score_progress else ""
    return Axes(
        f"first from {origin} toward {ahead}{behind}, then to the left of that line",
        ((f"from {origin} toward {ahead}", f"from {ahead} toward {origin}"), ("to the left", "to the right")),
        f"{origin} at the origin, {ahead} to its right",
    )
