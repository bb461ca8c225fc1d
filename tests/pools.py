"""A synthetic pool: two short swims of a fish with hidden parameters, in the middle of the box but for its lift."""

from dataclasses import replace

from swim2real.demo import SyntheticCamera, synthetic_reference
from swim2real.robots.fish import FISH
from swim2real.trials import TrialSet

FREQUENCIES = (1.2, 1.6)  # Hz
NAMES = ("f1_20", "f1_60")
LOGARITHMIC = replace(FISH.space, scale="log")


def hidden_values(lift: float = 0.85) -> dict[str, float]:
    """Parameters of a fish that swims: all but the lift are halfway on the logarithmic scale."""
    point = [0.5] * len(FISH.space)
    point[FISH.space.names.index("fluid_kutta_lift")] = lift
    return LOGARITHMIC.to_values(point)


def film(
    camera: SyntheticCamera | None = None, frequencies=FREQUENCIES, seconds: float = 2.0, seed: int = 3
) -> TrialSet:
    """Films the hidden fish; by default with a little noise and misplaced markers."""
    camera = camera or SyntheticCamera(noise=5e-4, placement=2e-3)
    return synthetic_reference(FISH, hidden_values(), frequencies, seconds, camera, seed, threads=2)
