"""The facts of a round as Markdown in plain English, for a VLM or a person.

Knows no robot: what is special about one is in its description and in its parameters' meanings.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from swim2real.advisor.briefing.past import past
from swim2real.advisor.briefing.swims import swims
from swim2real.advisor.briefing.tables import number, table, value

Facts = Mapping[str, Any]

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
    sections = [f"# Round {facts['round']}", _robot(facts), _parameters(facts)]
    if numbers:
        sections.append(swims(facts))
    sections.append(past(facts, numbers, rounds))
    return "\n\n".join(sections) + "\n"


def estimate_tokens(text: str) -> int:
    """About how many tokens a text takes, rather too many than too few.

    A rule of thumb for today's tokenizers: one token for up to six letters of a word, and one for every digit, sign,
    line break and character beyond ASCII. Four characters a token, the usual rule, is for prose; tables of numbers take
    about twice as many, since several tokenizers split numbers into digits.
    """
    return sum(-(-len(piece) // _LETTERS) for piece in _PIECE.findall(text))


def _robot(facts: Facts) -> str:
    robot = facts["robot"]
    return (
        f"## The robot\n\nName: {robot['name']}. {robot['description']}\n\n"
        f"Markers, head first: {', '.join(robot['markers'])}."
    )


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
