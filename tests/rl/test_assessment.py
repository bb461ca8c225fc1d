"""Rollouts, what they are measured by, open and closed loop, and the files and films made of them."""

import math

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from swim2real.errors import ArgumentError, RunError
from swim2real.rl.assessment import assess, compare_loops, policy_commands, scan_constant_speeds
from swim2real.rl.conditions import REAL_MOTOR, Disturbances, StateEstimate
from swim2real.rl.environment import make_environments
from swim2real.rl.policies import ConstantSpeed, RecordedActions, load_policy
from swim2real.rl.rollout import EpisodeStatistics, run_episodes, save_episodes
from swim2real.rl.training import train
from swim2real.rl.training_run import TrainingRun
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings

PUBLISHED = FISH.space.published
CHANGE = 2.0  # rad/s, by an action of 1
ANY_PHASE = Disturbances(start_phase=(-math.pi, math.pi))


@pytest.fixture(scope="module")
def steady():
    """Half a second at two speeds."""
    environments = make_environments("forward", [PUBLISHED], 2, seconds=0.5)
    return run_episodes(environments, ConstantSpeed([3.0, 7.0], CHANGE), [0, 1])


def test_a_constant_speed_is_reached_as_fast_as_is_allowed_and_kept(steady):
    slow, fast = steady
    assert slow.commands[:3] == pytest.approx([2.0, 3.0, 3.0])
    assert fast.commands[:5] == pytest.approx([2.0, 4.0, 6.0, 7.0, 7.0])
    assert slow.duration == pytest.approx(0.5)
    assert slow.markers.shape == (25, 11, 2)
    assert fast.distance == pytest.approx(-fast.heads[-1, 0])
    assert fast.episode_return == pytest.approx(-fast.heads[1:, 0].sum())


def test_recorded_actions_repeat_a_swim_to_the_last_bit(steady):
    environments = make_environments("forward", [PUBLISHED], 2, seconds=0.5)
    again = run_episodes(environments, RecordedActions([episode.actions for episode in steady]), [0, 1])
    for episode, repeated in zip(steady, again, strict=True):
        assert np.array_equal(episode.heads, repeated.heads)
        assert np.array_equal(episode.markers, repeated.markers)


def test_figures_of_episodes(steady):
    statistics = EpisodeStatistics.of(steady)
    assert statistics.distance == pytest.approx(np.mean([episode.distance for episode in steady]))
    assert statistics.episodes == 2
    assert statistics.success == 0
    assert statistics.time_to_target is None


def test_the_scan_finds_the_fastest_constant_speed():
    scan = scan_constant_speeds(PUBLISHED, FISH, [0.0], 0.6, count=2)
    assert scan.speeds == pytest.approx(REAL_MOTOR.speed * np.array([-1, -0.5, 0.5, 1]))
    assert abs(scan.speeds[scan.farthest]) == pytest.approx(REAL_MOTOR.speed)
    assert scan.best_distance == scan.distances.max()


def test_a_disturbed_swim_drifts_in_open_loop_and_an_undisturbed_one_does_not():
    policy, estimate = ConstantSpeed([6.0], CHANGE), StateEstimate()
    loops = compare_loops(policy, "forward", PUBLISHED, FISH, [0], Disturbances(), estimate, seconds=0.2)
    assert list(loops) == ["nominal", "open", "closed", "tracked"]
    assert [loops[name].drift for name in ("nominal", "open", "closed")] == [0, 0, 0]
    current = Disturbances(current=(0.0, 0.1))
    loops = compare_loops(policy, "forward", PUBLISHED, FISH, [0], current, estimate, seconds=0.4)
    assert loops["open"].drift > 0.001
    assert loops["open"].drift == loops["closed"].drift  # a constant speed doesn't look


