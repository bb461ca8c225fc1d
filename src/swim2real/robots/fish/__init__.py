"""The tendon-driven robotic fish of the paper and of the prior work [michelis2026simple]."""

from swim2real.robots.fish.fish import FISH

__all__ = ["FISH"]
