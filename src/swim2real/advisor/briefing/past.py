"""What was tried and what came of it, in words, so that nothing is tried twice."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swim2real.advisor.briefing.history import shortened
from swim2real.advisor.briefing.kinds import telling_for
from swim2real.advisor.briefing.tables import UNKNOWN, mm, value
from swim2real.advisor.briefing.telling import Facts, Telling
from swim2real.errors import ArgumentError

_NAMED, _LISTED = 3, 8  # changes that are named of an older and of a recent round
_LONGEST = 300  # characters of a list of names
_MENDED = {
    "clipped": "out of bounds, so moved to the bound",
    "ignored": "no parameters of this simulator, so ignored",
    "missing": "not given, so left as they were",
    "kept": "left as they were",
}


def past(facts: Facts, numbers: bool = True, rounds: int | None = None) -> str:
    """The section on earlier rounds.

    Args:
        facts: Of the round.
        numbers: Whether losses and diagnoses are told; a diagnosis may quote what was measured.
        rounds: How many of the last rounds are told in full. None for all.

    Raises:
        ArgumentError: The number of rounds is negative.
    """
    if rounds is not None and rounds < 0:
        raise ArgumentError(f"rounds is {rounds}; it must be at least 0, or None for all")
    history, telling = facts["history"], telling_for(facts)
    every = history["rounds"]
    older = 0 if rounds is None else max(len(every) - rounds, 0)
    lines = ["## What was tried"]
    if not every:
        first = _first(history, telling) if numbers else ""
        return "\n\n".join([*lines, f"Nothing yet: this is the first round.{first}"])
    lines.append(_how(facts, telling, numbers) + (_first(history, telling) if numbers else ""))
    lines.extend(_line(one, numbers) for one in every[:older])
    lines.extend(_full(one, telling, numbers) for one in every[older:])
    since = history["rounds_since_accepted"]
    if since:
        many = "round was" if since == 1 else f"{since} rounds were"
        lines.append(
            f"The last {many} rejected: what was proposed there from the current point leads the wrong way, or changes "
            "too much at once. Propose something else."
        )
    return "\n\n".join(lines)


def _how(facts: Facts, telling: Telling, numbers: bool) -> str:
    steps = (
        "A step of 1 tries the proposal itself, a step of 0.5 a point halfway to it, and so on; the first step that "
        "improves on the best point so far is kept, the others are rejected. Changes are listed as value before → "
        "proposed value, the largest first, with the value that was kept where a smaller step was accepted."
    )
    return f"{steps} {telling.steps(facts)}" if numbers else steps


def _first(history: Facts, telling: Telling) -> str:
    return f" The first point of the run: {_loss(history['first'])}{telling.step(history['first'])}."


def _full(one: Facts, telling: Telling, numbers: bool) -> str:
    parts = [f"**{_verdict(one, numbers)}**"]
    if numbers and one["diagnosis"]:
        parts.append(f"- Diagnosis: {one['diagnosis']}")
    parts.append(f"- Proposed: {_changes(one, _LISTED)}")
    parts.append(f"- Steps: {'; '.join(_step(step, one, telling, numbers) for step in one['steps'])}")
    parts.extend(f"- {_note(name, content)}" for name, content in one["notes"].items())
    return "\n".join(parts)


def _line(one: Facts, numbers: bool) -> str:
    return f"{_verdict(one, numbers)}. {_changes(one, _NAMED)}"


def _verdict(one: Facts, numbers: bool) -> str:
    if not one["accepted"]:
        return f"Round {one['round']}: rejected"
    last = one["steps"][-1]
    loss = ""
    if numbers:
        before = "failed" if one["start_loss"] is None else mm(one["start_loss"], 1)
        loss = f", loss {before} → {mm(last['loss'], 1)} mm"
    return f"Round {one['round']}: accepted at step {_size(last)}{loss}"


def _changes(one: Facts, most: int) -> str:
    if not one["changes"]:
        return "hardly any change."
    shown = [
        f"{change['name']} {value(change['from'], 3)} → {value(change['to'], 3)}" + _kept(change)
        for change in one["changes"][:most]
    ]
    rest = len(one["changes"]) - len(shown)
    return ", ".join(shown) + (f", and {rest} smaller change{'s' if rest > 1 else ''}" if rest else "") + "."


def _kept(change: Facts) -> str:
    kept = change["kept"]
    return f" (kept {value(kept, 3)})" if kept is not None and value(kept, 3) != value(change["to"], 3) else ""


def _step(step: Facts, one: Facts, telling: Telling, numbers: bool) -> str:
    size = _size(step)
    if not numbers:
        accepted = one["accepted"] and step is one["steps"][-1]
        return f"{size} {'failed' if step['failed'] else 'accepted' if accepted else 'rejected'}"
    told = f"{size}: {_loss(step)}"
    if not (step["failed"] or step["lower_bound"] or one["start_loss"] is None):
        told += f" ({mm(step['loss'] - one['start_loss'], 1, signed=True)})"
    return told + telling.step(step)


def _size(step: Facts) -> str:
    return f"{step['step_size']:.3g}"


def _loss(outcome: Facts) -> str:
    if outcome["failed"]:
        return f"the simulation diverged ({outcome['why'] or 'no reason on record'})"
    return f"{'over ' if outcome['lower_bound'] else ''}{mm(outcome['loss'], 1)} mm"


def _note(name: str, content: Any) -> str:
    if isinstance(content, Mapping):
        listed = ", ".join(f"{key} ({_given(given)} was given)" for key, given in content.items())
    else:
        listed = ", ".join(map(str, content)) if isinstance(content, list) else str(content)
    return f"{shortened(listed, _LONGEST)}: {_MENDED[name]}."


def _given(given: Any) -> str:
    if given is None:
        return UNKNOWN
    return value(given) if isinstance(given, int | float) else str(given)
