"""What differs between simulated and real trials, as a person would ask: where, when, how wide, how fast; trends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

CLEAR = 0.2  # of the widest beat of a trial: above it a marker's phase isn't ruled by noise
_LEAST_YAW, _LEAST_SWAY = 0.01, 1e-3  # rad and m, below which a swing of the head has no ratio
_SLOW = 1e-3  # m/s, below which a speed has no ratio
_LEAST_SPAN = 0.05  # of the logarithm of frequency, for an exponent
_FIGURES = ("speed_ratio", "amplitude_ratio", "yaw_ratio", "sway_ratio", "lag_real_deg", "lag_simulated_deg")

Trial = Mapping[str, Any]


def differences(trials: Sequence[Trial]) -> dict[str, Any]:
    """Ratios and lags by trial and by marker, the worst ones, and how they change with frequency and within a trial.

    A ratio is simulated to real; the amplitude's is the last marker's in a trial with a beat, the median over the
    markers in another one. A lag says by how many degrees of a beat the last marker is behind the foremost one that
    beats clearly in half of the trials. What is off in a window of time is the mean difference of places in it,
    averaged over the markers; `halves` are its means over the first and the second half of a trial. Medians are over
    trials.

    Args:
        trials: Trials, as `facts.trial_facts` gives them.
    """
    front = foremost(trials)
    rows = [_by_trial(trial, front) for trial in trials]
    names = [marker["name"] for marker in trials[0]["markers"]] if trials else []
    markers = [_by_marker(name, [trial["markers"][i] for trial in trials]) for i, name in enumerate(names)]
    sensors = range(len(trials[0]["sensors"])) if trials else ()
    return {
        "worst_trial": _worst(trials),
        "worst_marker": _worst(markers),
        "other_way": [trial["name"] for trial in trials if _goes_other_way(trial)],
        "lag_from": names[front] if front is not None else None,
        "lag_to": names[-1] if front is not None else None,
        "by_trial": rows,
        "by_marker": markers,
        "sensors": [_by_sensor([trial["sensors"][i] for trial in trials]) for i in sensors],
        "median": {key: median(row[key] for row in rows) for key in _FIGURES},
        "trend": {key: _ends(rows, key) for key in _FIGURES},
        "speed_exponent": {side: _exponent(trials, side) for side in ("real", "simulated")},
        "halves": [mean(row["halves"][half] for row in rows) for half in (0, 1)],
    }


def mean(values: Iterable[float | None]) -> float | None:
    """Mean of those that are known; None where none is."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def median(values: Iterable[float | None]) -> float | None:
    """Median of those that are known; None where none is."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def foremost(trials: Sequence[Trial]) -> int | None:
    """The first marker, before the last, that beats clearly on both sides in half of the trials; None without one."""
    count = len(trials[0]["markers"]) if trials else 0
    for i in range(count - 1):
        if 2 * sum(_beats_clearly(trial["markers"], i) for trial in trials) >= len(trials):
            return i
    return None


def lag(markers: Sequence[Mapping[str, Any]], front: int, side: str) -> float | None:
    """By how much the last marker is behind the one at `front`, summed from marker to marker [deg]."""
    on_the_way = [i for i in range(front, len(markers)) if _beats_clearly(markers, i)]
    if on_the_way[:1] != [front] or on_the_way[-1] != len(markers) - 1:
        return None
    phases = [markers[i]["phase_deg"][side] for i in on_the_way]
    return sum((before - after + 180) % 360 - 180 for before, after in pairwise(phases))


def off_by_window(trial: Trial) -> list[float | None]:
    """How far the markers are off in each window of time, on average over them [m]; empty without windows."""
    count = len(trial["edges"]) - 1 if trial["edges"] else 0
    windows = [marker["windows"] for marker in trial["markers"]]
    return [mean(math.hypot(*own[w]) if own[w] is not None else None for own in windows) for w in range(count)]


def _beats_clearly(markers: Sequence[Mapping[str, Any]], i: int) -> bool:
    if markers[i]["amplitude"]["ratio"] is None or None in markers[i]["phase_deg"].values():
        return False
    widest = {s: max(marker["amplitude"][s] or 0.0 for marker in markers) for s in ("real", "simulated")}
    return all(markers[i]["amplitude"][side] >= CLEAR * most for side, most in widest.items())


def _by_trial(trial: Trial, front: int | None) -> dict[str, Any]:
    speed, markers, off = trial["velocity"], trial["markers"], off_by_window(trial)
    known = [(w, size) for w, size in enumerate(off) if size is not None]
    worst = max(known, key=lambda pair: pair[1], default=None)
    moving = None not in speed.values() and abs(speed["real"]) >= _SLOW
    ratios = [marker["amplitude"]["ratio"] for marker in markers]
    half = len(off) // 2
    return {
        "name": trial["name"],
        "frequency": trial["frequency"],
        "worst_marker": _worst(markers),
        "worst_time": None if worst is None else [trial["edges"][worst[0]], trial["edges"][worst[0] + 1]],
        "speed_ratio": speed["simulated"] / speed["real"] if moving else None,
        "amplitude_ratio": median(ratios) if trial["frequency"] is None else ratios[-1] if ratios else None,
        "yaw_ratio": _swing_ratio(trial["figures"], "yaw", _LEAST_YAW),
        "sway_ratio": _swing_ratio(trial["figures"], "sway", _LEAST_SWAY),
        "lag_real_deg": lag(markers, front, "real") if front is not None else None,
        "lag_simulated_deg": lag(markers, front, "simulated") if front is not None else None,
        "halves": [mean(off[:half]), mean(off[half:])],
    }


def _swing_ratio(figures: Mapping[str, Any], name: str, least: float) -> float | None:
    real, simulated = (figures.get(f"{name}_{side}") for side in ("real", "simulated"))
    return simulated / real if real is not None and simulated is not None and real >= least else None


def _by_marker(name: str, markers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A marker over all trials: medians, since it may be hardly seen in one of them."""
    every = [marker["amplitude"] for marker in markers]
    both = [amplitude for amplitude in every if None not in (amplitude["real"], amplitude["simulated"])]
    offsets = [marker["offset"] for marker in markers if marker["offset"] is not None]
    return {
        "name": name,
        "error": mean(marker["error"] for marker in markers),
        "amplitude_real": median(amplitude["real"] for amplitude in both or every),
        "amplitude_simulated": median(amplitude["simulated"] for amplitude in both or every),
        "amplitude_ratio": median(amplitude["ratio"] for amplitude in every),
        "phase_difference_deg": median(marker["phase_difference_deg"] for marker in markers),
        "offset": [sum(parts) / len(offsets) for parts in zip(*offsets, strict=True)] if offsets else None,
    }


