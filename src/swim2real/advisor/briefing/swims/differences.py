"""What differs between simulated and real swims, as a person would ask first: speed, amplitude, body wave; trends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from swim2real.advisor.briefing.averages import mean, median
from swim2real.advisor.briefing.swims.trials import STILL, wrapped

CLEAR = 0.1  # of the widest beat of a trial: above it a marker's phase isn't ruled by noise
_SLOW = 1e-3  # m/s, below which a speed has no ratio
_LEAST_SPAN = 0.05  # of the logarithm of frequency, for an exponent
_FIGURES = ("speed_ratio", "amplitude_ratio", "lag_real_deg", "lag_simulated_deg")

Trial = Mapping[str, Any]


def differences(trials: Sequence[Trial]) -> dict[str, Any]:
    """Ratios and lags by trial and by marker, the worst trial, and how they change with frequency.

    A ratio is simulated to real; the amplitude's is the last marker's. A lag says by how many degrees of a beat the
    last marker is behind the foremost one that beats clearly in half of the trials. Medians are over trials.

    Args:
        trials: As `trials_of` gives them.
    """
    front = foremost(trials)
    rows = [_by_trial(trial, front) for trial in trials]
    compared = [trial for trial in trials if trial["error"] is not None]
    worst = max(compared, key=lambda trial: trial["error"], default=None)
    names = [marker["name"] for marker in trials[0]["markers"]] if trials else []
    return {
        "worst_trial": worst["name"] if worst else None,
        "backward": [t["name"] for t in trials if (t["velocity"]["simulated"] or 0) < 0],
        "lag_from": names[front] if front is not None else None,
        "lag_to": names[-1] if front is not None else None,
        "by_trial": rows,
        "by_marker": [_by_marker(i, name, trials) for i, name in enumerate(names)],
        "median": {key: median([row[key] for row in rows]) for key in _FIGURES},
        "trend": {key: _ends(rows, key) for key in _FIGURES},
        "speed_exponent": {side: _exponent(trials, side) for side in ("real", "simulated")},
    }


def foremost(trials: Sequence[Trial]) -> int | None:
    """The first marker, before the last, that beats clearly on both sides in half of the trials; None without one."""
    count = len(trials[0]["markers"]) if trials else 0
    for i in range(count - 1):
        if 2 * sum(_is_clear(trial["markers"], i) for trial in trials) >= len(trials):
            return i
    return None


def lag(markers: Sequence[Mapping[str, Any]], front: int, side: str) -> float | None:
    """By how much the last marker is behind the one at `front`, summed from marker to marker [deg]."""
    on_the_way = [i for i in range(front, len(markers)) if _is_clear(markers, i)]
    if on_the_way[:1] != [front] or on_the_way[-1] != len(markers) - 1:
        return None
    phases = [markers[i]["phase_deg"][side] for i in on_the_way]
    return sum(wrapped(before - after) for before, after in pairwise(phases))


def _is_clear(markers: Sequence[Mapping[str, Any]], i: int) -> bool:
    if markers[i]["amplitude"]["ratio"] is None:
        return False
    widest = {s: max(one["amplitude"][s] or 0.0 for one in markers) for s in ("real", "simulated")}
    return all(markers[i]["amplitude"][side] >= CLEAR * most for side, most in widest.items())


def _by_trial(trial: Trial, front: int | None) -> dict[str, Any]:
    speed = trial["velocity"]
    known = speed["simulated"] is not None and speed["real"] is not None and abs(speed["real"]) >= _SLOW
    lags = {
        f"lag_{side}_deg": lag(trial["markers"], front, side) if front is not None else None
        for side in ("real", "simulated")
    }
    return {
        "name": trial["name"],
        "frequency": trial["frequency"],
        "speed_ratio": speed["simulated"] / speed["real"] if known else None,
        "amplitude_ratio": trial["markers"][-1]["amplitude"]["ratio"] if trial["markers"] else None,
        **lags,
    }


def _by_marker(i: int, name: str, trials: Sequence[Trial]) -> dict[str, Any]:
    """A marker over all trials: medians, since a marker may be hardly seen in one of them."""
    ones = [trial["markers"][i] for trial in trials]
    every = [one["amplitude"] for one in ones]
    both = [amplitude for amplitude in every if None not in (amplitude["real"], amplitude["simulated"])]
    real, simulated = (median([amplitude[side] for amplitude in both or every]) for side in ("real", "simulated"))
    ratio = simulated / real if simulated is not None and real is not None and min(real, simulated) >= STILL else None
    return {
        "name": name,
        "error": mean([one["error"] for one in ones]),
        "amplitude_real": real,
        "amplitude_simulated": simulated,
        "amplitude_ratio": ratio,
        "phase_difference_deg": median([one["phase_difference_deg"] for one in ones]) if ratio else None,
    }


def _ends(rows: Sequence[Mapping[str, Any]], key: str) -> dict[str, float] | None:
    """A figure at the lowest and at the highest frequency that have it."""
    known = [row for row in rows if row[key] is not None]
    if len(known) < 2:
        return None
    return {
        "low": known[0][key], "low_frequency": known[0]["frequency"],
        "high": known[-1][key], "high_frequency": known[-1]["frequency"],
    }  # fmt: skip


def _exponent(trials: Sequence[Trial], side: str) -> float | None:
    """Exponent of frequency with which speed grows, over the trials where both robots swim forward."""
    forward = [t for t in trials if all(v is not None and v >= _SLOW for v in t["velocity"].values())]
    logs = np.log([t["frequency"] for t in forward])
    if len(forward) < 2 or np.ptp(logs) < _LEAST_SPAN:
        return None
    return float(np.polyfit(logs, np.log([t["velocity"][side] for t in forward]), 1)[0])
