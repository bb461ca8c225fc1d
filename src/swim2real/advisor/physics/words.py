"""Plain sentences of both physics advisors: what differs, what the trials tell, and which parameters are changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.physics.model import Swims
from swim2real.advisor.physics.sensitivities import Unidentified
from swim2real.parameters import ParameterSpace

Array = NDArray[np.float64]

_CLOSE = 0.05  # relative difference that isn't worth a word
_NAMED = 5  # parameters that are named in the reasoning
_MOST_SENSITIVE = 3  # parameters that the residual answers to most
_ALIKE = 1.25  # two changes whose ratio is less may be the same
_NUDGE = 1e-4  # of the cube
_SMALL = 0.01  # of a parameter's range


def diagnose_swims(frequencies: Array, real: Swims, simulated: Swims, evidence: Mapping[str, Any]) -> str:
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
        space: Parameters, on the scale of the points.
        here: Point of the incumbent. Shape (d,).
        point: Point that is proposed. Shape (d,).
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


def diagnose_sensitivities(
    space: ParameterSpace,
    place: Array,
    loss: float,
    effects: Array,
    unidentified: Sequence[Unidentified],
    evidence: Any,
) -> str:
    """How far off the simulation is, and which parameters the trials identify.

    Args:
        space: On the scale of the place.
        place: Where the effects were measured. Shape (d,).
        loss: Loss of the incumbent [m].
        effects: Change of the residual over each parameter's whole range [m]. Shape (d,).
        unidentified: Directions in which the trials tell nothing.
        evidence: Evidence of the incumbent. The worst trial is read from it, where it has any.
    """
    alone = {direction.members[0] for direction in unidentified if len(direction.members) == 1}
    order = [int(i) for i in np.argsort(-effects, kind="stable") if i not in alone]
    sentences = [f"The simulation is {1e3 * loss:.3g} mm off.", *_worst(evidence)]
    if order:
        effective = [f"{space.names[i]} ({1e3 * effects[i]:.3g} mm over its range)" for i in order[:_MOST_SENSITIVE]]
        sentences.append(f"The error answers most to {listed(effective)}.")
    if alone:
        names = listed([space.names[i] for i in sorted(alone)])
        sentences.append(
            f"It hardly answers to {names}: these trials don't tell {'it' if len(alone) == 1 else 'them'} so far."
        )
    combinations = [_combination(space, place, direction) for direction in unidentified if len(direction.members) > 1]
    return " ".join(sentences + combinations)


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: `a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _worst(evidence: Any) -> list[str]:
    trials: Any = evidence.get("trials") if isinstance(evidence, Mapping) else None
    if not isinstance(trials, Mapping) or len(trials) < 2:
        return []
    errors = {str(name): trial.get("loss", trial.get("aligned_marker_error")) for name, trial in trials.items()}
    known = {name: error for name, error in errors.items() if error is not None}
    if not known:
        return []
    worst = max(known, key=lambda name: known[name])
    return [f"The worst trial is {worst} with {1e3 * known[worst]:.3g} mm."]


def _combination(space: ParameterSpace, place: Array, direction: Unidentified) -> str:
    names = listed([space.names[i] for i in direction.members])
    kind = _kind(space, place, direction) if len(direction.members) == 2 else None
    return f"Of {names} only {f'the {kind}' if kind else 'a combination'} is seen."


def _kind(space: ParameterSpace, place: Array, direction: Unidentified) -> str | None:
    """What of two parameters stays the same along an unidentified direction; None if nothing simple does."""
    members, there = list(direction.members), np.clip(place, _NUDGE, 1 - _NUDGE)
    slopes = space.to_array(there + _NUDGE) - space.to_array(there - _NUDGE)
    changes = slopes[members] * direction.changes
    values = space.to_array(there)[members]
    opposite = changes[0] * changes[1] < 0
    unlike = {}
    if len({space.parameters[i].unit for i in members}) == 1:
        unlike["sum" if opposite else "difference"] = _unlike(changes)
    if np.all(values != 0):
        unlike["product" if opposite else "ratio"] = _unlike(changes / values)
    kind = min(unlike, key=lambda name: unlike[name], default=None)
    return kind if kind is not None and unlike[kind] <= _ALIKE else None


def _unlike(pair: Array) -> float:
    """How many times as large one is as the other."""
    small, large = np.sort(np.abs(pair))
    return float(large / small) if small > 0 else np.inf
