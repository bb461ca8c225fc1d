"""Plain sentences: what differs, and which parameters are held responsible."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.physics.features import Swims
from swim2real.parameters import ParameterSpace

Array = NDArray[np.float64]

_CLOSE = 0.05  # relative difference that isn't worth a word
_NAMED = 5  # parameters that are named in the reasoning
_SMALL = 0.01  # of a parameter's range


def diagnose(frequencies: Array, real: Swims, simulated: Swims, evidence: Mapping[str, Any]) -> str:
    """What differs between simulated and real swims: speed over frequency first, then the beat."""
    order = np.argsort(frequencies)
    speeds = [
        _speed(float(frequencies[i]), float(real.speed[i]), float(simulated.speed[i])) for i in (order[0], order[-1])
    ]
    sentences = [". ".join(speeds[: len(order)]) + "."]
    backward = frequencies[order][simulated.speed[order] < 0]
    forward = simulated.speed > 0
    if 0 < backward.size < len(order):
        sentences.append(
            f"It swims backward at {_listed(backward)} Hz: its thrust has no reserve against what opposes it."
        )
    elif backward.size:
        sentences.append("It swims tail first throughout: what opposes thrust is stronger than lift.")
    if forward.sum() > 1:
        sentences.append(_slope(frequencies[forward], real.speed[forward], simulated.speed[forward]))
    sentences.append(_beat(real, simulated))
    worst = max(evidence["trials"].items(), key=lambda item: item[1]["aligned_marker_error"])
    sentences.append(
        f"The worst trial is {worst[0]} with {1e3 * worst[1]['aligned_marker_error']:.0f} mm, of which shape alone is "
        f"{1e3 * worst[1]['shape_error']:.0f} mm."
    )
    return " ".join(sentences)


def reason(space: ParameterSpace, here: Array, point: Array, gains: Array) -> str:
    """Which parameters are changed, and what each change is expected to bring.

    Args:
        space: On the scale of the points.
        here: Incumbent. Shape (d,).
        point: Proposal. Shape (d,).
        gains: Expected decrease of the loss by each change [m]. Shape (d,).
    """
    before, after = space.to_values(here), space.to_values(point)
    moved = [i for i in np.argsort(-np.abs(gains)) if abs(point[i] - here[i]) > _SMALL]
    if not moved:
        return "No parameter is expected to help by more than a hair."
    parts: list[str] = []
    for i in moved[:_NAMED]:
        name, unit = space.names[i], space.parameters[i].unit.removesuffix("-")
        verb = "raise" if point[i] > here[i] else "lower"
        parts.append(
            f"{verb} {name} from {before[name]:.3g} to {after[name]:.3g} {unit}".rstrip()
            + f" (expected gain {1e3 * gains[i]:.1f} mm)"
        )
    rest = len(moved) - len(parts)
    more = f"; {rest} smaller change{'s' if rest > 1 else ''}" if rest else ""
    lead = space[space.names[moved[0]]].meaning
    return "; ".join(parts)[0].upper() + "; ".join(parts)[1:] + f"{more}. {lead}"


def _speed(frequency: float, real: float, simulated: float) -> str:
    measured = f"At {frequency:.2f} Hz it swims {1e3 * simulated:.0f} mm/s, the real one {1e3 * real:.0f} mm/s"
    if simulated <= 0 or abs(simulated - real) <= _CLOSE * abs(real):
        return measured
    factor = simulated / real
    size = (
        f"{factor:.1f} times too fast"
        if factor >= 2
        else f"{100 * abs(factor - 1):.0f} % too {'fast' if factor > 1 else 'slow'}"
    )
    return f"{measured}: {size}"


def _slope(frequencies: Array, real: Array, simulated: Array) -> str:
    logs = np.log(frequencies)
    steepness = [np.polyfit(logs, np.log(np.maximum(speed, 1e-4)), 1)[0] for speed in (real, simulated)]
    text = f"Speed grows with frequency to the power {steepness[1]:.1f}, in reality {steepness[0]:.1f}"
    if abs(steepness[1] - steepness[0]) < 0.1:
        return text + ", which fits."
    if steepness[1] < steepness[0]:
        return text + ": too much thrust at low frequencies or too much resistance at high ones."
    return text + ": too little thrust at low frequencies or too little resistance at high ones."


def _beat(real: Swims, simulated: Swims) -> str:
    half = real.beat.shape[1] // 2
    sizes = [np.hypot(side.beat[:, half - 1], side.beat[:, -1]) for side in (real, simulated)]
    known = np.isfinite(sizes[0]) & np.isfinite(sizes[1]) & (sizes[0] > 0)
    if not known.any():
        return "The tail tip is lost in all trials, so its beat can't be compared."
    ratio = float(np.mean(sizes[1][known] / sizes[0][known]))
    if abs(ratio - 1) <= _CLOSE:
        return f"The tail tip's amplitude fits ({100 * (ratio - 1):+.0f} %)."
    return f"The tail tip beats {100 * abs(ratio - 1):.0f} % too {'wide' if ratio > 1 else 'narrow'}."


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