def _by_sensor(readings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    about = {key: readings[0][key] for key in ("name", "unit", "meters_per_unit")}
    return {**about, "error": mean(reading["error"] for reading in readings)}


def _goes_other_way(trial: Trial) -> bool:
    real, simulated = trial["velocity"]["real"], trial["velocity"]["simulated"]
    return None not in (real, simulated) and abs(real) >= _SLOW and real * simulated < 0


def _worst(entries: Sequence[Mapping[str, Any]]) -> str | None:
    known = [entry for entry in entries if entry["error"] is not None]
    return max(known, key=lambda entry: entry["error"])["name"] if known else None


def _ends(rows: Sequence[Mapping[str, Any]], key: str) -> dict[str, float] | None:
    """A figure at the lowest and at the highest frequency that have it."""
    known = [row for row in rows if row[key] is not None and row["frequency"] is not None]
    if len(known) < 2:
        return None
    return {
        "low": known[0][key], "low_frequency": known[0]["frequency"],
        "high": known[-1][key], "high_frequency": known[-1]["frequency"],
    }  # fmt: skip


def _exponent(trials: Sequence[Trial], side: str) -> float | None:
    """Exponent of frequency with which speed grows, over the trials where both robots go forward."""
    forward = [
        trial
        for trial in trials
        if trial["frequency"] is not None and all(v is not None and v >= _SLOW for v in trial["velocity"].values())
    ]
    logs = np.log([trial["frequency"] for trial in forward])
    if len(forward) < 2 or np.ptp(logs) < _LEAST_SPAN:
        return None
    return float(np.polyfit(logs, np.log([trial["velocity"][side] for trial in forward]), 1)[0])
