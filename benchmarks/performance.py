"""Measures the simulator: steps, evaluations, batches, start-up. Prints the tables of docs/performance.md.

Everything that is compared is measured in turns in one process, and given as a ratio: machines differ and are shared.
Run with the package installed: `python benchmarks/performance.py`, `--quick` for a look.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import mujoco
import numba
import numpy as np
from mujoco import rollout

from fluidstep.step import FastStep
from swim2real.calibration import Problem
from swim2real.demo.synthetic import SyntheticCamera, synthetic_reference
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator
from swim2real.simulation.stepper import Stepper
from swim2real.trials import TrialSet

FREQUENCIES = (0.375, 0.5, 0.75, 1.0, 1.25, 1.4, 1.5, 1.69)  # Hz, eight swims
HORIZON = 4.0  # s of each swim that are compared
SETTLE = 4.0  # s after which a swim that began at rest counts as steady
PUBLISHED = FISH.space.published


def seconds(action: Callable[[], object]) -> float:
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


def in_turns(actions: dict[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Seconds of each action, one after another so that all see the same machine; once before, unmeasured."""
    for action in actions.values():
        action()
    times: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(repeats):
        for name, action in actions.items():
            times[name].append(seconds(action))
    return times


def ratio(times: dict[str, list[float]], slow: str, fast: str) -> float:
    """Median of the ratios within one turn."""
    return statistics.median(a / b for a, b in zip(times[slow], times[fast], strict=True))


def row(name: str, value: str) -> None:
    print(f"| {name} | {value} |", flush=True)


def steps_per_second(repeats: int, count: int = 2000) -> None:
    model = FISH.build(PUBLISHED).compile()
    fast = FastStep(model)
    times = in_turns(
        {
            "mj_step": lambda: Stepper(model, FISH, 0.1, 6.0, 0.0).run(count),
            "fast": lambda: Stepper(model, FISH, 0.1, 6.0, 0.0, fast).run(count),
        },
        repeats,
    )
    for name, spent in times.items():
        median = statistics.median(spent)
        row(f"{name}, one core", f"{count / median:,.0f} steps/s, {1e6 * median / count:.1f} µs per step")
    row("**ratio**", f"**{ratio(times, 'mj_step', 'fast'):.1f}**")


def full_length() -> None:
    """Eight swims from rest until steady and then as long as they are compared, on one thread of the engine."""
    model, physics = FISH.build(PUBLISHED).compile(), mujoco.mjtState.mjSTATE_FULLPHYSICS
    data = mujoco.MjData(model)
    for frequency in FREQUENCIES:
        mujoco.mj_resetData(model, data)
        speed = 2 * np.pi * frequency
        data.joint(FISH.swims.motor_joint).qvel[0] = speed
        state = np.empty(mujoco.mj_stateSize(model, physics))
        mujoco.mj_getState(model, data, state, physics)
        steps = round((SETTLE + HORIZON) / model.opt.timestep)
        rollout.rollout(model, data, state[None], np.full((1, steps, 1), speed), nstep=steps)


def evaluations(repeats: int) -> dict[str, Problem]:
    swims = synthetic_reference(FISH, PUBLISHED, FREQUENCIES, HORIZON + 1.0, SyntheticCamera(noise=1e-3), seed=1)
    problems = {
        f"{step} step, {threads} thread{'s' * (threads > 1)}": Problem(
            FISH, swims, "aligned", HORIZON, simulator=Simulator(FISH, threads, step=step)
        )
        for step, threads in (("engine", 1), ("engine", 2), ("fast", 1), ("fast", 2))
    }
    full = f"full length: {SETTLE:g} s + {HORIZON:g} s, mujoco.rollout, 1 thread"
    actions: dict[str, Callable[[], object]] = {full: full_length}
    actions |= {name: lambda problem=problem: problem.evaluate(PUBLISHED) for name, problem in problems.items()}
    times = in_turns(actions, repeats)
    for name, spent in times.items():
        row(name, f"{statistics.median(spent):.3f} s, {ratio(times, full, name):.1f} times faster")
    # with nothing but the compared seconds on the other side
    share = HORIZON / (SETTLE + HORIZON)
    row("fast step, 2 threads, against the compared seconds alone",
        f"{share * ratio(times, full, 'fast step, 2 threads'):.1f} times faster")  # fmt: skip
    return problems


