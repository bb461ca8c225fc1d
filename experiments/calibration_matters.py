"""Do calibration and roll matter to a policy? Trains in several simulators, swims in all of them and in held-out ones.

    python experiments/calibration_matters.py forward target --out matters \\
        --held-out fit=simulators/held-out.json rolling=simulators/rolling.json \\
        --simulators extended=simulators/extended.json published=published line-search=simulators/line-search.json

These are eighteen runs, one after another: the paper's 5 million steps, three seeds. Ctrl-C leaves a checkpoint; the
same command goes on, with what is done already kept, and `--tables` prints the tables of what is done.

A simulator may also be a file of `swim2real ensemble`, of which a set is drawn for every episode, and +tracked behind a
path trains on what a tracker with noise and delay sees.
A held-out simulator stands for the real robot: parameters that fit the real tracks, of whatever robot has the same
observations, and what no calibration knows of: friction of the left tendon, a current, a tracker's noise and delay. A
policy swims there in open loop (its commands are recorded in the simulator that it was trained in and replayed, as the
paper transfers them), in closed loop on the true state, and on the tracked one. Figures are means over starts, then
mean and standard deviation over the seeds of the training; the test of a difference is Welch's, over seeds.
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
from swim2real.interruption import Interruption
from swim2real.rl.assessment import TEST_SEED, constant_waves, scan_waves, sine_waves
from swim2real.rl.conditions import Disturbances, StateEstimate
from swim2real.rl.environment import make_environments
from swim2real.rl.rollout import EpisodeStatistics, load_policy, repeated, run_episodes
from swim2real.rl.training import train
from swim2real.rl.training_run import TrainingRun
from swim2real.robots import load_robot
from swim2real.settings import TrainingSettings
from swimbase.store import read_json, write_json

ANY_PHASE = (-math.pi, math.pi)
SCAN_PHASES = tuple(np.linspace(*ANY_PHASE, 4, endpoint=False))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="+", choices=("forward", "target", "paper-target"))
    parser.add_argument("--simulators", nargs="+", required=True, help="NAME=RUN_OR_PARAMETERS_OR_ENSEMBLE[+tracked]")
    parser.add_argument("--held-out", nargs="+", required=True, help="NAME=RUN_OR_PARAMETERS")
    parser.add_argument("--tendon-friction", type=float, default=0.5)
    parser.add_argument("--current", type=float, nargs=2, default=(0.0, 0.02), help="m/s, backward and to the side")
    parser.add_argument("--env-steps", type=int, default=5_000_000)
    parser.add_argument("--updates", type=int, help="after every 200 steps; by default about 25,000 in all")
    parser.add_argument("--learning-rate", type=float, default=TrainingSettings.learning_rate)
    parser.add_argument("--target-rate", type=float, default=TrainingSettings.target_rate)
    parser.add_argument("--near-goals", type=float, default=0.0, help="for target")
    parser.add_argument("--turn-reward", type=float, default=0.0, help="for target")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--tables", action="store_true", help="print the tables of what is done, and end")
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args()
    simulators, held_out = (
        {name: simulator_of(path) for name, _, path in (word.partition("=") for word in words)}
        for words in (a.simulators, a.held_out)
    )
    jobs = [(task, seed, name) for task in a.tasks for seed in range(a.seeds) for name in simulators]
    with Interruption() as interruption:
        for task, seed, name in [] if a.tables else jobs:
            folder = a.out / task / name / f"seed-{seed}"
            if not trained(a, task, seed, simulators[name], folder, interruption):
                break
            swims = assessed(a, task, name, folder, simulators, held_out)
            print(f"{task}, {name}, seed {seed}: {json.dumps({k: round(v['distance'], 3) for k, v in swims.items()})}")
    for task in a.tasks:
        policies = {
            name: [read_json(path) for path in sorted((a.out / task / name).glob("seed-*/swims.json"))]
            for name in simulators
        }
        print_tables({name: seeds for name, seeds in policies.items() if seeds}, task)
    if "forward" in a.tasks and not interruption:
        print_waves(a, held_out)


def trained(a, task, seed, simulator, folder, interruption):
    """Trains a policy, or goes on with it; whether it is done."""
    robot, sets, source, tracked = simulator
    begun = (folder / "settings.json").is_file()
    outcome = TrainingRun.open(folder).outcome if begun else None
    if outcome is None or not outcome.complete:
        settings = TrainingSettings(
            task, a.env_steps, seed, updates=a.updates, learning_rate=a.learning_rate, target_rate=a.target_rate,
            near_goals=0.0 if task == "forward" else a.near_goals,
            turn_reward=a.turn_reward if task == "target" else 0.0,
        )  # fmt: skip
        outcome = train(
            settings, sets, robot, folder, about={"reference": source}, threads=a.threads, resume=begun,
            disturbances=Disturbances(ANY_PHASE, estimate=StateEstimate() if tracked else None),
            on_progress=lambda now: show(folder, now), stop=lambda: bool(interruption),
        )  # fmt: skip
    return outcome.complete


def show(folder, now):
    if now.evaluation:
        print(f"{folder}: {now.step:,} of {now.total:,} steps, {now.seconds_left / 60:.0f} min left", flush=True)


def assessed(a, task, name, folder, simulators, held_out):
    """Figures of a policy's swims, by where: as kept in its folder, or made and kept."""
    conditions = {"held_out": a.held_out, "simulators": a.simulators, "episodes": a.episodes,
                  "current": list(a.current), "tendon_friction": a.tendon_friction}  # fmt: skip
    kept = folder / "swims.json"
    if kept.is_file() and (content := read_json(kept))["conditions"] == conditions:
        return content["swims"]
    run = TrainingRun.open(folder)
    policy = load_policy(run)

    def swim(simulator, policy, current=(0.0, 0.0), friction=0.0, estimate=None):
        environments = make_environments(
            task, simulator[1], a.episodes, robot=simulator[0], threads=a.threads,
            disturbances=Disturbances(ANY_PHASE, tuple(current), friction, estimate),
        )  # fmt: skip
        run.check_fits(load_policy(run), environments)
        episodes = run_episodes(environments, policy, range(TEST_SEED, TEST_SEED + a.episodes))
        environments.close()
        return episodes

    rough = {"current": a.current, "friction": a.tendon_friction}
    own = swim(simulators[name], policy)
    swims = {"own": own}
    for other, one in simulators.items():
        if other != name:
            swims[f"in {other}"] = swim(one, policy)
    for other, one in held_out.items():
        swims[f"{other}, open"] = swim(one, repeated([episode.actions for episode in own]), **rough)
        swims[f"{other}, closed"] = swim(one, policy, **rough)
        swims[f"{other}, tracked"] = swim(one, policy, **rough, estimate=StateEstimate())
    figures = {where: asdict(EpisodeStatistics.of(episodes)) for where, episodes in swims.items()}
    write_json(kept, {"conditions": conditions, "swims": figures})
    return figures


