"""Does calibration matter to a policy? Trains in several simulators, and swims in another that none of them is.

    python experiments/calibration_matters.py --out runs/matters --held-out runs/best --tendon-friction 0.5 \
        published=published line-search=runs/line-search random=runs/random

The held-out simulator stands for the real robot: parameters that fit the real tracks best, and friction of the left
tendon that no calibration knows of. A policy swims there in closed loop, and in open loop: its commands are recorded in
the simulator that it was trained in and replayed, as the paper transfers them. Whatever is done already is kept.
"""

import argparse
import json
import math
from pathlib import Path

import numpy as np

from swim2real.cli.subject import values_of
from swim2real.rl.assessment import SCANNED_SPEEDS, TEST_SEED, scan_constant_speeds
from swim2real.rl.conditions import Disturbances
from swim2real.rl.environment import make_environments
from swim2real.rl.policies import RecordedActions, load_policy
from swim2real.rl.rollout import EpisodeStatistics, run_episodes
from swim2real.rl.training import train
from swim2real.rl.training_run import TrainingRun
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings
from swim2real.simulation import Simulator

SECONDS = 2.0
PHASES = (-math.pi, math.pi)


def swim(values, policy, count, disturbances):
    environments = make_environments("forward", [values], count, disturbances=disturbances)
    return run_episodes(environments, policy, range(TEST_SEED, TEST_SEED + count))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("simulators", nargs="+", help="NAME=RUN_OR_PARAMETERS")
    parser.add_argument("--held-out", type=Path, required=True)
    parser.add_argument("--tendon-friction", type=float, default=0.5)
    parser.add_argument("--env-steps", type=int, default=100_000)
    parser.add_argument(
        "--updates", type=int, default=None, help="after every 200 steps; by default the short-run rule"
    )
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args()
    simulator = Simulator(FISH, 1)
    real = values_of(a.held_out, simulator)
    disturbed = Disturbances(start_phase=PHASES, tendon_friction=a.tendon_friction)
    plain = Disturbances(start_phase=PHASES)
    phases = np.linspace(*PHASES, 8, endpoint=False)
    scan = scan_constant_speeds(real, FISH, phases, SECONDS, count=SCANNED_SPEEDS, disturbances=disturbed)
    best, frequency = scan.best_distance, scan.best_distance_frequency
    print(f"held out: best constant frequency {1e3 * best:.0f} mm at {frequency:+.2f} Hz", flush=True)
    results = {"constant": scan.as_dict(), "policies": {}}
    for word in a.simulators:
        name, _, path = word.partition("=")
        values = values_of(Path(path), simulator)
        for seed in range(a.seeds):
            folder = a.out / name / f"seed-{seed}"
            settings = TrainingSettings("forward", a.env_steps, seed, updates=a.updates)
            begun = (folder / "settings.json").is_file()
            outcome = TrainingRun.open(folder).outcome if begun else None
            if outcome is None or not outcome.complete:
                outcome = train(
                    settings, [values], FISH, folder, disturbances=plain, about={"reference": path}, resume=begun
                )
            policy, seconds = load_policy(TrainingRun.open(folder)), outcome.seconds.total
            own = swim(values, policy, a.episodes, plain)
            recorded = RecordedActions([episode.actions for episode in own])
            statistics = {
                "own": EpisodeStatistics.of(own),
                "closed": EpisodeStatistics.of(swim(real, policy, a.episodes, disturbed)),
                "open": EpisodeStatistics.of(swim(real, recorded, a.episodes, disturbed)),
            }
            results["policies"][f"{name}/seed-{seed}"] = {
                "seconds": seconds, **{key: figures.as_dict() for key, figures in statistics.items()}
            }  # fmt: skip
            text = ", ".join(
                f"{key} {1e3 * figures.distance:.0f} ± {1e3 * figures.distance_std:.0f} mm"
                for key, figures in statistics.items()
            )
            print(f"{name}/seed-{seed}: {text}, trained in {seconds:.0f} s", flush=True)
            (a.out / "results.json").write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
