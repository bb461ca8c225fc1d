"""Simulation: parameters and actuations in, simulated trials out."""

from swim2real.simulation.engine import Engine
from swim2real.simulation.simulator import Simulator, Swim

__all__ = ["Engine", "Simulator", "Swim"]
