"""The recordings of an evaluation, marker by marker and window by window, as its evidence has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.averages import without_errors
from swim2real.robots.robot import Sensor

MOVING = 0.05  # of the widest real amplitude of a trial: below it a marker's amplitude is noise and has no ratio
_ELSEWHERE = ("loss", "velocity_real", "velocity_simulated", "sensor_errors", "divergence")


def trials_of(detail: Mapping[str, Any], markers: Sequence[str], sensors: Sequence[Sensor]) -> list[dict[str, Any]]:
    """Every trial that was simulated, in the order of the reference.

    Args:
        detail: Evidence of an evaluation.
        markers: Their names.
        sensors: That are compared.
    """
    return [_trial(name, one, markers, sensors) for name, one in detail.get("trials", {}).items()]


def _trial(name: str, content: Mapping[str, Any], markers: Sequence[str], sensors: Sequence[Sensor]) -> dict[str, Any]:
    """One trial. A diverged simulation has no figures."""
    diverged = content.get("divergence")
    figures = {key: value for key, value in content.items() if not isinstance(value, Mapping | list)}
    known = without_errors(figures) if diverged else figures
    windows, errors = content["windows"], content.get("sensor_errors", {})
    widest = max((one for one in content["amplitude_real"] if one is not None), default=0.0)
    return {
        "name": name,
        "diverged": diverged,
        "error": known["loss"],
        "figures": {key: value for key, value in known.items() if key not in _ELSEWHERE},
        "velocity": {side: known.get(f"velocity_{side}") for side in ("real", "simulated")},
        "edges": windows["edges"],
        "markers": [_marker(i, marker, content, widest) for i, marker in enumerate(markers)],
        "sensors": [
            {
                "name": one.name, "unit": one.unit, "worth": one.meters_per_unit, "error": errors.get(one.name),
                "windows": windows["sensors"].get(one.name),
            }
            for one in sensors
        ],
    }  # fmt: skip


def _marker(i: int, name: str, content: Mapping[str, Any], widest: float) -> dict[str, Any]:
    """One marker in one trial: its error, how far it moves, and by how much it is off on average and over time."""
    diverged = bool(content.get("divergence"))
    real: float | None = content["amplitude_real"][i]
    simulated: float | None = None if diverged else content["amplitude_simulated"][i]
    ratio = None
    if real is not None and simulated is not None and 0 < real >= MOVING * widest:
        ratio = simulated / real
    return {
        "name": name,
        "error": None if diverged else content["aligned_marker_errors"][i],
        "amplitude": {"real": real, "simulated": simulated, "ratio": ratio},
        "offset": _whole(content["offset"][i]),
        "windows": [_whole(window[i]) for window in content["windows"]["markers"]],
    }


def _whole(vector: Sequence[float | None]) -> list[float] | None:
    known = [part for part in vector if part is not None]
    return known if len(known) == len(vector) else None
