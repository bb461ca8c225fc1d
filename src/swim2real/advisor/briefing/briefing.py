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
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.objective import Comparison
from swim2real.optimizers import Situation
from swim2real.parameters import ParameterSpace, Values
from swim2real.rendering.album import Album
from swim2real.robots.robot import Robot
from swim2real.settings import BriefingSettings

_INSTRUCTIONS = """\
You calibrate a physics simulator of a robot. Each round you are shown how simulated motion differs from the real \
robot's, as pictures or films, as numbers, or both. Simulated is blue, real is red.

Work in this order:
1. diagnosis: name the physical discrepancies that you see or read, {look_for}.
2. reasoning: say which parameters are responsible and which way each must go. Keep effects apart that look alike: \
{alike}. Learn from the history: a direction that was rejected is wrong or too long; don't repeat it.
3. parameters: propose a value for every parameter, within its bounds. Repeat the current value of those you would \
keep. Change the few that explain most rather than all at once: changes that cancel one another teach nothing.

Your proposal is tried at the full change first, then at half of it, then at a quarter; the first that lowers the loss \
is kept. So the direction matters most, and a bold step costs little.

Answer with one JSON object and nothing else: \
{{"diagnosis": text, "reasoning": text, "parameters": {{name: number}}}}. \
Numbers are plain numbers in the units given, without units, text, null or NaN."""


def instructions(look_for: str, alike: str) -> str:
    """The system's part of the prompt.

    Args:
        look_for: Discrepancies that may be seen.
        alike: Effects that look alike, and what tells them apart.
    """
    return _INSTRUCTIONS.format(look_for=look_for, alike=alike)


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
        scenes = Album(comparison, self._robot).scenes
        media, remarks = gather_media(scenes, detail, self._takes_video, self._videos)
        kind = "films" if self._takes_video else "pictures"
        intro = " ".join((f"## The {kind}\n\nSimulated is blue, real is red.", *remarks))
        return Request(self._instructions, (text, intro, *media), self._schema, self._reply_tokens)
