"""Front views of steady swims with a rolling hull; a top view can't distinguish roll from sway."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from markertrack import frames
from swim2real.objective import ComparedTrial
from swim2real.objective.head import head_motion
from swim2real.parameters import Values
from swim2real.rendering.trial_view import TrialView
from swim2real.robots.robot import Robot
from swim2real.viewing import Motion, shown_swim
from swimbase.arrays import Array
from swimbase.errors import EngineError, TrialError

LEAST_ROLL = 1.0  # degrees to either side, in the fastest swim: a robot that rolls less doesn't roll
_LEAST_MAST = 0.1  # of the robot's size


@dataclass(frozen=True)
class SeenAhead:
    """A trial as it is seen from ahead.

    Attributes:
        view: Places to the right of the path and heights in the world [m]. Simulated markers are where they are on the
            robot; real ones are off them as in the view from above, at the same heights, which its camera doesn't see.
            After the M markers come the foot and the top of a mast that the simulated hull carries, on a line of their
            own. Shapes (T, M + 2, 2).
        roll: Amplitude of the simulated hull's roll, half of what is between its extremes [degrees].
    """

    view: TrialView
    roll: float


def seen_ahead(
    trials: Sequence[tuple[ComparedTrial, TrialView]], robot: Robot, values: Values
) -> Mapping[str, SeenAhead]:
    """Steady swims from ahead, by name of the trial; none of a robot whose hull doesn't roll.

    Each is simulated once more, in three dimensions. One that diverges is left out, and one of less than a beat.

    Args:
        trials: Each with its view from above.
        robot: The robot.
        values: Values of its parameters, with which the trials were simulated.
    """
    found: dict[str, SeenAhead] = {}
    for trial, view in sorted(trials, key=lambda one: one[0].frequency or 0.0, reverse=True):
        if trial.frequency is None or trial.divergence or view.path_real is None:
            continue
        try:
            motion = shown_swim(robot, values, trial.frequency, math.inf, trial)
            made = _from_ahead(view, robot, motion, trial.frequency)
        except (EngineError, TrialError):
            continue
        if not found and made.roll < LEAST_ROLL:
            break
        found[trial.name] = made
    return found


def _from_ahead(view: TrialView, robot: Robot, motion: Motion, frequency: float) -> SeenAhead:
    times, count = view.times - view.times[0], len(robot.marker_names)
    rows = [motion.nearest(time) for time in times]
    markers = motion.simulated[rows]
    feet, turns = _hull(motion, robot.marker_bodies[0], rows)
    tall = max(float((markers[:, :, 2] - feet[:, None, 2]).max()), _LEAST_MAST * robot.size)
    points = np.concatenate([markers, np.stack([feet, feet + tall * turns[:, :, 2]], axis=1)], axis=1)
    simulated = np.stack([_aside(times, points[:, :, :2], frequency), points[:, :, 2]], axis=2)
    real = np.where(np.arange(count + 2)[:, None] < count, simulated, np.nan)
    if view.path_real is not None and view.path_simulated is not None:
        real[:, :count, 0] += _aside(times, view.path_real, frequency) - _aside(times, view.path_simulated, frequency)
    seen_from_ahead = replace(
        view, marker_names=(*view.marker_names, "foot", "top"), lines=(*view.lines, (count, count + 1)),
        seen=np.isfinite(real).all(axis=2), real=real, simulated=simulated, path_real=None, path_simulated=None,
    )  # fmt: skip
    return SeenAhead(seen_from_ahead, math.degrees(np.ptp(np.arctan2(turns[:, 2, 1], turns[:, 2, 2])) / 2))


def _hull(motion: Motion, body: int, rows: Sequence[int]) -> tuple[Array, Array]:
    """Origin of a body in the world [m], and how it is turned from its attitude at rest. Shapes (T, 3), (T, 3, 3)."""
    data = mujoco.MjData(motion.model)
    mujoco.mj_kinematics(motion.model, data)
    rest = data.xmat[body].reshape(3, 3).T.copy()
    feet, turns = np.empty((len(rows), 3)), np.empty((len(rows), 3, 3))
    for i, row in enumerate(rows):
        data.qpos = motion.qpos[row]
        mujoco.mj_kinematics(motion.model, data)
        feet[i], turns[i] = data.xpos[body], data.xmat[body].reshape(3, 3) @ rest
    return feet, turns


def _aside(times: Array, positions: Array, frequency: float) -> Array:
    """Places to the right of the path, as who stands ahead sees them [m]. Shape (T, M, 2) to (T, M)."""
    return -head_motion(times, positions, frequency).to_path(frames.to_body(positions))[:, :, 1]
