"""Puts the question of a round together: instructions, words, pictures or films."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from swim2real.advisor.briefing.detail import DETAILS, shorter
from swim2real.advisor.briefing.facts import facts
from swim2real.advisor.briefing.kinds import telling_of
from swim2real.advisor.briefing.media import gather_media
from swim2real.advisor.briefing.words import words
from swim2real.advisor.vlm.exchange import Request
from swim2real.advisor.vlm.prompt import instructions
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.objective import Comparison
from swim2real.optimizers import Situation
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.settings import BriefingSettings


class Briefing:
    """Writes the question of a round from the situation."""

    def __init__(
        self, robot: Robot, space: ParameterSpace, look: Callable[[Values], Comparison], videos: Mapping[str, Path],
        settings: BriefingSettings, takes_video: bool, reply_tokens: int,
    ) -> None:  # fmt: skip
        """Prepares the briefing.

        Args:
            robot: Whose simulator is calibrated.
            space: Of its parameters, on the run's scale.
            look: Simulates values once more, to be drawn.
            videos: Real films by trial, where there are any.
            settings: What is shown.
            takes_video: Films, or sheets of pictures.
            reply_tokens: Most tokens of a reply.
        """
        self._robot, self._space, self._look, self._videos = robot, space, look, dict(videos)
        self._settings, self._takes_video, self._reply_tokens = settings, takes_video, reply_tokens
        self._schema, self._telling = reply_schema(space), telling_of(robot)
        self._instructions = instructions(self._telling.look_for, self._telling.alike)

    def question(self, situation: Situation, level: int = 0) -> Request:
        """What is asked in a situation.

        Args:
            situation: Of the run.
            level: 0 for the detail that was asked for, 1 for the next lower one.
        """
        detail = DETAILS[self._settings.detail]
        detail = shorter(detail) if level else detail
        known = facts(situation, self._robot, self._space)
        text = words(known, numbers=self._settings.show != "pictures", rounds=detail.rounds)
        if self._settings.show == "numbers":
            return Request(self._instructions, (text,), self._schema, self._reply_tokens)
        comparison = self._look(self._space.to_values(situation.incumbent.candidate.point))
        scenes = self._telling.album(comparison, self._robot).scenes
        media, remarks = gather_media(scenes, detail, self._takes_video, self._videos)
        kind = "films" if self._takes_video else "pictures"
        intro = " ".join((f"## The {kind}\n\nSimulated is blue, real is red.", *remarks))
        return Request(self._instructions, (text, intro, *media), self._schema, self._reply_tokens)
