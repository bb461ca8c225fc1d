"""Simulation: from parameter values and swims, or recordings, to simulated trials, with MuJoCo."""

from swim2real.simulation.forward_model import Engine, ForwardModel
from swim2real.simulation.playback import PlaybackSimulator, Rollout
from swim2real.simulation.simulator import Simulator, Swim

__all__ = ["Engine", "ForwardModel", "PlaybackSimulator", "Rollout", "Simulator", "Swim"]
