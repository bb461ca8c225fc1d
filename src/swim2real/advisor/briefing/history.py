"""History of a run: a block per finished round, which never changes, so that services need not read it anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.briefing.facts import Ratio, RoundFacts, median
from swim2real.advisor.briefing.texts import degrees, mm, number, reading, shortened, significant
from swim2real.objective import TAIL_FIRST_LOSS
from swim2real.objective.figures import FitFigures
from swim2real.optimizers import Evaluation, Proposal, Round
from swim2real.optimizers.advisor import STAYS
from swim2real.parameters import ParameterSpace

_DIGITS = 3  # of a value: what they show alike is no change
_LONGEST_LIST = 300  # characters
_UNFILMED = 5e-5  # m of a loss, below which swims that no trial shows aren't named
_MOST_CHANGES = 8  # of a proposal that are listed
# notes of a proposal that its author should hear of
_CORRECTED = {
    "clipped": "out of bounds, so moved to the bound",
    "ignored": "no parameters of this simulator, so ignored",
}
_PARTS = ("progress", "shape", "recoil")
_RATIOS: dict[str, Ratio] = {"amplitude": "amplitude_ratio", "yaw": "yaw_ratio", "sway": "sway_ratio"}


def rounds_told(facts: RoundFacts, numbers: bool) -> list[str]:
    """A block per finished round of the search, in order.

    Args:
        facts: Facts of the round that begins.
        numbers: Whether losses and other comparisons are reported.
    """
    best, blocks = facts.situation.first, list[str]()
    for nth, finished in enumerate(facts.situation.rounds, start=1):
        size = f" at step {significant(finished.steps[-1].step_size, _DIGITS)}" if finished.accepted else ""
        lines = measured(finished.measurements, best, facts, numbers) + _proposed(finished, facts, numbers)
        title = f"**Round {nth}: {'accepted' if finished.accepted else 'rejected'}{size}**"
        blocks.append("\n".join([title, *(f"- {line}" for line in lines)]))
        best = finished.result
    return blocks


def _proposed(finished: Round, facts: RoundFacts, numbers: bool) -> list[str]:
    """A round's proposal and its steps, a line each."""
    space, proposal, before = facts.space, finished.proposal, finished.incumbent
    lines = [f"Proposed: {changes(before, proposal.point, space, _MOST_CHANGES)}"]
    for one in finished.steps:
        kept, size = finished.accepted and one is finished.steps[-1], significant(one.step_size, _DIGITS)
        if one is finished.steps[0] or kept or one.evaluation.failed:  # of the shorter ones the loss says enough
            lines.append(f"Step {size}: {_result(one.evaluation, kept, facts, numbers)}")
        else:
            lines[-1] += f"; step {size}: {f'{mm(one.evaluation.loss)} mm' if numbers else 'not kept'}"
    return [*lines, *corrections(proposal)]


def measured(measurements: Sequence[Evaluation], best: Evaluation, facts: RoundFacts, numbers: bool) -> list[str]:
    """Measurements before a proposal, a line each, against the best point of their time."""
    lines: list[str] = []
    for one in measurements:
        kept = not one.failed and (best.failed or one.loss < best.loss) and not one.candidate.note.get(STAYS)
        what = changes(best, one.candidate.point, facts.space, len(facts.space))
        lines.append(f"Measured {what.rstrip('.')}: {_result(one, kept, facts, numbers)}")
        best = one if kept else best
    return lines


def better_measured(facts: RoundFacts) -> str:
    """What to reply where the best measurement of this round is better than the current point; else empty."""
    here, made = facts.situation.incumbent, facts.situation.measurements
    lower = [(one.loss, nth) for nth, one in enumerate(made, start=1) if not one.failed and one.loss < here.loss]
    if not lower or here.failed:
        return ""
    loss, nth = min(lower)
    return (
        f"Measurement {nth} is better than the current point by {mm(here.loss - loss)} mm and wasn't kept: to propose "
        f'it reply "take": "{nth}", with more changes if you like.'
    )


def _result(evaluation: Evaluation, kept: bool, facts: RoundFacts, numbers: bool) -> str:
    if not numbers:
        return "failed" if evaluation.failed else "kept" if kept else "not kept"
    return f"{loss(evaluation, facts)}{effects(evaluation, facts)}{', kept' if kept else ''}"


