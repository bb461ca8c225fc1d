"""What was recorded beside a track, in a reference folder: controls, sensors, and where the joints started."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.errors import TrialError
from swim2real.trials.signals import Signals
from swim2real.trials.tables import read_signals, write_signals
from swim2real.trials.trial import Trial

SIGNALS = ("controls", "sensors")
RECORDED = (*SIGNALS, "start", "start_velocities")
"""Keys of an index's entry."""


def recorded_entry(trial: Trial) -> dict[str, Any]:
    """What an index says of it; nothing where nothing was recorded."""
    starts = {"start": trial.start, "start_velocities": trial.start_velocities}
    return {
        **{kind: _file(trial, kind) for kind, signals in _signals(trial).items() if signals is not None},
        **{key: dict(start) for key, start in starts.items() if start},
    }


def recorded_tables(trial: Trial) -> dict[str, Callable[[Path], None]]:
    """What writes its tables, by the name of the file."""
    return {
        _file(trial, kind): partial(write_signals, signals)
        for kind, signals in _signals(trial).items()
        if signals is not None
    }


def with_recorded(trial: Trial, entry: Mapping[str, Any], folder: Path, index: Path) -> Trial:
    """The trial with what its entry says was recorded beside it.

    Raises:
        TrialError: A table isn't there or can't be read, or a start isn't numbers of joints.
    """
    return replace(
        trial,
        controls=_read(trial, "controls", entry, folder, index),
        sensors=_read(trial, "sensors", entry, folder, index),
        start=_start(trial, "start", entry, index),
        start_velocities=_start(trial, "start_velocities", entry, index),
    )


def _signals(trial: Trial) -> dict[str, Signals | None]:
    return {"controls": trial.controls, "sensors": trial.sensors}


def _file(trial: Trial, kind: str) -> str:
    return f"{trial.name}.{kind}.csv"


def _read(trial: Trial, kind: str, entry: Mapping[str, Any], folder: Path, index: Path) -> Signals | None:
    if kind not in entry:
        return None
    table = folder / str(entry[kind])
    if not table.is_file() or table.parent != folder:
        raise TrialError(f"{index}: {kind} '{entry[kind]}' of trial '{trial.name}' is not in {folder}")
    return read_signals(table)


def _start(trial: Trial, key: str, entry: Mapping[str, Any], index: Path) -> dict[str, float]:
    given = entry.get(key, {})
    if not isinstance(given, dict) or not all(_is_number(value) for value in given.values()):
        raise TrialError(f"{index}: {key} of trial '{trial.name}' is {given!r}; it must map names of joints to numbers")
    return {str(joint): float(value) for joint, value in given.items()}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
