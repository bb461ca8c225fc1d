from dataclasses import replace

import numpy as np
import pytest

from made_robots import ARM, ROBOT, made, parameter
from markertrack.track import MarkerTrack
from recorded import RINGING, ringing_reference
from refused import refusal, says
from small_models import PENDULUM
from swim2real.checks.probing import NOISE, excitation, growing, moved, probe
from swim2real.checks.reference import misfits
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH
from swim2real.simulation.playback import PlaybackSimulator
from swim2real.trials import Signals, Trial, TrialSet
from swimbase.errors import EngineError

DRIVEN = """
[recordings]
start = "START"
[recordings.controls]
servo = "table"
torque = "table"
[recordings.sensors]
angle = {unit = "rad", meters_per_unit = 0.1}
"""
SWINGING = ROBOT.replace('["base", "elbow", "tip"]', '["pivot", "elbow", "tip"]')


@pytest.fixture
def robot_of(tmp_path):
    """A robot with these parameters; the arm, driven, unless another one is given."""

    def load(*parts: str, start: str = "rest", model: str = ARM, text: str = ROBOT, trials: str = DRIVEN):
        return load_robot(made(tmp_path, text, trials.replace("START", start), *parts, model=model))

    return load


def pendulum(robot_of, *parts: str, start: str = "markers", model: str = PENDULUM):
    return robot_of(*parts, start=start, model=model, text=SWINGING, trials='[recordings]\nstart = "START"\n')


def test_what_moves_the_markers_and_what_does_not(robot_of):
    stiff = parameter("'joint \"link1\" stiffness'", 0.5, 8.0)
    unused = parameter("'body \"upper\" mass'", 0.1, 1.0, "value = 0.1").replace('"x"', '"y"')
    unseen = parameter("'geom \"rod0\" friction[0]'", 0.1, 2.0).replace('"x"', '"z"')
    first, second, third = probe(robot_of(stiff, unused, unseen), threads=1)
    assert min(first.lower.distance, first.upper.distance) > 1e-4
    assert not first.idle
    assert (second.effect.changes, second.distance, second.idle) == (False, 0.0, True)
    assert (third.effect.changes, third.idle) == (True, True)
    assert third.distance <= NOISE


def test_a_pendulum_that_hangs_at_rest_shows_nothing_and_one_that_swings_does(robot_of):
    damping = parameter("'joint \"shoulder\" damping'", 0.0, 0.1)
    assert probe(pendulum(robot_of, damping, start="rest"), threads=1)[0].idle
    swung = probe(pendulum(robot_of, damping), threads=1)[0]
    assert swung.lower.distance == 0.0  # where the model is already
    assert swung.upper.distance > 0.01


def test_a_bound_that_cannot_be_simulated_is_told_and_is_no_idle_parameter(robot_of):
    pull = parameter("'option gravity[0]'", 0.0, 1e12)
    found = probe(robot_of(pull), threads=1)[0]
    assert found.upper.failure is not None
    assert "diverged" in found.upper.failure
    assert np.isnan(found.upper.distance)
    assert not found.idle
    angle = parameter("'joint \"link0\" range[0]'", -40.0, 70.0)
    refused = probe(robot_of(angle), threads=1)[0]
    assert refused.refused == refused.upper.failure
    assert "doesn't compile" in refused.refused


def test_a_robot_that_diverges_by_itself_is_refused_and_one_that_would_be_thrown_about_is_moved_less(robot_of):
    model = PENDULUM.replace('timestep="0.002"', 'timestep="0.002" gravity="1e9 0 0"')
    robot = pendulum(robot_of, parameter("'joint \"shoulder\" armature'", 0.0, 1.0), model=model)
    said = refusal(EngineError, probe, robot, threads=1)
    assert says(said, "robot 'arm'", "its own values", "'excitation'", "diverged", "mend the model")
    strong = ARM.replace('kp="5"', 'kp="5000" forcerange="-5000 5000"').replace('gear="2"', 'gear="2000"')
    trial = moved(robot_of(parameter("'joint \"link0\" damping'"), model=strong), threads=1).trials[0]
    assert trial.divergence is None
    assert np.abs(trial.track.positions).max() < 1.0


