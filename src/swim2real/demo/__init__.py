"""The embedded example: a synthetic 'real' robot with hidden parameters, made at run time."""

from swim2real.demo.example import DEMO_FREQUENCIES, HELD_OUT, demo
from swim2real.demo.synthetic import Camera, synthetic_reference

__all__ = ["DEMO_FREQUENCIES", "HELD_OUT", "Camera", "demo", "synthetic_reference"]
