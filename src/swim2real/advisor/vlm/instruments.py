"""Instruments that a reply may ask: predictions, solved steps and effects, from a local model, without an evaluation.

They say what they don't know, and how well they have predicted the last evaluations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from swim2real.advisor.briefing.facts import EvaluationFacts
from swim2real.advisor.briefing.tables import effects_in_the_middle
from swim2real.advisor.briefing.texts import number, table
from swim2real.advisor.physics.model import expected_slopes
from swim2real.advisor.vlm.reply import SOLVED
from swim2real.formatting import listed
from swim2real.optimizers import Evaluation, Situation
from swim2real.optimizers.local_model import KNOWN, RADIUS, LocalModel, Prediction
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swimbase.arrays import Array, Mask
from swimbase.errors import OptimizerError

MOST_ASKED = 4  # times in a turn
_LATELY, _SHOWN = 10, 3  # evaluations that are looked back on, and that are told
_WRONG, _SHRINK = 2.0, 0.5  # standard deviations that count as wrong; of the radius, after three wrong in a row
_EFFECT = 0.05  # of a parameter's range, for which slopes are shown
_LARGEST = 8  # parameters of which little is known that are listed
_MOVED = 1e-3  # of a range, below which nothing was changed
_NOTHING = "·"  # an effect that isn't seen
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


class Answers(NamedTuple):
    """What instruments say, as Markdown, and the values of the step that was solved, where one was."""

    text: str
    solved: Values | None = None


class Instruments:
    """Answers of the local model of a run of a robot's calibration."""

    def __init__(self, robot: Robot, space: ParameterSpace) -> None:
        """Prepares the instruments.

        Args:
            robot: The robot whose simulator is calibrated.
            space: Its parameters, on the run's scale.
        """
        self._robot, self._space, self._slopes = robot, space, expected_slopes(robot, space)
        # by evaluations, which live as long as their run
        self._expected: dict[int, Prediction | None] = {}
        self._known: dict[int, Array] = {}

    def answers(self, inquiry: Inquiry, situation: Situation) -> Answers:
        """The answers of all instruments that are asked.

        Args:
            inquiry: What is asked.
            situation: Situation of the run, whose evaluations have their residuals.
        """
        try:
            model = LocalModel(situation.evaluations, self._slopes, base=situation.incumbent)
        except OptimizerError:
            middle = effects_in_the_middle(self._space) if inquiry.effects else ""
            more = (
                f"\n\n**effects**, in the middle of the bounds; near a good fit they may be ten times off:\n\n{middle}"
            )
            return Answers(
                "## Instruments\n\nThere is no local model yet: it takes four evaluations in which all trials go "
                f"forward. Propose or probe; that costs an evaluation each.{more if middle else ''}"
            )
        seen, solved = self._looked_back(situation.evaluations), None
        scale, before = _scale(seen), _scale(seen[_SHOWN:])
        lately = [one._replace(missed=one.missed / before) for one in seen[:_SHOWN]]
        wrong = len(lately) == _SHOWN and all(one.missed > _WRONG for one in lately)
        parts = [
            f"## Instruments\n\nA local model about the current point, {_mm(model.base.loss)}. {_told(lately, wrong)}"
        ]
        if inquiry.predict:
            point = inquiry.point(self._space, situation.incumbent.candidate.point)
            parts.append(f"**predict**: {self._predicted(model, point, model.predict(point), scale)}")
        if inquiry.solve:
            text, solved = self._solved(model, inquiry, situation, wrong, scale)
            parts.append(f"**solve**: {text}")
        if inquiry.effects:
            parts.append(f"**effects**: {self._effects(model)}")
        return Answers("\n\n".join(parts), solved)

    def _looked_back(self, evaluations: Sequence[Evaluation]) -> list[_Seen]:
        """The last evaluations, the newest first, beside what the model before each expected."""
        seen: list[_Seen] = []
        for count in range(len(evaluations) - 1, 0, -1):
            made = evaluations[count]
            if len(seen) == _LATELY:
                break
            if made.failed or not made.stages:
                continue
            if id(made) not in self._expected:
                self._expected[id(made)] = self._before(evaluations[:count], made)
            if (expected := self._expected[id(made)]) is None:
                break
            missed = abs(made.loss - expected.loss) / max(expected.std, 1e-9)
            seen.append(_Seen(made.loss, expected.loss, missed))
        return seen

    def _before(self, evaluations: Sequence[Evaluation], made: Evaluation) -> Prediction | None:
        try:
            return LocalModel(evaluations, self._slopes).predict(made.candidate.point)
        except OptimizerError:
            return None

    def _unknown(self, model: LocalModel, among: Mask) -> list[str]:
        return [name for i, name in enumerate(self._space.names) if among[i] and model.known[i] < KNOWN]

    def _predicted(self, model: LocalModel, point: Array, expected: Prediction, scale: float) -> str:
        here = model.base.candidate.point
        parts = [f"a loss of {_mm(expected.loss)} ± {1e3 * scale * expected.std:.1f}"]
        if expected.margins.size:
            least = int(np.argmin(expected.margins))
            slowest, unsure = expected.margins[least], scale * expected.margin_stds[least]
            parts.append(
                f"the slowest first beats at {1e3 * slowest:.0f} ± {1e3 * unsure:.0f} mm/s (now "
                f"{1e3 * model.base.margins.min():.0f}; a trial turns around near 0)"
            )
        text = "; ".join(parts) + f". {expected.known:.0%} of the way there is known."
        unknown = self._unknown(model, np.abs(point - here) > _MOVED)
        text += f" Little is known of {listed(unknown, _LARGEST)}: {_cost(unknown)}." if unknown else ""
        return "\n\n".join([text, *self._by_trial(model, point, scale)])

    def _by_trial(self, model: LocalModel, point: Array, scale: float) -> list[str]:
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
        means, stds = model.expect(point, self._figures)
        for (heading, (_, digits)), mean, std in zip(_FIGURES.items(), means.T, stds.T, strict=True):
            if not np.isfinite(mean).any():
                continue
            columns.append(heading)
            for row, value, unsure in zip(rows, mean, std, strict=True):
                row.append(f"{value:.{digits}f} ± {scale * unsure:.{digits}f}" if np.isfinite(value) else "n/a")
        return [table(columns, rows)] if len(columns) > 2 else []

    def _solved(
        self, model: LocalModel, inquiry: Inquiry, situation: Situation, wrong: bool, scale: float
    ) -> tuple[str, Values | None]:  # fmt: skip
        names = self._space.names
        weighable = {name for trial, part, _ in model.base.parts for name in (trial, part)} - {"", "unfilmed"}
        if strange := [name for name in inquiry.weigh if name not in weighable]:
            text = f"'weigh' names {listed(strange)}, which is neither a trial nor a part: {listed(sorted(weighable))}."
            return text, None
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
        hint = f" Little is known of {listed(unknown, _LARGEST)}: {_cost(unknown)}." if unknown else ""
        if not order:
            return f"no step along these, at most {reach:.2g} of each range, promises anything.{hint}", None
        values = ", ".join(f"{names[i]} {old[names[i]]:.4g} → {new[names[i]]:.4g}" for i in order)
        expected = model.predict(point)
        stay = "" if expected.loss < model.base.loss else "It is no better than to stay. "
        told = self._predicted(model, point, expected, scale)
        how = f'`"take": "{SOLVED}"` makes it your proposal'
        return f"at most {reach:.2g} of each range, {values}.{hint} {how}.\n\n{stay}Expected: {told}", new

    def _effects(self, model: LocalModel) -> str:
        """A row for each parameter with an effect that is known, and the names of those of which little is known."""
        losses, names = model.loss_slopes, self._space.names
        known = model.known >= KNOWN
        columns = ["parameter", "loss mm"]
        cells = [[_signed(mean, std, 1e3 * _EFFECT, 1)] for mean, std in zip(*losses, strict=True)]
        if model.base.detail:
            means, stds = model.slopes(self._figures)
            for k, (heading, (factor, _)) in enumerate(_FIGURES.items()):
                if np.isfinite(means[:, :, k]).any():
                    columns.append(heading.replace("ratio", "%"))
                    for cell, mean, std in zip(cells, means[:, :, k], stds[:, :, k], strict=True):
                        cell.append(_over_trials(mean, std, factor * _EFFECT))
        if model.base.margins.size:
            columns.append("slowest first beats mm/s")
            least = int(np.argmin(model.base.margins))
            for cell, mean, std in zip(cells, *model.margin_slopes(least), strict=True):
                cell.append(_signed(mean, std, 1e3 * _EFFECT, 1))
        told = [i for i in np.flatnonzero(known) if set(cells[i]) != {_NOTHING}]
        rows = table(columns, [[names[i], *cells[i]] for i in told]) if told else "None is known."
        unknown = [names[i] for i in np.argsort(-model.unknown) if not known[i]]
        more = f"\n\nNot known, what may matter most first: {listed(unknown, _LARGEST)}." if unknown else ""
        order = "by trial in the order of their table, one number where all are alike"
        return (
            f"by {_EFFECT:g} of the range more, from slopes at the current point ({order}; {_NOTHING} is less than its "
            f"uncertainty):\n\n{rows}{more}"
        )

    def _figures(self, evaluation: Evaluation) -> Array:
        """The figures of each trial, NaN for what it doesn't have. Shape (F, 6)."""
        if id(evaluation) not in self._known:
            rows: list[list[float | None]] = []
            for one in EvaluationFacts.of(evaluation, self._robot).trials:
                lags = [None if lag is None else np.degrees(lag) for lag in (one.figures.yaw_lag, one.figures.sway_lag)]
                rows.append([one.speed_ratio, one.amplitude_ratio, one.yaw_ratio, lags[0], one.sway_ratio, lags[1]])
            self._known[id(evaluation)] = np.array(rows, dtype=float)
        return self._known[id(evaluation)]


