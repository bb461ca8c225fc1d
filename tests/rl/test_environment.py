"""Environments: spaces, starts, ends, motor, divergence, what is registered."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_as_gymnasium
from stable_baselines3.common.env_checker import check_env as check_as_sb3

import swim2real.rl as rl
from swim2real.errors import ArgumentError, ParameterError
from swim2real.rl.body import Bodies, Body, Swimmer
from swim2real.rl.environment import make_task
from swim2real.robots.fish import FISH, FISH_EXTENDED

PUBLISHED = FISH.space.published
GO = np.array([1.0], np.float32)
COAST = np.array([0.0], np.float32)


def swim(env, steps, action=GO):
    for _ in range(steps):
        out = env.step(action)
    return out


@pytest.mark.parametrize("name", ["Forward", "Target"])
def test_registered_and_as_both_libraries_want_them(name):
    env = gymnasium.make(f"swim2real/{name}-v0")
    check_as_gymnasium(env.unwrapped, skip_render_check=True)
    check_as_sb3(env.unwrapped)
    assert env.observation_space.shape == ({"Forward": 52, "Target": 22}[name],)
    assert env.observation_space.dtype == np.float32


@pytest.mark.parametrize("task", ["forward", "target"])
def test_disturbed_as_both_libraries_want_them(task):
    rough = rl.Disturbances((0.0, 6.3), (0.02, -0.05), 0.5, rl.StateEstimate())
    env = rl.make_env(task, disturbances=rough, seed=1)
    check_as_gymnasium(env, skip_render_check=True)
    check_as_sb3(env)


def test_an_action_is_an_acceleration_that_becomes_a_limited_speed():
    env = rl.make_env("forward")
    env.reset(seed=0)
    commands = [env.step(GO)[4]["command"] for _ in range(6)]
    assert commands == pytest.approx([2.0, 4.0, 6.0, *[rl.REAL_MOTOR.speed] * 3])
    assert rl.REAL_MOTOR.speed == pytest.approx(7.29, abs=0.005)
    assert env.step(np.array([-0.5]))[4]["command"] == pytest.approx(rl.REAL_MOTOR.speed - 1.0)
    assert env.step(np.array([-7.0]))[4]["command"] == pytest.approx(rl.REAL_MOTOR.speed - 3.0)  # cut off at -1
    swim(env, 12, -GO)
    assert env.command == -rl.REAL_MOTOR.speed
    assert env.swimmer.data.qvel[6] == pytest.approx(env.command, abs=0.05)  # the motor follows


def test_the_motor_of_the_published_simulator_is_faster():
    env = rl.make_env("forward", motor=rl.PUBLISHED_MOTOR)
    env.reset(seed=0)
    assert swim(env, 2)[4]["command"] == pytest.approx(16.0)


def test_forward_ends_after_two_seconds_without_being_done():
    env = rl.make_env("forward")
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


def test_a_recorded_table_of_commands_repeats_the_swim():
    env = rl.make_env("forward")
    env.reset(seed=0)
    rng, commands = np.random.default_rng(1), []
    for _ in range(60):
        info = env.step(rng.uniform(-1, 1, 1))[4]
        commands.append(info["command"])
    swimmer = Swimmer(Body(FISH, PUBLISHED))
    swimmer.start(0.0)
    for command in commands:
        assert swimmer.advance(command)
    np.testing.assert_array_equal(swimmer.data.qpos, env.swimmer.data.qpos)


@pytest.mark.parametrize("broken", [np.nan, 1e6])
@pytest.mark.parametrize("task", ["forward", "target"])
def test_a_divergence_ends_the_episode_with_a_sentence_and_finite_numbers(task, broken):
    env = rl.make_env(task)
    env.reset(seed=0)
    good = swim(env, 3)
    env.swimmer.data.qvel[8] = broken
    seen, reward, ended, cut, info = env.step(GO)
    assert (reward, ended, cut, info["success"]) == (rl.DIVERGED, True, False, False)
    assert info["diverged"] == "the simulation diverged 0.08 s after the start, commanded 7.29 rad/s"
    np.testing.assert_array_equal(seen, good[0])
    assert info["distance"] == good[4]["distance"]
    with pytest.raises(ArgumentError, match="no episode is on"):
        env.step(GO)
    assert np.isfinite(env.reset()[0]).all()
    assert "diverged" not in env.step(GO)[4]


def test_the_engines_own_step_swims_the_same():
    rough = rl.Disturbances(current=(0.05, -0.02), tendon_friction=0.3)
    bodies = [Body(FISH, PUBLISHED, rough) for _ in range(2)]
    bodies[1]._fast = None
    swimmers = [Swimmer(body) for body in bodies]
    for swimmer in swimmers:
        swimmer.start(0.0)
        assert all(swimmer.advance(6.0) for _ in range(30))
    np.testing.assert_allclose(swimmers[0].data.qpos, swimmers[1].data.qpos, atol=1e-8)
    swimmers[1].data.qvel[8] = np.nan
    assert not swimmers[1].advance(6.0)


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


def test_the_extended_fish_swims_as_well():
    env = rl.make_env("forward", robot=FISH_EXTENDED)
    env.reset(seed=0)
    assert swim(env, 100)[4]["distance"] > 0.05


@pytest.mark.parametrize(
    ("wanted", "sentence"),
    [
        (lambda: rl.make_env("backward"), "there is no task 'backward'; there are forward, target"),
        (lambda: rl.make_env("forward", []), "an ensemble of 0 parameter sets is given; environments need at least 1"),
        (
            lambda: make_task("forward", seconds=0.01),
            r"an episode of 0.01 s is asked for; it must have at least 0.02 s",
        ),
        (lambda: rl.make_env("target", stage=4), "the curriculum has no stage 4; there are 1, 2, 3"),
        (lambda: rl.make_env("forward").set_stage(2), "only the task 'target' has a curriculum"),
        (lambda: rl.make_env("forward").step(GO), "no episode is on: call reset before step"),
        (lambda: rl.make_env("forward").swimmer, "no episode has begun: call reset first"),
        (lambda: rl.Motor(0.0, 1.0), "the motor's speed is 0; it must be finite and above 0"),
        (lambda: rl.Disturbances((1.0, 0.0)), "the start phase is 1 to 0 rad; both must be finite and not fall"),
        (lambda: rl.Disturbances(current=(3.0, 0.0)), r"the current is \(3.0, 0.0\) m/s; each part must be within -1"),
        (lambda: rl.Disturbances(tendon_friction=1.0), "the tendon friction is 1; it is a share, from 0 below 1"),
        (lambda: rl.StateEstimate(noise=-1.0), "the noise of the markers is -1 m; it must be finite and 0 or above"),
        (lambda: rl.StateEstimate(delay=-1), "the delay is -1 control intervals; it must be 0 or above"),
    ],
)
def test_what_is_not_there(wanted, sentence):
    with pytest.raises(ArgumentError, match=sentence):
        wanted()


def test_values_are_checked_before_anything_is_compiled():
    with pytest.raises(ParameterError, match="'motor_arm_length' in set 1 is 9, out of bounds"):
        Bodies(FISH, [PUBLISHED, {**PUBLISHED, "motor_arm_length": 9.0}])


def test_an_action_that_is_no_number():
    env = rl.make_env("forward")
    env.reset(seed=0)
    with pytest.raises(ArgumentError, match="the action is nan; it must be a number from -1 to 1"):
        env.step(np.array([np.nan]))
