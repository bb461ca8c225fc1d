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
_ALIKE = 1.25  # two changes whose ratio is less are the same
_NUDGE = 1e-4  # of the cube


def diagnose(
    space: ParameterSpace, point: Array, loss: float, effects: Array, blind: Sequence[Unseen], evidence: Any
) -> str:
    """How far off the simulation is, and which parameters the trials tell.

    Args:
        space: On the scale of the point.
        point: Incumbent. Shape (d,).
        loss: There [m].
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
            f"It hardly answers to {names}: these trials can't tell {'it' if len(alone) == 1 else 'them'}."
        )
    return " ".join(sentences + [_combination(space, point, one) for one in blind if len(one.members) > 1])


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


def _combination(space: ParameterSpace, point: Array, one: Unseen) -> str:
    names = listed([space.names[i] for i in one.members])
    kind = _kind(space, point, one) if len(one.members) == 2 else None
    return f"Of {names} only {f'the {kind}' if kind else 'a combination'} is seen."


def _kind(space: ParameterSpace, point: Array, one: Unseen) -> str | None:
    """What of two parameters stays the same along an unseen direction; None if nothing simple does."""
    members, there = list(one.members), np.clip(point, _NUDGE, 1 - _NUDGE)
    slopes = space.to_array(there + _NUDGE) - space.to_array(there - _NUDGE)
    changes = slopes[members] * one.direction
    values = space.to_array(there)[members]
    opposite = changes[0] * changes[1] < 0
    units = {space.parameters[i].unit for i in members}
    alike = len(units) == 1 and _same(changes)
    if alike and opposite:
        return "sum"
    if np.all(values != 0) and _same(changes / values):
        return "product" if opposite else "ratio"
    return "difference" if alike else None


def _same(pair: Array) -> bool:
    small, large = np.sort(np.abs(pair))
    return bool(0 < large <= _ALIKE * small)
