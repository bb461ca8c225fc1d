"""From a method's name to the optimizer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError
from swim2real.optimizers import (
    Advice,
    Advisor,
    BacktrackingLineSearch,
    BayesianOptimization,
    CmaEs,
    LeastSquares,
    Optimizer,
    RandomSearch,
    ScriptedAdvisor,
    Stage,
    Staged,
    WarmStart,
    first_point,
    streams,
)
from swim2real.optimizers.callback import CallbackSolver
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot
from swim2real.settings import Method
from swim2real.sysid import least_squares

Array = NDArray[np.float64]

_INSIDE = 0.02  # of a parameter's range


def make_optimizer(
    method: Method, robot: Robot, space: ParameterSpace, seed: int, budget: int, advisor: Advisor | None = None,
    advice: Sequence[Advice] = (), *, from_model: bool = False, starts: int = 1, max_steps: int = 3,
    early_stop: bool = False, give_up: float | None = None,
) -> Optimizer:  # fmt: skip
    """The optimizer of a name, fresh.

    Args:
        method: Its name.
        robot: Whose simulator is calibrated.
        space: Space of the robot's parameters, on the run's scale.
        seed: Seed of the run.
        budget: Budget of the run, which stages are planned by.
        advisor: Who proposes, where the method is advised.
        advice: On record, which isn't asked for again.
        from_model: Whether the first point is the model's own values; else it is random, by the seed. Where a method
            draws a population, it doesn't begin there.
        starts: Points that the line search evaluates first, the first point included.
        max_steps: Largest number of steps tried in a round of the line search.
        early_stop: Whether the line search lets evaluations stop once a step is certain to be rejected.
        give_up: When the line search leaves a direction after its full step; None never.

    Raises:
        ArgumentError: The method needs an advisor and there is none, or stages that the robot hasn't.
        MissingExtraError: A library that the method needs isn't installed.
    """
    dimension = len(space)
    first = _of_model(space) if from_model else first_point(dimension, seed)
    _, rng, _ = streams(seed)
    match method:
        case "random":
            return RandomSearch(dimension, rng, first)
        case "cma-es":  # begins where its own population does, as in the paper
            return CmaEs(dimension, rng)
        case "bayesopt":
            return BayesianOptimization(dimension, rng, first)
        case "least-squares":
            return LeastSquares(first, rng)
        case "mujoco-sysid":
            return CallbackSolver(first, rng, least_squares(space), "mujoco.sysid")
        case "staged":
            return _staged(robot, space, first, rng, budget)
        case "line-search" | "warm-start":
            pass
    if advisor is None:
        raise ArgumentError(f"method {method} needs an advisor")
    if advice:
        advisor = ScriptedAdvisor(advice, then=advisor)
    if method == "warm-start":
        return WarmStart(advisor, first, RandomSearch(dimension, rng))
    return BacktrackingLineSearch(
        advisor, first, max_steps=max_steps, early_stop=early_stop, give_up=give_up,
        more_starts=_spread(dimension, starts - 1, rng),
    )  # fmt: skip


def default_starts(dimension: int, budget: int) -> int:
    """Starts of a line search where nothing is known of the robot: a tenth of the budget, at most two a parameter."""
    return max(1, min(2 * dimension, budget // 10))


def _spread(dimension: int, count: int, rng: np.random.Generator) -> list[Array]:
    """Points that share each parameter's range evenly: a Latin hypercube. Shapes (d,)."""
    layers = rng.permuted(np.tile(np.arange(count), (dimension, 1)), axis=1).T
    return list((layers + rng.random((count, dimension))) / max(count, 1))


def _of_model(space: ParameterSpace) -> Array:
    """The model's own values, a little off the bounds, where differences can be taken both ways. Shape (d,)."""
    return np.clip(space.to_cube(space.published), _INSIDE, 1 - _INSIDE)


def _staged(robot: Robot, space: ParameterSpace, first: Array, rng: np.random.Generator, budget: int) -> Staged:
    """The robot's plan in the unit cube."""
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
    held_point = space.to_cube({**space.to_values(first), **plan.held})
    held = {space.names.index(name): float(held_point[space.names.index(name)]) for name in plan.held}
    return Staged(first, stages, budget, BayesianOptimization, rng, held)
