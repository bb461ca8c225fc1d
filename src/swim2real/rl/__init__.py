"""Reinforcement learning: the calibrated robot as environments, and policies trained in them.

Importing it registers `swim2real/Forward-v0` and `swim2real/Target-v0` with Gymnasium. It brings neither torch nor
MuJoCo; what needs them is imported when it is asked for.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from swim2real.errors import MissingExtraError

if TYPE_CHECKING:
    from swim2real.rl.disturbances import UNDISTURBED, Disturbances, StateEstimate
    from swim2real.rl.environment import DIVERGED, SwimEnv, make_env
    from swim2real.rl.forward import Forward
    from swim2real.rl.motor import CONTROL_INTERVAL, PUBLISHED_MOTOR, REAL_MOTOR, Motor
    from swim2real.rl.target import STAGES, Stage, Target
    from swim2real.rl.vector import SwimVecEnv, make_vector_env

__all__ = [
    "CONTROL_INTERVAL",
    "DIVERGED",
    "PUBLISHED_MOTOR",
    "REAL_MOTOR",
    "STAGES",
    "UNDISTURBED",
    "Disturbances",
    "Forward",
    "Motor",
    "Stage",
    "StateEstimate",
    "SwimEnv",
    "SwimVecEnv",
    "Target",
    "make_env",
    "make_vector_env",
]

_PLACES = {
    "disturbances": ("UNDISTURBED", "Disturbances", "StateEstimate"),
    "environment": ("DIVERGED", "SwimEnv", "make_env"),
    "forward": ("Forward",),
    "motor": ("CONTROL_INTERVAL", "PUBLISHED_MOTOR", "REAL_MOTOR", "Motor"),
    "target": ("STAGES", "Stage", "Target"),
    "vector": ("SwimVecEnv", "make_vector_env"),
}


def __getattr__(name: str) -> Any:
    for module, names in _PLACES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def _register() -> None:
    try:
        import gymnasium
    except ImportError as error:
        raise MissingExtraError(
            "reinforcement learning needs gymnasium; install it with: pip install 'swim2real[rl]'"
        ) from error
    for task in ("forward", "target"):
        gymnasium.register(
            f"swim2real/{task.capitalize()}-v0",
            entry_point="swim2real.rl.environment:make_env",
            kwargs={"task": task},
        )


_register()
