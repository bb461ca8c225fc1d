"""Builds the question of a round: instructions, words, pictures or films."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

from jinja2 import Environment, FunctionLoader, StrictUndefined

from swim2real.advisor.briefing import history, tables, texts
from swim2real.advisor.briefing.facts import RoundFacts
from swim2real.advisor.briefing.history import loss, rounds_told
from swim2real.advisor.briefing.media import DETAILS, Detail, Films, gather_media, shorter
from swim2real.advisor.vlm.exchange import Media, Request
from swim2real.advisor.vlm.instruments import MOST_ASKED
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.objective import TAIL_FIRST_LOSS, Comparison
from swim2real.optimizers import Evaluation, Situation
from swim2real.optimizers.advisor import STAYS
from swim2real.parameters import ParameterSpace, Values
from swim2real.rendering.album import Album
from swim2real.robots.robot import Robot
from swim2real.settings import BriefingSettings, Show
from swimbase.errors import ArgumentError
from swimbase.escaping import plain_markdown

FromRest: TypeAlias = Mapping[str, tuple[float | None, float | None]]


class TrialPromptBuilder:
    """Writes the question of a round from the situation. A `PromptBuilder`."""

    def __init__(
        self, robot: Robot, space: ParameterSpace, simulate: Callable[[Values], Comparison], videos: Films,
        settings: BriefingSettings, takes_video: bool, reply_tokens: int,
        from_rest: Callable[[Values], FromRest] = lambda values: {}, budget: int | None = None,
        several: bool = False,
    ) -> None:  # fmt: skip
        """Prepares the builder.

        Args:
            robot: The robot whose simulator is calibrated.
            space: Its parameters, on the run's scale.
            simulate: Simulates parameter values once more, so that they can be drawn.
            videos: Real films by the names of their trials, where there are any, with the rates that were given.
            settings: Settings of what is shown.
            takes_video: Whether films are shown, or sheets of pictures.
            reply_tokens: Most tokens of a reply.
            from_rest: Simulates from rest: forward speeds by trial [m/s], once it has settled and over the first two
                beats, None where it diverged.
            budget: Evaluations that the run has; None where that isn't known.
            several: Whether step sizes and alternatives are asked for.

        Raises:
            ArgumentError: Pictures alone are shown, of a robot without markers.
        """
        if settings.show == "pictures" and not robot.marker_names:
            raise ArgumentError(f"show is pictures, and robot '{robot.name}' has no markers to draw; show numbers")
        self._show: Show = settings.show if robot.marker_names else "numbers"
        self._robot, self._space, self._simulate, self._videos = robot, space, simulate, dict(videos)
        self._settings, self._takes_video, self._reply_tokens = settings, takes_video, reply_tokens
        self._from_rest, self._schema, self._budget = from_rest, reply_schema(space, several=several), budget
        self._several = several

    def question(self, situation: Situation, level: int = 0) -> Request:
        """Request for a proposal in a situation.

        Args:
            situation: Situation of the run.
            level: 0 for the detail of the settings, 1 for the next lower one.
        """
        detail = DETAILS[self._settings.detail]
        detail = shorter(detail) if level else detail
        values = self._space.to_values(situation.incumbent.candidate.point)
        known = RoundFacts(situation, self._robot, self._space, self._from_rest(values), self._budget)
        instructions, told, current = describe(known, self._show, self._several)
        if self._show == "numbers":
            return Request(instructions, (*told, current), self._schema, self._reply_tokens, len(told))
        media, remarks = self._media(situation, detail)
        intro = "\n\n".join((f"## The {'films' if self._takes_video else 'pictures'}", *remarks))
        parts = (*told, current, intro, *media)
        return Request(instructions, parts, self._schema, self._reply_tokens, len(told))

    def _media(self, situation: Situation, detail: Detail) -> tuple[Sequence[Media], Sequence[str]]:
        """Media of a request: of a point that is new, its worst trials."""
        before = None if self._show == "pictures" else shown_before(situation)  # pictures alone: there is nothing else
        here = situation.incumbent
        if before is here:
            return (), ("The current point was shown in an earlier round.",)
        scenes = Album(self._simulate(self._space.to_values(here.candidate.point)), self._robot).trials
        return gather_media(scenes, detail, self._takes_video, self._videos if before is None else {})


def shown_before(situation: Situation) -> Evaluation | None:
    """The point that the question before this one showed; None where this is the first of its search."""
    measured = list(situation.measurements)
    if not any(one.candidate.note.get("probe") for one in measured):  # none, or only those of before any question
        return situation.rounds[-1].incumbent if situation.rounds else None
    measured.pop()
    while measured and not measured[-1].candidate.note.get("probe"):
        measured.pop()
    start = situation.rounds[-1].result if situation.rounds else situation.first
    moved = [one for one in measured if not one.candidate.note.get(STAYS)]
    return min((start, *moved), key=lambda one: (one.failed, one.loss))


def describe(facts: RoundFacts, show: Show = "both", several: bool = False) -> tuple[str, list[str], str]:
    """All facts of a round as Markdown in plain English, for a VLM or a person.

    Args:
        facts: Facts of the round.
        show: What it comes with. With pictures alone, nothing measured or compared is reported; what stays: the robot,
            its parameters, and which proposals were accepted.
        several: Whether step sizes and alternatives are asked for.

    Returns:
        What stays the same in a run; a block per finished round, to which later rounds only add; the current point.
    """
    numbers = show != "pictures"
    instructions = _written("instructions.md.j2", facts=facts, numbers=numbers, show=show, several=several)
    first = facts.situation.first
    begun = f"\n\nThe first point of the run: {loss(first, facts)}{history.effects(first, facts)}." if numbers else ""
    told = [f"## What was tried{begun}", *rounds_told(facts, numbers)] if facts.situation.rounds else []
    current = _written("briefing.md.j2", facts=facts, numbers=numbers)
    return plain_markdown(instructions), [plain_markdown(block) for block in told], plain_markdown(current)


def _written(name: str, **content: object) -> str:
    """A template, filled; however many blank lines part two paragraphs, it is one."""
    text = _environment().get_template(name).render(content)
    return re.sub(r"\n\s*\n", "\n\n", text).strip()


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FunctionLoader(_template), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        autoescape=False,
    )  # fmt: skip
    for module in (history, tables, texts):
        environment.globals.update(vars(module))
    extra: dict[str, Any] = {"hypot": math.hypot, "tail_first_loss": TAIL_FIRST_LOSS, "most_asked": MOST_ASKED}
    environment.globals.update(extra)
    environment.filters["without_blank_lines"] = _without_blank_lines
    return environment


def _template(name: str) -> str:
    """A template's source, in which a line that ends in a backslash goes on in the next."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8").replace("\\\n", "")


def _without_blank_lines(text: str) -> str:
    return "\n".join(filter(str.strip, text.splitlines()))
