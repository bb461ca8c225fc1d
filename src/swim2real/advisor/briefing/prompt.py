"""Builds the question of a round: instructions, words, pictures or films."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined

from swim2real.advisor.briefing import history, tables, texts
from swim2real.advisor.briefing.facts import RoundFacts
from swim2real.advisor.briefing.media import DETAILS, gather_media, shorter
from swim2real.advisor.vlm.exchange import Request
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.errors import ArgumentError
from swim2real.escaping import plain_markdown
from swim2real.objective import TAIL_FIRST_LOSS, Comparison
from swim2real.optimizers import Evaluation, Situation, Step
from swim2real.parameters import ParameterSpace, Values
from swim2real.rendering.album import Album, TrialPictures
from swim2real.robots.robot import Robot
from swim2real.settings import BriefingSettings

_CLOSE = 1.15  # times the incumbent's loss: a rejected step that is no worse is shown


class TrialPromptBuilder:
    """Writes the question of a round from the situation. A `PromptBuilder`."""

    def __init__(
        self, robot: Robot, space: ParameterSpace, simulate: Callable[[Values], Comparison], videos: Mapping[str, Path],
        settings: BriefingSettings, takes_video: bool, reply_tokens: int,
        from_rest: Callable[[Values], Mapping[str, float | None]] = lambda values: {}, budget: int | None = None,
    ) -> None:  # fmt: skip
        """Prepares the builder.

        Args:
            robot: The robot whose simulator is calibrated.
            space: Its parameters, on the run's scale.
            simulate: Simulates parameter values once more, so that they can be drawn.
            videos: Real films by the names of their trials, where there are any.
            settings: Settings of what is shown.
            takes_video: Whether films are shown, or sheets of pictures.
            reply_tokens: Most tokens of a reply.
            from_rest: Simulates from rest: forward speeds by trial [m/s], None where it diverged.
            budget: Evaluations that the run has; None where that isn't known.
        """
        self._robot, self._space, self._simulate, self._videos = robot, space, simulate, dict(videos)
        self._settings, self._takes_video, self._reply_tokens = settings, takes_video, reply_tokens
        self._from_rest, self._schema, self._budget = from_rest, reply_schema(space), budget

    def question(self, situation: Situation, level: int = 0) -> Request:
        """What is asked in a situation.

        Args:
            situation: Situation of the run.
            level: 0 for the detail of the settings, 1 for the next lower one.
        """
        detail = DETAILS[self._settings.detail]
        detail = shorter(detail) if level else detail
        beats = self._robot.trials.swims is not None
        instructions = _written("instructions.md.j2", beats=beats)
        values = self._space.to_values(situation.incumbent.candidate.point)
        known = RoundFacts(situation, self._robot, self._space, self._from_rest(values), self._budget)
        text = describe(known, numbers=self._settings.show != "pictures", rounds=detail.rounds)
        if self._settings.show == "numbers":
            return Request(instructions, (text,), self._schema, self._reply_tokens)
        scenes = self._scenes(situation.incumbent)
        rejected = self._rejected(situation, scenes)
        media, remarks = gather_media(scenes, detail, self._takes_video, self._videos, rejected)
        kind = "films" if self._takes_video else "pictures"
        intro = " ".join((f"## The {kind}\n\nSimulated is blue, real is red.", *remarks))
        return Request(instructions, (text, intro, *media), self._schema, self._reply_tokens)

    def _scenes(self, evaluation: Evaluation) -> list[TrialPictures]:
        """The trials of an evaluation, simulated once more."""
        return Album(self._simulate(self._space.to_values(evaluation.candidate.point)), self._robot).trials

    def _rejected(self, situation: Situation, here: Sequence[TrialPictures]) -> tuple[str, TrialPictures] | None:
        """The best rejected step since the incumbent was found, where it came close, and the trial it changes most."""
        found = close_miss(situation)
        if found is None:
            return None
        nth, step = found
        there = self._scenes(step.evaluation)
        changed = max(range(len(there)), key=lambda i: abs(there[i].loss - here[i].loss))
        what = f"Not the current point but the rejected step {step.step_size:.3g} of round {nth}"
        if self._settings.show == "both":
            there_loss, here_loss = (texts.mm(one.loss) for one in (step.evaluation, situation.incumbent))
            what += f" ({there_loss} mm, the current point has {here_loss})"
        return what, there[changed]


def close_miss(situation: Situation) -> tuple[int, Step] | None:
    """The best step that was rejected since the incumbent was found, with its round, where its loss came close."""
    since: list[tuple[int, Step]] = []
    for i, finished in enumerate(situation.rounds, start=1):
        whole = [(i, s) for s in finished.steps if not s.evaluation.failed]
        since = [] if finished.accepted else since + whole
    best = min(since, key=lambda one: one[1].evaluation.loss, default=None)
    return best if best is not None and best[1].evaluation.loss <= _CLOSE * situation.incumbent.loss else None


def describe(facts: RoundFacts, *, numbers: bool = True, rounds: int | None = None) -> str:
    """All facts of a round as Markdown in plain English, for a VLM or a person.

    Args:
        facts: Facts of the round.
        numbers: Whether anything is told that was measured or compared. Without, what stays is the robot, its
            parameters, and which proposals were accepted.
        rounds: How many of the last rounds are told in full; older ones get a line. None for all.

    Raises:
        ArgumentError: The number of rounds is negative.
    """
    if rounds is not None and rounds < 0:
        raise ArgumentError(f"rounds is {rounds}; it must be at least 0, or None for all")
    older = 0 if rounds is None else max(len(facts.situation.rounds) - rounds, 0)
    text = _written("briefing.md.j2", facts=facts, numbers=numbers, older=older)
    return plain_markdown(text) + "\n"


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
    extra: dict[str, Any] = {"hypot": math.hypot, "tail_first_loss": TAIL_FIRST_LOSS}
    environment.globals.update(extra)
    environment.filters["without_blank_lines"] = _without_blank_lines
    return environment


def _without_blank_lines(text: str) -> str:
    return "\n".join(line for line in text.splitlines() if line.strip())


def _template(name: str) -> str:
    """A template's source, in which a line that ends in a backslash goes on in the next."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8").replace("\\\n", "")
