"""Recordings that begin at rest, in a keyframe, or in motion, of the pendulum, of floating links and of encoders."""

from dataclasses import replace

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from recorded import (
    FLOATER,
    FLOATER_HIDDEN,
    PENDULUM,
    PENDULUM_HIDDEN,
    blank,
    pendulum_reference,
    recorded,
    telling,
    torque_table,
)
from refused import says
from swim2real.calibration import Problem
from swim2real.checks.resting import better_starts, other_start, started
from swim2real.robots.drives import Drive
from swim2real.trials import Signals, TrialSet

RESTING, RAISED = telling(PENDULUM, start="rest"), telling(PENDULUM, start="raised")


def from_pose(robot, seconds=2.0, noise=3e-4, names="ab") -> TrialSet:
    blanks = [blank(robot, name, seconds, controls=torque_table(seconds, k)) for k, name in enumerate(names)]
    return recorded(robot, PENDULUM_HIDDEN, blanks, noise)


@pytest.mark.parametrize(("robot", "pose", "start"), [(RESTING, "model's own pose", "rest"),
                                                     (RAISED, "keyframe 'raised'", "raised")])  # fmt: skip
@pytest.mark.parametrize("fitted", ["fitted", "markers"])
def test_a_start_at_rest_is_proposed(fitted, robot, pose, start):
    trials = from_pose(robot)
    said = other_start(telling(PENDULUM, start=fitted), trials)
    assert says(said, "All 2 recordings begin at rest", pose, f'start = "{start}"')
    assert other_start(robot, trials) is None


def test_a_recording_in_motion_is_reported_where_the_file_says_rest():
    trials = pendulum_reference(1e-3)  # cut out of longer ones
    fitted = telling(PENDULUM, start="fitted")
    assert other_start(fitted, trials) is None
    assert says(
        other_start(RESTING, trials), "trial 'a' begins", 'start = "rest", middle moving by 1', 'say start = "fitted"'
    )
    blanks = [blank(RESTING, "a", 0.5, controls=torque_table(0.5), start={"shoulder": 1.0, "elbow": 0.2})]
    known = recorded(RESTING, PENDULUM_HIDDEN, blanks, 1e-3)  # a known start isn't looked at
    assert other_start(fitted, known) is None
    assert other_start(RESTING, known) is None


@pytest.mark.parametrize(("trials", "start"), [(from_pose(RESTING, names="a"), "rest"),
                                               (pendulum_reference(1e-3), "fitted")])  # fmt: skip
def test_where_no_start_is_named_each_recording_gets_what_suits_it(trials, start):
    unnamed, named = telling(RESTING, start_named=False), telling(PENDULUM, start=start)
    assert {one.start for one in better_starts(unnamed, trials).values()} == {start}
    losses = [Problem(robot, trials, horizon=1.0).evaluate(PENDULUM_HIDDEN).loss for robot in (unnamed, named)]
    assert losses[0] == losses[1]
    assert started(unnamed, trials).trials.start == start
    assert other_start(unnamed, trials) is None


def test_a_start_elsewhere_is_fitted_and_a_command_that_jumps_speaks_for_none():
    table = Signals([0.0, 2.0], ["torque"], [[0.1], [0.1]])
    trials = recorded(RESTING, PENDULUM_HIDDEN, [blank(RESTING, "a", 2.0, controls=table)], 3e-4)
    (one,) = better_starts(RESTING, trials).values()
    assert one.start == "rest"
    assert other_start(RESTING, trials) is None
    start = {"shoulder": 0.2, "elbow": 0.1}
    begun = blank(RESTING, "a", 1.0, controls=torque_table(1.0), start=start)
    placed = recorded(RESTING, PENDULUM_HIDDEN, [begun], 3e-4)
    unknown = replace(placed, trials=tuple(replace(trial, start={}) for trial in placed))
    said = other_start(RESTING, unknown)
    assert says(said, "trial 'a' begins", 'mm from the pose of start = "rest"', 'say start = "fitted"')


def test_links_that_float_begin_at_rest_wherever_they_are():
    blanks = [blank(FLOATER, "swim", 2.0, nominal_frequency=1.0)]
    floater = telling(FLOATER, controls={"bender": Drive(0.5), "flapper": Drive(0.4)})
    trials = recorded(floater, FLOATER_HIDDEN, blanks, 1e-4)
    (swim,) = trials
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    track = type(swim.track)(swim.track.times, swim.track.positions @ turn + [3.0, 1.0])
    elsewhere = TrialSet((type(swim)(**{**vars(swim), "track": track}),), trials.marker_names)
    told = other_start(telling(floater, start="fitted"), elsewhere)
    assert told is not None
    assert told.startswith("The recording begins at rest in the model's own pose")
    assert other_start(telling(floater, start="rest"), elsewhere) is None


def test_markers_that_are_lost_at_first_tell_nothing():
    trials = from_pose(RESTING)
    fitted = telling(PENDULUM, start="fitted")

    def without(count, markers) -> TrialSet:
        made = []
        for trial in trials:
            positions = trial.track.positions.copy()
            positions[:count, markers] = np.nan
            made.append(replace(trial, track=MarkerTrack(trial.track.times, positions)))
        return TrialSet(tuple(made), trials.marker_names)

    assert other_start(fitted, without(None, [0])) is not None
    assert other_start(fitted, without(20, [0, 1, 2])) is None
    assert other_start(RESTING, without(20, [0, 1, 2])) is None
    assert other_start(fitted, TrialSet(trials.trials, ("a", "b", "c"))) is None