def test_loops_are_compared_in_the_stage_that_is_asked_for():
    policy = ConstantSpeed([0.0], CHANGE)
    for stage, farthest in ((1, 1.2), (3, 4.0)):
        loops = compare_loops(
            policy, "target", PUBLISHED, FISH, [2], Disturbances(), StateEstimate(), seconds=0.04, stage=stage
        )
        goal = loops["open"].episodes[0].goal
        assert np.linalg.norm(goal) <= farthest
    assert np.linalg.norm(goal) > 1.2


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A policy that has learned for a moment."""
    out = tmp_path_factory.mktemp("policy") / "run"
    settings = TrainingSettings("forward", 400, exploration=200, updates=1, batch=32, layers=(16,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
        train(settings, [PUBLISHED], FISH, out)
    return TrainingRun.open(out)


def test_a_policy_is_assessed_the_same_way_every_time(run, tmp_path, monkeypatch):
    monkeypatch.setattr("swim2real.rl.assessment.SCANNED_PHASES", 1)
    monkeypatch.setattr("swim2real.rl.assessment.SCANNED_SPEEDS", 1)
    first = assess(run, 2, disturbances=ANY_PHASE)
    again = assess(run, 2, disturbances=ANY_PHASE)
    assert first.as_dict() == again.as_dict()
    assert len({episode.heads[-1].tobytes() for episode in first.episodes}) == 2  # two phases
    save_episodes(tmp_path / "episodes.npz", first.episodes)
    with np.load(tmp_path / "episodes.npz") as kept:
        assert np.array_equal(kept["commands"][1], first.episodes[1].commands)
        assert kept["heads"].shape == (2, 101, 2)
        assert np.isnan(kept["goals"]).all()


def test_commands_are_those_of_the_policy_in_its_simulator(run):
    commands = policy_commands(run, 0.6)
    assert commands.shape == (30,)
    assert np.abs(np.diff(commands, prepend=0.0)).max() <= CHANGE + 1e-9
    assert np.abs(commands).max() <= REAL_MOTOR.speed + 1e-9
    environments = make_environments("forward", [PUBLISHED], 1, seconds=0.6)
    assert np.array_equal(run_episodes(environments, load_policy(run), [5])[0].commands, commands)


def test_what_is_not_there_is_named(run, tmp_path):
    with pytest.raises(RunError, match=r"is no training run: it has no settings\.json; `swim2real train` makes one"):
        TrainingRun.open(tmp_path)
    (tmp_path / "settings.json").write_text('{"task": "forward"}')
    with pytest.raises(RunError, match=r"settings\.json': 'robot' is missing"):
        TrainingRun.open(tmp_path)
    settings = (run.folder / "settings.json").read_text()
    (tmp_path / "settings.json").write_text(settings.replace('"tendon_friction": 0.0', '"tendon_friction": 2.0'))
    with pytest.raises(RunError, match="the tendon friction is 2"):
        TrainingRun.open(tmp_path)
    (tmp_path / "settings.json").write_text(settings.replace('"robot": "fish"', '"robot": "eel"'))
    with pytest.raises(RunError, match="there is no robot 'eel'"):
        _ = TrainingRun.open(tmp_path).robot
    with pytest.raises(RunError, match=r"has no best\.zip yet; wait for its first checkpoint"):
        load_policy(TrainingRun.open(tmp_path))
    (tmp_path / "best.zip").write_bytes(b"no policy")
    with pytest.raises(RunError, match=r"policy '.*best\.zip' is damaged"):
        load_policy(TrainingRun.open(tmp_path))
    with pytest.raises(ArgumentError, match="a goal is for policies of task target"):
        policy_commands(run, 1.0, goal=(-1.0, 0.0))
    with pytest.raises(ArgumentError, match=r"0 s of commands are asked for; it must be at least 0\.02 s"):
        policy_commands(run, 0.0)
    with pytest.raises(ArgumentError, match="0 episodes are asked for"):
        assess(run, 0)


def test_a_film_shows_the_robot_and_its_goal(tmp_path):
    pytest.importorskip("av")
    from swim2real.rl.film import write_film
    from swim2real.video import VideoReader

    environments = make_environments("target", [PUBLISHED], 1, seconds=0.4)
    episode = run_episodes(environments, ConstantSpeed([7.0], CHANGE), [3], [{"goal": (-0.5, 0.2)}])[0]
    path = write_film(tmp_path / "swim.mp4", episode, 320, threshold=0.05)
    with VideoReader(path) as reader:
        pictures = [frame.image for frame in reader]
    assert len(pictures) == 10
    last = pictures[-1].astype(int)
    assert ((last[..., 2] > last[..., 0] + 60) & (last[..., 2] > 120)).sum() > 100  # blue: the robot
    assert ((last[..., 0] > last[..., 2] + 80) & (last[..., 0] > 150)).sum() > 10  # red: the goal
