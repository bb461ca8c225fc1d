"""What a number means doesn't depend on how trials are written down: losses and values stay as they are."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from markertrack.track import MarkerTrack
from recorded import (
    FLOATER,
    FLOATER_HIDDEN,
    PENDULUM,
    PENDULUM_HIDDEN,
    PENDULUM_SPACE,
    PENDULUM_XML,
    floater_reference,
    pendulum_reference,
    telling,
    with_markers,
)
from swim2real.calibration import Problem
from swim2real.parameters import read_parameters
from swim2real.pipeline import calibrate
from swim2real.settings import CalibrationSettings
from swim2real.trials import TrialSet

FITTED = telling(PENDULUM, start="fitted")
QUICK = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.fixture(scope="module")
def pendulum():
    return pendulum_reference(3e-4)


@pytest.fixture(scope="module")
def floater():
    return floater_reference(3e-4)


def loss(robot, trials, hidden):
    return Problem(robot, trials, "playback", threads=1).evaluate(hidden).loss


def changed(trials, change):
    return TrialSet(tuple(change(trial) for trial in trials), trials.marker_names)


def moved(trial, turn, shift):
    cos, sin = np.cos(turn), np.sin(turn)
    places = trial.track.positions @ np.array([[cos, sin], [-sin, cos]]) + shift
    return replace(trial, track=MarkerTrack(trial.track.times, places, trial.track.confidence))


def later(trial, seconds):
    controls, sensors = (replace(one, times=one.times + seconds) for one in (trial.controls, trial.sensors))
    track = MarkerTrack(trial.track.times + seconds, trial.track.positions, trial.track.confidence)
    return replace(trial, track=track, controls=controls, sensors=sensors)


@given(turn=st.floats(-np.pi, np.pi), shift=st.tuples(*[st.floats(-10, 10)] * 2))
@QUICK
def test_where_a_swimmer_swims_is_of_no_importance(floater, turn, shift):
    there = changed(floater, lambda trial: moved(trial, turn, np.array(shift)))
    assert loss(FLOATER, there, FLOATER_HIDDEN) == pytest.approx(loss(FLOATER, floater, FLOATER_HIDDEN), rel=1e-6)


@given(order=st.permutations([0, 1]), seconds=st.sampled_from([-7.0, 0.37, 100.0]))
@QUICK
def test_the_order_of_trials_and_the_zero_of_their_clock_are_of_no_importance(pendulum, order, seconds):
    other = TrialSet(tuple(later(pendulum.trials[k], seconds) for k in order), pendulum.marker_names)
    expected = loss(FITTED, pendulum, PENDULUM_HIDDEN)
    assert loss(FITTED, other, PENDULUM_HIDDEN) == pytest.approx(expected, rel=1e-3)


def test_stamps_since_1970_are_as_good(pendulum):
    expected = loss(FITTED, pendulum, PENDULUM_HIDDEN)
    unix = changed(pendulum, lambda trial: later(trial, 1.7e9))
    assert loss(FITTED, unix, PENDULUM_HIDDEN) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("order", list(permutations(range(3)))[1:])
def test_the_order_of_markers_is_of_no_importance(pendulum, order):
    names = tuple(PENDULUM.marker_names[k] for k in order)

    def build(values):
        return with_markers(PENDULUM_XML.format(**PENDULUM_SPACE.check(values)), names)

    rest = PENDULUM.rest_markers[list(order)]
    robot = replace(FITTED, build=build, marker_names=names, rest_markers=rest - rest[0])

    def ordered(trial):
        return replace(trial, track=MarkerTrack(trial.track.times, trial.track.positions[:, order]))

    other = TrialSet(tuple(map(ordered, pendulum)), names)
    assert loss(robot, other, PENDULUM_HIDDEN) == pytest.approx(loss(FITTED, pendulum, PENDULUM_HIDDEN), rel=1e-3)


@pytest.mark.slow
def test_half_the_frame_rate_finds_the_same_values(pendulum, tmp_path):
    def found(trials, name):
        chosen = CalibrationSettings(method="least-squares", budget=60, threads=1)
        calibrate(trials, FITTED, chosen, tmp_path / name)
        return read_parameters(tmp_path / name / "best.json", FITTED.name, FITTED.space).values

    def halved(trial):
        return replace(trial, track=MarkerTrack(trial.track.times[::2], trial.track.positions[::2]))

    full, half = found(pendulum, "full"), found(changed(pendulum, halved), "half")
    for name, hidden in PENDULUM_HIDDEN.items():
        assert full[name] == pytest.approx(hidden, rel=0.05)
        assert half[name] == pytest.approx(full[name], rel=0.05)
