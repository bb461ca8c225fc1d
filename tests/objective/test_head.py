"""The head's motion about its path, on motions whose yaw, sway, drift and course are known."""

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from swim2real.objective.head import head_motion
from swim2real.objective.target import steady_target
from swim2real.trials import Trial
from swimbase.errors import TrialError

FREQUENCY = 0.8  # Hz
LENGTHS = np.array([0.0, 0.1, 0.3])  # of the markers behind the first [m]


def swim(
    seconds=6.0, fps=60.0, speed=0.1, yaw=0.1, yaw_phase=0.4, sway=0.01, sway_phase=-0.9, turn_rate=0.0,
    place=(0.3, -0.2), direction=2.0, crab=0.0, jump=0.0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Times and positions of a rigid swimmer whose head follows an arc, sways across it and yaws."""
    t = np.arange(round(seconds * fps) + 1) / fps
    course = direction + turn_rate * t
    forward = np.column_stack([np.cos(course), np.sin(course)])
    path = np.cumsum(np.vstack([np.zeros(2), speed / fps * (forward[1:] + forward[:-1]) / 2]), axis=0)
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    head = place + path + sway * np.cos(2 * np.pi * FREQUENCY * t + sway_phase)[:, None] * -left
    beat = yaw * np.cos(2 * np.pi * FREQUENCY * t + yaw_phase)
    heading = course + np.pi + crab + beat + jump * (t > seconds / 2)
    axis = np.column_stack([np.cos(heading), np.sin(heading)])
    markers = head[:, None] + (LENGTHS - LENGTHS[:2].mean())[None, :, None] * axis[:, None]
    return t, markers


@pytest.mark.parametrize("turn_rate", [-0.1, 0.0, 0.05])
def test_yaw_and_sway_are_found_and_a_slow_turn_of_the_course_is_removed(turn_rate):
    head = head_motion(*swim(turn_rate=turn_rate), FREQUENCY)
    assert head.turn_rate == pytest.approx(turn_rate, abs=2e-3)
    assert head.yaw_beat.amplitude == pytest.approx(0.1, rel=0.01)
    assert head.sway_beat.amplitude == pytest.approx(0.01, rel=0.02)
    assert head.progress[-1] - head.progress[0] == pytest.approx(0.6, rel=2e-3)
    if not turn_rate:
        assert head.yaw_beat.phase == pytest.approx(0.4, abs=2e-3)
        assert head.sway_beat.phase == pytest.approx(-0.9, abs=5e-3)


def test_a_head_that_is_marked_askew_is_no_yaw_and_tail_first_is_negative_progress():
    straight, askew = head_motion(*swim(), FREQUENCY), head_motion(*swim(crab=0.1), FREQUENCY)
    np.testing.assert_allclose(askew.yaw, straight.yaw, atol=1e-9)
    np.testing.assert_allclose(askew.sway, straight.sway, atol=1e-9)
    backward = head_motion(*swim(speed=-0.05), FREQUENCY)
    assert backward.progress[-1] - backward.progress[0] == pytest.approx(-0.3, rel=2e-3)


def test_positions_in_the_frame_of_the_path_are_those_of_the_world():
    t, positions = swim()
    placed = head_motion(t, positions, FREQUENCY).to_path(MarkerTrack(t, positions).body)
    apart = np.linalg.norm(placed[:, :, None] - placed[:, None], axis=3)
    np.testing.assert_allclose(apart, np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3), atol=1e-12)
    np.testing.assert_allclose(placed.mean(axis=1)[:, 0].min(), placed[-1].mean(axis=0)[0], atol=5e-3)  # toward -x


def test_standard_errors_are_those_of_repeated_noise():
    found = []
    for seed in range(40):
        t, positions = swim(seconds=3.0)
        head = head_motion(t, positions + np.random.default_rng(seed).normal(0, 1e-3, positions.shape), FREQUENCY)
        found.append([head.yaw_beat.amplitude, head.yaw_beat.std, head.sway_beat.amplitude, head.sway_beat.std])
    yaws, yaw_std, sways, sway_std = np.array(found).T
    assert yaw_std.mean() == pytest.approx(yaws.std(), rel=0.4)
    assert sway_std.mean() > 0.5 * sways.std()


def test_a_head_that_is_lost_for_a_while_is_stepped_over():
    t, positions = swim()
    positions[100:140, :2] = np.nan
    head = head_motion(t, positions, FREQUENCY)
    assert np.isnan(head.yaw[100:140]).all()
    assert np.isfinite(head.yaw[140:]).all()
    assert head.yaw_beat.amplitude == pytest.approx(0.1, rel=0.01)
    assert head.sway_beat.amplitude == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize(("changed", "seen", "says"), [
    ({"seconds": 1.0}, None, r"its head is seen for 1.00 s, less than a beat of 1.25 s; protocol motion"),
    ({"jump": 1.2}, None, "its course turns sharply: beside the beat and a steady turn of .* protocol aligned"),
    ({}, 10, "its head is seen in 10 frames, and protocol motion needs 12"),
], ids=["short", "sharp", "lost"])  # fmt: skip
def test_a_trial_without_a_path_is_refused_in_a_sentence(changed, seen, says):
    trial = Trial("pool", MarkerTrack(*swim(**changed)))
    weights = np.ones(trial.track.positions.shape[:2])
    weights[seen if seen is not None else len(weights) :, 0] = 0
    with pytest.raises(TrialError, match=f"trial 'pool': {says}"):
        steady_target(trial, weights, FREQUENCY, whole_motion=True)
    assert steady_target(trial, weights, FREQUENCY).head is None
