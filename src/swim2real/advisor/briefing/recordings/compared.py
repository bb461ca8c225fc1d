"""How recordings are compared with their playbacks, as plain data and in words: a function of the robot alone."""

from __future__ import annotations

from typing import Any

from swim2real.advisor.briefing.recordings.axes import axes_of
from swim2real.robots.robot import Control, Recordings, Robot, Sine

_START = {
    "rest": "at rest in the model's own pose",
    "markers": "in the pose and at the speed that its first frames show",
}


def compared(robot: Robot, horizon: float | None) -> dict[str, Any]:
    """How this robot's recordings are compared.

    Args:
        robot: Whose simulator is calibrated.
        horizon: Seconds of each trial that are compared; None for all.
    """
    about, axes = robot.recordings, axes_of(robot)
    return {
        "protocol": "playback",
        "horizon": horizon,
        "loss": " ".join([_loss(robot), *_drive(about), "Neither time nor place is fitted."]),
        "links": [[robot.marker_names[a], robot.marker_names[b]] for a, b in robot.links],
        "travels": about.score_progress,
        "axes": axes.words,
        "ways": axes.ways,
        "picture": axes.picture,
    }


def _loss(robot: Robot) -> str:
    about = robot.recordings
    said = "The mean distance between the simulated and the real markers over time, markers and trials"
    if about.frame is None:
        said += ", in the world."
    else:
        origin, ahead = (robot.marker_names[marker] for marker in about.frame)
        said += f". It is taken in a frame that is fixed to {origin}, with its x axis toward {ahead}."
        if about.score_progress:
            said += (
                " Along that axis the distance by which the simulated robot has come too far or not far enough is "
                f"added; forward is from {ahead} to {origin}."
            )
    if about.sensors:
        worths = ", ".join(f"1 {one.unit} of {one.name} as {1e3 * one.meters_per_unit:g} mm" for one in about.sensors)
        said += f" The mean error of each sensor is added: {worths}."
    return f"{said} Lost tracks don't count."


def _drive(about: Recordings) -> list[str]:
    """What drives a playback, and where it starts."""
    groups: dict[str, list[str]] = {}
    for actuator, control in about.controls.items():
        groups.setdefault(_command(control), []).append(actuator)
    drive = "; ".join(f"{' and '.join(actuators)}: {command}" for command, actuators in groups.items())
    start = _START.get(about.start, f"in the model's pose '{about.start}'")
    return [
        f"Each trial is played back under its own commands ({drive})." if drive else "Nothing drives a playback.",
        f"It starts {start}, unless the trial says how it started.",
    ]


def _command(control: Control) -> str:
    if control == "table":
        return "as recorded"
    if control == "frequency":
        return "a steady speed at the trial's own rate"
    if isinstance(control, Sine):
        around = f" around {control.offset:g}" if control.offset else ""
        return f"a sine of {control.amplitude:g}{around} at the trial's own rate"
    return f"always {control:g}"
