"""From a robot and a reference to the problem that they make."""

from __future__ import annotations

from swim2real.calibration.playback_problem import PlaybackProblem
from swim2real.calibration.problem import Problem
from swim2real.calibration.swim_problem import SwimProblem, examine
from swim2real.errors import ArgumentError
from swim2real.objective import Protocol
from swim2real.robots.robot import Robot
from swim2real.settings import HORIZON, Start
from swim2real.simulation import PlaybackSimulator, Simulator
from swim2real.trials import TrialSet


def pose_problem(
    robot: Robot, reference: TrialSet, protocol: Protocol = "aligned", horizon: float | None = HORIZON,
    threads: int | None = None, start: Start = "speed",
) -> Problem:  # fmt: skip
    """The problem of calibrating a robot against a reference, whatever its trials are.

    Args:
        robot: What is calibrated.
        reference: Real trials.
        protocol: How trials are compared, as `protocol_for` takes it.
        horizon: Seconds of each trial that are compared, None for all.
        threads: Trials simulated at a time, None for all cores.
        start: Of steady swims under protocol `aligned`.

    Raises:
        ArgumentError: The robot's trials can't be compared like that.
        TrialError: The reference isn't the robot's, or a trial lacks what it takes.
    """
    resolved = protocol_for(robot, protocol)
    if start != "speed" and resolved != "aligned":
        raise ArgumentError(f"start is '{start}', which is for steady swims under protocol aligned, not {resolved}")
    if resolved == "playback":
        return PlaybackProblem(reference, PlaybackSimulator(robot, threads), horizon)
    return SwimProblem(robot, examine(reference, robot), Simulator(robot, threads), resolved, horizon, start)


def protocol_for(robot: Robot, asked: Protocol) -> Protocol:
    """How a robot's trials are compared: swims as asked, recordings by playback, which `aligned` means, too.

    Raises:
        ArgumentError: Recordings by the paper's protocol, or swims by playback.
    """
    allowed = robot.trials.protocols
    if asked in allowed:
        return asked
    if asked == "aligned":
        return allowed[0]
    raise ArgumentError(
        f"protocol is '{asked}'; the trials of robot '{robot.name}' are {robot.trials.description}, which are compared "
        f"by protocol {' or '.join(allowed)}"
    )
