"""What was proposed in earlier rounds, what was measured, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from numpy.typing import ArrayLike

from swim2real.advisor.briefing.facts import EvaluationFacts, Known, RoundFacts
from swim2real.advisor.briefing.texts import mm, number, reading, shortened, significant, table
from swim2real.objective.figures import FitFigures
from swim2real.optimizers import Evaluation, Proposal, Round
from swim2real.parameters import ParameterSpace

_DIGITS = 3  # of a value: what they show alike is no change
_LONGEST_LIST = 300  # characters of a list of names
# notes of a proposal that its author should hear of
_CORRECTED = {
    "clipped": "out of bounds, so moved to the bound",
    "ignored": "no parameters of this simulator, so ignored",
}
_PARTS = ("shape", "recoil")


def told_of_steps(facts: RoundFacts) -> str:
    """What is told of each step."""
    parts = ["its loss, the change from the loss before the round"]
    if facts.here.sensors:
        parts.append("what the markers have of it, the mean error of each sensor")
    if facts.robot.trials.score_progress:
        each = " of each trial, by rising frequency" if facts.beats else ""
        parts.append(f"the ratio of speeds (simulated / real){each}")
    known = facts.here.figures.model_fields_set
    parts += [f"the error in {part}, in mm" for part in _PARTS if f"{part}_error" in known]
    last = f" of {facts.robot.marker_names[-1]}" if facts.beats else ""
    return f"{', '.join(parts)} and the ratio of amplitudes{last} (simulated / real)"


def changes(finished: Round, space: ParameterSpace, most: int) -> str:
    """What the proposal changed, the largest change first, and the value that was kept where it is another one."""
    start, end = finished.incumbent.candidate.point, finished.proposal.point
    before, after = (_short_values(space, point) for point in (start, end))
    kept = _short_values(space, finished.steps[-1].evaluation.candidate.point) if finished.accepted else after
    order = [space.names[i] for i in sorted(range(len(space)), key=lambda i: -abs(end[i] - start[i]))]
    moved = [name for name in order if before[name] != after[name]]
    if not moved:
        return "hardly any change."
    rest = len(moved) - most
    more = f", and {rest} smaller change{'s' if rest > 1 else ''}" if rest > 0 else ""
    shown = (
        f"{name} {before[name]} → {after[name]}" + (f" (kept {kept[name]})" if kept[name] != after[name] else "")
        for name in moved[:most]
    )
    return f"{', '.join(shown)}{more}."


def _short_values(space: ParameterSpace, point: ArrayLike) -> dict[str, str]:
    return {name: significant(value, _DIGITS) for name, value in space.to_values(point).items()}


def effects(evaluation: Evaluation, facts: RoundFacts) -> str:
    """What else an evaluation did, in few words after its loss; empty where nothing is known."""
    if evaluation.failed:
        return ""
    known = EvaluationFacts.of(evaluation, facts.robot)
    markers = known.mean_of("aligned_marker_error") if known.sensors else None
    parts = [] if markers is None else [f"markers {mm(markers)} mm"]
    parts += [
        f"{one.sensor.name} {reading(one.error)} {one.sensor.unit}" for one in known.sensors if one.error is not None
    ]
    speed, amplitude = known.ratio("speed_ratio"), known.ratio("amplitude_ratio")
    if speed is not None:
        each = [trial.speed_ratio for trial in known.trials] if any(t.frequency for t in known.trials) else [speed]
        parts.append("speed " + " ".join(number(ratio, 2) for ratio in each))
    errors = ((part, known.mean_of(f"{part}_error")) for part in _PARTS)
    parts += [f"{part} {mm(error)}" for part, error in errors if error is not None]
    if amplitude is not None:
        parts.append(f"amplitude {number(amplitude, 2)}")
    return "".join(f", {part}" for part in parts)


def first_divergence(evaluation: Evaluation) -> str | None:
    """What diverged first, in a sentence."""
    trials = FitFigures.model_validate(evaluation.detail or {}).trials.items()
    return next((f"trial '{name}': {trial.divergence}" for name, trial in trials if trial.divergence), None)


def corrections(proposal: Proposal) -> list[str]:
    """What its author should hear of."""
    lines: list[str] = []
    for name, said in _CORRECTED.items():
        found: Mapping[str, float] | Sequence[str] | None = proposal.notes.get(name)
        if isinstance(found, Mapping):
            found = [f"{key} ({significant(given)} was given)" for key, given in found.items()]
        if found:
            lines.append(f"{shortened(', '.join(found), _LONGEST_LIST)}: {said}.")
    return lines


@dataclass(frozen=True)
class Measured:
    """A measurement against the best point of its time.

    Attributes:
        before: The best evaluation of its time.
        after: The measurement.
        facts: What is known of both.
    """

    before: Evaluation
    after: Evaluation
    facts: tuple[EvaluationFacts, EvaluationFacts]

    @property
    def failed(self) -> bool:
        return self.before.failed or self.after.failed

    def changes(self, space: ParameterSpace) -> str:
        """What was changed."""
        points = self.before.candidate.point, self.after.candidate.point
        old, new = (_short_values(space, point) for point in points)
        moved = (name for name, there in zip(space.names, points[0] != points[1], strict=True) if there)
        return ", ".join(f"{name} {old[name]} → {new[name]}" for name in moved)

    @cached_property
    def by_trial(self) -> list[Known]:
        """By how much each trial's ratio of speeds differs, or its error [m] where none has one; empty if unknown."""
        trials = [known.trials for known in self.facts]
        if self.failed or len(trials[0]) != len(trials[1]):
            return []
        told = [[trial.speed_ratio for trial in side] for side in trials]
        if not any(ratio is not None for side in told for ratio in side):
            told = [[trial.error for trial in side] for side in trials]
        return [_less(new, old) for old, new in zip(*told, strict=True)]

    def difference(self, figure: str) -> Known:
        """By how much a mean figure differs."""
        return _less(*(known.mean_of(figure) for known in reversed(self.facts)))


