"""Provenance of a result, which distinguishes it from others: versions, commit, a fingerprint of the reference."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

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


def made_by(*libraries: str) -> Mapping[str, Any]:
    """Versions, commit and time for the file of a result made now; with the versions of further libraries."""
    return {
        "versions": versions() | {name: metadata.version(name) for name in libraries}, "commit": _commit(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip


def _commit() -> str | None:
    """Commit of the checkout that this code runs from; None when it is installed otherwise."""
    try:
        if not (Path(_git("rev-parse", "--show-toplevel")) / "src" / "swim2real").is_dir():
            return None
        return _git("describe", "--always", "--dirty", "--abbrev=12") or None
    except (OSError, subprocess.SubprocessError):
        return None


def _git(*words: str) -> str:
    command = ["git", "-C", str(Path(__file__).resolve().parent), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=5, check=True).stdout.strip()


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
