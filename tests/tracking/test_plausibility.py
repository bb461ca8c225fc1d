"""Tracks that can't be the robot's are named as what they probably are."""

import numpy as np
import pytest

from swim2real.errors import TrialError
from swim2real.tracking import check_plausible, doubled_rate
from swim2real.trials import MarkerTrack, Trial
from swimmers import REST, Swimmer

NAMES = tuple(f"M{m}" for m in range(len(REST)))


def trial(change=lambda positions: positions):
    track = Swimmer().track(seed=0)
    return Trial("one", MarkerTrack(track.times, change(track.positions)))


def said(one):
    with pytest.raises(TrialError) as refused:
        check_plausible(one, REST, NAMES)
    return str(refused.value)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "millimeters"), (1e2, "centimeters"), (39.37, "inches"), (1e-3, "kilometers")]
)
def test_another_unit_is_named(factor, unit):
    sentence = said(trial(lambda positions: factor * positions))
    assert sentence.startswith("trial 'one': its markers are ")
    assert sentence.endswith(f"as far apart as the robot's: that looks like {unit}; tracks are in meters")


def test_a_size_of_no_unit_is_told_as_well():
    sentence = said(trial(lambda positions: 8.1 * positions))
    assert "markers are 7.99 times as far apart" in sentence
    assert "check the camera file's lengths, or the robot file's model" in sentence


@pytest.mark.parametrize("factor", [0.3, 1.0, 4.0])
def test_what_a_camera_may_be_off_by_passes(factor):
    check_plausible(trial(lambda positions: factor * positions), REST, NAMES)


def test_markers_from_tail_to_head_are_told():
    sentence = said(trial(lambda positions: positions[:, ::-1]))
    assert sentence.endswith("in the other order, from M8 to M0; click, or name, M0 first")


def test_lost_markers_and_single_ones_say_nothing():
    def mostly_lost(positions):
        out = np.full_like(positions, np.nan)
        out[3, :1] = positions[3, :1]
        return out

    check_plausible(trial(mostly_lost), REST, NAMES)
    lone = trial()
    check_plausible(Trial("lone", MarkerTrack(lone.track.times, 1e3 * lone.track.positions[:, :1])), REST[:1], ("M0",))


@pytest.mark.parametrize(("frequency", "told"), [(2.0, True), (1.5, True), (1.0, False), (0.75, False), (0.5, True)])
def test_a_beat_that_no_motor_makes_is_told(frequency, told):
    sentence = doubled_rate(frequency, 1.0)
    assert (sentence is not None) == told
    if told:
        assert "times its nominal 1 Hz: that looks like a frame rate that is off" in sentence
    assert doubled_rate(frequency, None) is None