_FIGURES = {  # of a trial: by what effects on them are multiplied, and their digits
    "speed ratio": (100.0, 2), "amplitude ratio": (100.0, 2), "yaw ratio": (100.0, 2), "yaw phase deg": (1.0, 0),
    "sway ratio": (100.0, 2), "sway phase deg": (1.0, 0),
}  # fmt: skip


def _signed(value: float, std: float, factor: float, digits: int) -> str:
    """An effect, if it is more than its uncertainty."""
    return number(value, digits, factor, signed=True) if abs(value) > std else _NOTHING


def _over_trials(values: Array, stds: Array, factor: float) -> str:
    """Effects on all trials, in one number where they are alike."""
    seen = np.isfinite(values)
    if not np.any(np.abs(values[seen]) > stds[seen]):
        return _NOTHING
    if np.ptp(values[seen]) <= max(2 * float(stds[seen].max()), 1 / factor):
        return number(float(values[seen].mean()), 0, factor, signed=True)
    return " ".join(_signed(value, std, factor, 0) for value, std in zip(values, stds, strict=True))


class _Seen(NamedTuple):
    """An evaluation, the loss that was expected of it, and by how many standard deviations that missed."""

    loss: float
    expected: float
    missed: float


def _scale(seen: Sequence[_Seen]) -> float:
    """What a model's standard deviation of a loss, which takes its kernel for true, is to be multiplied by.

    The most likely one for what came, with one more that came as expected.
    """
    return float(np.sqrt((1 + sum(one.missed**2 for one in seen)) / (1 + len(seen))))


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
