"""Provenance of a result, which distinguishes it from others: versions, commit, a fingerprint of the reference."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from importlib import metadata
from pathlib import Path

import numpy as np

from swim2real.trials import TrialSet

_PACKAGES = ("swim2real", "numpy", "scipy", "mujoco", "numba")


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on."""
    found = {name: _version(name) for name in _PACKAGES}
    return {**found, "python": platform.python_version(), "machine": platform.machine()}


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # numba: slower without it
        return "not installed"


def commit() -> str | None:
    """Commit of the checkout that this code runs from; None when it is installed otherwise."""
    here = Path(__file__).resolve().parent
    try:
        top = subprocess.run(
            ["git", "-C", str(here), "rev-parse", "--show-toplevel"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        ).stdout.strip()
        if not (Path(top) / "src" / "swim2real").is_dir():
            return None
        found = subprocess.run(
            ["git", "-C", str(here), "describe", "--always", "--dirty", "--abbrev=12"],
            capture_output=True, text=True, timeout=5, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip() or None


def reference_fingerprint(reference: TrialSet) -> str:
    """sha256 over a reference: names, time stamps, positions, confidences, and what was recorded beside them."""
    digest = hashlib.sha256()
    for trial in reference:
        digest.update(trial.name.encode())
        digest.update(repr(trial.nominal_frequency).encode())
        for array in (trial.track.times, trial.track.positions, trial.track.confidence):
            digest.update(np.ascontiguousarray(array).tobytes())
        for kind, signals in (("controls", trial.controls), ("sensors", trial.sensors)):
            if signals is not None:
                digest.update(repr((kind, signals.names)).encode())
                digest.update(signals.times.tobytes() + signals.values.tobytes())
        if trial.start or trial.start_velocities:
            digest.update(repr((sorted(trial.start.items()), sorted(trial.start_velocities.items()))).encode())
    return digest.hexdigest()
