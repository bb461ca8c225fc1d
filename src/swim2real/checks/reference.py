"""Misfits of real trials with a robot: its markers, what drives it, its sensors, the place in which they begin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from markertrack.frames import to_body
from swim2real.checks.motion import Motion
from swim2real.robots.robot import Robot
from swim2real.simulation.start import STRETCH
from swim2real.trials import Trial, TrialSet
from swimbase.errors import Swim2RealError, TrialError


def misfits(robot: Robot, reference: TrialSet) -> list[str]:
    """A sentence for each thing that keeps trials from being compared with a robot; none where they can be.

    Raises:
        EngineError: The robot itself can't be simulated.
    """
    if reference.marker_names != robot.marker_names:
        return [
            f"the reference has the markers {', '.join(reference.marker_names)}; robot '{robot.name}' has "
            f"{', '.join(robot.marker_names)}; name them alike, in the same order"
        ]
    if robot.trials.steady:
        return []
    motion = Motion(robot)
    return [sentence for trial in reference for sentence in _of(motion, trial)]


def starts(robot: Robot, reference: TrialSet) -> dict[str, NDArray[np.float64]]:
    """Distances of simulations with the parameters as published from the recordings, where these start.

    Returns:
        Simulated minus real markers in the frame of comparison in the first quarter of a second, NaN where one isn't
        seen, by trial; nothing of swims [m]. Shape (K, M, 2).

    Raises:
        TrialError: A trial can't be played back.
        EngineError: The robot itself can't be simulated.
    """
    if robot.trials.steady or not robot.marker_names:
        return {}
    motion, frame = Motion(robot), robot.trials.frame
    rollouts = [motion.request(trial, STRETCH) for trial in reference]
    found: dict[str, NDArray[np.float64]] = {}
    for rollout, made in zip(rollouts, motion.player.simulate(robot.space.published, rollouts), strict=True):
        places = (made.track.positions, rollout.trial.track.positions)
        simulated, real = places if frame is None else (to_body(one, frame) for one in places)
        found[made.name] = simulated - real
    return found


def _of(motion: Motion, trial: Trial) -> Iterator[str]:
    try:
        motion.player.request(trial)
    except Swim2RealError as error:
        yield str(error)
    track, sensors, wanted = trial.track, trial.sensors, motion.robot.trials.scales
    columns = () if sensors is None else sensors.names
    if missing := [name for name in wanted if name not in columns]:
        yield (
            f"trial '{trial.name}' has no readings of {', '.join(missing)}; it has {', '.join(columns) or 'none'}; add "
            f"columns of these names to its table of sensors, or take the sensors out of the robot file"
        )
    elif sensors is not None and wanted:
        try:
            sensors.between(track.times[0], track.times[-1])
        except TrialError as error:
            yield f"trial '{trial.name}': its sensors can't be compared: {error}"