def test_sensors_count_by_their_worth(robot_of):
    stiff = parameter("'joint \"link1\" stiffness'", 0.5, 8.0)
    more_worth = DRIVEN.replace("meters_per_unit = 0.1", "meters_per_unit = 1.1")
    plain, worth = robot_of(stiff), robot_of(stiff, trials=more_worth)
    sensors = replace(plain, trials=replace(plain.recordings, sensors=()))
    none, some, more = (probe(one, threads=1)[0].upper.distance for one in (sensors, plain, worth))
    assert more - none == pytest.approx(11 * (some - none), rel=1e-6)
    assert some > none


def recorded(robot, **changes) -> TrialSet:
    """What a robot does under its excitation, as if it had been filmed."""
    trial = excitation(robot, 1.0)
    player = PlaybackSimulator(robot, 1)
    made = player.simulate(robot.space.published, [player.request(trial)]).trials[0]
    real = replace(made, controls=trial.controls, start=trial.start, start_velocities=trial.start_velocities)
    return TrialSet((replace(real, **changes),), robot.marker_names)


def test_real_trials_are_used_where_there_are_some(robot_of):
    robot = robot_of(parameter("'actuator \"torque\" gear[0]'", 1.0, 4.0))
    reference = recorded(robot)
    assert misfits(robot, reference) == []
    usual = probe(robot, threads=1)[0]
    same = probe(robot, reference, threads=1)[0]
    assert same.upper.distance == pytest.approx(usual.upper.distance, rel=1e-9)
    controls = reference.trials[0].controls
    still = recorded(robot, controls=Signals(controls.times, controls.names, 0 * controls.values))
    assert probe(robot, still, threads=1)[0].idle


def test_what_does_not_fit_a_robot_is_reported(robot_of):
    robot = robot_of(parameter("'joint \"link0\" damping'"))
    reference = recorded(robot)
    trial = reference.trials[0]
    column = Signals(trial.controls.times, ("servo", "motor"), trial.controls.values)
    first, second = misfits(robot, recorded(robot, controls=column, sensors=None))
    assert says(first, "'excitation'", "actuator 'torque'", "no column 'torque'", "servo, motor")
    assert says(second, "'excitation'", "no readings of angle", "robot file")
    later = {
        kind: Signals(1e3 + signals.times, signals.names, signals.values)
        for kind, signals in (("controls", trial.controls), ("sensors", trial.sensors))
    }
    first, second = misfits(robot, TrialSet((replace(trial, **later),), robot.marker_names))
    assert says(first, "'excitation'", "controls", "its rows are from 1000 s to 1")
    assert says(second, "'excitation'", "sensors", "its rows are from 1000 s to 1")
    (names,) = misfits(robot, TrialSet(reference.trials, ("base", "tip", "elbow")))
    assert says(names, "base, tip, elbow", "'arm'", "base, elbow, tip")
    swim = Trial("swim", MarkerTrack([0.0, 1.0], np.zeros((2, 9, 2))))  # a swimmer's trials need its markers only
    assert misfits(FISH, TrialSet((swim,), FISH.marker_names)) == []
    assert len(misfits(FISH, TrialSet((swim,), tuple("abcdefghi")))) == 1


def test_a_search_follows_no_pendulum_that_goes_over_the_top_and_no_long_ring_down(robot_of):
    spring = parameter("'joint \"shoulder\" stiffness'", 0.0005, 0.05, "value = 0.005")
    robot = pendulum(robot_of, spring, start="rest")

    def said(angle, horizon=None, intervals=(0.02,)):
        start, trials = {"shoulder": angle, "elbow": angle}, []
        for interval in intervals:
            times = np.arange(0.0, 3.99, interval)
            trials.append(Trial(f"thrown {interval}", MarkerTrack(times, np.zeros((len(times), 3, 2))), start=start))
        return growing(robot, TrialSet(tuple(trials), robot.marker_names), horizon)

    (sentence,) = said(2.5)
    assert says(sentence, "a search can't follow trials of 3.98 s", "try --pieces ")
    shorter = float(sentence.rpartition(" ")[2])
    assert 0.3 <= shorter < 3.0
    assert said(2.5, shorter) == said(0.1) == []
    assert said(2.5, intervals=(0.02, 0.01)) == [sentence]
    ringing = ringing_reference(20.0)
    (sentence,) = growing(RINGING, ringing, 4.0)  # of 6 Hz
    assert says(sentence, "trials of 2.95 s", "try --pieces ")
    assert 0.3 <= float(sentence.rpartition(" ")[2]) < 1.0
    assert growing(RINGING, ringing, 0.5) == growing(FISH, ringing, None) == []
