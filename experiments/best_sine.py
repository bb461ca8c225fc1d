"""The farthest sine that CMA-ES finds, or the one with the highest return: what a policy for `forward` has to beat.

    python experiments/best_sine.py examples/snake/snake.toml published --evaluations 200 --seeds 3 --by return

Each actuator follows middle + amplitude sin(2 pi f t + phase), with one frequency for all, an amplitude of each (a
share of half its range) and a phase of each but the first, within its limits and rates, from rest for two seconds.
"""

import argparse
import math
from pathlib import Path

import numpy as np

from swim2real.cli.subject import robot_for, values_for
from swim2real.optimizers import CmaEs, Evaluation
from swim2real.rl.conditions import CONTROL_INTERVAL
from swim2real.rl.environment import make_environments
from swim2real.rl.rollout import followed, run_episodes

SECONDS, HIGHEST = 2.0, 5.0  # s, Hz


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot")
    parser.add_argument("parameters", type=Path)
    parser.add_argument("--by", choices=("distance", "return"), default="distance")
    parser.add_argument("--evaluations", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=3)
    a = parser.parse_args()
    robot = robot_for(a.parameters, a.robot)
    environments = make_environments("forward", values_for(a.parameters, robot), 1, robot=robot)
    actuators = environments.bodies.actuators
    times = CONTROL_INTERVAL * np.arange(1.0, round(SECONDS / CONTROL_INTERVAL) + 1)
    middle, half = (actuators.upper + actuators.lower) / 2, (actuators.upper - actuators.lower) / 2

    def commands(point):
        amplitudes, phases = point[1 : 1 + len(actuators)], np.append(0.0, 2 * math.pi * point[1 + len(actuators) :])
        angles = 2 * math.pi * HIGHEST * point[0] * times[:, None] - phases
        return middle + amplitudes * half * np.sin(angles)

    for seed in range(a.seeds):
        search, swims = CmaEs(2 * len(actuators), np.random.default_rng(seed)), []
        for _ in range(a.evaluations):
            candidate = search.ask()
            episode = run_episodes(environments, followed(commands(candidate.point)[:, None], actuators), [0])[0]
            figures = {"distance": episode.distance, "return": episode.episode_return}
            search.tell(Evaluation(candidate, -figures[a.by]))
            swims.append((figures, candidate.point))
        best, found = max(swims, key=lambda swim: swim[0][a.by])
        print(f"seed {seed}: {best['distance']:.3f} m, return {best['return']:.1f} at {HIGHEST * found[0]:.2f} Hz, "
              f"amplitudes and phases {found[1:].round(2)}")  # fmt: skip
    environments.close()


if __name__ == "__main__":
    main()
