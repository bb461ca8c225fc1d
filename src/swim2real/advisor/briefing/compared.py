"""How trials are compared, in words: the loss, the frame, what drives a simulation and how it starts."""

from __future__ import annotations

from typing import Any

from swim2real.objective import TAIL_FIRST_LOSS
from swim2real.robots.robot import Control, Robot, Sine

PAPER = (
    "The mean distance between the simulated and the real markers over time, markers and trials, in a frame that turns "
    "with the head and advances with it. The simulated robot starts from rest at motor angle 0 and nothing is fitted: "
    "an unknown motor angle at the start and static offsets of the markers count as well."
)
_STARTS = {
    "rest": "at rest in the model's own pose",
    "markers": "in the pose and at the speed that its first frames show",
    "fitted": "in the pose and at the speed with which it meets the first quarter of a second best",
}
_AXES = "xyz"


def how_compared(robot: Robot, protocol: str, horizon: float | None) -> dict[str, Any]:
    """How a robot's trials are compared, as plain data and in words.

    Args:
        robot: The robot whose simulator is calibrated.
        protocol: Name of the protocol.
        horizon: Seconds of each trial that are compared; None for all.

    Returns:
        `loss` in words; `axes` of differences in words and `ways`, of each axis which way a positive and which way a
        negative difference leads; `picture`, how a picture lies; `links` of markers by name.
    """
    axes, ways, picture = _axes(robot)
    return {
        "protocol": protocol,
        "horizon": horizon,
        "loss": PAPER if protocol == "paper" else " ".join(_loss(robot, protocol)),
        "links": [[robot.marker_names[a], robot.marker_names[b]] for a, b in robot.links],
        "score_progress": robot.trials.score_progress,
        "axes": axes,
        "ways": ways,
        "picture": picture,
    }


def _loss(robot: Robot, protocol: str) -> list[str]:
    trials = robot.trials
    sentences = ["The mean distance between the simulated and the real markers over time, markers and trials"]
    if trials.frame is None:
        sentences[0] += ", in the world."
    elif protocol == "motion":
        origin, ahead = (robot.marker_names[marker] for marker in trials.frame)
        sentences[0] += (
            ". It is taken in the frame of the trial's path, so that the yaw and the sway of the head count: x points "
            f"along the path, the way that {ahead} lies from {origin}, and the robot goes the other way. A slow turn "
            "of the course is removed."
        )
    else:
        origin, ahead = (robot.marker_names[marker] for marker in trials.frame)
        sentences[0] += f". It is taken in a frame that is fixed to {origin}, with its x axis toward {ahead}."
        if trials.score_progress:
            sentences.append(
                "Along that axis the distance by which the simulated robot has come too far or not far enough is "
                f"added; forward is from {ahead} to {origin}."
            )
    if trials.sensors:
        weights = ", ".join(
            f"1 {sensor.unit} of {sensor.name} as {1e3 * sensor.meters_per_unit:g} mm" for sensor in trials.sensors
        )
        sentences.append(f"The mean error of each sensor is added: {weights}.")
    sentences.append("Lost tracks don't count.")
    if protocol in ("motion", "aligned"):
        sentences.append(
            "The motor's angle at the start is fitted, and static offsets of the markers don't count. The simulated "
            "robot is in its steady motion from the start."
        )
        if protocol == "motion":
            sentences.append(
                f"Where any trial goes backward, last marker first, {1e3 * TAIL_FIRST_LOSS:.0f} mm are added, so that "
                "it is never better than one in which all go forward."
            )
        return sentences
    return [*sentences, _drive(robot), _start(robot), "Neither time nor place is fitted."]


def _drive(robot: Robot) -> str:
    groups: dict[str, list[str]] = {}
    for actuator, control in robot.trials.controls.items():
        groups.setdefault(_command(control), []).append(actuator)
    drive = "; ".join(f"{' and '.join(actuators)}: {command}" for command, actuators in groups.items())
    return f"Each trial is played back under its own commands ({drive})." if drive else "Nothing drives a playback."


def _start(robot: Robot) -> str:
    start = robot.recordings.start
    how = _STARTS.get(start, f"in the model's pose '{start}'")
    return f"It starts {how}, unless the trial says how it started."


def _command(control: Control) -> str:
    if control == "table":
        return "as recorded"
    if control == "frequency":
        return "a steady speed at the trial's own rate"
    if isinstance(control, Sine):
        around = f" around {control.offset:g}" if control.offset else ""
        return f"a sine of {control.amplitude:g}{around} at the trial's own rate"
    return f"always {control:g}"


def _axes(robot: Robot) -> tuple[str, list[list[str]], str]:
    """The axes of the frame of comparison in words, which way their signs lead, and how a picture lies."""
    frame = robot.trials.frame
    if frame is None:
        right, up = (_AXES[axis] for axis in robot.plane)
        words = f"first to the right (the world's {right}), then up (the world's {up})"
        return words, [["to the right", "to the left"], ["up", "down"]], f"{right} right, {up} up"
    origin, ahead = (robot.marker_names[marker] for marker in frame)
    behind = " (being behind counts as well)" if robot.trials.score_progress else ""
    return (
        f"first from {origin} toward {ahead}{behind}, then to the left of that line",
        [[f"from {origin} toward {ahead}", f"from {ahead} toward {origin}"], ["to the left", "to the right"]],
        f"{origin} at the origin, {ahead} to its right",
    )
