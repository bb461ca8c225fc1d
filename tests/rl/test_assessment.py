"""Rollouts, what they are measured by, open and closed loop, and the files and films made of them."""

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from swim2real.objective.expected_run import motion_of
from swim2real.rl.assessment import Wave, assess, compare_loops, policy_commands, scan_waves
from swim2real.rl.body import Actuators
from swim2real.rl.conditions import Disturbances, StateEstimate
from swim2real.rl.environment import make_environments
from swim2real.rl.rollout import EpisodeStatistics, expect, followed, load_policy, repeated, run_episodes, save_episodes
from swim2real.rl.training import train
from swim2real.rl.training_run import TrainingRun
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings
from swimbase.errors import ArgumentError, RunError

EXAMPLES = Path(__file__).parents[2] / "examples"
PUBLISHED = FISH.space.published
CHANGE = 2.0  # rad/s, by an action of 1
MOTOR = Actuators.of(FISH.policy.actuators)
ANY_PHASE = Disturbances(start_phase=(-math.pi, math.pi))


def constant(*speeds):
    return followed(np.array(speeds)[:, None], MOTOR)


@pytest.fixture(scope="module")
def steady():
    """Half a second at two speeds."""
    environments = make_environments("forward", [PUBLISHED], 2, seconds=0.5)
    return run_episodes(environments, constant(3.0, 7.0), [0, 1])


def test_a_constant_speed_is_reached_as_fast_as_is_allowed_and_kept(steady):
    slow, fast = steady
    assert slow.commands[:3, 0] == pytest.approx([2.0, 3.0, 3.0])
    assert fast.commands[:5, 0] == pytest.approx([2.0, 4.0, 6.0, 7.0, 7.0])
    assert slow.duration == pytest.approx(0.5)
    assert slow.markers.shape == (25, 11, 2)
    assert fast.distance == pytest.approx(-fast.heads[-1, 0])
    statistics = EpisodeStatistics.of(steady)
    assert statistics.distance == pytest.approx((slow.distance + fast.distance) / 2)
    assert (statistics.episodes, statistics.success, statistics.time_to_target) == (2, 0, None)
    assert fast.episode_return == pytest.approx(-fast.heads[1:, 0].sum())


def test_recorded_actions_repeat_a_swim_to_the_last_bit(steady):
    environments = make_environments("forward", [PUBLISHED], 2, seconds=0.5)
    again = run_episodes(environments, repeated([episode.actions for episode in steady]), [0, 1])
    for episode, other in zip(steady, again, strict=True):
        assert np.array_equal(episode.heads, other.heads)
        assert np.array_equal(episode.markers, other.markers)


def test_the_scan_finds_the_best_wave_and_a_sine_swings_about_the_middle_of_the_range():
    waves = [Wave(-1.0), Wave(0.5), Wave(1.0), Wave(1.0, frequency=2.0)]
    scan = scan_waves(waves, "forward", PUBLISHED, FISH, [0.0], 0.6)
    assert scan.distances[2] > scan.distances[1]
    assert scan.best_distance == scan.distances.max()
    assert scan.farthest is waves[int(scan.distances.argmax())]
    wave = Wave(0.5, frequency=1.0, lag=np.pi / 2)
    two = Actuators(("a", "b"), ("m", "m"), np.array([0.0, -1.0]), np.array([2.0, 1.0]), np.array([1.0, 1.0]))
    np.testing.assert_allclose(wave.commands(two, np.array([0.0, 0.25])), [[1.0, -0.5], [1.5, 0.0]], atol=1e-12)
    np.testing.assert_allclose(Wave(-1.0).commands(two, np.zeros(1)), [[0.0, -1.0]])


def test_a_disturbed_swim_drifts_in_open_loop_and_an_undisturbed_one_does_not():
    policy, estimate = constant(6.0), StateEstimate()
    loops = compare_loops(policy, "forward", PUBLISHED, FISH, [0], Disturbances(), estimate, seconds=0.2)
    assert list(loops) == ["nominal", "open", "closed", "tracked"]
    assert [loops[name].drift for name in ("nominal", "open", "closed")] == [0, 0, 0]
    current = Disturbances(current=(0.0, 0.1))
    loops = compare_loops(policy, "forward", PUBLISHED, FISH, [0], current, estimate, seconds=0.4)
    assert loops["open"].drift > 0.001
    assert loops["open"].drift == loops["closed"].drift  # a constant speed doesn't look