def measured_table(facts: RoundFacts) -> str:
    """A row per measurement."""
    rows = measurements(facts)
    beats, speeds = facts.beats, facts.robot.trials.score_progress
    named = max(len(row.by_trial) for row in rows)
    names = [f"{t.frequency:.2f} Hz" if beats else t.name for t in facts.here.trials][:named]
    parts = [part for part in _PARTS if any(row.difference(f"{part}_error") is not None for row in rows)]
    yaws = [_less(*(known.ratio("yaw_ratio") for known in reversed(row.facts))) for row in rows]
    columns = [
        "change", "loss mm", *(f"{name} {'% speed' if speeds else 'mm'}" for name in names),
        *(f"{part} mm" for part in parts), f"{facts.robot.marker_names[-1]} % wider" if beats else "% wider",
        *(["yaw % wider"] if any(yaw is not None for yaw in yaws) else []),
    ]  # fmt: skip
    cells = [
        [
            row.changes(facts.space),
            "diverged" if row.failed else mm(row.after.loss - row.before.loss, signed=True),
            *(number(change, 1, 100 if speeds else 1e3, signed=True) for change in row.by_trial or [None] * named),
            *(mm(row.difference(f"{part}_error"), signed=True) for part in parts),
            _wider(_less(*(known.ratio("amplitude_ratio") for known in reversed(row.facts)))),
            _wider(yaw),
        ][: len(columns)]
        for row, yaw in zip(rows, yaws, strict=True)
    ]
    return table(columns, cells)


def measurements(facts: RoundFacts) -> list[Measured]:
    """Every measurement of the run, in order."""
    situation, rows = facts.situation, list[Measured]()
    best = situation.first
    for measurements, steps in (
        *((finished.measurements, finished.steps) for finished in situation.rounds), (situation.measurements, ())
    ):  # fmt: skip
        for one in measurements:
            known = EvaluationFacts.of(best, facts.robot), EvaluationFacts.of(one, facts.robot)
            rows.append(Measured(best, one, known))
            best = min(best, one, key=_rank)
        best = min((best, *(step.evaluation for step in steps)), key=_rank)
    return rows


def _rank(evaluation: Evaluation) -> float:
    return float("inf") if evaluation.failed else evaluation.loss


def _wider(change: Known) -> str:
    return number(change, 1, 100, signed=True)


def _less(new: Known, old: Known) -> Known:
    return None if new is None or old is None else new - old
