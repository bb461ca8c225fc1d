"""Reinforcement learning: the calibrated robot as environments, and policies trained in them.

Importing it registers `swim2real/Forward-v0` and `swim2real/Target-v0` with Gymnasium. Its names are imported when they
are used, since torch and MuJoCo take a while. Only training needs torch and Stable-Baselines3: a policy is evaluated by
NumPy.
"""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from swim2real.errors import MissingExtraError

if TYPE_CHECKING:
    from swim2real.rl.assessment import Assessment, assess
    from swim2real.rl.conditions import CONTROL_INTERVAL, UNDISTURBED, Disturbances, StateEstimate
    from swim2real.rl.environment import DIVERGED, Environments, RobotEnv, make_env, make_environments
    from swim2real.rl.learner import RobotVecEnv, make_vector_env
    from swim2real.rl.tasks import STAGES, Forward, ReachGoal, Task
    from swim2real.rl.training import train
    from swim2real.rl.training_run import TrainingOutcome, TrainingRun

__all__ = [
    "CONTROL_INTERVAL", "DIVERGED", "STAGES", "UNDISTURBED", "Assessment", "Disturbances", "Environments", "Forward",
    "ReachGoal", "RobotEnv", "RobotVecEnv", "StateEstimate", "Task", "TrainingOutcome", "TrainingRun", "assess",
    "make_env", "make_environments", "make_vector_env", "train",
]  # fmt: skip
_MODULES = ("conditions", "tasks", "environment", "training_run", "assessment", "learner", "training")  # light first


def __getattr__(name: str) -> Any:
    for module in _MODULES if name in __all__ else ():
        found = vars(importlib.import_module(f"{__name__}.{module}"))
        if name in found:
            return found[name]
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


if find_spec("gymnasium") is None:
    raise MissingExtraError("policies need gymnasium; install it with: pip install 'swim2real[rl]'")
_gymnasium = importlib.import_module("gymnasium")
for _task in ("forward", "target"):
    _gymnasium.register(
        f"swim2real/{_task.capitalize()}-v0", "swim2real.rl.environment:make_env", kwargs={"task": _task}
    )
