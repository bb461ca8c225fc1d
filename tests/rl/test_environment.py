"""Environments: spaces, starts, ends, commands, divergence, what is registered."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_as_gymnasium
from stable_baselines3.common.env_checker import check_env as check_as_sb3

import swim2real.rl as rl
from swim2real.rl.body import Bodies
from swim2real.robots.fish import FISH, FISH_EXTENDED
from swimbase.errors import ArgumentError, ParameterError

PUBLISHED = FISH.space.published
GO = np.array([1.0], np.float32)
SPEED = 7.29  # rad/s, the motor's limit


def swim(env, steps, action=GO):
    for _ in range(steps):
        out = env.step(action)
    return out


def engine_data(env, index=0):
    """The state of the engine of one robot, to be disturbed."""
    return (env.environments if isinstance(env, rl.RobotEnv) else env).robots.batch.data(index)


@pytest.mark.parametrize("name", ["Forward", "Target"])
def test_registered_and_as_both_libraries_want_them(name):
    env = gymnasium.make(f"swim2real/{name}-v0")
    rough = rl.Disturbances((0.0, 6.3), (0.02, -0.05), 0.5, rl.StateEstimate())
    for one in (env.unwrapped, rl.make_env(name.lower(), disturbances=rough, seed=1)):
        check_as_gymnasium(one, skip_render_check=True)
        check_as_sb3(one)


def test_an_action_is_a_rate_that_becomes_a_limited_command():
    env = rl.make_env("forward")
    env.reset(seed=0)
    commands = [env.step(GO)[4]["commands"] for _ in range(6)]
    assert np.ravel(commands) == pytest.approx([2.0, 4.0, 6.0, *[SPEED] * 3])
    assert env.step(np.array([-0.5]))[4]["commands"] == pytest.approx([SPEED - 1.0])
    assert env.step(np.array([-7.0]))[4]["commands"] == pytest.approx([SPEED - 3.0])  # cut off at -1
    info = swim(env, 12, -GO)[4]
    assert info["commands"] == (-SPEED,)
    assert engine_data(env).qvel[6] == pytest.approx(-SPEED, abs=0.05)  # the motor follows


@pytest.mark.parametrize("robot", [FISH, FISH_EXTENDED])
def test_forward_ends_after_two_seconds_without_being_done(robot):
    env = rl.make_env("forward", robot=robot)
    env.reset(seed=0)
    _, reward, ended, cut, info = swim(env, 100)
    assert (ended, cut, info["time"], info["success"]) == (False, True, pytest.approx(2.0), False)
    assert reward == pytest.approx(info["distance"])
    assert info["distance"] == -info["position"][0]
    assert 0.05 < info["distance"] < 0.5  # it swims forward
    with pytest.raises(ArgumentError, match="no episode is on: call reset before step"):
        env.step(GO)


def test_nothing_is_drawn_but_from_the_seed():
    envs = [rl.make_env("target", seed=5), rl.make_env("target")]
    first = [envs[0].reset()[0], envs[1].reset(seed=5)[0]]
    np.testing.assert_array_equal(*first)
    np.testing.assert_array_equal(swim(envs[0], 20)[0], swim(envs[1], 20)[0])
    np.testing.assert_array_equal(envs[0].reset()[0], envs[1].reset()[0])
    assert (envs[0].reset()[0] != first[0]).any()


@pytest.mark.parametrize("broken", [np.nan, 1e6])
@pytest.mark.parametrize("task", ["forward", "target"])
def test_a_divergence_ends_the_episode_with_a_sentence_and_finite_numbers(task, broken):
    env = rl.make_env(task)
    env.reset(seed=0)
    good = swim(env, 3)
    engine_data(env).qvel[8] = broken
    seen, reward, ended, cut, info = env.step(GO)
    assert (reward, ended, cut, info["success"]) == (rl.DIVERGED, True, False, False)
    assert info["diverged"] == "the simulation diverged 0.08 s after the start, commanded 7.29 rad/s"
    np.testing.assert_array_equal(seen, good[0])
    with pytest.raises(ArgumentError, match="no episode is on"):
        env.step(GO)
    assert np.isfinite(env.reset()[0]).all()
    assert "diverged" not in env.step(GO)[4]


def test_an_ensemble_draws_a_set_for_every_episode():
    slow = {**PUBLISHED, "fluid_slender_drag": 9.9, "motor_arm_length": 0.02}
    env = rl.make_env("forward", [PUBLISHED, slow], seed=2)
    swum: set[float] = set()
    for _ in range(6):
        env.reset()
        swum.add(swim(env, 50)[4]["distance"])
    assert len(swum) == 2
    env.reset(options={"member": 1})
    assert swim(env, 50)[4]["distance"] == min(swum)
    with pytest.raises(ArgumentError, match="the ensemble has no member 2; there are 2, from 0 on"):
        env.reset(options={"member": 2})


@pytest.mark.parametrize(("wanted", "sentence"), [
    (lambda: rl.make_env("backward"), "no task 'backward'; there are forward, target, paper-target"),
    (lambda: rl.make_env("python:nowhere.py:Task"), "can't be imported: FileNotFou"),
    (lambda: rl.make_env("forward", []), "0 parameter sets"),
    (lambda: rl.make_env("forward", seconds=0.01), r"0\.01 s .* at least 0\.02"),
    (lambda: rl.make_env("target", stage=4), "no stage 4; this task has 1, 2, 3"),
    (lambda: rl.make_env("forward").step(GO), "call reset before step"),
    (lambda: rl.make_environments("forward", None, 0), "0 environments"),
    (lambda: rl.Disturbances((1.0, 0.0)), "phase is 1 to 0 rad"),
    (lambda: rl.Disturbances(current=(3.0, 0.0)), r"current is \(3.0, 0.0\) m/s"),
    (lambda: rl.Disturbances(tendon_friction=1.0), "friction is 1"),
    (lambda: rl.StateEstimate(noise=-1.0), "-1 m"),
    (lambda: rl.StateEstimate(delay=-1), "delay is -1"),
])  # fmt: skip
def test_what_is_not_there(wanted, sentence):
    with pytest.raises(ArgumentError, match=sentence):
        wanted()


def test_values_and_actions_are_checked():
    with pytest.raises(ParameterError, match="'motor_arm_length' in set 1 is 9, out of bounds"):
        Bodies(FISH, [PUBLISHED, {**PUBLISHED, "motor_arm_length": 9.0}])
    env = rl.make_env("forward")
    env.reset(seed=0)
    with pytest.raises(ArgumentError, match="an action is nan; it must be a number from -1 to 1"):
        env.step(np.array([np.nan]))
