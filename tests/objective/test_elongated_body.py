"""Speeds from the motion of the tail's end alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swim2real.calibration import Problem
from swim2real.errors import TrialError
from swim2real.objective import steady_target
from swim2real.objective.elongated_body import (
    TailMotion,
    drag_coefficient,
    fit_drag_ratio,
    predict_speeds,
    tail_motion,
)
from swim2real.robots.fish import FISH
from swim2real.trials import MarkerTrack, Trial

END = (2, 3)  # of four markers
LENGTH = 0.06
positive = st.floats(0.01, 10)


def swim(frequency=1.2, sweep=0.06, angle=0.4, lag=0.7, speed=0.1, heading=0.0, seconds=5.0, placed=0.0, name="a"):
    """A stiff head and a tail end that sweeps and turns; markers at the end may be placed askew."""
    times = np.arange(round(seconds * 60)) / 60
    turn = 2 * np.pi * frequency * times
    positions = np.zeros((len(times), 4, 2))
    positions[:, 1, 0], positions[:, 3, 0], positions[:, 2, 0] = 0.14, 0.5, 0.5 - LENGTH
    positions[:, 3, 1] = sweep * np.cos(turn)
    positions[:, 2, 1] = positions[:, 3, 1] - LENGTH * angle * np.cos(turn - lag) + placed
    positions[:, :, 0] -= speed * times[:, None]
    c, s = np.cos(heading), np.sin(heading)
    track = MarkerTrack(times + 3, positions @ np.array([[c, s], [-s, c]]) + [0.7, -0.3])
    return steady_target(Trial(name, track), np.ones((len(times), 4)), frequency)


def test_the_motion_of_a_tail_done_by_hand():
    motion = tail_motion(swim(heading=0.8), END)
    assert motion.lateral_speed == pytest.approx(2 * np.pi * 1.2 * 0.06 / np.sqrt(2))
    assert motion.slope == pytest.approx(0.4 / np.sqrt(2))
    assert motion.speed == pytest.approx(0.1)
    assert motion.frequency == 1.2
    assert motion.wave_speed == pytest.approx(2 * np.pi * 1.2 * 0.06 / 0.4)


def test_thrust_and_drag_balance_at_the_predicted_speed():
    motion, density, span, area = tail_motion(swim(), END), 1000.0, 0.2, 0.1
    moved = density * np.pi * span**2 / 4
    speed = motion.cruising_speed(4.0)
    thrust = moved / 2 * (motion.lateral_speed**2 - speed**2 * motion.slope**2)
    drag = drag_coefficient(4.0, span, area) * density * area * speed**2 / 2
    assert thrust == pytest.approx(drag)
    assert drag_coefficient(4.0, span, area, added_mass=0.9) == pytest.approx(0.9 * drag_coefficient(4.0, span, area))


def test_how_the_markers_were_placed_does_not_count():
    askew = tail_motion(swim(placed=0.02), END)
    assert askew.slope == pytest.approx(tail_motion(swim(), END).slope)
    assert askew.lateral_speed == pytest.approx(tail_motion(swim(), END).lateral_speed)


def test_without_a_sweep_there_is_no_speed():
    still = tail_motion(swim(sweep=0.0, angle=0.0), END)
    assert still.cruising_speed(1.0) == pytest.approx(0.0, abs=1e-9)
    assert TailMotion("a", 1.0, 0.0, 0.0, 0.0).cruising_speed(2.0) == 0.0
    assert TailMotion("a", 1.0, 0.3, 0.0, 0.0).wave_speed == float("inf")


@given(positive, positive, positive, st.floats(1e-3, 100))
def test_the_speed_stays_below_the_wave_s(lateral_speed, slope, factor, ratio):
    motion = TailMotion("a", 1.0, lateral_speed, slope, 0.0)
    assert 0 < motion.cruising_speed(ratio) < motion.wave_speed
    slower = TailMotion("a", 1.0, lateral_speed, slope, 0.0).cruising_speed(ratio * (1 + factor))
    assert slower < motion.cruising_speed(ratio)
    assert motion.cruising_speed(1e-12 * slope**2) == pytest.approx(motion.wave_speed)  # no drag


def test_the_speed_rises_with_frequency_and_amplitude():
    def speed(**changes):
        return tail_motion(swim(**changes), END).cruising_speed(4.0)

    assert speed(frequency=2.4) == pytest.approx(2 * speed())  # the same shape: in proportion
    assert speed(sweep=0.09) == pytest.approx(1.5 * speed())
    assert speed(angle=0.6) < speed()


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


def test_the_beat_s_own_frequency_is_taken():
    driven = swim()
    other = steady_target(driven.trial, driven.weights, 1.6, 1.2)
    assert tail_motion(other, END) == tail_motion(driven, END)


def test_markers_that_are_lost_are_told():
    target = swim()
    weights = target.weights.copy()
    weights[40:, 2] = 0
    with pytest.raises(TrialError) as caught:
        tail_motion(steady_target(target.trial, weights, target.frequency), END)
    assert str(caught.value) == (
        "trial 'a': markers 2 and 3 are seen together in 40 of 300 frames; elongated body theory needs a whole beat "
        "of them"
    )
    weights[:, 2] = 0
    with pytest.raises(TrialError, match="in 0 of 300 frames"):
        tail_motion(steady_target(target.trial, weights, target.frequency), END)


@pytest.mark.parametrize("ratio", [0.01, 0.3, 4.0, 900.0])
def test_the_drag_of_swims_that_follow_the_theory_is_found(ratio):
    made = [TailMotion(f"{f}", f, 0.3 * f, 0.4, 0.0) for f in (0.5, 1.0, 2.0)]
    seen = [TailMotion(m.name, m.frequency, m.lateral_speed, m.slope, m.cruising_speed(ratio)) for m in made]
    assert fit_drag_ratio(seen) == pytest.approx(ratio, rel=1e-4)


def test_each_trial_is_predicted_from_the_others():
    ratio, targets = 4.0, []
    for i, frequency in enumerate((0.5, 1.0, 1.5)):
        speed = tail_motion(swim(frequency), END).cruising_speed(ratio)
        targets.append(swim(frequency, speed=speed if i else 3 * speed, name=f"swim{i}"))
    odd, *others = predict_speeds(targets, END)
    assert odd.drag_ratio == pytest.approx(ratio, rel=1e-3)  # its own speed has no say
    assert odd.speed == pytest.approx(odd.motion.speed / 3, rel=1e-3)
    assert odd.velocity_error == pytest.approx(odd.motion.speed * 2 / 3, rel=1e-3)
    assert all(other.drag_ratio < 3.9 for other in others)


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_trials_are_told(count):
    with pytest.raises(TrialError) as caught:
        predict_speeds([swim()] * count, END)
    word = "is" if count == 1 else "are"
    assert str(caught.value).startswith(f"{count} trial{'' if count == 1 else 's'} {word} too few: each speed is")


def test_nothing_to_fit_to_is_told():
    with pytest.raises(TrialError, match="one coefficient to fit and no trial to fit it to"):
        fit_drag_ratio([])


@pytest.mark.parametrize("protocol", ["aligned", "paper"])
def test_the_published_swims(tracks, protocol):
    problem = Problem(FISH, tracks, protocol, None, threads=1)
    found = predict_speeds([prepared.target for prepared in problem.prepared], (7, 8))
    assert [one.motion.name for one in found] == list(tracks.names)
    for one in found:
        assert one.motion.speed < one.motion.wave_speed
        assert one.speed < one.motion.wave_speed
        assert one.velocity_error < 0.05
    assert np.mean([one.velocity_error for one in found]) < 0.025
    if len(found) > 2:
        order = np.argsort([one.motion.frequency for one in found])
        assert np.all(np.diff([found[i].speed for i in order]) > 0)
