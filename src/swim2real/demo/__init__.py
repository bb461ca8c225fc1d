"""The embedded example: a 'real' robot with hidden parameters in a synthetic pool, made at run time."""

from swim2real.demo.example import (
    DEMO_FREQUENCIES,
    FULL_FREQUENCIES,
    HELD_OUT,
    DemoCallbacks,
    demo_settings,
    film_and_track,
    fit,
    hidden_values,
)
from swim2real.demo.synthetic import SyntheticCamera, film_swims, synthetic_reference

__all__ = [
    "DEMO_FREQUENCIES",
    "FULL_FREQUENCIES",
    "HELD_OUT",
    "DemoCallbacks",
    "SyntheticCamera",
    "demo_settings",
    "film_and_track",
    "film_swims",
    "fit",
    "hidden_values",
    "synthetic_reference",
]
