"""All that a VLM can be told at a round, as plain data: a pure function of the situation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.averages import without_errors
from swim2real.advisor.briefing.history import history
from swim2real.advisor.briefing.kinds import telling_of
from swim2real.objective.comparison import rounded
from swim2real.optimizers import Evaluation, Situation
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot

_ABOUT = ("trials", "protocol", "horizon", "loss", "skipped")


def facts(situation: Situation, robot: Robot, space: ParameterSpace) -> dict[str, Any]:
    """What is known at a round, ready for JSON.

    Lengths are in m, speeds in m/s, phases in degrees, parameters in their units. None stands for what isn't known: a
    marker that was lost, a simulation that diverged, a ratio to something that hardly moves.

    Args:
        situation: As an advisor gets it.
        robot: Whose simulator is calibrated.
        space: Its parameters, as the optimizer uses them.
    """
    detail: Mapping[str, Any] = situation.incumbent.detail or {}
    telling = telling_of(robot)
    trials = telling.trials(detail, robot)
    return rounded(
        {
            "round": len(situation.rounds) + 1,
            "robot": {"name": robot.name, "description": robot.description, "markers": list(robot.marker_names)},
            "kind": telling.kind,
            "compared": telling.compared(detail, robot),
            "scale": space.scale,
            "parameters": _parameters(situation, space),
            "incumbent": _incumbent(situation, detail, trials),
            "differences": telling.differences(trials),
            "history": history(situation, space, robot),
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
