"""Expected motion under a table of a policy's commands: the commands again, with every parameter set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markertrack import frames
from swim2real.objective.expected_run import Band, ExpectedRun, arrival, motion_of
from swim2real.parameters import Values
from swim2real.rl.environment import make_environments
from swim2real.rl.rollout import Episode, repeated, run_episodes
from swim2real.rl.tasks import STAGES, ReachGoal, find_task
from swim2real.rl.training_run import TrainingRun
from swimbase.errors import ArgumentError

_ROLLS = 0.03  # rad; a hull that is held by springs rolls less


def expect(run: TrainingRun, episode: Episode, phase: float, ensemble: Sequence[Values]) -> ExpectedRun | None:
    """Repeats recorded commands with the parameters of a training and with others, as the real robot repeats them.

    Args:
        run: Training of the policy.
        episode: The episode whose commands are exported.
        phase: Angle of the motor at its start [rad].
        ensemble: Further parameter sets of the robot.

    Returns:
        What is expected; None for a robot without a frame, of which nothing can be compared.

    Raises:
        ArgumentError: The simulation diverges with one of the sets.
    """
    robot, pair = run.robot, run.robot.trials.frame
    if pair is None:
        return None
    sets = [run.settings.parameters[0], *ensemble]
    environments = make_environments("forward", sets, len(sets), robot=robot, seconds=episode.duration)
    options = [{"phase": phase, "member": i} for i in range(len(sets))]
    swims = run_episodes(environments, repeated([episode.actions] * len(sets)), range(len(sets)), options)
    for number, swim in enumerate(swims):
        if swim.failure:
            raise ArgumentError(f"parameter set {number} of the expectation: {swim.failure}; leave it out")
    first = swims[0]
    axes = frames.body_axes(first.markers[:1], pair)
    origin = frames.components(first.heads[1:2] - frames.heads(first.markers[:1], pair), axes)[0]
    motions = [motion_of(swim.markers, pair, origin) for swim in swims]
    places = np.array([np.vstack([np.zeros((1, 2)), place]) for place, _ in motions])  # with the start
    headings = np.array([np.append(0.0, heading) for _, heading in motions])
    rolls = np.array([np.append(0.0, swim.rolls) for swim in swims])
    goal = None if episode.goal is None else (float(episode.goal[0]), float(episode.goal[1]))
    aims = goal is not None and issubclass(find_task(run.task), ReachGoal)
    threshold = STAGES[max(STAGES)].threshold if aims else None
    return ExpectedRun(
        robot=robot.name, task=run.settings.task, frame=(robot.marker_names[pair[0]], robot.marker_names[pair[1]]),
        origin=(float(origin[0]), float(origin[1])), goal=goal, threshold=threshold, rate=episode.rate,
        sets=len(sets), x=Band.of(places[..., 0]), y=Band.of(places[..., 1]), heading=Band.of(headings),
        roll=Band.of(rolls) if np.abs(rolls).max() > _ROLLS else None,
        arrivals=[arrival(swim.heads, episode.rate, goal, threshold) for swim in swims],
    )  # fmt: skip
