"""The tendon-driven robotic fish of the paper and of the prior work [michelis2026simple]."""

from dataclasses import replace
from pathlib import Path

from swim2real.robots.file import load_robot

__all__ = ["FISH", "FISH_EXTENDED"]

_HERE = Path(__file__).parent
# known by their names wherever this package is, so they need no file
FISH = replace(load_robot(_HERE / "fish.toml"), source=None)
FISH_EXTENDED = replace(load_robot(_HERE / "fish-extended.toml"), source=None)
