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
from swim2real.rl.assessment import TEST_SEED
from swim2real.rl.disturbances import Disturbances
from swim2real.rl.drift import side_by_side
from swim2real.rl.evaluation import figures, scan_constant_speeds
from swim2real.rl.policy import Recorded, Trained
from swim2real.rl.rollout import roll, some_environments
from swim2real.rl.training import train
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings
from swim2real.simulation import Simulator

SECONDS = 2.0
PHASES = (-math.pi, math.pi)


def swims(values, driver, count, what):
    environments = some_environments("forward", [values], count, robot=FISH, disturbances=what)
    return roll(environments, driver, range(TEST_SEED, TEST_SEED + count))


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
    constant = scan_constant_speeds(real, FISH, phases, SECONDS, disturbances=disturbed).as_dict()
    best, frequency = constant["best_distance"], constant["best_distance_frequency"]
    print(f"held out: best constant frequency {1e3 * best:.0f} mm at {frequency:+.2f} Hz", flush=True)
    results = {"constant": constant, "policies": {}}
    for word in a.simulators:
        name, _, path = word.partition("=")
        values = values_of(Path(path), simulator)
        for seed in range(a.seeds):
            run = a.out / name / f"seed-{seed}"
            settings = TrainingSettings("forward", a.env_steps, seed, updates=a.updates)
            if not (run / "outcome.json").is_file() or not json.loads((run / "outcome.json").read_text())["complete"]:
                train(
                    settings, [values], FISH, run, disturbances=plain, about={"reference": path},
                    resume=(run / "settings.json").is_file(),
                )  # fmt: skip
            seconds = json.loads((run / "outcome.json").read_text())["seconds"]["total"]
            policy = Trained(run)
            own = swims(values, policy, a.episodes, plain)
            recorded = Recorded(side_by_side([one.actions for one in own]))
            found = {
                "seconds": seconds,
                "own": figures(own),
                "closed": figures(swims(real, policy, a.episodes, disturbed)),
                "open": figures(swims(real, recorded, a.episodes, disturbed)),
            }
            results["policies"][f"{name}/seed-{seed}"] = found
            text = ", ".join(
                f"{key} {1e3 * found[key]['distance']:.0f} ± {1e3 * found[key]['distance_std']:.0f} mm"
                for key in ("own", "closed", "open")
            )
            print(f"{name}/seed-{seed}: {text}, trained in {seconds:.0f} s", flush=True)
            (a.out / "results.json").write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
