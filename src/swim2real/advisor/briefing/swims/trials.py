"""The swims of an evaluation, marker by marker, as its evidence has them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.averages import without_errors

STILL = 1e-3  # m, below which an amplitude is noise and has neither ratio nor phase
_DEGREES = 180 / math.pi
_ERROR = {"aligned": "aligned_marker_error", "paper": "marker_error"}
_ELSEWHERE = ("frequency", "phase", "velocity_real", "velocity_simulated", "divergence")


def protocol_of(detail: Mapping[str, Any]) -> str:
    """Which figure is the loss."""
    return detail.get("protocol") or "aligned"


def trials_of(detail: Mapping[str, Any], markers: Sequence[str]) -> list[dict[str, Any]]:
    """Every trial that was simulated, by rising frequency.

    Args:
        detail: Evidence of an evaluation.
        markers: Their names.
    """
    found = [_trial(name, one, protocol_of(detail), markers) for name, one in detail.get("trials", {}).items()]
    return sorted(found, key=lambda trial: trial["frequency"])


def wrapped(degrees: float) -> float:
    """An angle from -180 to 180 [deg]."""
    return (degrees + 180) % 360 - 180


def _trial(name: str, content: Mapping[str, Any], protocol: str, markers: Sequence[str]) -> dict[str, Any]:
    """One trial of the incumbent. A diverged simulation has no figures."""
    diverged = content.get("divergence")
    figures = {key: value for key, value in content.items() if not isinstance(value, Mapping | list)}
    known = without_errors(figures) if diverged else figures
    return {
        "name": name,
        "frequency": content["frequency"],
        "diverged": diverged,
        "error": known.get(_ERROR[protocol]),
        "figures": {key: value for key, value in known.items() if key not in _ELSEWHERE},
        "velocity": {
            "real": content.get("velocity_real"), "simulated": None if diverged else content.get("velocity_simulated"),
        },
        "markers": [_marker(i, marker, content, protocol) for i, marker in enumerate(markers)],
    }  # fmt: skip


def _marker(i: int, name: str, content: Mapping[str, Any], protocol: str) -> dict[str, Any]:
    """One marker in one trial: its error and its sideways beat in the body frame.

    Under the paper's protocol the simulation starts at motor angle 0, wherever the real motor stood, so that a
    difference of phases says nothing.
    """
    diverged = bool(content.get("divergence"))
    errors = content.get(f"{_ERROR[protocol]}s")
    shape_errors = content.get("shape_marker_errors")
    sides = {"real": content.get("beat_real"), "simulated": None if diverged else content.get("beat_simulated")}

    def both(quantity: str, factor: float = 1.0) -> dict[str, Any]:
        found = {side: beat[quantity][i] if beat else None for side, beat in sides.items()}
        return {side: None if value is None else factor * value for side, value in found.items()}

    amplitude, phase = both("amplitude"), both("phase", _DEGREES)
    beats = all(value is not None and value >= STILL for value in amplitude.values())
    in_step = beats and protocol == "aligned"
    return {
        "name": name,
        "error": None if diverged or not errors else errors[i],
        "shape_error": None if diverged or not shape_errors else shape_errors[i],
        "amplitude": {**amplitude, "ratio": amplitude["simulated"] / amplitude["real"] if beats else None},
        "phase_deg": phase,
        "phase_difference_deg": wrapped(phase["simulated"] - phase["real"]) if in_step else None,
        "mean": both("mean"),
    }
