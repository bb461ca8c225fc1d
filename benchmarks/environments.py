"""Environment steps per second: physics alone, environments, training; and a plain environment that loops `mj_step`.

The plain one has the same model, actions, observations and rewards, and is checked to give the same numbers. All are
measured in turns in one process, so that other work disturbs their ratios least. Run with the package installed:
`OPENBLAS_NUM_THREADS=1 python benchmarks/environments.py`, `--quick` for a look, `--updates` for what an update costs.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import torch
from gymnasium import spaces

from fluidstep.batch import Batch
from swim2real.rl import UNDISTURBED, make_env, make_environments
from swim2real.rl.body import Bodies
from swim2real.rl.learner import Learner, RobotVecEnv
from swim2real.rl.training import Trainer
from swim2real.robots.fish import FISH
from swim2real.settings import TRAIN_FREQ, TrainingSettings

COUNT = TrainingSettings.environments
SITES = Bodies(FISH, FISH.space.published).layout.seen
SPEED, ACCELERATION = 7.29, 100.0  # the motor's limits


class PlainForward(gymnasium.Env):
    """What one would write first, without wasting anything on purpose."""

    def __init__(self) -> None:
        self.model = FISH.model
        self.data = mujoco.MjData(self.model)
        self.sites = [self.model.site(name).id for name in SITES]
        self.anchor = self.model.jnt_pos[0][:2].copy()
        self.observation_space = spaces.Box(-1000.0, 1000.0, (52,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.command, self.count = 0.0, 0
        return self._observation(), {}

    def step(self, action: np.ndarray):
        acceleration = float(np.clip(action[0], -1, 1)) * ACCELERATION
        self.command = float(np.clip(self.command + 0.02 * acceleration, -SPEED, SPEED))
        self.data.ctrl[0] = self.command
        for _ in range(20):
            mujoco.mj_step(self.model, self.data)
        self.count += 1
        distance = -float(self.data.qpos[0])
        return self._observation(), distance, False, self.count >= 100, {"distance": distance}

    def _observation(self) -> np.ndarray:
        model, data = self.model, self.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        positions = data.site_xpos[self.sites, :2] - self.anchor
        velocities, twist = np.empty((len(self.sites), 2)), np.empty(6)
        for i, site in enumerate(self.sites):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
            velocities[i] = twist[3:5]
        head, moving = data.qpos[[0, 1, 5]], data.qvel[[0, 1, 5]]
        motor = [math.remainder(data.qpos[6], math.tau), data.qvel[6]]
        parts = (positions.ravel(), velocities.ravel(), head, moving, motor)
        return np.concatenate(parts).astype(np.float32)


def agreement(steps: int = 100) -> float:
    """Largest difference between what the two see over an episode."""
    plain, ours, rng = PlainForward(), make_env("forward"), np.random.default_rng(0)
    gap = float(np.abs(plain.reset()[0] - ours.reset(seed=0)[0]).max())
    for _ in range(steps):
        action = rng.uniform(-1, 1, 1).astype(np.float32)
        gap = max(gap, float(np.abs(plain.step(action)[0] - ours.step(action)[0]).max()))
    return gap


def single(env: gymnasium.Env, steps: int) -> Callable[[], None]:
    rng = np.random.default_rng(1)
    env.reset(seed=0)

    def run() -> None:
        for _ in range(steps):
            _, _, ended, cut, _ = env.step(rng.uniform(-1, 1, 1).astype(np.float32))
            if ended or cut:
                env.reset()

    return run


def physics(threads: int, steps: int) -> Callable[[], None]:
    """Fast steps alone, of as many robots as train together: the limit."""
    bodies = Bodies(FISH, FISH.space.published)
    batch = Batch(bodies.models, COUNT, threads)
    for i in range(COUNT):
        batch.start(i, 0)

    def run() -> None:
        for k in range(steps // COUNT):
            batch.step(np.full((COUNT, 1), 7.0 * np.sin(0.3 * k)), bodies.steps)

    return run


def environments(threads: int, steps: int) -> Callable[[], None]:
    """The same with observations, rewards, ends and starts."""
    envs, rng = make_environments("forward", None, COUNT, threads=threads, seed=0), np.random.default_rng(1)
    envs.begin(np.arange(COUNT))

    def run() -> None:
        for _ in range(steps // COUNT):
            ended = np.flatnonzero(envs.step(rng.uniform(-1, 1, (COUNT, 1))).ended)
            if len(ended):
                envs.begin(ended)

    return run


def training(threads: int, steps: int) -> Callable[[], None]:
    """The same with learning at the paper's ratio: an update after 200 steps, of batches of 256."""
    settings = TrainingSettings("forward", 10_000_000, exploration=200, updates=1, environments=COUNT)
    folder = Path(tempfile.mkdtemp())
    trainer = Trainer(settings, [FISH.space.published], FISH, folder, UNDISTURBED, threads)
    trainer.begin({}, resume=False)
    for _ in range(3):
        trainer.round()

    def run() -> None:
        for _ in range(steps // TRAIN_FREQ):
            trainer.round()

    return run


def updates(turns: int) -> None:
    """An update as Stable-Baselines3 makes it on its own, as we do, and compiled: in turns, with their ratios."""
    learners: dict[str, Learner] = {}
    for name in ("as Stable-Baselines3 makes it", "ours", "ours, torch.compile"):
        vector_env = RobotVecEnv(make_environments("forward", None, COUNT))
        learner = Learner(TrainingSettings("forward", 20_000), vector_env, 0.99)
        sac, buffer, rng = learner._sac, learner._buffer, np.random.default_rng(0)
        for array in (buffer.observations, buffer.next_observations, buffer.actions, buffer.rewards):
            array[:] = 0.3 * rng.standard_normal(array.shape)
        buffer.full = True
        if not learners:
            sac.critic._forward_pre_hooks.clear()
            for optimizer in learner._optimizers().values():
                for group in optimizer.param_groups:
                    group["foreach"], group["fused"] = True, False
        if name.endswith("compile"):
            for network in (sac.critic, sac.critic_target, sac.actor.latent_pi):
                network.forward = torch.compile(network.forward)
            sac.train(1, TrainingSettings.batch)
        learners[name] = learner
    torch.set_num_threads(1)
    seconds: dict[str, list[float]] = {name: [] for name in learners}
    for _ in range(turns):
        for name, learner in learners.items():
            begun = time.perf_counter()
            learner._sac.train(10, TrainingSettings.batch)
            seconds[name].append((time.perf_counter() - begun) / 10)
    first = next(iter(seconds.values()))
    for name, each in seconds.items():
        ratio = statistics.median(a / b for a, b in zip(each, first, strict=True))
        print(f"update, {name}: {1e3 * statistics.median(each):.1f} ms, {ratio:.3f} of the first")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--updates", action="store_true", help="what an update is made of, instead")
    arguments = parser.parse_args()
    quick = arguments.quick
    if arguments.updates:
        updates(3 if quick else 25)
        return
    turns, steps = (3, 400) if quick else (15, 2000)
    gap = agreement(20 if quick else 100)
    runs: dict[str, Callable[[], None]] = {
        "plain, loops mj_step": single(PlainForward(), steps // 10),
        "physics alone, 1 thread": physics(1, steps),
        "environments, 1 thread": environments(1, steps),
        "training, 1 thread": training(1, steps),
        "physics alone, 2 threads": physics(2, steps),
        "environments, 2 threads": environments(2, steps),
        "training, 2 threads": training(2, steps),
    }
    made = {name: steps // 10 if name.startswith("plain") else steps for name in runs}
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(turns):
        for name, run in runs.items():
            begun = time.perf_counter()
            run()
            seconds[name].append((time.perf_counter() - begun) / made[name])
    print(f"{os.cpu_count()} cores, MuJoCo {mujoco.__version__}, largest difference of observations {gap:.1e}")
    for name, each in seconds.items():
        limit = seconds[f"physics alone, {name.partition(', ')[2]}"] if "thread" in name else None
        share = "" if limit is None else statistics.median(a / b for a, b in zip(limit, each, strict=True))
        of = f", {100 * share:.0f} % of the physics limit" if share else ""
        print(f"{name}: {1 / statistics.median(each):,.0f} environment steps per second{of}")
    ratio = statistics.median(a / b for a, b in zip(seconds["plain, loops mj_step"], seconds["environments, 1 thread"],
                                                     strict=True))  # fmt: skip
    print(f"environments on 1 thread are {ratio:.1f} times as fast as the plain one")


if __name__ == "__main__":
    main()
