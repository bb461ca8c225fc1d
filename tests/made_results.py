"""Results of a comparison with numbers that are known, without a simulation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from swim2real.comparison.results import ComparisonResults, RunResult, StepRound
from swim2real.objective.figures import FitFigures

TRIALS, MARKERS, BUDGET = ("slow", "fast"), ("M0", "M1", "M2"), 8
FREQUENCIES = {"slow": 0.5, "fast": 1.5}
REAL_SPEEDS = {"slow": 0.02, "fast": 0.2}


def trial_evidence(name: str, error: float, speed_miss: float = 0.004, lost: bool = False) -> dict[str, Any]:
    """Evidence of one trial: errors grow from head to tail, and more without registration."""
    gradient = error * np.array([0.5, 1.0, 1.5])
    return {
        "marker_error": 2 * error, "aligned_marker_error": error, "shape_error": error / 2, "progress_error": error,
        "static_offset": 0.02, "velocity_error": abs(speed_miss), "frequency": FREQUENCIES[name],
        "velocity_real": REAL_SPEEDS[name], "velocity_simulated": REAL_SPEEDS[name] + speed_miss, "divergence": None,
        "marker_errors": (2 * gradient).tolist(), "aligned_marker_errors": gradient.tolist(),
        "shape_marker_errors": [0.0, error / 2, None if lost else error],
    }  # fmt: skip


def evidence_of(error: float, trials: tuple[str, ...] = TRIALS, **more: Any) -> FitFigures:
    """Figures of a fit."""
    found = {name: trial_evidence(name, error, **more) for name in trials}
    means = ("marker_error", "aligned_marker_error", "shape_error", "velocity_error", "static_offset")
    overall = {name: float(np.mean([one[name] for one in found.values()])) for name in means}
    return FitFigures.model_validate({**overall, "trials": found})


def made_run(
    method: str, seed: int, losses: list[float], protocol: str = "aligned", rounds: tuple[StepRound, ...] = (),
    held_out: str | None = None, failed: tuple[int, ...] = (), folder: str | None = None,
    unseen: float | None = None, **more: Any,
) -> RunResult:  # fmt: skip
    """A run that ends at the lowest of its losses."""
    key = f"{protocol}/{method}/seed-{seed}" + (f"/without-{held_out}" if held_out else "")
    kept = tuple(name for name in TRIALS if name != held_out)
    marks = tuple(i in failed for i in range(len(losses)))
    best = min((loss for loss, mark in zip(losses, marks, strict=True) if not mark), default=losses[0])
    return RunResult(
        method=method, seed=seed, protocol=protocol, scale="log", held_out=held_out, losses=tuple(losses),
        failed=marks, rounds=rounds, calls=len(rounds), spent=None, fit=evidence_of(best, kept, **more),
        held_out_fit=None if held_out is None else evidence_of(best if unseen is None else unseen, (held_out,)),
        values={"drag": 0.5}, seconds=2.0, folder=folder or f"runs/{key}",
    )  # fmt: skip


def made_results(
    *runs: RunResult, missing: dict[str, str] | None = None, methods: tuple[str, ...] = ()
) -> ComparisonResults:
    """Results of these runs."""
    return ComparisonResults(
        runs=runs, methods=methods or tuple(dict.fromkeys(run.method for run in runs)),
        protocols=tuple(dict.fromkeys(run.protocol for run in runs)), trials=TRIALS, markers=MARKERS, budget=BUDGET,
        reference="d5756570ca64", missing=missing or {}, engine={"name": "mujoco 3.13.0"},
    )  # fmt: skip


ROUNDS = (
    StepRound(1, (1.0,), True, True), StepRound(2, (1.0, 0.5), True, True), StepRound(4, (1.0, 0.5, 0.25), False, True),
    StepRound(7, (1.0,), False, False),
)  # fmt: skip


def two_methods() -> ComparisonResults:
    """`good`, with a line search, beats `bad` by 50 mm on every one of three seeds; one method never ran."""
    runs: list[RunResult] = []
    for seed in range(3):
        low = 0.01 + 0.002 * seed
        runs.append(made_run("good", seed, [0.2, 0.08, 0.1, 0.04, 0.05, 0.06, 0.06, low], rounds=ROUNDS))
        runs.append(made_run("bad", seed, [0.2] * 6 + [0.1, low + 0.05], speed_miss=-0.03))
    runs += [made_run("good", 0, [0.2] * 7 + [0.02], held_out=trial, unseen=0.03) for trial in TRIALS]
    missing = {"aligned/absent/seed-0": "the library is not there"}
    return made_results(*runs, missing=missing, methods=("good", "bad", "absent"))


def playback_evidence(error: float, **more: Any) -> FitFigures:
    """Figures of a fit to a recording."""
    trial = {
        "aligned_marker_errors": [0.0, 2 * error], "loss": error, "aligned_marker_error": error,
        "velocity_simulated": 0.1,
    }  # fmt: skip
    return FitFigures.model_validate({"aligned_marker_error": error, "loss": error, **more, "trials": {"a": trial}})


def playback_results(**more: Any) -> ComparisonResults:
    """Two seeds of a method on a recording, 10 and 20 mm off."""
    runs = [
        replace(
            made_run("good", seed, [loss] * BUDGET, "playback"),
            fit=playback_evidence(loss, **more),
        )
        for seed, loss in enumerate((0.01, 0.02))
    ]
    return replace(made_results(*runs), markers=("root", "tip"), sensors={"load": "N"})
