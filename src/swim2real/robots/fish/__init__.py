"""The tendon-driven robotic fish of the paper and of the prior work [michelis2026simple]."""

from swim2real.robots.fish.extended import FISH_EXTENDED
from swim2real.robots.fish.fish import FISH

__all__ = ["FISH", "FISH_EXTENDED"]
