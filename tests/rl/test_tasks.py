"""What the tasks show and reward, against independent reckoning from the engine's state."""

import mujoco
import numpy as np
import pytest

import swim2real.rl as rl
from swim2real.rl.tasks import STAGES, PaperReachGoal, ReachGoal
from swim2real.robots.fish import FISH

MARKERS = (*FISH.marker_names, "left_fin_tip", "right_fin_tip")


def wiggled(task, **options):
    """An environment after some steps, and the last step's return."""
    env, rng = rl.make_env(task), np.random.default_rng(3)
    env.reset(seed=4, options=options)
    for _ in range(40):
        out = env.step(rng.uniform(0, 1, 1) if rng.random() < 0.7 else -np.ones(1))
    data = env.environments.robots.batch.data(0)
    return env, out, data.qpos.copy(), data.qvel.copy()


def sites(qpos, qvel):
    """Markers' places and speeds by the engine, from a model of its own; speeds by a small step."""
    model = FISH.build(FISH.space.published).compile()
    places = []
    for h in (-1e-6, 0.0, 1e-6):
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_integratePos(model, data.qpos, qvel, h)
        mujoco.mj_kinematics(model, data)
        places.append(np.array([data.site(name).xpos[:2] for name in MARKERS]))
    return places[1] - model.jnt_pos[0][:2], (places[2] - places[0]) / 2e-6


@pytest.mark.parametrize(("task", "length"), [("forward", 52), ("target", 22), ("paper-target", 22)])
def test_an_observation_is_as_long_as_the_papers(task, length):
    environments = rl.make_environments(task, None, 1)
    covered = [i for part in environments.names.values() for i in range(part.start, part.stop)]
    assert covered == list(range(len(environments.bounds))) == list(range(length))


def test_forward_shows_markers_head_and_motor():
    env, (seen, reward, *_, info), qpos, qvel = wiggled("forward")
    part = {name: seen[where] for name, where in env.environments.names.items()}
    places, speeds = sites(qpos, qvel)
    np.testing.assert_allclose(part["markers"].reshape(11, 2), places, atol=1e-6)
    np.testing.assert_allclose(part["marker_velocities"].reshape(11, 2), speeds, atol=1e-5)
    np.testing.assert_allclose(part["position"], qpos[:2], atol=1e-6)
    np.testing.assert_allclose(part["velocity"], qvel[:2], atol=1e-6)
    assert part["heading"] == pytest.approx(qpos[5], abs=1e-3)  # roll and pitch turn the markers' direction a little
    assert part["heading_rate"] == pytest.approx(qvel[5], rel=1e-2)
    assert part["motor_speeds"] == pytest.approx(qvel[6], rel=1e-5)
    assert np.exp(1j * part["motor_angles"]) == pytest.approx(np.exp(1j * qpos[6]), abs=1e-5)
    assert abs(part["motor_angles"]) <= np.pi
    assert reward == pytest.approx(-qpos[0])
    assert info["heading"] == pytest.approx(qpos[5], abs=1e-3)


