"""Environments in a vector do what each does alone, however they are shared out."""

import numpy as np
import pytest
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import VecMonitor

import swim2real.rl as rl
from swim2real.robots.fish import FISH

PUBLISHED = FISH.space.published
SLOW = {**PUBLISHED, "fluid_slender_drag": 9.9}
SEEN = rl.Disturbances(estimate=rl.StateEstimate())
ROUGH = rl.Disturbances((0.0, 0.0), (0.02, 0.0), 0.3, rl.StateEstimate())


def actions(count, steps):
    """The same for an environment, however many there are."""
    return np.stack(
        [np.random.default_rng(100 + i).uniform(-1, 1, (steps, 1)).astype(np.float32) for i in range(count)], axis=1
    )


@pytest.mark.parametrize(
    ("task", "count", "threads", "disturbances"),
    [("target", 1, 1, SEEN), ("target", 4, 3, SEEN), ("forward", 2, 2, ROUGH)],
)
def test_the_same_as_alone_through_ends_and_new_starts(task, count, threads, disturbances):
    steps, sets = 13, [PUBLISHED, SLOW]
    vector = rl.make_vector_env(
        task, sets, count, threads=threads, seed=7, disturbances=disturbances, seconds=0.12
    )  # so that each ends twice
    seen = vector.reset()
    alone = [rl.make_env(task, sets, seed=7 + i, disturbances=disturbances, seconds=0.12) for i in range(count)]
    np.testing.assert_array_equal(seen, [env.reset()[0] for env in alone])
    ends = 0
    for row in actions(count, steps):
        seen, rewards, ended, infos = vector.step(row)
        for i, env in enumerate(alone):
            one, reward, terminated, truncated, info = env.step(row[i])
            assert rewards[i] == np.float32(reward)
            assert ended[i] == (terminated or truncated)
            if ended[i]:
                ends += 1
                np.testing.assert_array_equal(infos[i].pop("terminal_observation"), one)
                one, _ = env.reset()
            assert infos[i].pop("TimeLimit.truncated", False) == (truncated and not terminated)
            assert infos[i].pop("success", False) == info.pop("success")
            assert infos[i] == info
            np.testing.assert_array_equal(seen[i], one)
    assert ends == 2 * count
    vector.close()


def test_reaching_a_goal_is_no_time_limit():
    vector = rl.make_vector_env("target", PUBLISHED, 2, seed=0)
    vector.set_options([{"goal": (-0.06, 0.0)}] * 2)
    vector.reset()
    distance = vector.environments.names["goal_distance"].start
    for _ in range(200):
        seen, rewards, ended, infos = vector.step(np.ones((2, 1), np.float32))
        if ended.any():
            break
    assert ended.all()
    assert (rewards > 20).all()
    for i, info in enumerate(infos):
        assert info["success"]
        assert info["TimeLimit.truncated"] is False
        assert info["terminal_observation"][distance] < 0.05
        assert seen[i, distance] > 0.1  # a new episode, with a goal of its own
    assert (vector.environments.times == 0).all()


def test_a_divergence_stays_with_its_environment():
    vector = rl.make_vector_env("forward", PUBLISHED, 2, threads=2, seed=0)
    vector.reset()
    vector.environments.robots.batch.data(0).qpos[7] = np.nan
    seen, rewards, ended, infos = vector.step(np.ones((2, 1), np.float32))
    assert list(ended) == [True, False]
    assert rewards[0] == rl.DIVERGED
    assert ["diverged" in info for info in infos] == [True, False]
    assert infos[0]["TimeLimit.truncated"] is False
    assert np.isfinite(seen).all()
    vector.close()


@pytest.mark.slow
def test_stable_baselines_learns_in_it():
    torch.set_num_threads(1)
    vector = VecMonitor(rl.make_vector_env("forward", PUBLISHED, 2, seed=0, seconds=0.2))
    learner = SAC("MlpPolicy", vector, learning_starts=10, train_freq=5, batch_size=8, seed=0, device="cpu")
    learner.learn(60)
    assert [np.isfinite(episode["r"]) for episode in learner.ep_info_buffer] == [True] * 6


def test_a_running_batch_is_saved_and_goes_on_as_it_would_have():
    rough = rl.Disturbances(estimate=rl.StateEstimate())
    first, second = (rl.make_environments("target", [PUBLISHED, SLOW], 3, seed=1, seconds=0.4, disturbances=rough)
                     for _ in range(2))  # fmt: skip
    for environments in (first, second):
        environments.begin(np.arange(3))
    rows = actions(3, 30)
    for row in rows[:12]:
        first.step(row)
    second.restore(*first.save())
    for row in rows[12:]:
        for environments in (first, second):
            stepped = environments.step(row)
            if stepped.ended.any():
                environments.begin(np.flatnonzero(stepped.ended))
        np.testing.assert_array_equal(first.observations, second.observations)