def test_loops_are_compared_in_the_stage_that_is_asked_for():
    alike = (constant(0.0), "target", PUBLISHED, FISH, [2], Disturbances(), StateEstimate())
    near, far = (compare_loops(*alike, seconds=0.04, stage=stage)["open"].episodes[0].goal for stage in (1, 3))
    assert np.linalg.norm(near) < 1.2 < np.linalg.norm(far) < 4.0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A policy that has learned for a moment."""
    out = tmp_path_factory.mktemp("policy") / "run"
    settings = TrainingSettings("forward", 400, exploration=200, updates=1, batch=32, layers=(16,), environments=8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
        train(settings, [PUBLISHED], FISH, out)
    return TrainingRun.open(out)


@pytest.mark.slow
def test_a_policy_is_assessed_the_same_way_every_time(run, tmp_path, monkeypatch):
    monkeypatch.setattr("swim2real.rl.assessment.SCANNED_PHASES", 1)
    monkeypatch.setattr("swim2real.rl.assessment.constant_waves", lambda: [Wave(1.0)])
    monkeypatch.setattr("swim2real.rl.assessment.sine_waves", lambda actuators: [Wave(1.0, 2.0)])
    first = assess(run, 2, disturbances=ANY_PHASE)
    again = assess(run, 2, disturbances=ANY_PHASE)
    assert first.as_dict() == again.as_dict()
    assert len({episode.heads[-1].tobytes() for episode in first.episodes}) == 2  # two phases
    save_episodes(tmp_path / "episodes.npz", first.episodes)
    with np.load(tmp_path / "episodes.npz") as kept:
        assert np.array_equal(kept["commands"][1], first.episodes[1].commands)
        assert kept["heads"].shape == (2, 101, 2)
        assert np.isnan(kept["goals"]).all()


def test_a_policy_swims_in_another_robot_that_it_fits_and_in_no_other(run, monkeypatch):
    monkeypatch.setattr("swim2real.rl.assessment._scans", lambda *given: {})
    rolling, snake = load_robot("fish-rolling"), load_robot(EXAMPLES / "snake/snake.toml")
    episode = assess(run, 1, parameters=[rolling.space.published], robot=rolling).episodes[0]
    assert episode.markers.shape == (100, 11, 2)
    assert np.abs(episode.rolls).max() > 0.02 > np.abs(assess(run, 1).episodes[0].rolls).max()
    says = r"doesn't fit robot 'snake': markers, .* differ; it observes markers, .* commands motor, the robot has posi"
    with pytest.raises(RunError, match=says):
        assess(run, 1, parameters=[snake.space.published], robot=snake, disturbances=Disturbances())


def test_commands_are_those_of_the_policy_in_its_simulator(run):
    actuators, episode = policy_commands(run, 0.6)
    commands = episode.commands
    assert (actuators.names, actuators.units) == (("motor",), ("rad/s",))
    assert commands.shape == (30, 1)
    assert np.abs(np.diff(commands[:, 0], prepend=0.0)).max() <= CHANGE + 1e-9
    assert np.abs(commands).max() <= MOTOR.upper[0] + 1e-9
    environments = make_environments("forward", [PUBLISHED], 1, seconds=0.6)
    assert np.array_equal(run_episodes(environments, load_policy(run), [5])[0].commands, commands)


def test_what_commands_are_expected_to_do_is_what_they_do_with_every_set(run):
    _, episode = policy_commands(run, 0.6)
    longer_arm = {**PUBLISHED, "motor_arm_length": 0.05}
    expected = expect(run, episode, 0.0, [longer_arm])
    assert (expected.sets, expected.seconds, expected.frame, expected.roll) == (2, 0.6, ("M0", "M1"), None)
    told = np.column_stack([expected.x.expected, expected.y.expected])
    np.testing.assert_allclose(told, episode.heads, atol=1e-3)  # by the markers, which roll and pitch move a little
    environments = make_environments("forward", [longer_arm], 1, seconds=0.6)
    other = run_episodes(environments, repeated([episode.actions]), [0])[0]
    each = [motion_of(swim.markers, (0, 1), np.array(expected.origin))[0][:, 0] for swim in (episode, other)]
    np.testing.assert_allclose(expected.x.expected[1:], each[0], atol=1e-6)
    np.testing.assert_allclose(expected.x.low[1:], np.min(each, axis=0), atol=1e-6)
    np.testing.assert_allclose(expected.x.high[1:], np.max(each, axis=0), atol=1e-6)
    assert np.abs(each[0] - each[1]).max() > 1e-4
    assert expected.sentence.startswith(f"{-each[0][-1]:.3f} m forward (")


def test_what_is_not_there_is_named(run, tmp_path):
    def opened(old="", new=""):
        (tmp_path / "settings.json").write_text((run.folder / "settings.json").read_text().replace(old, new))
        return TrainingRun.open(tmp_path)

    for error, said, call in (
        (RunError, r"no settings\.json; `swim2real train`", lambda: TrainingRun.open(tmp_path)),
        (RunError, "friction is 2", lambda: opened('"tendon_friction": 0.0', '"tendon_friction": 2.0')),
        (RunError, "no robot 'eel'", lambda: opened('"robot": "fish"', '"robot": "eel"').robot),
        (RunError, r"no best\.npz yet", lambda: load_policy(opened())),
        (ArgumentError, "goal is -300, 0 m", lambda: policy_commands(run, 1.0, goal=(-300.0, 0.0))),
        (ArgumentError, "a task with goals", lambda: policy_commands(run, 1.0, goal=(-1.0, 0.0))),
        (ArgumentError, "an episode of 0 s", lambda: policy_commands(run, 0.0)),
        (ArgumentError, "0 episodes", lambda: assess(run, 0)),
    ):
        with pytest.raises(error, match=said):
            call()


def test_a_film_shows_the_robot_and_its_goal(tmp_path):
    pytest.importorskip("av")
    from markertrack.video import VideoReader
    from swim2real.rl.film import Scene, write_film

    environments = make_environments("target", [PUBLISHED], 1, seconds=0.4)
    episode = run_episodes(environments, constant(7.0), [3], [{"goal": (-0.5, 0.2)}])[0]
    path = write_film(tmp_path / "swim.mp4", [Scene("", episode, FISH)], 320, threshold=0.05)
    four = write_film(tmp_path / "four.mp4", [Scene(name, episode, FISH) for name in "abcd"], 640)
    with VideoReader(four) as reader:
        beside = next(iter(reader)).image
    with VideoReader(path) as reader:
        pictures = [frame.image for frame in reader]
    assert len(pictures) == 10
    last = pictures[-1].astype(int)
    assert ((last[..., 2] > last[..., 0] + 60) & (last[..., 2] > 120)).sum() > 100  # blue: the robot
    assert ((last[..., 0] > last[..., 2] + 80) & (last[..., 0] > 150)).sum() > 10  # red: the goal
    assert beside.shape[1] == 640
    assert beside.shape[0] == 2 * pictures[0].shape[0]  # two rows of panels as large as the one
