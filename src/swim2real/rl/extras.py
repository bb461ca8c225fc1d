"""The optional libraries of this room."""

from __future__ import annotations

import importlib

from swim2real.errors import MissingExtraError


def require_learning() -> None:
    """Raises a sentence where the libraries of reinforcement learning aren't installed.

    Raises:
        MissingExtraError: gymnasium, torch or Stable-Baselines3 isn't installed.
    """
    try:
        for name in ("gymnasium", "torch", "stable_baselines3"):
            importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(
            "reinforcement learning needs gymnasium, torch and stable-baselines3; install them with: "
            "pip install 'swim2real[rl]'"
        ) from error
