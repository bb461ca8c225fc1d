"""The whole pipeline on the embedded example."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.calibration import Progress
from swim2real.demo.synthetic import Camera, synthetic_reference
from swim2real.errors import RunError
from swim2real.pipeline import Settings, run
from swim2real.robots.fish import FISH
from swim2real.trials import TrialSet, load_reference, save_reference

DEMO_FREQUENCIES = (0.5, 0.75, 1.0, 1.25, 1.5)
HELD_OUT = "f1_00"
_HIDDEN_SEED = 2026
_SECONDS = 5.0
_CAMERA = Camera(noise=8e-4, placement=3e-3, timestep=5e-4, lost={"f1_25": (6, 7, 1.0)})
# a fish that swims: the hidden parameters are drawn around these points of the cube, one a parameter group
_CENTER, _SPREAD = np.repeat([0.55, 0.6, 0.5, 0.85, 0.5, 0.55, 0.55, 0.3], [1, 1, 1, 1, 1, 1, 5, 5]), 0.12


def hidden_values() -> dict[str, float]:
    """The parameters of the demo's 'real' fish. Calibration never sees them."""
    rng = np.random.default_rng(_HIDDEN_SEED)
    point = np.clip(_CENTER + rng.uniform(-_SPREAD, _SPREAD, len(_CENTER)), 0, 1)
    return replace(FISH.space, scale="log").to_values(point)


def demo(
    out: str | Path, budget: int = 40, seed: int = 0, resume: bool = False, threads: int | None = None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> tuple[TrialSet, dict[str, Any]]:  # fmt: skip
    """Makes a synthetic reference, saves it, and calibrates against it with one trial left out.

    Args:
        out: Folder; gets `reference/` and `run/`.
        budget: Simulation evaluations.
        seed: Of the calibration.
        resume: Go on with an interrupted demo.
        threads: Swims simulated at a time.
        on_progress: Called after every evaluation.

    Returns:
        The reference and the run's outcome.
    """
    folder = Path(out)
    if not resume and (folder / "run" / "settings.json").exists():
        raise RunError(f"'{folder}' holds a demo already; remove it, choose another --out or go on with --resume")
    settings = Settings(budget=budget, seed=seed, hold_out=(HELD_OUT,), threads=threads)
    filmed = synthetic_reference(FISH, hidden_values(), DEMO_FREQUENCIES, _SECONDS, _CAMERA, _HIDDEN_SEED, threads)
    save_reference(filmed, folder / "reference")
    reference = load_reference(folder / "reference")  # as the other commands read it
    outcome = run(
        reference, FISH, settings, folder / "run", source=str(folder / "reference"), resume=resume, sensitivity=True,
        on_progress=on_progress,
    )  # fmt: skip
    return reference, outcome
