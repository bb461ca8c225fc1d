"""Instruments that a reply may ask: predictions, solved steps and effects, from a local model, without an evaluation.

They say what they don't know, and how well they have predicted the last evaluations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from swim2real.advisor.briefing.facts import EvaluationFacts
from swim2real.advisor.briefing.texts import number, table
from swim2real.advisor.physics.model import expected_slopes
from swim2real.formatting import listed
from swim2real.optimizers import Evaluation, Situation
from swim2real.optimizers.local_model import RADIUS, LocalModel
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot
from swimbase.arrays import Array, Mask
from swimbase.errors import OptimizerError

MOST_ASKED = 4  # times in a turn
_KNOWN = 0.5  # share of a parameter's effect that evaluations tell of, below which it counts as unknown
_LATELY = 3  # evaluations that are looked back on
_WRONG, _SHRINK = 2.0, 0.5  # standard deviations that count as wrong; of the radius, after three wrong in a row
_EFFECT = 0.1  # of a parameter's range, over which effects are shown
_LARGEST = 8  # parameters of which little is known that are listed
_MOVED = 1e-3  # of a range, below which nothing was changed
_PARTS = ("progress", "shape", "recoil")


class Inquiry(Protocol):
    """The questions of a reply: values to predict, what to solve for, whether to show effects."""

    @property
    def predict(self) -> bool: ...
    @property
    def solve(self) -> tuple[str, ...]: ...
    @property
    def weigh(self) -> Mapping[str, float]: ...
    @property
    def radius(self) -> float | None: ...
    @property
    def effects(self) -> bool: ...
    def point(self, space: ParameterSpace, incumbent: Array) -> Array: ...


class Instruments:
    """Answers of the local model of a run of a robot's calibration."""

    def __init__(self, robot: Robot, space: ParameterSpace) -> None:
        """Prepares the instruments.

        Args:
            robot: The robot whose simulator is calibrated.
            space: Its parameters, on the run's scale.
        """
        self._robot, self._space, self._slopes = robot, space, expected_slopes(robot, space)

    def answers(self, inquiry: Inquiry, situation: Situation) -> str:
        """The answers of all instruments that are asked, as Markdown.

        Args:
            inquiry: What is asked.
            situation: Situation of the run, whose evaluations have their residuals.
        """
        try:
            model = LocalModel(situation.evaluations, self._slopes, base=situation.incumbent)
        except OptimizerError:
            model = None
        if model is None or not model.forward:
            return (
                "## Instruments\n\nThere is no local model yet: it takes four evaluations in which all trials go "
                "forward. Propose or probe; that costs an evaluation each."
            )
        seen = _looked_back(situation.evaluations, self._slopes)
        wrong = len(seen) == _LATELY and all(one.missed > _WRONG for one in seen)
        parts = [
            f"## Instruments\n\nA local model about the current point, {_mm(model.base.loss)}. {_told(seen, wrong)}"
        ]
        if inquiry.predict:
            here = situation.incumbent.candidate.point
            parts.append(f"**predict**: {self._predicted(model, inquiry.point(self._space, here))}")
        if inquiry.solve:
            parts.append(f"**solve**: {self._solved(model, inquiry, situation, wrong)}")
        if inquiry.effects:
            parts.append(f"**effects**, raised by a tenth of the range:\n\n{effects_table(model, self._space)}")
        return "\n\n".join(parts)

    def _unknown(self, model: LocalModel, among: Mask) -> list[str]:
        return [name for i, name in enumerate(self._space.names) if among[i] and model.known[i] < _KNOWN]

    def _predicted(self, model: LocalModel, point: Array) -> str:
        expected, here = model.predict(point), model.base.candidate.point
        parts = [f"a loss of {_mm(expected.loss)} ± {1e3 * expected.std:.1f}, of which what isn't known is a part"]
        if expected.margins.size:
            least = int(np.argmin(expected.margins))
            parts.append(
                f"the slowest first beats at {1e3 * expected.margins[least]:.0f} ± "
                f"{1e3 * expected.margin_stds[least]:.0f} mm/s (now {1e3 * model.base.margins.min():.0f}; a trial "
                f"turns around near 0)"
            )
        text = "; ".join(parts) + f". {expected.known:.0%} of the way there is known."
        unknown = self._unknown(model, np.abs(point - here) > _MOVED)
        text += f" Little is known of {listed(unknown)}: {_cost(unknown)}." if unknown else ""
        return "\n\n".join([text, *self._by_trial(model, point)])

    def _by_trial(self, model: LocalModel, point: Array) -> list[str]:
        """A table with a row per trial of what is expected; none of what has no figures."""
        if not model.base.detail:
            return []
        here = EvaluationFacts.of(model.base, self._robot).trials
        sizes, squares = model.sizes(point), np.zeros((2, len(here)))
        errors: dict[str, list[float | None]] = {}
        names = [trial.name for trial in here]
        for (trial, part, _), size in zip(model.base.parts, sizes, strict=True):
            if trial in names and part in _PARTS:
                i = names.index(trial)
                now: float | None = getattr(here[i].figures, f"{part}_error")
                errors.setdefault(part, [None] * len(here))[i] = None if now is None else now * size
                squares += np.eye(len(here))[i] * (np.nan if now is None else now) ** 2 * np.array([[1.0], [size**2]])
        columns = ["trial", "error mm", *(f"{part} mm" for part in _PARTS if part in errors)]
        rows = [[trial.name] for trial in here]
        grown = np.sqrt(squares[1] / np.maximum(squares[0], 1e-12))
        for i, trial in enumerate(here):
            whole = None if trial.error is None or not squares[0, i] > 0 else trial.error * grown[i]
            rows[i] += [number(whole, 1, 1e3), *(number(errors[p][i], 1, 1e3) for p in _PARTS if p in errors)]
        means, stds = model.expect(point, lambda one: _figures(one, self._robot))
        for (heading, digits), mean, std in zip(_FIGURES.items(), means.T, stds.T, strict=True):
            if not np.isfinite(mean).any():
                continue
            columns.append(heading)
            for row, value, unsure in zip(rows, mean, std, strict=True):
                row.append(f"{value:.{digits}f} ± {unsure:.{digits}f}" if np.isfinite(value) else "n/a")
        return [table(columns, rows)] if len(columns) > 2 else []

    def _solved(self, model: LocalModel, inquiry: Inquiry, situation: Situation, wrong: bool) -> str:
        names = self._space.names
        weighable = {name for trial, part, _ in model.base.parts for name in (trial, part)} - {"", "unfilmed"}
        if strange := [name for name in inquiry.weigh if name not in weighable]:
            return f"'weigh' names {listed(strange)}, which is neither a trial nor a part: {listed(sorted(weighable))}."
        if inquiry.weigh:
            weighed = LocalModel(situation.evaluations, self._slopes, inquiry.weigh, situation.incumbent)
        else:
            weighed = model
        free = np.array([name in inquiry.solve for name in names])
        unknown = self._unknown(model, free)
        reach = (RADIUS if inquiry.radius is None else inquiry.radius) * (_SHRINK if wrong else 1.0)
        point, here = weighed.solve(reach, free), model.base.candidate.point
        old, new = self._space.to_values(here), self._space.to_values(point)
        order = [i for i in np.argsort(-np.abs(point - here)) if abs(point[i] - here[i]) > _MOVED]
        hint = f" Little is known of {listed(unknown)}: {_cost(unknown)}." if unknown else ""
        if not order:
            return f"no step along these, at most {reach:.2g} of each range, promises anything.{hint}"
        values = ", ".join(f"{names[i]} {old[names[i]]:.4g} → {new[names[i]]:.4g}" for i in order)
        stay = "" if model.predict(point).loss < model.base.loss else " That is no better than to stay."
        return f"at most {reach:.2g} of each range, {values}.{hint}\n\nExpected:{stay} {self._predicted(model, point)}"


