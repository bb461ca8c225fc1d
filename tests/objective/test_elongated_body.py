"""Speeds from the motion of the tail's end alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markertrack.track import MarkerTrack
from swim2real.calibration import Problem
from swim2real.objective import steady_target
from swim2real.objective.elongated_body import TailMotion, fit_drag_ratio, predict_speeds, tail_motion
from swim2real.robots.fish import FISH
from swim2real.trials import Trial
from swimbase.errors import TrialError

END = (2, 3)  # of four markers
LENGTH = 0.06
positive = st.floats(0.01, 10)


def swim(frequency=1.2, sweep=0.06, angle=0.4, speed=0.1, heading=0.0, placed=0.0, name="a"):
    """A stiff head and a tail end that sweeps and turns; markers at the end may be placed askew."""
    times = np.arange(300) / 60
    turn = 2 * np.pi * frequency * times
    positions = np.zeros((len(times), 4, 2))
    positions[:, 1, 0], positions[:, 3, 0], positions[:, 2, 0] = 0.14, 0.5, 0.5 - LENGTH
    positions[:, 3, 1] = sweep * np.cos(turn)
    positions[:, 2, 1] = positions[:, 3, 1] - LENGTH * angle * np.cos(turn - 0.7) + placed
    positions[:, :, 0] -= speed * times[:, None]
    c, s = np.cos(heading), np.sin(heading)
    track = MarkerTrack(times + 3, positions @ np.array([[c, s], [-s, c]]) + [0.7, -0.3])
    return steady_target(Trial(name, track), np.ones((len(times), 4)), frequency)


@pytest.mark.parametrize("placed", [0.0, 0.02])  # how the markers were placed doesn't count
def test_the_motion_of_a_tail_done_by_hand(placed):
    motion = tail_motion(swim(heading=0.8, placed=placed), END)
    assert motion.lateral_speed == pytest.approx(2 * np.pi * 1.2 * 0.06 / np.sqrt(2))
    assert motion.slope == pytest.approx(0.4 / np.sqrt(2))
    assert motion.speed == pytest.approx(0.1)
    driven = swim()
    assert tail_motion(steady_target(driven.trial, driven.weights, 1.6, 1.2), END) == tail_motion(driven, END)


@given(positive, st.floats(0.0, 10), positive, st.floats(1e-3, 100))
def test_thrust_and_drag_balance_below_the_wave_s_speed(lateral_speed, slope, factor, ratio):
    motion = TailMotion("a", lateral_speed, slope, 0.0)
    speed = motion.cruising_speed(ratio)
    assert lateral_speed**2 - speed**2 * slope**2 == pytest.approx(ratio * speed**2)  # of half the moved water
    assert 0 <= speed * slope < lateral_speed
    assert motion.cruising_speed(ratio * (1 + factor)) < speed


def test_lost_frames_and_noise_hardly_change_it():
    clean = swim()
    positions = clean.trial.track.positions + np.random.default_rng(0).normal(0, 5e-4, (300, 4, 2))
    positions[100:140, 3] += 0.3
    positions[200:210, 2] = np.nan
    weights = np.ones((300, 4))
    weights[100:140, 3] = 0
    noisy = steady_target(Trial("a", MarkerTrack(clean.trial.track.times, positions)), weights, clean.frequency)
    found, expected = tail_motion(noisy, END), tail_motion(clean, END)
    assert found.lateral_speed == pytest.approx(expected.lateral_speed, rel=0.01)
    assert found.slope == pytest.approx(expected.slope, rel=0.01)


@pytest.mark.parametrize("seen", [0, 40])
def test_markers_that_are_lost_are_named(seen):
    target = swim()
    weights = target.weights.copy()
    weights[seen:, 2] = 0
    with pytest.raises(TrialError, match=rf"trial 'a': markers 2 and 3 are seen together in {seen} of 300 frames"):
        tail_motion(steady_target(target.trial, weights, target.frequency), END)


@pytest.mark.parametrize("ratio", [0.01, 0.3, 4.0, 900.0])
def test_the_drag_of_swims_that_follow_the_theory_is_found(ratio):
    made = [TailMotion(f"{f}", 0.3 * f, 0.4, 0.0) for f in (0.5, 1.0, 2.0)]
    seen = [TailMotion(m.name, m.lateral_speed, m.slope, m.cruising_speed(ratio)) for m in made]
    assert fit_drag_ratio(seen) == pytest.approx(ratio, rel=1e-4)


def test_each_trial_is_predicted_from_two_or_more_others():
    targets = []
    for i, frequency in enumerate((0.5, 1.0, 1.5)):
        speed = tail_motion(swim(frequency), END).cruising_speed(4.0)
        targets.append(swim(frequency, speed=speed if i else 3 * speed, name=f"swim{i}"))
    found = predict_speeds(targets, END)
    assert found["swim0"] == pytest.approx(tail_motion(targets[0], END).speed / 3, rel=1e-3)  # its own has no say
    assert found["swim1"] > tail_motion(targets[1], END).speed
    for few in (targets[:1], []):
        with pytest.raises(TrialError, match=rf"^{len(few)} trials? (is|are) too few"):
            predict_speeds(few, END)


def test_the_published_swims(tracks):
    targets = [prepared.target for prepared in Problem(FISH, tracks, "aligned", None, threads=1).prepared]
    found = predict_speeds(targets, (7, 8))
    assert list(found) == list(tracks.names)
    misses = [abs(found[target.name] - target.velocity) for target in targets]
    assert max(misses) < 0.05
    assert np.mean(misses) < 0.025
