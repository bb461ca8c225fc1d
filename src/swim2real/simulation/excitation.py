"""A made-up recording that moves a robot: sines on what a table drives, and a start off its rest pose."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.robots.robot import Robot
from swim2real.simulation.start import MARKERS
from swim2real.trials import MarkerTrack, Signals, Trial

Array = NDArray[np.float64]

SECONDS = 2.0
FREQUENCY = 1.0  # Hz, of all that swings
_RATE = 100.0  # Hz
_SWING = 0.25  # of an actuator's range
_POSITION = 0.5  # rad or m, of a position servo without a range
_ANGLE = 0.3  # rad
_SHIFT = 0.1  # of the robot's size
_EDGE = 0.1  # of a joint's range, which the start keeps away from its ends


def excitation(robot: Robot, strength: float) -> Trial:
    """A trial whose controls and start move a robot.

    Actuators that trials give a table for swing within their ranges, one after the other. Where trials start in any
    pose (start `markers`), the joints are off their rest and moving; elsewhere the start is the robot's own.

    Args:
        robot: Whose trials are recordings.
        strength: 1, or less for a robot that diverges.
    """
    model = robot.build(robot.space.published).compile()
    times = np.arange(round(SECONDS * _RATE) + 1) / _RATE
    names = [name for name, control in robot.recordings.controls.items() if control == "table"]
    columns = [_swing(model, name, times, i, strength) for i, name in enumerate(names)]
    start, velocities = _start(model, strength) if robot.recordings.start == MARKERS else ({}, {})
    nowhere = np.zeros((len(times), len(robot.marker_names), 2))
    return Trial(
        "excitation",
        MarkerTrack(times, nowhere),
        FREQUENCY,
        controls=Signals(times, names, np.stack(columns, axis=1)) if names else None,
        start=start,
        start_velocities=velocities,
    )


def _swing(model: mujoco.MjModel, name: str, times: Array, number: int, strength: float) -> Array:
    actuator = model.actuator(name)
    middle, swing = 0.0, _POSITION if actuator.biasprm[1] else 1.0
    if actuator.ctrllimited[0]:
        low, high = map(float, actuator.ctrlrange)
        middle, swing = (low + high) / 2, _SWING * (high - low)
    return middle + strength * swing * np.sin(2 * np.pi * FREQUENCY * times - number)


def _start(model: mujoco.MjModel, strength: float) -> tuple[dict[str, float], dict[str, float]]:
    """Positions and velocities of the sliding and turning joints that have names."""
    start: dict[str, float] = {}
    velocities: dict[str, float] = {}
    sizes = {mujoco.mjtJoint.mjJNT_HINGE: _ANGLE, mujoco.mjtJoint.mjJNT_SLIDE: _SHIFT * float(model.stat.extent)}
    for j in range(model.njnt):
        joint = model.joint(j)
        size = sizes.get(mujoco.mjtJoint(int(joint.type[0])))
        if size is None or not joint.name:
            continue
        place = float(model.qpos0[joint.qposadr[0]]) + strength * size
        if joint.limited[0]:
            low, high = map(float, joint.range)
            place = float(np.clip(place, low + _EDGE * (high - low), high - _EDGE * (high - low)))
        start[joint.name] = place
        velocities[joint.name] = strength * size  # per second
    return start, velocities
