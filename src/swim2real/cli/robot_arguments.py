"""Arguments of the commands about robot files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

Positional = tyro.conf.Positional


@dataclass(frozen=True)
class Init:
    """Write a robot file for an MJCF model: markers, what drives a trial, and candidates of what to calibrate.

    Reads the model and moves it for 2 s with each candidate at both bounds; what no camera would see is written as a
    comment, and so is what is better weighed or looked up. Edit the file, then: swim2real check ROBOT.toml.
    """

    model: Positional[Path]
    """MJCF file."""
    out: Path | None = None
    """Robot file to write; by default beside the model."""
    force: bool = False
    """Write over a file that is there."""


@dataclass(frozen=True)
class Check:
    """Check a robot: what each parameter writes and moves, its markers, and what drives a trial.

    Simulates 2 s with each parameter at both bounds, and draws a map of the markers. Exits with 1 when a parameter
    changes nothing, the model doesn't compile at a bound, or the trials of --reference don't fit. Costs some seconds.
    """

    robot: Positional[str]
    """Robot file, or the name of a robot: fish, fish-extended."""
    reference: Path | None = None
    """Folder with real trials, whose controls are used; otherwise the robot is moved by made-up ones."""
    out: Path | None = None
    """Picture of the markers to write (PNG); by default beside the robot file."""
    threads: int = 0
    """Simulations at a time; 0 for all cores. Results don't depend on it."""


@dataclass(frozen=True)
class ExportModel:
    """Write the calibrated simulator as one MJCF file, for any program that loads MuJoCo models.

    Reads a run folder or parameters file. The markers' sensors are in the model; meshes and textures stay where they
    are. Numbers are as exact as MuJoCo writes them, which is told.
    """

    parameters: Positional[Path]
    """Run folder or parameters file; 'published' for the prior work's values."""
    out: Path
    """MJCF file to write (.xml)."""
