"""The arguments of `export-sysid` and `import-sysid`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

Positional = tyro.conf.Positional


@dataclass(frozen=True)
class ExportSysid:
    """Write a reference and parameters as files of MuJoCo's own identification toolbox, mujoco.sysid.

    Reads a run folder or parameters file and a reference; writes params_x_0.yaml, the model as MJCF and a .npz a trial.
    docs/mujoco-sysid.md says what goes over and how to go on. Costs a few seconds.
    """

    parameters: Positional[Path]
    """Run folder or parameters file, where an identification is to begin; 'published' for the prior work's values."""
    reference: Path
    """Folder with the real trials."""
    out: Path
    """New folder to write."""
    horizon: float = 4.0
    """Seconds of each trial that are written; 0 for all of it."""
    threads: int = 0
    """Trials simulated at a time; 0 for all cores."""


@dataclass(frozen=True)
class ImportSysid:
    """Make a parameters file of what MuJoCo's identification toolbox has found.

    Names and bounds are checked against the robot's.
    """

    results: Positional[Path]
    """Folder that its save_results wrote, or a YAML file of its parameters."""
    like: Path
    """Run folder or parameters file of the same robot, whose values parameters keep that the toolbox didn't have;
    'published' for the prior work's values."""
    out: Path
    """Parameters file to write."""
