"""All that a VLM can be told at a round, as plain data: a pure function of the situation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.differences import differences
from swim2real.advisor.briefing.history import history
from swim2real.advisor.briefing.trials import protocol_of, trials_of, without_errors
from swim2real.objective.evidence import rounded
from swim2real.optimizers import Evaluation, Situation
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot

LOSS = {
    "aligned": (
        "The mean distance between the simulated and the real markers over time, markers and trials. It is taken in a "
        "frame that is fixed to the first two markers, and along the swimming direction the distance by which the "
        "simulated robot has come too far or not far enough is added. The motor's angle at the start is fitted; static "
        "offsets of the markers and lost tracks don't count. The simulated robot is in its steady swim from the start."
    ),
    "paper": (
        "The mean distance between the simulated and the real markers over time, markers and trials, in a frame that "
        "turns with the head and advances with it. The simulated robot starts from rest at motor angle 0 and nothing "
        "is fitted: an unknown motor angle at the start and static offsets of the markers count as well."
    ),
}
_ABOUT = ("trials", "protocol", "horizon", "loss", "skipped")


def facts(situation: Situation, robot: Robot, space: ParameterSpace) -> dict[str, Any]:
    """What is known at a round, ready for JSON.

    Lengths are in m, speeds in m/s, phases in degrees, parameters in their units. None stands for what isn't known: a
    marker that was lost, a simulation that diverged, a ratio to something that hardly moves. Trials are in the order of
    their frequencies.

    Args:
        situation: As an advisor gets it.
        robot: Whose simulator is calibrated.
        space: Its parameters, as the optimizer uses them.
    """
    detail: Mapping[str, Any] = situation.incumbent.detail or {}
    protocol, trials = protocol_of(detail), trials_of(detail, robot.marker_names)
    return rounded(
        {
            "round": len(situation.rounds) + 1,
            "robot": {"name": robot.name, "description": robot.description, "markers": list(robot.marker_names)},
            "compared": {"protocol": protocol, "horizon": detail.get("horizon"), "loss": LOSS[protocol]},
            "scale": space.scale,
            "parameters": _parameters(situation, space),
            "incumbent": _incumbent(situation, detail, trials),
            "differences": differences(trials),
            "history": history(situation, space, robot.marker_names),
        }
    )


def _parameters(situation: Situation, space: ParameterSpace) -> list[dict[str, Any]]:
    here = situation.incumbent.candidate.point
    current, first = space.to_values(here), space.to_values(situation.first.candidate.point)
    return [
        {
            "name": one.name, "unit": one.unit, "lower": one.lower, "upper": one.upper, "meaning": one.meaning,
            "current": current[one.name], "first": first[one.name], "place": float(here[i]),
        }
        for i, one in enumerate(space)
    ]  # fmt: skip


def _incumbent(situation: Situation, detail: Mapping[str, Any], trials: Sequence[dict[str, Any]]) -> dict[str, Any]:
    evaluation: Evaluation = situation.incumbent
    accepted = [number for number, one in enumerate(situation.rounds, start=1) if one.accepted]
    figures = {name: value for name, value in detail.items() if name not in _ABOUT}
    return {
        "found_in_round": accepted[-1] if accepted else 0,
        "failed": evaluation.failed,
        "loss": None if evaluation.failed else evaluation.loss,
        "figures": without_errors(figures) if evaluation.failed else figures,
        "skipped": detail.get("skipped", 0),
        "trials": list(trials),
    }
