"""The embedded example: films of a 'real' fish with hidden parameters, tracked and calibrated."""

from swim2real.demo.example import (
    FREQUENCIES,
    HELD_OUT,
    MORE_FREQUENCIES,
    DemoCallbacks,
    demo_settings,
    fit,
    hidden_values,
    track,
)
from swim2real.demo.synthetic import SyntheticCamera, synthetic_reference

__all__ = [
    "FREQUENCIES", "HELD_OUT", "MORE_FREQUENCIES", "DemoCallbacks", "SyntheticCamera", "demo_settings", "fit",
    "hidden_values", "synthetic_reference", "track",
]  # fmt: skip
