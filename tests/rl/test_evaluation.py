"""Rollouts, what they are measured by, open and closed loop, and the files and films made of them."""

import math

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from swim2real.errors import ArgumentError, RunError
from swim2real.rl.assessment import assess, policy_commands, write_episodes
from swim2real.rl.disturbances import Disturbances, StateEstimate
from swim2real.rl.drift import compare_loops
from swim2real.rl.evaluation import figures, scan_constant_speeds
from swim2real.rl.motor import REAL_MOTOR
from swim2real.rl.policy import ConstantSpeed, Recorded, Trained
from swim2real.rl.rollout import roll, some_environments
from swim2real.rl.training import train
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings

PUBLISHED = FISH.space.published
CHANGE = 2.0  # rad/s, by an action of 1
ANY_PHASE = Disturbances(start_phase=(-math.pi, math.pi))


@pytest.fixture(scope="module")
def steady():
    """Half a second at two speeds."""
    environments = some_environments("forward", [PUBLISHED], 2, robot=FISH, seconds=0.5)
    return roll(environments, ConstantSpeed([3.0, 7.0], CHANGE), [0, 1])


def test_a_constant_speed_is_reached_as_fast_as_is_allowed_and_kept(steady):
    slow, fast = steady
    assert slow.commands[:3] == pytest.approx([2.0, 3.0, 3.0])
    assert fast.commands[:5] == pytest.approx([2.0, 4.0, 6.0, 7.0, 7.0])
    assert slow.duration == pytest.approx(0.5)
    assert slow.markers.shape == (25, 11, 2)
    assert fast.distance == pytest.approx(-fast.heads[-1, 0])
    assert fast.episode_return == pytest.approx(-fast.heads[1:, 0].sum())


def test_recorded_actions_repeat_a_swim_to_the_last_bit(steady):
    environments = some_environments("forward", [PUBLISHED], 2, robot=FISH, seconds=0.5)
    again = roll(environments, Recorded(np.stack([one.actions for one in steady], axis=1)), [0, 1])
    for one, other in zip(steady, again, strict=True):
        assert np.array_equal(one.heads, other.heads)
        assert np.array_equal(one.markers, other.markers)


def test_figures_of_episodes(steady):
    found = figures(steady)
    assert found["distance"] == pytest.approx(np.mean([one.distance for one in steady]))
    assert found["episodes"] == 2
    assert found["success"] == 0
    assert found["time_to_target"] is None


def test_the_scan_finds_the_fastest_constant_speed():
    scan = scan_constant_speeds(PUBLISHED, FISH, [0.0], 1.0, count=2)
    assert scan.speeds == pytest.approx(REAL_MOTOR.speed * np.array([-1, -0.5, 0.5, 1]))
    assert abs(scan.speeds[scan.farthest]) == pytest.approx(REAL_MOTOR.speed)
    assert scan.as_dict()["best_distance"] == scan.distances.max()


def test_a_disturbed_swim_drifts_in_open_loop_and_an_undisturbed_one_does_not():
    driver, estimate = ConstantSpeed([6.0, 6.0], CHANGE), StateEstimate()
    found, episodes = compare_loops(driver, "forward", PUBLISHED, FISH, [0, 1], Disturbances(), estimate, seconds=0.6)
    assert [found[name]["drift"] for name in ("nominal", "open", "closed")] == [0, 0, 0]
    assert set(episodes) == {"nominal", "open", "closed", "tracked"}
    current = Disturbances(current=(0.0, 0.1))
    found, _ = compare_loops(driver, "forward", PUBLISHED, FISH, [0, 1], current, estimate, seconds=0.6)
    assert found["open"]["drift"] > 0.001
    assert found["open"]["drift"] == found["closed"]["drift"]  # a constant speed doesn't look


def test_loops_are_compared_in_the_stage_that_is_asked_for():
    driver = ConstantSpeed([0.0], CHANGE)
    for stage, farthest in ((1, 1.2), (3, 4.0)):
        _, episodes = compare_loops(
            driver, "target", PUBLISHED, FISH, [2], Disturbances(), StateEstimate(), seconds=0.1, stage=stage
        )
        assert np.linalg.norm(episodes["open"][0].goal) <= farthest
    assert np.linalg.norm(episodes["open"][0].goal) > 1.2


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A policy that has learned for a moment."""
    out = tmp_path_factory.mktemp("policy") / "run"
    settings = TrainingSettings("forward", 600, exploration=200, updates=1, batch=32, layers=(16,))
    train(settings, [PUBLISHED], FISH, out)
    return out


def test_a_policy_is_assessed_the_same_way_every_time(run, tmp_path):
    first = assess(run, FISH, 2, disturbances=ANY_PHASE, scanned=1)
    again = assess(run, FISH, 2, disturbances=ANY_PHASE, scanned=1)
    assert first.content == again.content
    assert len({one.heads[-1].tobytes() for one in first.episodes}) == 2  # two phases
    write_episodes(tmp_path / "episodes.npz", first.episodes)
    with np.load(tmp_path / "episodes.npz") as kept:
        assert np.array_equal(kept["commands"][1], first.episodes[1].commands)
        assert kept["heads"].shape == (2, 101, 2)
        assert np.isnan(kept["goals"]).all()


def test_commands_are_those_of_the_policy_in_its_simulator(run):
    commands = policy_commands(run, FISH, 3.0)
    assert commands.shape == (150,)
    assert np.abs(np.diff(commands, prepend=0.0)).max() <= CHANGE + 1e-9
    assert np.abs(commands).max() <= REAL_MOTOR.speed + 1e-9
    environments = some_environments("forward", [PUBLISHED], 1, robot=FISH, seconds=3.0)
    assert np.array_equal(roll(environments, Trained(run), [5])[0].commands, commands)


def test_what_is_not_there_is_named(run, tmp_path):
    with pytest.raises(RunError, match=r"is no training run: it has no settings\.json; `swim2real train` makes one"):
        Trained(tmp_path)
    (tmp_path / "settings.json").write_text('{"task": "forward"}')
    with pytest.raises(RunError, match=r"has no best.zip yet; wait for its first checkpoint"):
        Trained(tmp_path)
    with pytest.raises(ArgumentError, match="a goal is for policies of task target"):
        policy_commands(run, FISH, 1.0, goal=(-1.0, 0.0))
    with pytest.raises(ArgumentError, match="0 episodes are asked for"):
        assess(run, FISH, 0)


def test_a_film_shows_the_robot_and_its_goal(tmp_path):
    pytest.importorskip("av")
    from swim2real.rl.film import write_film
    from swim2real.video import VideoReader

    environments = some_environments("target", [PUBLISHED], 1, robot=FISH, seconds=0.4)
    episode = roll(environments, ConstantSpeed([7.0], CHANGE), [3], [{"goal": (-0.5, 0.2)}])[0]
    path = write_film(tmp_path / "swim.mp4", episode, 320, threshold=0.05)
    with VideoReader(path) as reader:
        pictures = [frame.image for frame in reader]
    assert len(pictures) == 10
    last = pictures[-1].astype(int)
    assert ((last[..., 2] > last[..., 0] + 60) & (last[..., 2] > 120)).sum() > 100  # blue: the robot
    assert ((last[..., 0] > last[..., 2] + 80) & (last[..., 0] > 150)).sum() > 10  # red: the goal
