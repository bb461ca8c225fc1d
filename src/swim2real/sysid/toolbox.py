"""MuJoCo's identification toolbox, `mujoco.sysid`, where it is installed."""

from __future__ import annotations

import importlib
from typing import Any

from swim2real.errors import MissingExtraError


def toolbox() -> Any:
    """The module.

    Raises:
        MissingExtraError: It isn't installed. MuJoCo then has it without content.
    """
    found = importlib.import_module("mujoco.sysid")
    if not hasattr(found, "optimize"):
        raise MissingExtraError(
            "MuJoCo's identification toolbox isn't installed; install it with: pip install 'swim2real[sysid]'"
        )
    return found
