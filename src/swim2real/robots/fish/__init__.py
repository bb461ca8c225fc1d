"""The tendon-driven robotic fish of the paper and of the prior work [michelis2026simple]."""

from pathlib import Path

from swim2real.robots.file import load_robot

__all__ = ["FISH", "FISH_EXTENDED"]

_HERE = Path(__file__).parent
FISH = load_robot(_HERE / "fish.toml")
FISH_EXTENDED = load_robot(_HERE / "fish-extended.toml")
