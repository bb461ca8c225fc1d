"""Environment steps a second, against a plain Gymnasium environment that loops `mj_step` in Python.

The plain one has the same model, actions, observations and rewards, and is checked to give the same numbers. All are
measured in turns in one process; the figure that counts is the ratio of processor time, a core's, which other work on
the machine disturbs least. Run with the package installed: `python benchmarks/environments.py`, `--quick` for a look.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces

from swim2real.rl import REAL_MOTOR, make_env, make_vector_env
from swim2real.rl.body import FISH_LAYOUT
from swim2real.robots.fish import FISH

COUNT = 8  # environments of a vector
MARKERS = (*FISH.marker_names, *FISH_LAYOUT.fin_tips)


class PlainForward(gymnasium.Env):
    """What one would write first, without wasting anything on purpose."""

    def __init__(self) -> None:
        self.model = FISH.build(FISH.space.published).compile()
        self.data = mujoco.MjData(self.model)
        self.sites = [self.model.site(name).id for name in MARKERS]
        self.anchor = self.model.jnt_pos[0][:2].copy()
        self.observation_space = spaces.Box(-1000.0, 1000.0, (52,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.command, self.count = 0.0, 0
        return self._observation(), {}

    def step(self, action: np.ndarray):
        acceleration = float(np.clip(action[0], -1, 1)) * REAL_MOTOR.acceleration
        self.command = float(np.clip(self.command + 0.02 * acceleration, -REAL_MOTOR.speed, REAL_MOTOR.speed))
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


def vector(threads: int, steps: int) -> Callable[[], None]:
    envs, rng = make_vector_env("forward", count=COUNT, threads=threads, seed=0), np.random.default_rng(1)
    envs.reset()

    def run() -> None:
        for _ in range(steps // COUNT):
            envs.step(rng.uniform(-1, 1, (COUNT, 1)).astype(np.float32))

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    turns, steps = (3, 80) if quick else (15, 200)
    gap = agreement(20 if quick else 100)
    runs = {
        "plain, loops mj_step": single(PlainForward(), steps),
        "ours, one": single(make_env("forward", seed=0), steps),
        f"ours, {COUNT} in a vector": vector(1, steps),
        f"ours, {COUNT} in a vector, 2 threads": vector(2, steps),
        "ours, one, target": single(make_env("target", seed=0), steps),
    }
    core: dict[str, list[float]] = {name: [] for name in runs}
    wall: dict[str, list[float]] = {name: [] for name in runs}
    for run in runs.values():
        run()
    for _ in range(turns):
        for name, run in runs.items():
            began, used = time.perf_counter(), time.process_time()
            run()
            core[name].append((time.process_time() - used) / steps)
            wall[name].append((time.perf_counter() - began) / steps)
    print(f"same observations to {gap:.1g}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; {turns} turns\n")
    print("| environment | steps a second of a core | ratio | steps a second by the clock | ratio |")
    print("|---|---|---|---|---|")
    plain = next(iter(runs))
    for name in runs:
        cells = [name]
        for times in (core, wall):
            rate = 1 / statistics.median(times[name])
            ratio = statistics.median(a / b for a, b in zip(times[plain], times[name], strict=True))
            cells += [f"{rate:,.0f}", f"{ratio:.1f}"]
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