def test_target_shows_the_goal_from_the_robot():
    env, (seen, *_, info), qpos, qvel = wiggled("target", goal=(-0.8, 0.6))
    part = {name: seen[where] for name, where in env.environments.names.items()}
    to_goal, heading = np.array([-0.8, 0.6]) - qpos[:2], info["heading"]
    c, s = np.cos(heading), np.sin(heading)
    from_world = np.array([[c, s], [-s, c]])
    assert abs(heading) > 0.02  # so that the frames differ
    np.testing.assert_allclose(part["goal"], from_world @ to_goal, atol=1e-6)
    np.testing.assert_allclose(part["goal_rate"], from_world @ -qvel[:2], atol=1e-6)
    np.testing.assert_allclose(part["goal_distance"], np.linalg.norm(to_goal), atol=1e-6)
    np.testing.assert_allclose(part["motor_directions"], [np.cos(qpos[6]), np.sin(qpos[6])], 1e-5)
    np.testing.assert_allclose(part["motor_speeds"], qvel[6], rtol=1e-5)
    np.testing.assert_allclose(part["turning"], qvel[3:6], rtol=1e-2, atol=1e-2)
    np.testing.assert_allclose(part["joint_angles"], qpos[7:], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(part["joint_rates"], qvel[7:], rtol=1e-5, atol=1e-7)
    assert -1 <= part["previous_actions"] <= 1
    assert info["goal"] == (-0.8, 0.6)
    assert info["goal_distance"] == pytest.approx(np.linalg.norm(to_goal))


@pytest.mark.parametrize(("task", "turn"), [("target", 0.0), ("target", 0.2), ("paper-target", 0.0)])
def test_reaching_the_goal_ends_the_episode_with_the_bonus(task, turn):
    env = rl.make_env(task)
    env.environments.task.turn_reward = turn
    seen, _ = env.reset(seed=0, options={"goal": (-0.06, 0.0)})
    rewards, goals = [], [seen[18:20]]
    for _ in range(200):
        seen, reward, ended, cut, info = env.step(np.array([1.0]))
        rewards.append(reward)
        goals.append(seen[18:20])
        if ended:
            break
    assert (ended, cut, info["success"]) == (True, False, True)
    assert info["goal_distance"] < STAGES[3].threshold
    x, y = np.array(goals, float).T  # x backward
    left, angles = np.hypot(x, y), np.abs(np.arctan2(y, -x))
    if task == "target":
        expected = -100 * np.diff(left + turn * angles) - 0.02
        expected[-1] += 20
        assert rewards == pytest.approx(expected, abs=1e-4)  # observations are float32
        assert np.ptp(angles) > 0.1
    else:  # the paper's reward, Sec. IV
        assert rewards == pytest.approx([*(-left[1:-1] - 0.5), 300.0 - 0.5 - left[-1]])


@pytest.mark.parametrize("number", STAGES)
@pytest.mark.parametrize("kind", [ReachGoal, PaperReachGoal])
def test_goals_fill_the_region_of_the_stage(number, kind):
    task, stage, rng = kind(FISH, 400, stage=number), STAGES[number], np.random.default_rng(0)
    for i in range(400):
        assert task.begin(i, rng, {}) == stage.seconds
    x, y = task.goals.T
    assert -stage.ahead <= x.min() < -0.97 * stage.ahead
    assert -0.03 * stage.ahead < x.max() <= 0
    assert stage.across / 2 * 0.97 < np.abs(y).max() <= stage.across / 2
    assert np.hypot(x, y).min() > 2 * stage.threshold


def test_near_goals_are_mixed_into_later_stages_and_count_as_earlier_ones():
    task, rng = ReachGoal(FISH, 400, stage=3), np.random.default_rng(0)
    task.near_goals = 0.4
    seconds = [task.begin(i, rng, {}) for i in range(400)]
    near = task.episode_stages < 3
    assert near.mean() == pytest.approx(0.4, abs=0.07)
    assert {1, 2, 3} == set(task.episode_stages)
    assert (task.thresholds == STAGES[3].threshold).all()
    for goal, stage, length in zip(task.goals, task.episode_stages, seconds, strict=True):
        assert -goal[0] <= STAGES[stage].ahead
        assert length == STAGES[stage].seconds
    task.stage = 1
    assert {task.begin(i, rng, {}) for i in range(50)} == {STAGES[1].seconds}


def test_a_new_stage_counts_from_the_next_episode_on():
    env = rl.make_env("target", stage=1)
    env.reset(seed=0, options={"goal": (-1.0, 0.0)})
    env.environments.set_stage(3)
    info, task = env.step(np.zeros(1))[4], env.environments.task
    assert (info["stage"], task.thresholds[0]) == (1, 0.10)
    _, info = env.reset()
    assert (info["stage"], task.thresholds[0]) == (3, 0.05)
