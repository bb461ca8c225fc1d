"""What was proposed in earlier rounds and what came of it, as plain data and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swim2real.advisor.briefing.differences import differences, mean
from swim2real.advisor.briefing.formatting import UNKNOWN, mm, number, reading, shortened, value
from swim2real.advisor.briefing.measured import TrialsOf, measured
from swim2real.errors import ArgumentError
from swim2real.optimizers import Evaluation, Round, Situation
from swim2real.parameters import ParameterSpace

LONGEST = 280  # characters of a diagnosis
_NAMED, _LISTED = 3, 8  # changes that are named of an older and of a recent round
_DIGITS = 3  # of a value: what they show alike is no change
_LONGEST_LIST = 300  # characters of a list of names
# notes of a proposal that its author should hear of
_CORRECTED = {
    "clipped": "out of bounds, so moved to the bound",
    "ignored": "no parameters of this simulator, so ignored",
    "kept": "left as they were",
}

Facts = Mapping[str, Any]


def history(situation: Situation, space: ParameterSpace, trials_of: TrialsOf) -> dict[str, Any]:
    """The first evaluation, every round in order, and how long ago one was accepted.

    Args:
        situation: Situation as an advisor gets it.
        space: Parameters, as the optimizer uses them.
        trials_of: Facts of the trials of an evaluation.
    """
    rounds = [_round(number, finished, space, trials_of) for number, finished in enumerate(situation.rounds, start=1)]
    accepted = [finished["round"] for finished in rounds if finished["accepted"]]
    return {
        "evaluations": len(situation.evaluations),
        "first": _outcome(situation.first, trials_of),
        "measured": measured(situation, space, trials_of),
        "rounds": rounds,
        "rounds_since_accepted": len(rounds) - (accepted[-1] if accepted else 0),
    }


def describe_history(facts: Facts, numbers: bool = True, rounds: int | None = None) -> str:
    """The section on earlier rounds.

    Args:
        facts: Facts of the round.
        numbers: Whether losses and diagnoses are told; a diagnosis may quote what was measured.
        rounds: How many of the last rounds are told in full. None for all.

    Raises:
        ArgumentError: The number of rounds is negative.
    """
    if rounds is not None and rounds < 0:
        raise ArgumentError(f"rounds is {rounds}; it must be at least 0, or None for all")
    past = facts["history"]
    every = past["rounds"]
    older = 0 if rounds is None else max(len(every) - rounds, 0)
    first = f" The first point of the run: {_loss(past['first'])}{_effects(past['first'])}." if numbers else ""
    lines = ["## What was tried"]
    if not every:
        return "\n\n".join([*lines, f"Nothing yet: this is the first round.{first}"])
    lines.append(_how_told(facts, numbers) + first)
    lines.extend(_in_one_line(finished, numbers) for finished in every[:older])
    lines.extend(_in_full(finished, numbers) for finished in every[older:])
    since = past["rounds_since_accepted"]
    if since:
        many = "round was" if since == 1 else f"{since} rounds were"
        lines.append(
            f"The last {many} rejected: what was proposed there from the current point leads the wrong way, or changes "
            "too much at once. Propose something else."
        )
    return "\n\n".join(lines)


def _round(number: int, finished: Round, space: ParameterSpace, trials_of: TrialsOf) -> dict[str, Any]:
    before, last = finished.incumbent, finished.steps[-1].evaluation if finished.steps else None
    known = last is not None and not (last.failed or before.failed)
    notes = finished.proposal.notes
    return {
        "round": number,
        "accepted": finished.accepted,
        "diagnosis": shortened(finished.proposal.diagnosis, LONGEST),
        "changes": _changes(finished, space),
        "steps": [{"step_size": step.step_size, **_outcome(step.evaluation, trials_of)} for step in finished.steps],
        "start_loss": None if before.failed else before.loss,
        "loss_change": last.loss - before.loss if last is not None and known else None,
        "notes": {name: notes[name] for name in _CORRECTED if notes.get(name)},
    }


def _changes(finished: Round, space: ParameterSpace) -> list[dict[str, Any]]:
    """What the proposal changed, the largest change first; `kept` is the value that was accepted."""
    start, end = finished.incumbent.candidate.point, finished.proposal.point
    before, after = space.to_values(start), space.to_values(end)
    kept = space.to_values(finished.steps[-1].evaluation.candidate.point) if finished.accepted else {}
    order = [space.names[i] for i in sorted(range(len(space)), key=lambda i: -abs(end[i] - start[i]))]
    moved = [name for name in order if value(before[name], _DIGITS) != value(after[name], _DIGITS)]
    return [{"name": n, "from": before[n], "to": after[n], "kept": kept.get(n)} for n in moved]


def _outcome(evaluation: Evaluation, trials_of: TrialsOf) -> dict[str, Any]:
    """The loss of an evaluation and, where all trials were simulated, what else it did."""
    failed, detail = evaluation.failed, evaluation.detail or {}
    trials = [] if failed else trials_of(evaluation)
    whole = differences(trials)
    sensors = whole["sensors"]
    speeds = [row["speed_ratio"] for row in whole["by_trial"]] if any(t["frequency"] for t in trials) else []
    return {
        "loss": None if failed else evaluation.loss,
        "failed": failed,
        "why": _first_divergence(detail) if failed else None,
        "marker_error": mean(trial["figures"].get("aligned_marker_error") for trial in trials) if sensors else None,
        "sensors": sensors,
        "speed_ratios": speeds if any(ratio is not None for ratio in speeds) else None,
        "speed_ratio": whole["median"]["speed_ratio"],
        "amplitude_ratio": whole["median"]["amplitude_ratio"],
        **{part: mean(trial["figures"].get(f"{part}_error") for trial in trials) for part in ("shape", "recoil")},
    }


def _first_divergence(detail: Facts) -> str | None:
    """What diverged first, in a sentence."""
    reasons = ((name, trial.get("divergence")) for name, trial in detail.get("trials", {}).items())
    return next((f"trial '{name}': {reason}" for name, reason in reasons if reason), None)


def _how_told(facts: Facts, numbers: bool) -> str:
    steps = (
        "A step of 1 tries the proposal itself, a step of 0.5 a point halfway to it, and so on; the first step that "
        "improves on the best point so far is kept, the others are rejected. Changes are listed as value before → "
        "proposed value, the largest first, with the value that was kept where a smaller step was accepted; what isn't "
        "listed stayed as it was."
    )
    if not numbers:
        return steps
    parts = ["its loss, the change from the loss before the round"]
    if facts["differences"]["sensors"]:
        parts.append("what the markers have of it, the mean error of each sensor")
    if facts["compared"]["score_progress"]:
        each = " of each trial, by rising frequency" if facts["robot"]["beats"] else ""
        parts.append(f"the ratio of speeds (simulated / real){each}")
    figures = facts["incumbent"]["figures"]
    parts += [f"the error in {part}, in mm" for part in ("shape", "recoil") if f"{part}_error" in figures]
    last = f" of {facts['robot']['markers'][-1]}" if facts["robot"]["beats"] else ""
    parts.append(f"the ratio of amplitudes{last} (simulated / real)")
    return f"{steps} A step tells {', '.join(parts[:-1])} and {parts[-1]}: learn from it what a change does."


def _in_full(finished: Facts, numbers: bool) -> str:
    parts = [f"**{_verdict(finished, numbers)}**"]
    if numbers and finished["diagnosis"]:
        parts.append(f"- Diagnosis: {finished['diagnosis']}")
    parts.append(f"- Proposed: {_changes_text(finished, _LISTED)}")
    parts.append(f"- Steps: {'; '.join(_step(step, finished, numbers) for step in finished['steps'])}")
    parts.extend(f"- {_note(name, content)}" for name, content in finished["notes"].items())
    return "\n".join(parts)


def _in_one_line(finished: Facts, numbers: bool) -> str:
    return f"{_verdict(finished, numbers)}. {_changes_text(finished, _NAMED)}"


def _verdict(finished: Facts, numbers: bool) -> str:
    if not finished["accepted"]:
        return f"Round {finished['round']}: rejected"
    last = finished["steps"][-1]
    loss = ""
    if numbers:
        before = "failed" if finished["start_loss"] is None else mm(finished["start_loss"], 1)
        loss = f", loss {before} → {mm(last['loss'], 1)} mm"
    return f"Round {finished['round']}: accepted at step {last['step_size']:.3g}{loss}"


def _changes_text(finished: Facts, most: int) -> str:
    if not finished["changes"]:
        return "hardly any change."
    shown = [
        f"{change['name']} {value(change['from'], _DIGITS)} → {value(change['to'], _DIGITS)}" + _kept(change)
        for change in finished["changes"][:most]
    ]
    rest = len(finished["changes"]) - len(shown)
    return ", ".join(shown) + (f", and {rest} smaller change{'s' if rest > 1 else ''}" if rest else "") + "."


def _kept(change: Facts) -> str:
    kept = change["kept"]
    if kept is None or value(kept, _DIGITS) == value(change["to"], _DIGITS):
        return ""
    return f" (kept {value(kept, _DIGITS)})"


def _step(step: Facts, finished: Facts, numbers: bool) -> str:
    size = f"{step['step_size']:.3g}"
    if not numbers:
        accepted = finished["accepted"] and step is finished["steps"][-1]
        return f"{size} {'failed' if step['failed'] else 'accepted' if accepted else 'rejected'}"
    change = ""
    if not (step["failed"] or finished["start_loss"] is None):
        change = f" ({mm(step['loss'] - finished['start_loss'], 1, signed=True)})"
    return f"{size}: {_loss(step)}{change}{_effects(step)}"


def _effects(outcome: Facts) -> str:
    """What else a step did, in few words after its loss; empty where nothing is known."""
    parts = [f"markers {mm(outcome['marker_error'], 1)} mm"] if outcome["marker_error"] is not None else []
    parts += [
        f"{sensor['name']} {reading(sensor['error'])} {sensor['unit']}"
        for sensor in outcome["sensors"]
        if sensor["error"] is not None
    ]
    if outcome["speed_ratios"]:
        parts.append("speed " + " ".join(number(ratio, 2) for ratio in outcome["speed_ratios"]))
    elif outcome["speed_ratio"] is not None:
        parts.append(f"speed {number(outcome['speed_ratio'], 2)}")
    parts += [f"{part} {mm(outcome[part], 1)}" for part in ("shape", "recoil") if outcome[part] is not None]
    if outcome["amplitude_ratio"] is not None:
        parts.append(f"amplitude {number(outcome['amplitude_ratio'], 2)}")
    return "".join(f", {part}" for part in parts)


def _loss(outcome: Facts) -> str:
    if outcome["failed"]:
        return f"the simulation diverged ({outcome['why'] or 'no reason on record'})"
    return f"{mm(outcome['loss'], 1)} mm"


def _note(name: str, content: Any) -> str:
    if isinstance(content, Mapping):
        listed = ", ".join(f"{key} ({_given(given)} was given)" for key, given in content.items())
    else:
        listed = ", ".join(map(str, content)) if isinstance(content, list) else str(content)
    return f"{shortened(listed, _LONGEST_LIST)}: {_CORRECTED[name]}."


def _given(given: Any) -> str:
    if given is None:
        return UNKNOWN
    return value(given) if isinstance(given, int | float) else str(given)
