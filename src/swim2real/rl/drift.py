"""Open against closed loop: how far a disturbed robot strays from the way that a policy took without disturbance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.parameters import Values
from swim2real.rl.disturbances import Disturbances, StateEstimate
from swim2real.rl.evaluation import figures
from swim2real.rl.policy import Driver, Recorded
from swim2real.rl.rollout import Episode, roll, some_environments
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]


def compare_loops(
    driver: Driver, task: str, parameters: Values, robot: Robot, seeds: Sequence[int], disturbances: Disturbances,
    estimate: StateEstimate, seconds: float | None = None, stage: int = 3,
) -> tuple[dict[str, Any], dict[str, list[Episode]]]:  # fmt: skip
    """Swims each start four times, and says how it went.

    `nominal` is without the disturbances. Then with them: `open` repeats the nominal actions, as the paper's transfer
    does; `closed` sees the true state; `tracked` sees what a marker tracker tells.

    Args:
        driver: Steers.
        task: `forward` or `target`.
        parameters: Of the simulator.
        robot: Whose they are.
        seeds: Of the starts.
        disturbances: What is added; its start phases hold for the nominal swims, too.
        estimate: What a tracker sees.
        seconds: Length of the episodes [s]; None for the task's own.
        stage: Of the curriculum of `target`.

    Returns:
        Figures by loop, each with `drift`: the mean distance between a swim's end and the nominal way at the same time
        [m], and `sideways`, the mean of |y| at the end [m]; and the episodes by loop.
    """
    phases = Disturbances(start_phase=disturbances.start_phase)
    plain = replace(disturbances, estimate=None)

    def swims(driver: Driver, what: Disturbances) -> list[Episode]:
        environments = some_environments(
            task, [parameters], len(seeds), robot=robot, disturbances=what, seconds=seconds, stage=stage
        )  # fmt: skip
        return roll(environments, driver, seeds)

    nominal = swims(driver, phases)
    episodes = {
        "nominal": nominal,
        "open": swims(Recorded(side_by_side([one.actions for one in nominal])), plain),
        "closed": swims(driver, plain),
        "tracked": swims(driver, replace(disturbances, estimate=estimate)),
    }
    found: dict[str, Any] = {}
    for name, several in episodes.items():
        drifts = [drift(one, reference) for one, reference in zip(several, nominal, strict=True)]
        found[name] = {
            **figures(several), "drift": float(np.mean(drifts)),
            "sideways": float(np.mean([abs(one.heads[-1, 1]) for one in several])),
        }  # fmt: skip
    return found, episodes


def drift(episode: Episode, reference: Episode) -> float:
    """Distance of two ways at the last time that both have [m]."""
    last = min(len(episode.heads), len(reference.heads)) - 1
    return float(np.linalg.norm(episode.heads[last] - reference.heads[last]))


def side_by_side(series: Sequence[Array]) -> Array:
    """Series of several lengths as one array, filled up with 0. Shapes (T_i,) to (T, N)."""
    out = np.zeros((max(len(one) for one in series), len(series)))
    for i, one in enumerate(series):
        out[: len(one), i] = one
    return out
