"""The tendon-driven robotic fish of the paper and of the prior work [michelis2026simple]."""

from dataclasses import replace
from pathlib import Path

from swim2real.robots.file import robot_from_file

__all__ = ["FISH", "FISH_EXTENDED", "FISH_ROLLING"]

_HERE = Path(__file__).parent
# known by their names wherever this package is, so they need no file
FISH = replace(robot_from_file(_HERE / "fish.toml"), source=None)
FISH_EXTENDED = replace(robot_from_file(_HERE / "fish-extended.toml"), source=None)
FISH_ROLLING = replace(robot_from_file(_HERE / "fish-rolling.toml"), source=None)
