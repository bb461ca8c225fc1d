"""The optimizers of the methods of calibration, made of a run's settings."""

from __future__ import annotations

import pkgutil
from dataclasses import dataclass, replace

import numpy as np

from swim2real import optimizers
from swim2real.advisor import PhysicsAdvisor
from swim2real.methods import METHODS
from swim2real.optimizers.callback import CallbackSolver
from swim2real.optimizers.enough import Sizes
from swim2real.optimizers.mujoco_sysid import least_squares as solver
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.settings import PAPER_BUDGET, CalibrationSettings
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

_INSIDE = 0.02  # of a parameter's range
_STARTS_PER_PARAMETER = 2.5  # of method multi-start
_LED = 10  # evaluations by which the physics advisor finds where multi-start begins, where a response is known


@dataclass(frozen=True)
class Start:
    """Parts that an optimizer is made of.

    Attributes:
        robot: Robot whose simulator is calibrated.
        space: Its parameters, on the run's scale.
        settings: Settings of the run.
        first: First point. Shape (d,).
        rng: Random stream of the optimizer.
        advisor: Who proposes, None without one.
        sizes: Noise and motion of the trials.
        led: Whether the physics advisor, or the method before a finish, finds where multi-start begins first.
    """

    robot: Robot
    space: ParameterSpace
    settings: CalibrationSettings
    first: Array
    rng: np.random.Generator
    advisor: optimizers.Advisor | None
    sizes: Sizes
    led: bool


def make_optimizer(
    settings: CalibrationSettings, robot: Robot, space: ParameterSpace, advisor: optimizers.Advisor | None = None,
    begin: Values | None = None, *, sizes: Sizes | None = None, led: bool = True,
) -> optimizers.Optimizer:  # fmt: skip
    """The optimizer of a run's settings, fresh.

    Args:
        settings: Its method, seed and budget, whether multi-start goes on after that, and steps and starts of the line
            search.
        robot: Robot whose simulator is calibrated.
        space: The robot's parameters, on the run's scale.
        advisor: Who proposes, where the method is advised.
        begin: Values of the first point; None for the seed's, or for the model's own, a little off the bounds, where
            differences can be taken both ways.
        sizes: Noise and motion of the trials, by which multi-start judges whether it is done.
        led: Whether multi-start first follows the best point of the physics advisor, where the robot's response is
            known, or of the method that it finishes; runs of before don't.

    Raises:
        ArgumentError: The method needs an advisor and there is none, or stages that the robot hasn't.
        MissingExtraError: A library that the method needs isn't installed.
    """
    first = optimizers.first_point(len(space), settings.seed)
    if settings.first == "model":
        first = np.clip(space.to_cube(space.published), _INSIDE, 1 - _INSIDE)
    elif begin is not None:
        first = space.to_cube(begin)
    _, rng, _ = optimizers.streams(settings.seed)
    budget = settings.budget
    start = Start(robot, space, settings, first, rng, advisor, sizes or Sizes(), led)
    optimizer = pkgutil.resolve_name(METHODS[settings.chosen_method].make)(start)
    if settings.finish and budget is not None:
        later = np.random.default_rng([settings.seed, budget])
        return optimizers.Sequel(optimizer, budget, lambda best: _spread_starts(start, best, later, led))
    return optimizer


def default_starts(dimension: int, budget: int) -> int:
    """Starts of a line search where nothing is known of the robot: a tenth of the budget, at most two per parameter."""
    return max(1, min(2 * dimension, budget // 10))


def line_search(start: Start) -> optimizers.Optimizer:
    """The method line-search."""
    return _descent(start, optimizers.BacktrackingLineSearch)


def _descent(
    start: Start, kind: type[optimizers.BacktrackingLineSearch | optimizers.ProposalSearch]
) -> optimizers.Optimizer:
    if start.advisor is None:
        raise ArgumentError(f"method {start.settings.method} needs an advisor")
    return kind(
        start.advisor, start.first, max_steps=start.settings.max_steps,
        more_starts=_spread(len(start.space), (start.settings.starts or 1) - 1, start.rng),
    )  # fmt: skip


def proposal_search(start: Start) -> optimizers.Optimizer:
    """The method proposal-search."""
    return _descent(start, optimizers.ProposalSearch)


def _spread_starts(start: Start, first: Array, rng: np.random.Generator, led: bool) -> optimizers.MultiStart:
    count, robot = round(_STARTS_PER_PARAMETER * len(first)), start.robot
    smooth = robot.trials.steady and robot.swims.slow_mode  # swims at full length end at no threshold
    return optimizers.MultiStart([first, *_spread(len(first), count - 1, rng)], rng, smooth, start.sizes, led)


def _spread(dimension: int, count: int, rng: np.random.Generator) -> list[Array]:
    """Points that share each parameter's range evenly: a Latin hypercube. Shapes (d,)."""
    layers = rng.permuted(np.tile(np.arange(count), (dimension, 1)), axis=1).T
    return list((layers + rng.random((count, dimension))) / max(count, 1))


def staged(start: Start) -> optimizers.Optimizer:
    """The method staged: the robot's plan of stages in the unit cube."""
    robot, space = start.robot, start.space
    plan = robot.swims.fit_plan
    if plan is None:
        raise ArgumentError(f"robot '{robot.name}' has no stages, which method staged needs; choose another method")
    stages = [
        optimizers.Stage(
            one.name, tuple(space.names.index(name) for name in one.parameters), one.share,
            "scan" if one.together else "search", one.score,
        )
        for one in plan.stages
    ]  # fmt: skip
    held_point = space.to_cube({**space.to_values(start.first), **plan.held})
    held = {space.names.index(name): float(held_point[space.names.index(name)]) for name in plan.held}
    return optimizers.Staged(
        start.first, stages, start.settings.budget or PAPER_BUDGET, optimizers.BayesianOptimization, start.rng, held
    )


def random_search(start: Start) -> optimizers.Optimizer:
    """The method random, which also evaluates the first point."""
    return optimizers.RandomSearch(len(start.space), start.rng, start.first)


def cma_es(start: Start) -> optimizers.Optimizer:
    """The method cma-es, which begins where its own population does, as in the paper."""
    return optimizers.CmaEs(len(start.space), start.rng)


def bayesopt(start: Start) -> optimizers.Optimizer:
    """The method bayesopt."""
    return optimizers.BayesianOptimization(len(start.space), start.rng, start.first)


def least_squares(start: Start) -> optimizers.Optimizer:
    """The method least-squares."""
    return optimizers.LeastSquares(start.first, start.rng)


def multi_start(start: Start) -> optimizers.Optimizer:
    """The method multi-start; where the robot's response is known, unless it is slow, an advisor finds the first."""
    robot = start.robot
    if not (start.led and robot.trials.steady and robot.swims.response is not None and not robot.swims.slow_mode):
        return _spread_starts(start, start.first, start.rng, led=False)
    advised = replace(start, advisor=PhysicsAdvisor(robot, start.space, start.settings.seed, solves=False))
    return optimizers.Sequel(line_search(advised), _LED, lambda best: _spread_starts(start, best, start.rng, led=True))


def mujoco_sysid(start: Start) -> optimizers.Optimizer:
    """The method mujoco-sysid."""
    return CallbackSolver(start.first, start.rng, solver(start.space), "mujoco.sysid")
