"""Where real trials don't fit a robot: its markers, what drives it, its sensors, the place in which they begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from markertrack.frames import to_body
from swim2real.robots.robot import Robot, Trials
from swim2real.simulation.playback import PlaybackSimulator
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
    if robot.trials.swims is not None:
        return []
    simulator = PlaybackSimulator(robot)
    return [sentence for trial in reference for sentence in _of(simulator, robot.trials, trial)]


def starts(robot: Robot, reference: TrialSet) -> dict[str, NDArray[np.float64]]:
    """How far the simulation of each recording, with the parameters as published, is from it where it starts.

    Returns:
        Simulated minus real markers in the frame of comparison in the first quarter of a second, NaN where one isn't
        seen, by trial; nothing of swims [m]. Shape (K, M, 2).

    Raises:
        TrialError: A trial can't be played back.
        EngineError: The robot itself can't be simulated.
    """
    about, found = robot.trials, dict[str, NDArray[np.float64]]()
    if about.swims is not None or not robot.marker_names:
        return found
    simulator, begun = PlaybackSimulator(robot), [trial.cut(STRETCH) for trial in reference]
    pairs = zip(reference, begun, strict=True)
    rollouts = [replace(simulator.request(trial), trial=first) for trial, first in pairs]
    made = simulator.simulate(robot.space.published, rollouts)
    for real, simulated in zip(begun, made, strict=True):
        places = (simulated.track.positions, real.track.positions)
        seen, shown = places if about.frame is None else (to_body(one, about.frame) for one in places)
        found[real.name] = seen - shown
    return found


def _of(simulator: PlaybackSimulator, about: Trials, trial: Trial) -> list[str]:
    sentences: list[str] = []
    try:
        simulator.request(trial)
    except Swim2RealError as error:
        sentences.append(str(error))
    track = trial.track
    columns = () if trial.sensors is None else trial.sensors.names
    missing = [sensor.name for sensor in about.sensors if sensor.name not in columns]
    if missing:
        there = ", ".join(columns) or "none"
        sentences.append(
            f"trial '{trial.name}' has no readings of {', '.join(missing)}; it has {there}; add columns of these "
            f"names to its table of sensors, or take the sensors out of the robot file"
        )
    elif trial.sensors is not None and about.sensors:
        try:
            trial.sensors.between(track.times[0], track.times[-1])
        except TrialError as error:
            sentences.append(f"trial '{trial.name}': its sensors can't be compared: {error}")
    return sentences