def loss(evaluation: Evaluation, facts: RoundFacts) -> str:
    """An evaluation's loss, and what it is without the addition for going tail first."""
    if evaluation.failed:
        trials = FitFigures.model_validate(evaluation.detail or {}).trials.items()
        first = next((f"trial '{name}': {trial.divergence}" for name, trial in trials if trial.divergence), None)
        return f"the simulation diverged ({first or 'no reason on record'})"
    alone = facts.of(evaluation).mean_of("loss")
    rest = 0.0 if alone is None else evaluation.loss - alone
    said = ""
    if alone is not None and rest > TAIL_FIRST_LOSS / 2:
        said = f" [{mm(alone)} without the {mm(TAIL_FIRST_LOSS, 0)}]"
    elif rest > _UNFILMED and facts.beats and facts.robot.swims.head_first:
        said = f" [{mm(rest)} of it by swims from rest that no trial shows]"
    return f"{mm(evaluation.loss)} mm{said}"


def effects(evaluation: Evaluation, facts: RoundFacts) -> str:
    """Other effects of an evaluation, in few words after its loss; empty if nothing is known."""
    if evaluation.failed:
        return ""
    known = facts.of(evaluation)
    markers = known.mean_of("aligned_marker_error") if known.sensors else None
    parts = [] if markers is None else [f"markers {mm(markers)} mm"]
    parts += [
        f"{one.sensor.name} {reading(one.error)} {one.sensor.unit}" for one in known.sensors if one.error is not None
    ]
    if known.ratio("speed_ratio") is not None:
        parts.append("speed " + " ".join(_percent(trial.speed_ratio) for trial in known.trials))
    if evaluation.loss >= TAIL_FIRST_LOSS:  # how a fish swims that turned around says little
        return "".join(f", {part}" for part in parts)
    if len(known.trials) > 1:
        parts.append("trials " + " ".join(mm(trial.error, 0 if known.has_head else 1) for trial in known.trials))
    errors = ((part, known.mean_of(f"{part}_error")) for part in _PARTS)
    parts += [f"{part} {mm(error)}" for part, error in errors if error is not None]
    for name, kind in _RATIOS.items():
        ratio = known.ratio(kind)
        lag = median(getattr(trial.figures, f"{name}_lag", None) for trial in known.trials)
        phase = "" if lag is None else f" ({degrees(lag, 0, signed=True)})"
        parts += [] if ratio is None else [f"{name} {_percent(ratio)}{phase}"]
    return "".join(f", {part}" for part in parts)


def _percent(ratio: float | None) -> str:
    return number(ratio, 0, 100)


def told_of_steps(facts: RoundFacts) -> str:
    """Describes an evaluation."""
    parts, here = ["loss"], facts.here
    if here.sensors:
        parts.append(f"{'what the markers have of it, ' if here.markers else ''}mean error of each sensor")
    if facts.robot.trials.score_progress:
        parts.append("speed by trial in % of the real one, negative the other way")
    if len(here.trials) > 1:
        parts.append("error by trial")
    known = here.figures.model_fields_set
    parts += [", ".join(part for part in _PARTS if f"{part}_error" in known)]
    last = f" of {facts.robot.marker_names[-1]}" if facts.beats else ""
    head = ", head's yaw and sway (phases in deg)" if here.has_head else ""
    parts += [f"in % of the real ones amplitude{last}{head}"] if here.markers else []
    order = " Trials are by rising frequency" if facts.beats else " Trials are in the order of their table"
    return f"{', '.join(filter(None, parts))}; errors in mm.{order if len(here.trials) > 1 else ''}"


def changes(before: Evaluation, point: NDArray[np.float64], space: ParameterSpace, most: int) -> str:
    """Differences of a point, the largest change first."""
    old, new = (_short_values(space, one) for one in (before.candidate.point, point))
    far = dict(zip(space.names, np.abs(before.candidate.point - point), strict=True))
    moved = [name for name in sorted(space.names, key=lambda name: -far[name]) if old[name] != new[name]]
    if not moved:
        return "hardly any change."
    rest = len(moved) - most
    more = f", and {rest} smaller change{'s' if rest > 1 else ''}" if rest > 0 else ""
    return f"{', '.join(f'{name} {old[name]} → {new[name]}' for name in moved[:most])}{more}."


def _short_values(space: ParameterSpace, point: NDArray[np.float64]) -> dict[str, str]:
    return {name: significant(value, _DIGITS) for name, value in space.to_values(point).items()}


def corrections(proposal: Proposal) -> list[str]:
    """Corrections that the author of a proposal should hear of."""
    lines: list[str] = []
    for name, said in _CORRECTED.items():
        found: Mapping[str, float] | Sequence[str] | None = proposal.notes.get(name)
        if isinstance(found, Mapping):
            found = [f"{key} ({significant(given)} was given)" for key, given in found.items()]
        if found:
            lines.append(f"{shortened(', '.join(found), _LONGEST_LIST)}: {said}.")
    return lines
