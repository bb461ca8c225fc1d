"""The kinds of trials and how each is told: the only place of the room that asks which it is."""

from __future__ import annotations

from swim2real.advisor.briefing.recordings.telling import RecordingTelling
from swim2real.advisor.briefing.swims.telling import SwimTelling
from swim2real.advisor.briefing.telling import Facts, Telling
from swim2real.robots.robot import Robot

_TELLINGS: dict[str, Telling] = {telling.kind: telling for telling in (SwimTelling(), RecordingTelling())}


def telling_of(robot: Robot) -> Telling:
    """How a robot's trials are told."""
    return _TELLINGS[robot.trials.kind]


def telling_for(facts: Facts) -> Telling:
    """How the trials of these facts are told."""
    return _TELLINGS[facts["kind"]]
