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
    from swim2real.rl.conditions import (
        CONTROL_INTERVAL,
        UNDISTURBED,
        Disturbances,
        StateEstimate,
    )
    from swim2real.rl.environment import DIVERGED, Environments, RobotEnv, make_env, make_environments
    from swim2real.rl.tasks import STAGES, Forward, Stage, Target, Task
    from swim2real.rl.training import train
    from swim2real.rl.training_run import TrainingOutcome, TrainingRun
    from swim2real.rl.vector import RobotVecEnv, make_vector_env

_MODULES = {
    "assessment": ("Assessment", "assess"),
    "conditions": ("CONTROL_INTERVAL", "UNDISTURBED", "Disturbances", "StateEstimate"),
    "environment": ("DIVERGED", "Environments", "RobotEnv", "make_env", "make_environments"),
    "tasks": ("STAGES", "Forward", "Stage", "Target", "Task"),
    "training": ("train",),
    "training_run": ("TrainingOutcome", "TrainingRun"),
    "vector": ("RobotVecEnv", "make_vector_env"),
}  # fmt: skip

__all__ = [
    "CONTROL_INTERVAL",
    "DIVERGED",
    "STAGES",
    "UNDISTURBED",
    "Assessment",
    "Disturbances",
    "Environments",
    "Forward",
    "RobotEnv",
    "RobotVecEnv",
    "Stage",
    "StateEstimate",
    "Target",
    "Task",
    "TrainingOutcome",
    "TrainingRun",
    "assess",
    "make_env",
    "make_environments",
    "make_vector_env",
    "train",
]


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def _register() -> None:
    if find_spec("gymnasium") is None:
        raise MissingExtraError("policies need gymnasium; install it with: pip install 'swim2real[rl]'")
    import gymnasium

    for task in ("forward", "target"):
        gymnasium.register(
            f"swim2real/{task.capitalize()}-v0",
            entry_point="swim2real.rl.environment:make_env",
            kwargs={"task": task},
        )


_register()
