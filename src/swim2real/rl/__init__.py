"""Reinforcement learning: the calibrated robot as environments, and policies trained in them.

Importing it registers `swim2real/Forward-v0` and `swim2real/Target-v0` with Gymnasium. Its names are imported when they
are used, since torch and MuJoCo take a while. Only training needs torch and Stable-Baselines3: a policy is evaluated by
NumPy.
"""

import importlib
from importlib.util import find_spec

import lazy_loader

from swimbase.errors import MissingExtraError

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

if find_spec("gymnasium") is None:
    raise MissingExtraError("policies need gymnasium; install it with: pip install 'swim2real[rl]'")
_gymnasium = importlib.import_module("gymnasium")
for _task in ("forward", "target"):
    _gymnasium.register(
        f"swim2real/{_task.capitalize()}-v0", "swim2real.rl.environment:make_env", kwargs={"task": _task}
    )