def effects_table(model: LocalModel, space: ParameterSpace) -> str:
    """A row for each parameter with an effect that is known, and the names of those of which little is known."""
    here, rows, known = model.base.candidate.point, list[str](), model.known >= _KNOWN
    for i in np.flatnonzero(known):
        raised = here.copy()
        raised[i] += _EFFECT  # beyond a bound, too: a slope
        expected = model.predict(raised)
        change = expected.loss - model.base.loss
        if abs(change) < expected.std:
            continue
        beats = f"{1e3 * (expected.margins - model.base.margins).min():+.0f}" if expected.margins.size else "n/a"
        rows.append(f"| {space.names[i]} | {1e3 * change:+.1f} | {1e3 * expected.std:.1f} | {beats} |")
    head = ["| parameter | loss mm | ± | first beats mm/s |", "|-|-|-|-|"]
    text = "\n".join([*head, *rows] if rows else ["None is known."])
    unknown = [space.names[i] for i in np.argsort(-model.unsure) if not known[i]]
    return text + (f"\n\nNot known, what may matter most first: {listed(unknown, _LARGEST)}." if unknown else "")


_FIGURES = {  # of a trial, with the digits that they are shown with
    "speed ratio": 2, "amplitude ratio": 2, "yaw ratio": 2, "yaw phase deg": 0, "sway ratio": 2, "sway phase deg": 0,
}  # fmt: skip


def _figures(evaluation: Evaluation, robot: Robot) -> Array:
    """The figures of each trial, NaN for what it doesn't have. Shape (F, 6)."""
    rows: list[list[float | None]] = []
    for one in EvaluationFacts.of(evaluation, robot).trials:
        lags = [None if lag is None else np.degrees(lag) for lag in (one.figures.yaw_lag, one.figures.sway_lag)]
        rows.append([one.speed_ratio, one.amplitude_ratio, one.yaw_ratio, lags[0], one.sway_ratio, lags[1]])
    return np.array(rows, dtype=float)


class _Seen(NamedTuple):
    """An evaluation, the loss that was expected of it, and by how many standard deviations that missed."""

    loss: float
    expected: float
    missed: float


def _looked_back(evaluations: Sequence[Evaluation], slopes: Callable[[Evaluation], Array] | None) -> list[_Seen]:
    """The last evaluations, the newest first, beside what the model before each expected."""
    seen: list[_Seen] = []
    for count in range(len(evaluations) - 1, 0, -1):
        made = evaluations[count]
        if len(seen) == _LATELY:
            break
        if made.failed or not made.stages:
            continue
        try:
            expected = LocalModel(evaluations[:count], slopes).predict(made.candidate.point)
        except OptimizerError:
            break
        missed = abs(made.loss - expected.loss) / max(expected.std, 1e-9)
        seen.append(_Seen(made.loss, expected.loss, missed))
    return seen


def _told(seen: Sequence[_Seen], wrong: bool) -> str:
    if not seen:
        return "It has predicted nothing yet."
    pairs = ", ".join(f"{_mm(one.expected)} → {_mm(one.loss)} ({one.missed:.1f} std)" for one in seen)
    more = " It has been wrong three times running: trust small steps only, or measure." if wrong else ""
    return f"What it expected of the last evaluations, the newest first, and what came: {pairs}.{more}"


def _cost(unknown: Sequence[str]) -> str:
    count = len(unknown)
    return f'"measure" shows what {"it does, at an evaluation" if count == 1 else f"they do, at {count} evaluations"}'


def _mm(loss: float) -> str:
    return f"{1e3 * loss:.1f} mm"
