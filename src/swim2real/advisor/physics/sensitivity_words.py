"""Plain sentences on measured sensitivities: what the residual answers to, and what it can't tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.physics.unseen import Unseen
from swim2real.parameters import ParameterSpace

Array = NDArray[np.float64]

_NAMED = 3  # parameters that the residual answers to most
_ALIKE = 1.25  # two changes whose ratio is less may be the same
_NUDGE = 1e-4  # of the cube


def diagnose(
    space: ParameterSpace, place: Array, loss: float, effects: Array, blind: Sequence[Unseen], evidence: Any
) -> str:
    """How far off the simulation is, and which parameters the trials tell.

    Args:
        space: On the scale of the place.
        place: Where the effects were measured. Shape (d,).
        loss: Of the incumbent [m].
        effects: By how much each parameter changes the residual over its whole range [m]. Shape (d,).
        blind: Directions that aren't seen.
        evidence: Of the incumbent; the worst trial is read from it, where it has any.
    """
    alone = {one.members[0] for one in blind if len(one.members) == 1}
    order = [int(i) for i in np.argsort(-effects, kind="stable") if i not in alone]
    sentences = [f"The simulation is {1e3 * loss:.3g} mm off.", *_worst(evidence)]
    if order:
        told = [f"{space.names[i]} ({1e3 * effects[i]:.3g} mm over its range)" for i in order[:_NAMED]]
        sentences.append(f"The error answers most to {listed(told)}.")
    if alone:
        names = listed([space.names[i] for i in sorted(alone)])
        sentences.append(
            f"It hardly answers to {names}: these trials don't tell {'it' if len(alone) == 1 else 'them'} so far."
        )
    return " ".join(sentences + [_combination(space, place, one) for one in blind if len(one.members) > 1])


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


def _combination(space: ParameterSpace, place: Array, one: Unseen) -> str:
    names = listed([space.names[i] for i in one.members])
    kind = _kind(space, place, one) if len(one.members) == 2 else None
    return f"Of {names} only {f'the {kind}' if kind else 'a combination'} is seen."


def _kind(space: ParameterSpace, place: Array, one: Unseen) -> str | None:
    """What of two parameters stays the same along an unseen direction; None if nothing simple does."""
    members, there = list(one.members), np.clip(place, _NUDGE, 1 - _NUDGE)
    slopes = space.to_array(there + _NUDGE) - space.to_array(there - _NUDGE)
    changes = slopes[members] * one.direction
    values = space.to_array(there)[members]
    opposite = changes[0] * changes[1] < 0
    unlike = {}
    if len({space.parameters[i].unit for i in members}) == 1:
        unlike["sum" if opposite else "difference"] = _unlike(changes)
    if np.all(values != 0):
        unlike["product" if opposite else "ratio"] = _unlike(changes / values)
    kind = min(unlike, key=lambda one: unlike[one], default=None)
    return kind if kind is not None and unlike[kind] <= _ALIKE else None


def _unlike(pair: Array) -> float:
    """How many times as large one is as the other."""
    small, large = np.sort(np.abs(pair))
    return float(large / small) if small > 0 else np.inf
