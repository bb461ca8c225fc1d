"""`train`."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import fields
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from swim2real.calibration.ensemble import read_ensemble
from swim2real.calibration.from_rest import backward_from_rest, from_rest
from swim2real.calibration.provenance import commit, versions
from swim2real.cli.compare import chosen_seeds
from swim2real.cli.interruption import noted_interrupts
from swim2real.cli.rl_arguments import Train
from swim2real.cli.subject import robot_for, values_of
from swim2real.errors import ArgumentError
from swim2real.parameters import Values
from swim2real.rl.disturbances import Disturbances
from swim2real.rl.motor import REAL_MOTOR
from swim2real.rl.run_files import SETTINGS
from swim2real.rl.training import Progress
from swim2real.rl.training import train as run
from swim2real.settings import TrainingSettings
from swim2real.simulation import Simulator

_PLAIN_EVERY = 10.0  # s, between lines where there is no terminal


def train(a: Train) -> int:
    """Trains one seed here, or several in processes of their own."""
    if a.workers < 0 or a.threads < 1:
        raise ArgumentError(f"--workers is {a.workers} and --threads {a.threads}; they must be at least 0 and 1")
    if a.seeds:
        return _several(a, chosen_seeds(a.seeds))
    settings = TrainingSettings(
        a.task, a.env_steps, a.seed, a.environments, a.exploration, a.updates, a.checkpoint_every
    )
    robot = robot_for(a.parameters)
    simulator = Simulator(robot, 1)
    if a.ensemble:
        sets = read_ensemble(a.ensemble, robot)
    else:
        sets = [values_of(a.parameters, simulator)]
        _warn_if_backward(a.parameters, sets[0], simulator)
    phases = (-math.pi, math.pi) if a.any_phase else (0.0, 0.0)
    about = {
        "reference": str(a.ensemble or a.parameters), "engine": simulator.engine.as_dict(),
        "versions": {**versions(), **{name: metadata.version(name) for name in _LEARNING}}, "commit": commit(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip
    with noted_interrupts() as stop, _shown(a.env_steps, a.quiet) as show:
        outcome = run(
            settings, sets, robot, a.out, about=about, disturbances=Disturbances(phases, (0.0, 0.0), a.tendon_friction),
            threads=a.threads, resume=a.resume, on_progress=show, stop=stop,
        )  # fmt: skip
    if a.json:
        print(json.dumps(outcome, indent=2))
    elif not a.quiet:
        print(_ended(outcome, a.out))
    if not outcome["complete"]:
        print(f"swim2real: interrupted at step {outcome['step']}; --resume goes on", file=sys.stderr)
    return 0 if outcome["complete"] else 1


def _warn_if_backward(path: Path, values: Values, simulator: Simulator) -> None:
    """Tries the motor's greatest speed from rest."""
    found = from_rest(simulator, values, {"fastest": REAL_MOTOR.speed / (2 * math.pi)})
    warning = backward_from_rest({name: swim.as_dict() for name, swim in found.items()})
    if warning:
        print(f"swim2real: warning: '{path}': {warning}", file=sys.stderr)


_LEARNING = ("gymnasium", "stable-baselines3", "torch")


def _ended(outcome: dict[str, Any], out: Path) -> str:
    last = outcome["last_evaluation"]
    found = ""
    if last:
        found = f"return {last['episode_return']:.1f}, distance {last['distance']:.3f} m, "
        found += f"success {100 * last['success']:.0f} %; " if last["goal_distance"] is not None else ""
    return (
        f"{out}: {outcome['step']} steps, {outcome['gradient_steps']} updates, "
        f"{outcome['steps_per_second']:.0f} steps/s ({100 * outcome['learner_share']:.0f} % of the time learning, "
        f"{100 * outcome['simulator_share']:.0f} % simulating); {found}"
        f"`swim2real rollout {out}` assesses it"
    )


def line(p: Progress) -> str:
    """How far a run is, in one line."""
    parts = [f"{p.step:>9,}/{p.total:,}", f"{p.rate:.0f} steps/s"]
    if p.episode_return is not None and p.distance is not None and p.success is not None:
        parts.append(f"return {p.episode_return:.1f}")
        parts.append(f"distance {p.distance:.3f} m")
        if p.stage is not None:
            parts.append(f"stage {p.stage}, success {100 * p.success:.0f} %")
    parts.append(f"learning {100 * p.learner_share:.0f} %")
    if p.evaluation:
        text = f"evaluated: return {p.evaluation['episode_return']:.1f}, distance {p.evaluation['distance']:.3f} m"
        parts.append(text + (f", success {100 * p.evaluation['success']:.0f} %" if p.stage is not None else ""))
    minutes, seconds = divmod(round(p.seconds_left), 60)
    return ", ".join([*parts, f"{minutes}:{seconds:02d} left"])


@contextmanager
def _shown(total: int, quiet: bool) -> Generator[Callable[[Progress], None]]:
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    if quiet:
        yield lambda progress: None
    elif not console.is_terminal:
        told = -math.inf

        def plain(p: Progress) -> None:
            nonlocal told
            if p.evaluation or p.step >= p.total or time.monotonic() - told > _PLAIN_EVERY:
                told = time.monotonic()
                console.print(line(p))

        yield plain
    else:
        with Bar(TextColumn("training"), BarColumn(), TextColumn("{task.fields[text]}"), console=console) as bar:
            task = bar.add_task("", total=total, text="first steps")

            def update(p: Progress) -> None:
                bar.update(task, completed=p.step, total=p.total, text=line(p))
                if p.evaluation:
                    bar.console.print(line(p))

            yield update


def _several(a: Train, seeds: list[int]) -> int:
    """Each seed in a process of its own, so many at a time as there are workers."""
    waiting, running, failed = list(seeds), dict[int, subprocess.Popen[bytes]](), list[int]()
    most = a.workers or os.cpu_count() or 1
    a.out.mkdir(parents=True, exist_ok=True)
    with noted_interrupts() as stop:
        told = False
        while running or (waiting and not stop()):
            while waiting and len(running) < most and not stop():
                seed = waiting.pop(0)
                running[seed] = subprocess.Popen(_words(a, seed), start_new_session=True)
            if stop() and not told:
                told = True
                for process in running.values():
                    process.send_signal(signal.SIGINT)
            for seed, process in list(running.items()):
                if process.poll() is not None:
                    del running[seed]
                    if process.returncode:
                        failed.append(seed)
            time.sleep(0.1)
    if failed or waiting:
        names = ", ".join(map(str, sorted(failed + waiting)))
        print(f"swim2real: seeds {names} aren't done; the same command with --resume goes on", file=sys.stderr)
    return 1 if failed or waiting else 0


def _words(a: Train, seed: int) -> list[str]:
    """The command of one seed."""
    out = a.out / f"seed-{seed}"
    words = [sys.executable, "-m", "swim2real", "train", a.task]
    for field in fields(a):
        value = getattr(a, field.name)
        if field.name in ("task", "seed", "seeds", "workers", "out", "resume") or value is None:
            continue
        flag = "--" + field.name.replace("_", "-")
        words += ([flag] if value else []) if isinstance(value, bool) else [flag, str(value)]
    return [
        *words, "--seed", str(seed), "--out", str(out),
        *(["--resume"] if a.resume and (out / SETTINGS).exists() else []),
    ]  # fmt: skip
