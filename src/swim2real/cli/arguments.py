"""The commands and their arguments, as typed dataclasses. Help texts are their docstrings.

Nothing heavy is imported here, so that `swim2real --help` is quick.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

Positional = tyro.conf.Positional


@dataclass(frozen=True)
class Calibrate:
    """Find simulator parameters that make simulated swims match real ones.

    Reads a reference (a folder with reference.json, or with published CSVs) and writes a run folder: settings.json,
    record.jsonl (one line an evaluation), best.json (the parameters), outcome.json, swims.npz and report.html. Costs
    under a second an evaluation on two cores. Ctrl-C leaves a usable run; --resume goes on with it.
    """

    reference: Positional[Path]
    """Folder with the real trials."""
    out: Path
    """Run folder to write."""
    method: Literal["line-search", "random", "warm-start"] = "line-search"
    """line-search: an advisor's proposals with backtracking; random; warm-start: one proposal, then random."""
    advisor: str = "physics"
    """Who proposes: 'physics' is built in and needs no key."""
    protocol: Literal["aligned", "paper"] = "aligned"
    """aligned: identified frequency, steady swim, phase, registration, lost tracks left out. paper: none of these."""
    budget: int = 40
    """Simulation evaluations, the first included."""
    seed: int = 0
    """Decides the first point and every random choice."""
    scale: Literal["auto", "log", "linear"] = "auto"
    """Scale of the parameters; auto: linear for protocol paper, log otherwise."""
    max_steps: int = 3
    """Steps of the line search; 1 is the ablation without it."""
    early_stop: bool = False
    """Stop a step's evaluation once it is certain to be rejected. The advisor then sees less of rejected steps."""
    horizon: float = 4.0
    """Seconds of each trial that are compared; 0 for all of it."""
    hold_out: tuple[str, ...] = ()
    """Trials to leave out of the fit and to evaluate on afterwards."""
    sensitivity: bool = False
    """Also measure each parameter's effect on the loss at the end: two evaluations a parameter, outside the budget."""
    resume: bool = False
    """Go on with the run in --out."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores. Results don't depend on it."""
    json: bool = False
    """Print the outcome as JSON."""
    quiet: bool = False
    """Print no progress."""


@dataclass(frozen=True)
class Evaluate:
    """Compare parameters with real trials: every figure, per trial and per marker.

    Reads a run folder or parameters file and a reference; writes nothing. Costs one evaluation, under a second.
    """

    parameters: Positional[Path]
    """Run folder or parameters file; 'published' for the prior work's values."""
    reference: Path
    """Folder with the real trials."""
    protocol: Literal["aligned", "paper"] = "aligned"
    """As for calibrate."""
    horizon: float = 4.0
    """Seconds of each trial that are compared; 0 for all of it."""
    sensitivity: bool = False
    """Also print each parameter's effect on the loss: about 30 more evaluations."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores."""
    json: bool = False
    """Print JSON in SI units."""


@dataclass(frozen=True)
class Quality:
    """Check the tracks of a reference: lost markers, body lengths, and what drove each trial.

    Exits with 1 when a trial shouldn't be used as it is. Calibration leaves lost marker-frames out by itself.
    """

    reference: Positional[Path]
    """Folder with the real trials."""
    plot: Path | None = None
    """Also write an HTML page that shows which marker is lost when."""
    json: bool = False
    """Print JSON."""


@dataclass(frozen=True)
class Simulate:
    """Simulate swims and write the markers' paths.

    Writes an .npz with times (T,) s, frequencies (F,) Hz, markers (F, T, M, 2) m in the world frame and marker_names.
    """

    parameters: Positional[Path]
    """Run folder or parameters file; 'published' for the prior work's values."""
    frequency: tuple[float, ...]
    """Motor frequencies [Hz]."""
    out: Path
    """File to write."""
    seconds: float = 4.0
    """Length of each swim [s]."""
    rate: float = 60.0
    """Samples a second [Hz]."""
    from_rest: bool = False
    """Start from rest with the motor turning; otherwise a steady cycle, from motor angle 0."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores."""


@dataclass(frozen=True)
class Report:
    """Write the report page of a run: one self-contained HTML file that opens without a network."""

    run: Positional[Path]
    """Run folder."""


@dataclass(frozen=True)
class Fetch:
    """Get the eight published marker tracks, check them (sha256) and write a reference folder."""

    to: Path
    """Folder to write."""
    source: Annotated[str | None, tyro.conf.arg(name="from")] = None
    """Folder or URL that holds the CSV files; by default their public repository."""


@dataclass(frozen=True)
class Demo:
    """Run the whole pipeline on an embedded example: no data, no network, no key.

    Simulates a 'real' fish with hidden parameters, a finer time step, camera noise, misplaced markers and a lost track;
    checks the tracks, calibrates, evaluates on a trial that was left out, and writes the report.
    """

    out: Path = Path("demo-out")
    """Folder to write."""
    budget: int = 40
    """Simulation evaluations."""
    seed: int = 0
    """Decides the first point and every random choice."""
    resume: bool = False
    """Go on with an interrupted demo."""
    quiet: bool = False
    """Print no progress."""


Command = Calibrate | Demo | Evaluate | Fetch | Quality | Report | Simulate
