"""Arguments of the commands that study finished runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

Positional = tyro.conf.Positional


@dataclass(frozen=True)
class Identify:
    """Tell which parameters the trials determine at a run's best fit, and which make up for one another.

    Improves the fit by a few steps, measures its neighborhood, then fixes each parameter at values across its range and
    re-fits the others. Reads a run folder and its reference; writes identifiability.json, and the values at the lowest
    loss as identified.json, into the run folder. Costs up to about 1400 evaluations for the fish's 16 parameters, about
    half of that as a rule: some minutes. Ctrl-C keeps what is done; the same command goes on with it.
    """

    run: Positional[Path]
    """Run folder."""
    reference: Path
    """Folder with the real trials that the run was made with."""
    rise: float = 0.05
    """Rise of the loss that counts, as a share of the lowest."""
    steps: int = 2
    """Steps of each re-fit, three evaluations each."""
    polish: int = 4
    """Steps that improve the run's best fit first, twice; 0 for none."""
    again: bool = False
    """Begin anew even if there is a study."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores. Results don't depend on it."""
    json: bool = False
    """Print JSON in SI units."""
    quiet: bool = False
    """Print no progress."""


@dataclass(frozen=True)
class Ensemble:
    """Gather parameter sets that fit nearly as well as the best, as ranges for domain randomization.

    Reads run folders (records, and studies by identify) and their reference; evaluates more sets around them; writes
    one JSON file with the sets and each parameter's range. Costs --evaluations and two more a parameter.
    """

    runs: Positional[tuple[Path, ...]]
    """Run folders of one robot, protocol and reference."""
    reference: Path
    """Folder with the real trials that the runs were made with."""
    out: Path
    """File to write."""
    within: float = 1.1
    """Highest loss of a member, in multiples of the lowest."""
    count: int = 20
    """Members to keep, spread out."""
    evaluations: int = 200
    """To look for more sets than the runs hold; 0 for none."""
    seed: int = 0
    """Decides every random choice."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores. Results don't depend on it."""
    json: bool = False
    """Print the file's content."""
    quiet: bool = False
    """Print no progress."""
