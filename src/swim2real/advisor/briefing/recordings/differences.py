"""What differs between recordings and their playbacks, as a person would ask first: where, when, how wide, how fast."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.averages import mean, median

_SLOW = 1e-3  # m/s, below which a speed has no ratio

Trial = Mapping[str, Any]


def differences(trials: Sequence[Trial]) -> dict[str, Any]:
    """The worst trial and marker, ratios, and how differences change within a trial.

    A ratio is simulated to real. What is off in a window of time is the mean difference of places in it, averaged over
    the markers; `halves` are its means over the first and the second half of a trial.

    Args:
        trials: As `trials_of` gives them.
    """
    rows = [_by_trial(trial) for trial in trials]
    markers = [_by_marker([trial["markers"][i] for trial in trials]) for i in range(_count(trials))]
    return {
        "worst_trial": _worst(trials),
        "worst_marker": _worst(markers),
        "other_way": [trial["name"] for trial in trials if _other_way(trial)],
        "by_trial": rows,
        "by_marker": markers,
        "sensors": [_sensor([trial["sensors"][i] for trial in trials]) for i in range(_count(trials, "sensors"))],
        "median": {key: median(row[key] for row in rows) for key in ("amplitude_ratio", "speed_ratio")},
        "halves": [mean(row["halves"][half] for row in rows) for half in (0, 1)],
    }


def off_by_window(trial: Trial) -> list[float | None]:
    """How far the markers are off in each window of time, on average over them [m]."""
    markers = trial["markers"]
    count = len(trial["edges"]) - 1
    return [mean(math.hypot(*found) if (found := one["windows"][w]) else None for one in markers) for w in range(count)]


def _by_trial(trial: Trial) -> dict[str, Any]:
    off, speed = off_by_window(trial), trial["velocity"]
    known = [(w, size) for w, size in enumerate(off) if size is not None]
    worst = max(known, key=lambda pair: pair[1], default=None)
    compared = None not in speed.values() and abs(speed["real"]) >= _SLOW
    half = len(off) // 2
    return {
        "name": trial["name"],
        "worst_marker": _worst(trial["markers"]),
        "worst_time": None if worst is None else [trial["edges"][worst[0]], trial["edges"][worst[0] + 1]],
        "amplitude_ratio": median(one["amplitude"]["ratio"] for one in trial["markers"]),
        "speed_ratio": speed["simulated"] / speed["real"] if compared else None,
        "halves": [mean(off[:half]), mean(off[half:])],
    }


def _by_marker(ones: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A marker over all trials."""
    offsets = [one["offset"] for one in ones if one["offset"] is not None]
    return {
        "name": ones[0]["name"],
        "error": mean(one["error"] for one in ones),
        "amplitude_real": median(one["amplitude"]["real"] for one in ones),
        "amplitude_simulated": median(one["amplitude"]["simulated"] for one in ones),
        "amplitude_ratio": median(one["amplitude"]["ratio"] for one in ones),
        "offset": [sum(parts) / len(offsets) for parts in zip(*offsets, strict=True)] if offsets else None,
    }


def _sensor(ones: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {**{key: ones[0][key] for key in ("name", "unit", "worth")}, "error": mean(one["error"] for one in ones)}


def _other_way(trial: Trial) -> bool:
    real, simulated = trial["velocity"]["real"], trial["velocity"]["simulated"]
    return None not in (real, simulated) and abs(real) >= _SLOW and real * simulated < 0


def _worst(ones: Sequence[Mapping[str, Any]]) -> str | None:
    known = [one for one in ones if one["error"] is not None]
    return max(known, key=lambda one: one["error"])["name"] if known else None


def _count(trials: Sequence[Trial], what: str = "markers") -> int:
    return len(trials[0][what]) if trials else 0
