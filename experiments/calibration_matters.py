"""Does calibration matter to a policy? Trains in several simulators, and swims in all of them and in one that none is.

    python experiments/calibration_matters.py forward --out matters --held-out runs/extended-1 \
        line-search=runs/fish-0 bayesopt=runs/bayesopt-0 published=published random=runs/random-0

A simulator may also be a file of `swim2real ensemble`, of which a set is drawn for every episode, and +tracked behind a
path trains on what a tracker with noise and delay sees.
The held-out simulator stands for the real robot: parameters that fit the real tracks, and what no calibration knows of:
friction of the left tendon, a current, and a tracker's noise and delay. A policy swims there in open loop (its commands
are recorded in the simulator that it was trained in and replayed, as the paper transfers them), in closed loop on the
true state, and on the tracked one. Figures are means over starts, then mean and standard deviation over the seeds of
the training; the test of a difference is Welch's, over seeds. What is done already is kept: an interrupted run goes on.
"""

import argparse
import json
import math
import os
from dataclasses import asdict
from pathlib import Path

import numpy as np
from scipy.stats import ttest_ind

from swim2real.cli.subject import robot_for, values_for
from swim2real.identification.ensemble import read_ensemble
from swim2real.rl.assessment import TEST_SEED, constant_waves, scan_waves, sine_waves
from swim2real.rl.conditions import Disturbances, StateEstimate
from swim2real.rl.environment import make_environments
from swim2real.rl.rollout import EpisodeStatistics, load_policy, repeated, run_episodes
from swim2real.rl.training import train
from swim2real.rl.training_run import TrainingRun
from swim2real.robots import load_robot
from swim2real.settings import TrainingSettings

ANY_PHASE = (-math.pi, math.pi)
SCAN_PHASES = tuple(np.linspace(*ANY_PHASE, 4, endpoint=False))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=("forward", "target", "paper-target"))
    parser.add_argument("simulators", nargs="+", help="NAME=RUN_OR_PARAMETERS_OR_ENSEMBLE[+tracked]")
    parser.add_argument("--held-out", type=Path, required=True)
    parser.add_argument("--tendon-friction", type=float, default=0.5)
    parser.add_argument("--current", type=float, nargs=2, default=(0.0, 0.02), help="m/s, backward and to the side")
    parser.add_argument("--env-steps", type=int, default=5_000_000)
    parser.add_argument("--updates", type=int, default=1, help="after every 200 steps")
    parser.add_argument("--environments", type=int, default=TrainingSettings.environments)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args()
    simulators = {}
    for word in a.simulators:
        name, _, path = word.partition("=")
        simulators[name] = simulator_of(path)
    start = Disturbances(ANY_PHASE)
    rough = Disturbances(ANY_PHASE, tuple(a.current), a.tendon_friction)
    tracked = Disturbances(ANY_PHASE, tuple(a.current), a.tendon_friction, StateEstimate())
    held_out = simulator_of(str(a.held_out))

    def swim(simulator, policy, disturbances):
        environments = make_environments(
            a.task, simulator[1], a.episodes, robot=simulator[0], disturbances=disturbances, threads=a.threads
        )
        episodes = run_episodes(environments, policy, range(TEST_SEED, TEST_SEED + a.episodes))
        environments.close()
        return episodes

    results = {"settings": {**vars(a), "out": str(a.out), "held_out": str(a.held_out)}, "policies": {}, "waves": {}}
    if a.task == "forward":
        for name, waves in {"constant": constant_waves(), "sine": sine_waves(1)}.items():
            scan = scan_waves(
                waves, a.task, held_out[1][0], held_out[0], SCAN_PHASES, 2.0, disturbances=rough, threads=a.threads
            )
            results["waves"][name] = scan.as_dict()
            print(f"best {name} wave in the held-out simulator: {1e3 * scan.best_distance:.0f} mm, {scan.farthest}")
    for seed in range(a.seeds):
        for name, simulator in simulators.items():
            folder = a.out / a.task / name / f"seed-{seed}"
            begun = (folder / "settings.json").is_file()
            outcome = TrainingRun.open(folder).outcome if begun else None
            if outcome is None or not outcome.complete:
                settings = TrainingSettings(a.task, a.env_steps, seed, updates=a.updates, environments=a.environments)
                outcome = train(
                    settings, simulator[1], simulator[0], folder,
                    disturbances=Disturbances(ANY_PHASE, estimate=StateEstimate() if simulator[3] else None),
                    about={"reference": simulator[2]}, threads=a.threads, resume=begun,
                )  # fmt: skip
            policy = load_policy(TrainingRun.open(folder))
            own = swim(simulator, policy, start)
            swims = {
                "own": own,
                **{f"in {other}": swim(one, policy, start) for other, one in simulators.items() if other != name},
                "held out, open": swim(held_out, repeated([episode.actions for episode in own]), rough),
                "held out, closed": swim(held_out, policy, rough),
                "held out, tracked": swim(held_out, policy, tracked),
            }
            results["policies"].setdefault(name, []).append(
                {where: asdict(EpisodeStatistics.of(episodes)) for where, episodes in swims.items()}
            )
            print(f"{name}, seed {seed}: {outcome.seconds.total:.0f} s", flush=True)
            (a.out / f"{a.task}.json").write_text(json.dumps(results, indent=2, default=str))
    print_tables(results["policies"], a.task)


def simulator_of(word):
    """Robot, parameter sets, where they are from, and whether a policy is trained on tracked states there."""
    path, _, tracked = word.partition("+")
    content = json.loads(Path(path).read_text()) if Path(path).is_file() else {}
    if "members" in content:
        robot = load_robot(content["robot"])
        return robot, read_ensemble(Path(path), robot), path, bool(tracked)
    robot = robot_for(Path(path))
    return robot, [values_for(Path(path), robot)], path, bool(tracked)


def print_tables(policies, task):
    """Figures by simulator, and whether they differ from the first simulator's, over seeds."""
    figures = [("distance", 1e3, "mm"), ("episode_return", 1.0, "return")]
    if task != "forward":
        figures = [("success", 100.0, "% reached"), ("median_time_to_target", 1.0, "s to the goal, median")]
    first = next(iter(policies))
    for key, factor, unit in figures:
        columns = [
            "own",
            *(f"in {name}" for name in policies),
            "held out, open",
            "held out, closed",
            "held out, tracked",
        ]
        print(f"\n| trained in, {unit} | {' | '.join(columns)} |\n|{'---|' * (len(columns) + 1)}")
        for name, seeds in policies.items():
            cells = []
            for where in columns:
                values = np.array([seed[where][key] for seed in seeds if seed.get(where, {}).get(key) is not None])
                spread = f" ± {factor * values.std(ddof=1):.1f}" if len(values) > 1 else ""
                cells.append(f"{factor * values.mean():.1f}{spread}" if len(values) else "–")
            print(f"| {name} | " + " | ".join(cells) + " |")
        for name in list(policies)[1:]:
            for where in ("own", "held out, open", "held out, closed"):
                ours, theirs = ([seed[where][key] for seed in policies[one]] for one in (first, name))
                if min(len(ours), len(theirs)) > 1 and None not in [*ours, *theirs]:
                    p = ttest_ind(ours, theirs, equal_var=False).pvalue
                    difference = factor * (np.mean(ours) - np.mean(theirs))
                    print(f"{first} against {name}, {where}: {difference:+.1f} {unit}, p = {p:.3f}")


if __name__ == "__main__":
    main()
