"""The facts of a round as Markdown in plain English, for a VLM or a person.

Knows no robot: what is special about one is in its description and in its parameters' meanings.
"""

from __future__ import annotations

import re

from swim2real.advisor.briefing.kinds import telling_for
from swim2real.advisor.briefing.past import past
from swim2real.advisor.briefing.tables import mm, number, table, value
from swim2real.advisor.briefing.telling import Facts, Telling

_PIECE = re.compile(r"[A-Za-z]+|[^\s]|\n")
_LETTERS = 6  # of a word that a token holds, on average
_SCALE = {"log": "the logarithmic scale", "linear": "the linear scale"}


def words(facts: Facts, *, numbers: bool = True, rounds: int | None = None) -> str:
    """All facts in words.

    Args:
        facts: As `facts.facts` gives them.
        numbers: Whether anything is told that was measured or compared. Without, what stays is the robot, its
            parameters, and which proposals were accepted.
        rounds: How many of the last rounds are told in full; older ones get a line. None for all.
    """
    telling = telling_for(facts)
    sections = [f"# Round {facts['round']}", _robot(facts, telling), _parameters(facts)]
    if numbers:
        sections.append(_differences(facts, telling))
    sections.append(past(facts, numbers, rounds))
    return "\n\n".join(sections) + "\n"


def estimate_tokens(text: str) -> int:
    """About how many tokens a text takes, rather too many than too few.

    A rule of thumb for today's tokenizers: one token for up to six letters of a word, and one for every digit, sign,
    line break and character beyond ASCII. Four characters a token, the usual rule, is for prose; tables of numbers take
    about twice as many, since several tokenizers split numbers into digits.
    """
    return sum(-(-len(piece) // _LETTERS) for piece in _PIECE.findall(text))


def _robot(facts: Facts, telling: Telling) -> str:
    robot = facts["robot"]
    return f"## The robot\n\nName: {robot['name']}. {robot['description']}\n\n{telling.markers(facts)}"


def _parameters(facts: Facts) -> str:
    rows = [
        [
            one["name"], one["unit"], value(one["lower"]), value(one["upper"]), value(one["first"]),
            value(one["current"]), number(one["place"], 2), one["meaning"],
        ]
        for one in facts["parameters"]
    ]  # fmt: skip
    how = (
        "Each value is in the unit of its row; answer in the same unit. `current` is the best point so far, from which "
        "you change; `first` is where the run began. `place` says where `current` lies between the bounds, 0 at the "
        f"lower and 1 at the upper one, on {_SCALE[facts['scale']]} on which steps are taken."
    )
    columns = ("parameter", "unit", "lower", "upper", "first", "current", "place", "meaning")
    return f"## Parameters of the simulator\n\n{how}\n\n{table(columns, rows)}"


def _differences(facts: Facts, telling: Telling) -> str:
    """How simulated trials differ from the real ones at the best point so far."""
    incumbent, trials = facts["incumbent"], facts["incumbent"]["trials"]
    parts = [f"## Simulated and real {telling.motion}s at the current point", _compared(facts, telling)]
    if incumbent["failed"]:
        parts.append("The simulation at the current point failed, so it has no loss. First of all it must run stably.")
    diverged = [f"- {telling.called(t)}: diverged. {t['diverged']}" for t in trials if t["diverged"]]
    if diverged:
        parts.append("\n".join([f"These trials have no simulated {telling.motion}:", *diverged]))
    if incumbent["skipped"]:
        parts.append(f"Trials that weren't simulated and that nothing here includes: {incumbent['skipped']}.")
    details = telling.details(facts) if trials else ["There are no numbers of this point."]
    return "\n\n".join([*parts, *details])


def _compared(facts: Facts, telling: Telling) -> str:
    compared, incumbent = facts["compared"], facts["incumbent"]
    horizon = compared["horizon"]
    seconds = f"The first {horizon:g} s of each trial are compared." if horizon else "All of each trial is compared."
    first = facts["history"]["first"]
    loss = ""
    if incumbent["loss"] is not None:
        began = "" if incumbent["found_in_round"] == 0 or first["failed"] else f" (first {mm(first['loss'], 1)} mm)"
        found = f", found in round {incumbent['found_in_round']}" if incumbent["found_in_round"] else ""
        loss = f"**The loss is {mm(incumbent['loss'], 1)} mm**{began}{found}; lower is better."
    return " ".join(part for part in (loss, compared["loss"], seconds, telling.names) if part)
