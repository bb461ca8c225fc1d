"""The methods of calibration: one entry each, with how it is made and what a comparison needs to know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swim2real.optimizers import (
    Advisor,
    BacktrackingLineSearch,
    BayesianOptimization,
    CmaEs,
    LeastSquares,
    MultiStart,
    Optimizer,
    ProposalSearch,
    RandomSearch,
    Sequel,
    Stage,
    Staged,
    first_point,
    streams,
)
from swim2real.optimizers.callback import CallbackSolver
from swim2real.optimizers.mujoco_sysid import least_squares
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.settings import PAPER_BUDGET, CalibrationSettings, Method
from swimbase.errors import ArgumentError

Array = NDArray[np.float64]

_INSIDE = 0.02  # of a parameter's range
_STARTS_PER_PARAMETER = 2.5  # of method multi-start


@dataclass(frozen=True)
class _Start:
    """What an optimizer is made of.

    Attributes:
        robot: Robot whose simulator is calibrated.
        space: Its parameters, on the run's scale.
        settings: Settings of the run.
        first: First point. Shape (d,).
        rng: Random stream of the optimizer.
        advisor: Who proposes, None without one.
    """

    robot: Robot
    space: ParameterSpace
    settings: CalibrationSettings
    first: Array
    rng: np.random.Generator
    advisor: Advisor | None


@dataclass(frozen=True)
class _MethodEntry:
    """A method of calibration.

    Attributes:
        make: Makes its optimizer.
        advised: Whether an advisor proposes.
        planned_by_budget: Whether a run can't go on with another budget.
        cost: Duration of an evaluation relative to a random search's, with what the method itself takes.
        by_default: Whether a comparison has it where no methods are named.
    """

    make: Callable[[_Start], Optimizer]
    advised: bool = False
    planned_by_budget: bool = False
    cost: float = 1.0
    by_default: bool = True


def make_optimizer(
    settings: CalibrationSettings, robot: Robot, space: ParameterSpace, advisor: Advisor | None = None,
    begin: Values | None = None,
) -> Optimizer:  # fmt: skip
    """The optimizer of a run's settings, fresh.

    Args:
        settings: Its method, seed and budget, whether multi-start goes on after that, and steps and starts of the line
            search.
        robot: Robot whose simulator is calibrated.
        space: The robot's parameters, on the run's scale.
        advisor: Who proposes, where the method is advised.
        begin: Values of the first point; None for the seed's, or for the model's own, a little off the bounds, where
            differences can be taken both ways.

    Raises:
        ArgumentError: The method needs an advisor and there is none, or stages that the robot hasn't.
        MissingExtraError: A library that the method needs isn't installed.
    """
    first = first_point(len(space), settings.seed)
    if settings.first == "model":
        first = np.clip(space.to_cube(space.published), _INSIDE, 1 - _INSIDE)
    elif begin is not None:
        first = space.to_cube(begin)
    _, rng, _ = streams(settings.seed)
    budget = settings.budget
    optimizer = METHODS[settings.chosen_method].make(_Start(robot, space, settings, first, rng, advisor))
    if settings.finish and budget is not None:
        later = np.random.default_rng([settings.seed, budget])
        return Sequel(optimizer, budget, lambda best: _spread_starts(robot, best, later))
    return optimizer


def default_starts(dimension: int, budget: int) -> int:
    """Starts of a line search where nothing is known of the robot: a tenth of the budget, at most two per parameter."""
    return max(1, min(2 * dimension, budget // 10))


def _advised(start: _Start) -> Optimizer:
    if start.advisor is None:
        raise ArgumentError(f"method {start.settings.method} needs an advisor")
    search = ProposalSearch if start.settings.method == "proposal-search" else BacktrackingLineSearch
    return search(
        start.advisor, start.first, max_steps=start.settings.max_steps,
        more_starts=_spread(len(start.space), (start.settings.starts or 1) - 1, start.rng),
    )  # fmt: skip


def _spread_starts(robot: Robot, first: Array, rng: np.random.Generator) -> MultiStart:
    swims = robot.trials.swims  # those at full length end at no threshold
    count = round(_STARTS_PER_PARAMETER * len(first))
    return MultiStart([first, *_spread(len(first), count - 1, rng)], rng, swims is not None and swims.slow_mode)


def _spread(dimension: int, count: int, rng: np.random.Generator) -> list[Array]:
    """Points that share each parameter's range evenly: a Latin hypercube. Shapes (d,)."""
    layers = rng.permuted(np.tile(np.arange(count), (dimension, 1)), axis=1).T
    return list((layers + rng.random((count, dimension))) / max(count, 1))


def _staged(start: _Start) -> Optimizer:
    """The robot's plan of stages in the unit cube."""
    robot, space = start.robot, start.space
    plan = robot.swims.fit_plan
    if plan is None:
        raise ArgumentError(f"robot '{robot.name}' has no stages, which method staged needs; choose another method")
    stages = [
        Stage(
            one.name, tuple(space.names.index(name) for name in one.parameters), one.share,
            "scan" if one.together else "search", one.score,
        )
        for one in plan.stages
    ]  # fmt: skip
    held_point = space.to_cube({**space.to_values(start.first), **plan.held})
    held = {space.names.index(name): float(held_point[space.names.index(name)]) for name in plan.held}
    return Staged(start.first, stages, start.settings.budget or PAPER_BUDGET, BayesianOptimization, start.rng, held)


METHODS: dict[Method, _MethodEntry] = {
    "line-search": _MethodEntry(_advised, advised=True),
    "proposal-search": _MethodEntry(_advised, advised=True, by_default=False),
    "random": _MethodEntry(lambda start: RandomSearch(len(start.space), start.rng, start.first)),
    # begins where its own population does, as in the paper
    "cma-es": _MethodEntry(lambda start: CmaEs(len(start.space), start.rng)),
    "bayesopt": _MethodEntry(lambda start: BayesianOptimization(len(start.space), start.rng, start.first), cost=3.0),
    "least-squares": _MethodEntry(lambda start: LeastSquares(start.first, start.rng)),
    "multi-start": _MethodEntry(lambda start: _spread_starts(start.robot, start.first, start.rng), by_default=False),
    "mujoco-sysid": _MethodEntry(
        lambda start: CallbackSolver(start.first, start.rng, least_squares(start.space), "mujoco.sysid"),
        by_default=False,
    ),
    "staged": _MethodEntry(_staged, planned_by_budget=True, cost=2.0),
}
