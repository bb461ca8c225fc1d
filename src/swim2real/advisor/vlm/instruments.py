"""Instruments that a reply may ask: predictions, solved steps and effects, from a local model, without an evaluation.

They say what they don't know, and how well they have predicted the last evaluations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from swim2real.formatting import listed
from swim2real.optimizers import Evaluation, Situation
from swim2real.optimizers.local_model import RADIUS, LocalModel
from swim2real.parameters import ParameterSpace
from swimbase.arrays import Array
from swimbase.errors import OptimizerError

MOST_ASKED = 4  # times in a turn
_KNOWN = 0.5  # share of a parameter's effect that evaluations tell of, below which it counts as unknown
_LATELY, _FEWEST = 3, 3  # evaluations that are looked back on, and that a model is made of at least
_WRONG, _SHRINK = 2.0, 0.5  # standard deviations that count as wrong; of the radius, after three wrong in a row
_EFFECT = 0.1  # of a parameter's range, over which effects are shown
_LARGEST = 8  # changes of a solved step that are listed
_MOVED = 1e-3  # of a range, below which nothing was changed


class Inquiry(Protocol):
    """The questions of a reply: values to predict, parameters to solve along, whether to show effects."""

    @property
    def predict(self) -> bool: ...
    @property
    def solve(self) -> tuple[str, ...]: ...
    @property
    def radius(self) -> float | None: ...
    @property
    def effects(self) -> bool: ...
    def point(self, space: ParameterSpace, incumbent: Array) -> Array: ...


def answers(inquiry: Inquiry, situation: Situation, space: ParameterSpace) -> str:
    """The answers of all instruments that are asked, as Markdown.

    Args:
        inquiry: What is asked.
        situation: Situation of the run, whose evaluations have their residuals.
        space: Parameters, on the scale of the run.
    """
    try:
        model = LocalModel(situation.evaluations)
    except OptimizerError:
        model = None
    if model is None or not model.forward:
        return (
            "## Instruments\n\nThere is no local model yet: it takes two evaluations in which all trials go forward. "
            "Propose or probe; that costs an evaluation each."
        )
    seen = _looked_back(situation.evaluations)
    wrong = len(seen) == _LATELY and all(abs(one) > _WRONG for one in seen)
    parts = [f"## Instruments\n\nA linear model about the best point, {_mm(model.base.loss)}. {_told(seen, wrong)}"]
    if inquiry.predict:
        here = situation.incumbent.candidate.point
        parts.append(f"**predict**: {_predicted(model, inquiry.point(space, here), space)}")
    if inquiry.solve:
        parts.append(f"**solve**: {_solved(model, inquiry.solve, inquiry.radius, wrong, space)}")
    if inquiry.effects:
        parts.append(f"**effects**, raised by a tenth of the range:\n\n{_effects(model, space)}")
    return "\n\n".join(parts)


def _looked_back(evaluations: Sequence[Evaluation]) -> list[float]:
    """By how many standard deviations each of the last evaluations missed what the model before it expected."""
    missed: list[float] = []
    for count in range(len(evaluations) - 1, _FEWEST - 1, -1):
        made = evaluations[count]
        if len(missed) == _LATELY:
            break
        if made.failed or not made.stages:
            continue
        try:
            expected = LocalModel(evaluations[:count]).predict(made.candidate.point)
        except OptimizerError:
            break
        missed.append((made.loss - expected.loss) / max(expected.std, 1e-9))
    return missed


def _told(missed: Sequence[float], wrong: bool) -> str:
    if not missed:
        return "It has predicted nothing yet."
    off = ", ".join(f"{one:+.1f}" for one in missed)
    more = " It has been wrong three times running: trust small steps only, or measure." if wrong else ""
    return f"It missed the last evaluations, the newest first, by {off} of its own standard deviations.{more}"


def _predicted(model: LocalModel, point: Array, space: ParameterSpace) -> str:
    expected, here = model.predict(point), model.base.candidate.point
    moved = np.abs(point - here) > _MOVED
    unknown = [name for i, name in enumerate(space.names) if moved[i] and model.known[i] < _KNOWN]
    parts = [f"a loss of {_mm(expected.loss)} ± {1e3 * expected.std:.1f}"]
    if expected.margins.size:
        least = int(np.argmin(expected.margins))
        parts.append(
            f"the slowest first beats at {1e3 * expected.margins[least]:.0f} ± "
            f"{1e3 * expected.margin_stds[least]:.0f} mm/s (now {1e3 * model.base.margins.min():.0f}; a trial turns "
            f"around near 0)"
        )
    text = "; ".join(parts) + f". {expected.known:.0%} of the way there is known."
    return text + (f" Nobody has tried {listed(unknown)}; measuring costs an evaluation each." if unknown else "")


def _solved(
    model: LocalModel, names: Sequence[str], radius: float | None, wrong: bool, space: ParameterSpace
) -> str:  # fmt: skip
    free = np.array([name in names for name in space.names])
    unknown = [name for i, name in enumerate(space.names) if free[i] and model.known[i] < _KNOWN]
    reach = (RADIUS if radius is None else radius) * (_SHRINK if wrong else 1.0)
    point, here = model.solve(reach, free), model.base.candidate.point
    old, new = space.to_values(here), space.to_values(point)
    order = [i for i in np.argsort(-np.abs(point - here)) if abs(point[i] - here[i]) > _MOVED]
    if not order:
        hint = f"; nobody has moved {listed(unknown)}, which measuring shows, at an evaluation each" if unknown else ""
        return f"no step along these, at most {reach:.2g} of each range, promises anything{hint}."
    moved = [space.names[i] for i in order[:_LARGEST]]
    values = ", ".join(f"{name} {old[name]:.4g} → {new[name]:.4g}" for name in moved)
    rest = f", and {len(order) - _LARGEST} smaller changes" if len(order) > _LARGEST else ""
    return f"at most {reach:.2g} of each range, {values}{rest}. Expected: {_predicted(model, point, space)}"


def _effects(model: LocalModel, space: ParameterSpace) -> str:
    """A row for each parameter whose effect is known, and the names of the others."""
    here, rows, unknown = model.base.candidate.point, list[str](), list[str]()
    for i, name in enumerate(space.names):
        if model.known[i] < _KNOWN:
            unknown.append(name)
            continue
        raised = here.copy()
        raised[i] += _EFFECT  # beyond a bound, too: a slope
        expected = model.predict(raised)
        beats = f"{1e3 * (expected.margins - model.base.margins).min():+.0f}" if expected.margins.size else "n/a"
        rows.append(f"| {name} | {1e3 * (expected.loss - model.base.loss):+.1f} | {1e3 * expected.std:.1f} | {beats} |")
    head = ["| parameter | loss mm | ± | first beats mm/s |", "|---|---|---|---|"]
    table = [*head, *rows] if rows else ["None is known."]
    return "\n".join(table) + (f"\n\nNot known: {listed(unknown, len(unknown))}." if unknown else "")


def _mm(loss: float) -> str:
    return f"{1e3 * loss:.1f} mm"
