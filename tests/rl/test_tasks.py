"""What the tasks show and reward, against independent reckoning from the engine's state."""

import mujoco
import numpy as np
import pytest

import swim2real.rl as rl
from swim2real.rl.tasks import STAGES, Target
from swim2real.robots.fish import FISH

MARKERS = (*FISH.marker_names, "left_fin_tip", "right_fin_tip")


def wiggled(task, **options):
    """An environment after some steps, and the last step's return."""
    env, rng = rl.make_env(task), np.random.default_rng(3)
    env.reset(seed=4, options=options)
    for _ in range(40):
        out = env.step(rng.uniform(0, 1, 1) if rng.random() < 0.7 else -np.ones(1))
    return env, out


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


@pytest.mark.parametrize("task", [rl.Forward, rl.Target])
def test_the_parts_of_an_observation_are_all_of_it(task):
    covered = [i for part in task.OBSERVATION_NAMES.values() for i in range(part.start, part.stop)]
    assert covered == list(range(len(task.bounds)))
    assert len(covered) == (52 if task is rl.Forward else 22)


def test_forward_shows_markers_head_and_motor():
    env, (seen, reward, *_, info) = wiggled("forward")
    qpos, qvel = env.swimmer.data.qpos, env.swimmer.data.qvel
    part = {name: seen[where] for name, where in rl.Forward.OBSERVATION_NAMES.items()}
    places, speeds = sites(qpos, qvel)
    np.testing.assert_allclose(part["marker_positions"].reshape(11, 2), places, atol=1e-6)
    np.testing.assert_allclose(part["marker_velocities"].reshape(11, 2), speeds, atol=1e-5)
    np.testing.assert_allclose(part["head_position"], qpos[:2], atol=1e-6)
    np.testing.assert_allclose(part["head_velocity"], qvel[:2], atol=1e-6)
    assert part["heading"] == pytest.approx(qpos[5], abs=1e-6)
    assert part["heading_rate"] == pytest.approx(qvel[5], rel=1e-5)
    assert part["motor_speed"] == pytest.approx(qvel[6], rel=1e-5)
    assert np.exp(1j * part["motor_angle"]) == pytest.approx(np.exp(1j * qpos[6]), abs=1e-5)
    assert abs(part["motor_angle"]) <= np.pi
    assert reward == pytest.approx(-qpos[0])
    assert info["heading"] == qpos[5]


def test_target_shows_the_goal_from_the_robot():
    env, (seen, reward, *_, info) = wiggled("target", goal=(-0.8, 0.6))
    qpos, qvel = env.swimmer.data.qpos, env.swimmer.data.qvel
    part = {name: seen[where] for name, where in rl.Target.OBSERVATION_NAMES.items()}
    to_goal = np.array([-0.8, 0.6]) - qpos[:2]
    c, s = np.cos(qpos[5]), np.sin(qpos[5])
    from_world = np.array([[c, s], [-s, c]])
    assert abs(qpos[5]) > 0.02  # so that the frames differ
    np.testing.assert_allclose(part["goal"], from_world @ to_goal, atol=1e-6)
    np.testing.assert_allclose(part["goal_rate"], from_world @ -qvel[:2], atol=1e-6)
    np.testing.assert_allclose(part["goal_distance"], np.linalg.norm(to_goal), atol=1e-6)
    np.testing.assert_allclose([*part["motor_cosine"], *part["motor_sine"]], [np.cos(qpos[6]), np.sin(qpos[6])], 1e-5)
    np.testing.assert_allclose(part["motor_speed"], qvel[6], rtol=1e-5)
    np.testing.assert_allclose(part["head_turning"], qvel[3:6], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(part["tail_angles"], qpos[7:], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(part["tail_rates"], qvel[7:], rtol=1e-5, atol=1e-7)
    action = float(part["previous_action"][0])
    assert reward == pytest.approx(-np.linalg.norm(to_goal) - 0.5 * abs(action), abs=1e-6)
    assert info["goal"] == (-0.8, 0.6)
    assert info["goal_distance"] == pytest.approx(np.linalg.norm(to_goal))


def test_the_goal_rate_is_how_the_goal_moves_in_the_body_when_it_does_not_turn():
    env, (before, *_) = wiggled("target", goal=(-0.8, 0.6))
    heading, place = env.swimmer.data.qpos[5], env.swimmer.data.qpos[:2].copy()
    goal, rate = (rl.Target.OBSERVATION_NAMES[name] for name in ("goal", "goal_rate"))
    env.swimmer.data.qpos[:2] += 1e-3 * env.swimmer.data.qvel[:2]
    after = np.zeros(22)
    env.task.observe(env.swimmer.read(markers=False), 0.0, after)
    assert env.swimmer.data.qpos[5] == heading
    assert (env.swimmer.data.qpos[:2] != place).any()
    np.testing.assert_allclose((after[goal] - before[goal]) / 1e-3, before[rate], atol=1e-3)


def test_reaching_the_goal_ends_the_episode_with_the_bonus():
    env = rl.make_env("target")
    env.reset(seed=0, options={"goal": (-0.06, 0.0)})
    rewards = []
    for _ in range(200):
        _, reward, ended, cut, info = env.step(np.array([1.0]))
        rewards.append(reward)
        if ended:
            break
    assert (ended, cut, info["success"]) == (True, False, True)
    assert info["goal_distance"] < STAGES[3].threshold
    assert rewards[-1] == pytest.approx(300.0 - 0.5 - info["goal_distance"])
    assert max(rewards[:-1]) < 0


@pytest.mark.parametrize(("number", "stage"), STAGES.items())
def test_goals_fill_the_region_of_the_stage(number, stage):
    task, rng = Target(number), np.random.default_rng(0)
    goals = []
    for _ in range(400):
        task.begin(rng, {})
        goals.append(task.goal.copy())
    x, y = np.array(goals).T
    assert -stage.ahead <= x.min() < -0.97 * stage.ahead
    assert -0.03 * stage.ahead < x.max() <= 0
    assert stage.across / 2 * 0.97 < np.abs(y).max() <= stage.across / 2
    assert np.hypot(x, y).min() > 2 * stage.threshold


def test_the_curriculum_is_the_papers():
    assert (STAGES[1].ahead, STAGES[1].across, STAGES[1].threshold) == (1.0, 1.0, 0.10)
    assert (STAGES[3].ahead, STAGES[3].across, STAGES[3].threshold) == (3.0, 4.0, 0.05)


def test_a_new_stage_counts_from_the_next_episode_on():
    env = rl.make_env("target", stage=1)
    env.reset(seed=0, options={"goal": (-1.0, 0.0)})
    env.set_stage(3)
    info = env.step(np.zeros(1))[4]
    assert (info["stage"], env.task.threshold, env.task.seconds) == (1, 0.10, STAGES[1].seconds)
    _, info = env.reset()
    assert (info["stage"], env.task.threshold, env.task.seconds) == (3, 0.05, STAGES[3].seconds)
