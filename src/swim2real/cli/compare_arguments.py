"""The arguments of `compare`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from swim2real.cli.vlm_arguments import Vlm


@dataclass(frozen=True)
class Compare:
    """Run methods against methods: each with every seed, under every protocol, with one budget.

    Reads a reference; writes a folder with plan.json, a run folder for each run, results.json (all that tables and
    figures need) and results.csv (a line a run). Costs about 15 s a run on one core, and more for methods that think.
    Ctrl-C leaves everything usable; the same command goes on. With more methods, seeds or protocols, or a higher
    budget, it adds to what is there. Exits with 1 when a run failed; the others are done nevertheless.
    """

    reference: tyro.conf.Positional[Path]
    """Folder with the real trials."""
    out: Path
    """Folder to write."""
    robot: Annotated[str, tyro.conf.arg(aliases=["--parameters"])] = "fish"
    """As for calibrate: fish, fish-extended, or a robot file."""
    methods: tuple[str, ...] = ()
    """random, cma-es, bayesopt, least-squares, mujoco-sysid, staged, line-search (with the physics advisor),
    no-line-search (its ablation), warm-start; line-search@ADVISOR, no-line-search@ADVISOR and warm-start@ADVISOR for
    other advisors, as line-search@google:MODEL or line-search@replay:RUN. By default all but mujoco-sysid and
    warm-start, and but staged for a robot without stages."""
    seeds: tuple[str, ...] = ("0:5",)
    """Numbers, and ranges without their end: 0:5 is 0 1 2 3 4."""
    budget: int = 40
    """Simulation evaluations of a run, the first included."""
    protocols: tuple[Literal["aligned", "paper"], ...] = ()
    """As for calibrate; by default both. Recordings have but one."""
    start: Literal["speed", "rest"] = "speed"
    """As for calibrate: where steady swims begin under protocol aligned."""
    scale: tuple[Literal["auto", "log", "linear"], ...] = ("auto",)
    """Scales of the parameters, each a contestant of its own; auto: linear under protocol paper, log otherwise.
    METHOD+log and METHOD+linear choose it for one method."""
    leave_one_out: bool = False
    """Also run every method and seed once for each trial, with it left out of the fit, and evaluate on it."""
    horizon: float = 4.0
    """Seconds of each trial that are compared; 0 for all of it."""
    vlm: Vlm = field(default_factory=Vlm)
    workers: int = 0
    """Runs at a time on this machine; 0 for as many as there are cores."""
    cluster: str | None = None
    """Instead of --workers, a Dask cluster: the address of its scheduler (tcp://HOST:PORT), or local:N. Its workers
    need this version of swim2real and must see --out at the same path. Results don't depend on who does the work."""
    json: bool = False
    """Print the results as JSON."""
    quiet: bool = False
    """Print no progress."""
