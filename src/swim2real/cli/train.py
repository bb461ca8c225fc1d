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

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from swim2real.calibration.ensemble import read_ensemble
from swim2real.calibration.from_rest import backward_from_rest, from_rest
from swim2real.calibration.provenance import commit, versions
from swim2real.cli.compare import chosen_seeds
from swim2real.cli.rl_arguments import Train
from swim2real.cli.subject import robot_for, values_of
from swim2real.errors import ArgumentError
from swim2real.interruption import Interruption
from swim2real.parameters import Values
from swim2real.rl.conditions import REAL_MOTOR, Disturbances
from swim2real.rl.training import Progress
from swim2real.rl.training import train as run_training
from swim2real.rl.training_run import SETTINGS, TrainingOutcome
from swim2real.settings import TrainingSettings
from swim2real.simulation import Simulator

_PLAIN_EVERY = 10.0  # s, between lines where there is no terminal


def train(a: Train) -> int:
    """Trains one seed here, or several in processes of their own."""
    if a.workers < 0 or a.threads < 1:
        raise ArgumentError(f"--workers is {a.workers} and --threads {a.threads}; they must be at least 0 and 1")
    if a.seeds:
        return _train_seeds(a, chosen_seeds(a.seeds))
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
    with Interruption() as interruption, _progress_display(a.env_steps, a.quiet) as show:
        outcome = run_training(
            settings, sets, robot, a.out, about=about, disturbances=Disturbances(phases, (0.0, 0.0), a.tendon_friction),
            threads=a.threads, resume=a.resume, on_progress=show,
            stop=lambda: bool(interruption),
        )  # fmt: skip
    if a.json:
        print(json.dumps(outcome.as_dict(), indent=2))
    elif not a.quiet:
        print(_summary(outcome, a.out))
    if not outcome.complete:
        print(f"swim2real: interrupted at step {outcome.step}; --resume goes on", file=sys.stderr)
    return 0 if outcome.complete else 1


def _warn_if_backward(path: Path, values: Values, simulator: Simulator) -> None:
    """Swims from rest at the motor's greatest speed, and warns where that goes backward."""
    swims = from_rest(simulator, values, {"fastest": REAL_MOTOR.speed / (2 * math.pi)})
    warning = backward_from_rest({name: swim.as_dict() for name, swim in swims.items()})
    if warning:
        print(f"swim2real: warning: '{path}': {warning}", file=sys.stderr)


_LEARNING = ("gymnasium", "stable-baselines3", "torch")


def _summary(outcome: TrainingOutcome, out: Path) -> str:
    last, evaluated = outcome.last_evaluation, ""
    if last:
        evaluated = f"return {last['episode_return']:.1f}, distance {last['distance']:.3f} m, "
        evaluated += f"success {100 * last['success']:.0f} %; " if last["goal_distance"] is not None else ""
    return (
        f"{out}: {outcome.step} steps, {outcome.gradient_steps} updates, {outcome.steps_per_second:.0f} steps/s "
        f"({100 * outcome.learner_share:.0f} % of the time learning, {100 * outcome.simulator_share:.0f} % "
        f"simulating); {evaluated}`swim2real rollout {out}` assesses it"
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
def _progress_display(total: int, quiet: bool) -> Generator[Callable[[Progress], None]]:
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    if quiet:
        yield lambda progress: None
    elif not console.is_terminal:
        last = -math.inf

        def plain(p: Progress) -> None:
            nonlocal last
            if p.evaluation or p.step >= p.total or time.monotonic() - last > _PLAIN_EVERY:
                last = time.monotonic()
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


def _train_seeds(a: Train, seeds: list[int]) -> int:
    """Trains each seed by a program of its own, as many at a time as there are workers.

    Each program hears of Ctrl-C by a signal, writes its checkpoint and ends.
    """
    waiting, running, failed = list(seeds), dict[int, subprocess.Popen[bytes]](), list[int]()
    most = a.workers or os.cpu_count() or 1
    a.out.mkdir(parents=True, exist_ok=True)
    with Interruption() as interruption:
        signaled = False
        while running or (waiting and not interruption):
            while waiting and len(running) < most and not interruption:
                seed = waiting.pop(0)
                running[seed] = subprocess.Popen(_command_line(a, seed), start_new_session=True)
            if interruption and not signaled:
                signaled = True
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


def _command_line(a: Train, seed: int) -> list[str]:
    """The words of the command that trains one seed."""
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