def parts(problem: Problem, repeats: int) -> None:
    requests = [prepared.request for prepared in problem.prepared]
    simulated = problem.simulator.simulate(PUBLISHED, requests)
    pairs = [(prepared.target, trial) for prepared, trial in zip(problem.prepared, simulated, strict=True)]
    times = in_turns(
        {
            "build the model": lambda: FISH.build(PUBLISHED).compile(),
            "whole simulation, build included": lambda: problem.simulator.simulate(PUBLISHED, requests),
            "objective": lambda: [problem.protocol.compare(target, trial).loss for target, trial in pairs],
            "evaluation": lambda: problem.evaluate(PUBLISHED),
        },
        repeats,
    )
    whole = statistics.median(times["evaluation"])
    for name, spent in times.items():
        median = statistics.median(spent)
        row(name, f"{1e3 * median:.1f} ms, {100 * median / whole:.0f} %")


def scaling(reference: TrialSet, repeats: int) -> None:
    """Evaluations a second by number of threads, up to twice the cores."""
    counts = [n for n in (1, 2, 4, 8, 16, 32, 64) if n <= 2 * (os.cpu_count() or 1)]
    problems = {f"{n} thread{'s' * (n > 1)}": Problem(FISH, reference, "aligned", HORIZON, threads=n) for n in counts}
    batch = [PUBLISHED] * 4
    times = in_turns({name: lambda p=p: p.evaluate_many(batch) for name, p in problems.items()}, repeats)
    for name, spent in times.items():
        row(name, f"{len(batch) / statistics.median(spent):.1f} /s, {ratio(times, '1 thread', name):.2f} times")


def batches(problem: Problem, sizes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    for size in sizes:
        candidates = [FISH.space.to_values(point) for point in rng.random((size, len(FISH.space)))]
        turns = 5 if size == 1 else 1
        spent = statistics.median(seconds(lambda c=candidates: problem.evaluate_many(c)) for _ in range(turns))
        row(f"random candidates in batches of {size}", f"{size / spent:.1f} /s")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024 if sys.platform != "darwin" else 1024**2)
    row("largest memory of the process so far", f"{peak:.0f} MB")


FIRST = """
import time; began = time.perf_counter()
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, TrialSet
Simulator(FISH, 2).simulate(FISH.space.published, [Swim(str(f), Actuation(f, 0.0, 0.1), 4.0) for f in {frequencies}])
print(time.perf_counter() - began)
"""


def start_up(repeats: int) -> None:
    commands = {
        "an empty Python, for comparison": ["-c", "pass"],
        "`import swim2real`": ["-c", "import swim2real"],
        "`swim2real --help`": ["-m", "swim2real", "--help"],
        "first simulation of eight swims, imports included": ["-c", FIRST.format(frequencies=FREQUENCIES)],
    }
    actions = {
        name: lambda arguments=arguments: subprocess.run([sys.executable, *arguments], capture_output=True, check=True)
        for name, arguments in commands.items()
    }
    for name, spent in in_turns(actions, repeats).items():
        row(name, f"{statistics.median(spent):.2f} s")


def heading(title: str) -> None:
    print(f"\n| {title} | |\n|---|---|", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=7, help="turns of each comparison (%(default)s)")
    parser.add_argument("--quick", action="store_true", help="three turns, no batches of 64 and 512")
    arguments = parser.parse_args()
    repeats = 3 if arguments.quick else arguments.repeats
    print(
        f"{os.cpu_count()} cores {platform.machine()}, {platform.system()}; Python {platform.python_version()}, "
        f"MuJoCo {mujoco.__version__}, numba {numba.__version__}, NumPy {np.__version__}"
    )
    heading("steps")
    steps_per_second(3 * repeats)
    heading("one evaluation: eight swims, 0.375 to 1.69 Hz, aligned protocol, published parameters")
    problems = evaluations(repeats)
    heading("parts of an evaluation, fast step, 1 thread")
    parts(problems["fast step, 1 thread"], repeats)
    heading("throughput, fast step, 2 threads")
    batches(problems["fast step, 2 threads"], (1, 8) if arguments.quick else (1, 8, 64, 512))
    heading("the published candidate, four in a batch, by threads")
    scaling(TrialSet(problems["fast step, 2 threads"].trials, FISH.marker_names), repeats)
    heading("start-up, compiled code on the disk")
    start_up(repeats)


if __name__ == "__main__":
    main()
