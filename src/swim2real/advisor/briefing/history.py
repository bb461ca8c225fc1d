"""What was proposed in earlier rounds and what came of it, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swim2real.advisor.briefing.kinds import telling_of
from swim2real.optimizers import Evaluation, Round, Situation, Step
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot

NOTICEABLE = 0.01  # of a parameter's range, on the space's scale: what counts as a change
LONGEST = 280  # characters of a diagnosis
_MENDED = ("clipped", "ignored", "missing", "kept")  # notes of a proposal that its author should hear of


def history(situation: Situation, space: ParameterSpace, robot: Robot) -> dict[str, Any]:
    """The first evaluation, every round in order, and how long ago one was accepted."""
    rounds = [_round(number, one, space, robot) for number, one in enumerate(situation.rounds, start=1)]
    accepted = [one["round"] for one in rounds if one["accepted"]]
    return {
        "evaluations": len(situation.evaluations),
        "first": _outcome(situation.first, robot),
        "rounds": rounds,
        "rounds_since_accepted": len(rounds) - (accepted[-1] if accepted else 0),
    }


def _round(number: int, one: Round, space: ParameterSpace, robot: Robot) -> dict[str, Any]:
    before, last = one.incumbent, one.steps[-1].evaluation if one.steps else None
    known = last is not None and not (last.failed or last.lower_bound or before.failed)
    return {
        "round": number,
        "accepted": one.accepted,
        "diagnosis": shortened(one.proposal.diagnosis),
        "changes": _changes(one, space),
        "steps": [_step(step, robot) for step in one.steps],
        "start_loss": None if before.failed else before.loss,
        "loss_change": last.loss - before.loss if last is not None and known else None,
        "notes": {name: one.proposal.notes[name] for name in _MENDED if one.proposal.notes.get(name)},
    }


def _changes(one: Round, space: ParameterSpace) -> list[dict[str, Any]]:
    """What the proposal changed, the largest change first; `kept` is the value that was accepted."""
    start, end = one.incumbent.candidate.point, one.proposal.point
    before, after = space.to_values(start), space.to_values(end)
    kept = space.to_values(one.steps[-1].evaluation.candidate.point) if one.accepted else {}
    order = sorted(range(len(space)), key=lambda i: -abs(end[i] - start[i]))
    moved = [space.names[i] for i in order if abs(end[i] - start[i]) > NOTICEABLE]
    return [{"name": n, "from": before[n], "to": after[n], "kept": kept.get(n)} for n in moved]


def _step(step: Step, robot: Robot) -> dict[str, Any]:
    return {"step_size": step.step_size, **_outcome(step.evaluation, robot)}


def _outcome(evaluation: Evaluation, robot: Robot) -> dict[str, Any]:
    """Its loss and, where all trials were simulated, what else it did."""
    failed, detail, telling = evaluation.failed, evaluation.detail or {}, telling_of(robot)
    return {
        "loss": None if failed else evaluation.loss,
        "lower_bound": evaluation.lower_bound,
        "failed": failed,
        "why": _why(detail) if failed else None,
        **telling.outcome([] if failed or evaluation.lower_bound else telling.trials(detail, robot)),
    }


def _why(detail: Mapping[str, Any]) -> str | None:
    """What diverged first, in a sentence."""
    found = ((name, trial.get("divergence")) for name, trial in detail.get("trials", {}).items())
    return next((f"trial '{name}': {why}" for name, why in found if why), None)


def shortened(text: str, longest: int = LONGEST) -> str:
    """A text on one line, cut at a word."""
    line = " ".join(text.split())
    if len(line) <= longest:
        return line
    cut = line[: longest - 1]
    return cut[: cut.rfind(" ")].rstrip(" ,;:") + "…" if " " in cut else cut + "…"
