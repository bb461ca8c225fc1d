"""References that aren't what they are taken for are named as what they are, and sound ones aren't."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from examples.test_worked import code_of
from markertrack.track import MarkerTrack
from recorded import (
    FLOATER,
    PENDULUM,
    PENDULUM_HIDDEN,
    PENDULUM_XML,
    RINGING,
    blank,
    floater_reference,
    make_robot,
    pendulum_reference,
    recorded,
    ringing_reference,
    telling,
    torque_table,
    with_markers,
)
from swim2real.checks.mistakes import judged
from swim2real.checks.reference import starts
from swim2real.robots.drives import TABLE
from swim2real.robots.robot import Sensor, Trials
from swim2real.trials import Signals, TrialSet

ROD = make_robot(
    "rod", PENDULUM.space, lambda values: with_markers(PENDULUM_XML.format(**PENDULUM.space.check(values)), ("end",)),
    Trials({}, (), "rest"), ("end",), (0, 2),
)  # fmt: skip
ENCODED = telling(PENDULUM, start="fitted", sensors=(Sensor("encoder", "rad", 0.2),))


def changed(trials: TrialSet, change) -> TrialSet:
    return replace(trials, trials=tuple(change(trial) for trial in trials))


def placed(change):
    return lambda trial: replace(trial, track=MarkerTrack(trial.track.times, change(trial.track.positions)))


def swapped(i, j):
    def change(positions):
        order = list(range(positions.shape[1]))
        order[i], order[j] = order[j], order[i]
        return positions[:, order]

    return placed(change)


def clocked(factor):
    return lambda trial: replace(trial, track=MarkerTrack(factor * trial.track.times, trial.track.positions))


def signals(kind, change):
    def made(trial):
        table = getattr(trial, kind)
        return replace(trial, **{kind: Signals(table.times, table.names, change(table.values))})

    return made


def late(kind, seconds):
    return lambda trial: replace(
        trial, **{kind: replace(getattr(trial, kind), times=getattr(trial, kind).times + seconds)}
    )


def exchanged(kind):
    """Each of the pendulum's trials with the other one's table."""
    return lambda trial: replace(trial, **{kind: torque_table(2.0, 1 - "ab".index(trial.name))})


def filmed(name):
    code = code_of(name)
    return code.ROBOT, code.record() if name == "arm" else code.LAB.record(code.takes())


@functools.cache
def sound(name):
    """A robot and a reference without a mistake."""
    resting = [blank(PENDULUM, name, 2.0, controls=torque_table(2.0, k)) for k, name in enumerate("ab")]
    made = {
        "pendulum": lambda: (ENCODED, recorded(ENCODED, PENDULUM_HIDDEN, resting, 3e-4)),
        "moving": lambda: (telling(PENDULUM, start="fitted"), pendulum_reference(1e-3)),
        "floater": lambda: (telling(FLOATER, start="fitted"), floater_reference(3e-4)),
        "ringing": lambda: (RINGING, ringing_reference(100.0, 3e-4)),
    }
    return made[name]() if name in made else filmed(name)


QUICK = ("that looks like millimeters; tracks are in meters", "pendulum", "floater")


def of_each(*cases):
    """Cases of robots; a few on the small ones are quick."""
    return [pytest.param(*case, marks=() if case[-1] in QUICK else pytest.mark.slow) for case in cases]


@pytest.mark.parametrize(
    "name", of_each(*[(name,) for name in ("pendulum", "moving", "floater", "ringing", "arm", "finger", "snake")])
)
def test_the_motion_of_a_sound_reference_is_explained(name):
    verdict = judged(*sound(name))
    assert verdict.doubts == ()
    if name != "ringing":  # of many swings a short search finds no way down
        assert "All trials fit" in verdict.summary(sound(name)[1].names)


@pytest.mark.parametrize(
    ("name", "change", "said"),
    of_each(
        ("pendulum", placed(lambda p: 1e3 * p), "that looks like millimeters; tracks are in meters"),
        ("floater", placed(lambda p: 1.5 * p), "its markers are about 1.6 times as far apart as the robot's"),
        ("finger", placed(lambda p: p[:, :, ::-1]), "its axes look swapped: the camera sees x to its right and z up"),
        ("finger", placed(lambda p: p * [1, -1]), "its z looks upside down"),
        ("finger", placed(lambda p: p * [-1, 1]), "its x looks mirrored"),
        ("finger", placed(lambda p: p[:, ::-1]), "in the other order, from tip to palm1; click, or name, palm1 first"),
        ("snake", swapped(1, 2), "markers neck and back1 look swapped"),
        ("floater", swapped(0, -1), "markers nose and tail look swapped"),
        ("pendulum", placed(lambda p: p + np.array([0.56, 0])), "it lies beside the robot by x +560 mm"),
        ("finger", placed(lambda p: p[:, [0, 5, 1, 4, 2, 3]]), "is it a film of this robot"),
        ("finger", clocked(1.2), "times as long as what drove it: give --fps, about 60"),
        ("pendulum", clocked(5 / 6), "its frames last 0.833 times as long as what drove it: give --fps, about 60"),
        ("pendulum", clocked(2.4), "its frames last 2.4 times as long"),
        ("snake", clocked(2.0), "its frames last 2 times as long"),
        ("floater", placed(lambda p: p[:, :, ::-1]), "as the robot does in a mirror"),
        ("snake", placed(lambda p: p[:, ::-1]), "in the other order, from tail to nose"),
        (
            "pendulum",
            signals("controls", np.negative),
            "'torque' look of the other sign: say NAME=COLUMN:-1",
        ),
        ("pendulum", late("controls", 0.3), "its film seems 0.30 s early, or its commands as late"),
        ("pendulum", exchanged("controls"), "trials 'a' and 'b': their tables of controls"),
        ("arm", signals("controls", np.fliplr), "the commands that move them, look swapped"),
        (
            "arm",
            signals("sensors", np.fliplr),
            "sensors 'shoulder_angle' and 'elbow_angle', or the commands that move them, look swapped",
        ),
        ("arm", signals("sensors", lambda v: v * [1, -1]), "sensor 'elbow_angle' look of the other sign"),
        ("arm", signals("sensors", lambda v: v + np.array([0, 0.8])), "'elbow_angle' are +0.794 beside"),
        ("arm", signals("sensors", np.rad2deg), "'elbow_angle' look like degrees in place of radians"),
        ("pendulum", signals("sensors", np.negative), "readings of sensor 'encoder' look of the other sign"),
        ("pendulum", signals("sensors", np.rad2deg), "look like degrees in place of radians: say NAME=COLUMN:UNIT"),
        ("pendulum", signals("sensors", lambda v: v - 0.5), "readings of sensor 'encoder' are -0.506 beside"),
        ("pendulum", late("sensors", 0.2), "its readings seem 0.20 s late, or its commands as early"),
    ),
)
def test_a_mistake_is_named(name, change, said):
    robot, trials = sound(name)
    found = judged(robot, changed(trials, change)).doubts
    assert any(said in sentence for sentence in found), found


@pytest.mark.slow
def test_one_trial_of_several_is_named_and_other_natural_frequencies_are_no_clock():
    robot, trials = sound("finger")
    mixed = replace(trials, trials=(*trials.trials[:2], swapped(2, 3)(trials.trials[2])))
    (found,) = judged(robot, mixed).doubts
    assert found.startswith("trial 'ramp': markers prox1 and prox2 look swapped")
    robot, trials = sound("ringing")
    assert judged(robot, changed(trials, clocked(1.2))).doubts == ()


def test_encoders_without_readings_tell_nothing_and_a_place_of_no_importance_is_none():
    trials = changed(sound("floater")[1], placed(lambda p: p + np.array([0.5, 0.2])))
    slow, _ = starts(telling(FLOATER, start="rest"), trials).values()
    assert np.abs(slow[0]).max() < 2e-3
    robot, trials = sound("pendulum")
    assert judged(robot, changed(trials, lambda trial: replace(trial, sensors=None))).doubts == ()


@pytest.mark.slow
def test_few_markers_and_frames_without_any_are_judged_as_far_as_they_tell():
    robot, trials = sound("finger")

    def late(positions):
        moved = positions + np.array([0.56, 0.0])
        moved[:30] = np.nan
        return moved

    (found,) = judged(robot, changed(trials, placed(late))).doubts
    assert "it lies beside the robot by x +560 mm" in found
    lone = replace(ROD, trials=replace(ROD.trials, controls={"torque": TABLE}))
    blanks = [blank(lone, "a", 1.0, controls=torque_table(1.0))]
    swung = recorded(lone, PENDULUM_HIDDEN, blanks)
    assert judged(lone, swung).doubts == ()
    (said,) = judged(lone, changed(swung, signals("controls", np.negative))).doubts
    assert "commands of actuator 'torque' look of the other sign: say NAME=COLUMN:-1" in said or "in a mirror" in said