def print_waves(a, held_out):
    """The best commands that don't look at the robot, in the held-out simulators."""
    rough = Disturbances(ANY_PHASE, tuple(a.current), a.tendon_friction)
    for name, (robot, sets, *_) in held_out.items():
        for kind, waves in {"constant": constant_waves(), "sine": sine_waves(1)}.items():
            scan = scan_waves(waves, "forward", sets[0], robot, SCAN_PHASES, 2.0, disturbances=rough, threads=a.threads)
            print(f"best {kind} wave in {name}: {1e3 * scan.best_distance:.0f} mm, {scan.farthest}")


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
    columns = list(dict.fromkeys(where for seeds in policies.values() for seed in seeds for where in seed["swims"]))

    def values(name, where, key):
        each = [seed["swims"].get(where, {}).get(key) for seed in policies[name]]
        return np.array([value for value in each if value is not None])

    for key, factor, unit in figures if policies else []:
        print(f"\n| {task}, trained in, {unit} | {' | '.join(columns)} |\n|{'---|' * (len(columns) + 1)}")
        for name in policies:
            cells = []
            for where in columns:
                found = factor * values(name, where, key)
                spread = f" ± {found.std(ddof=1):.1f}" if len(found) > 1 else ""
                cells.append(f"{found.mean():.1f}{spread}" if len(found) else "–")
            print(f"| {name}, {len(policies[name])} seeds | " + " | ".join(cells) + " |")
        first = next(iter(policies))
        for name in list(policies)[1:]:
            for where in columns:
                ours, theirs = values(first, where, key), values(name, where, key)
                if min(len(ours), len(theirs)) > 1:
                    p = ttest_ind(ours, theirs, equal_var=False).pvalue
                    difference = factor * (ours.mean() - theirs.mean())
                    print(f"{first} against {name}, {where}: {difference:+.1f} {unit}, p = {p:.3f}")


if __name__ == "__main__":
    main()
