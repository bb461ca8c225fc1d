"""Where real trials don't fit a robot: its markers, what drives it, its sensors."""

from __future__ import annotations

from swim2real.errors import Swim2RealError, TrialError
from swim2real.robots.robot import Recordings, Robot
from swim2real.simulation.playback import Player
from swim2real.trials import Trial, TrialSet


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
    if not isinstance(robot.trials, Recordings):
        return []
    player = Player(robot)
    return [sentence for trial in reference for sentence in _of(player, robot.trials, trial)]


def _of(player: Player, about: Recordings, trial: Trial) -> list[str]:
    found: list[str] = []
    try:
        player.prepared(trial)
    except Swim2RealError as error:
        found.append(str(error))
    track = trial.track
    columns = () if trial.sensors is None else trial.sensors.names
    missing = [sensor.name for sensor in about.sensors if sensor.name not in columns]
    if missing:
        there = ", ".join(columns) or "none"
        found.append(
            f"trial '{trial.name}' has no readings of {', '.join(missing)}; it has {there}; add columns of these "
            f"names to its table of sensors, or take the sensors out of the robot file"
        )
    elif trial.sensors is not None and about.sensors:
        try:
            trial.sensors.between(track.times[0], track.times[-1])
        except TrialError as error:
            found.append(f"trial '{trial.name}': its sensors can't be compared: {error}")
    return found
