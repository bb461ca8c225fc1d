"""Swims made of formulas, whose every number is known: a traveling wave on the fish's markers."""

from dataclasses import dataclass

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.robots.fish import FISH
from swim2real.trials import Trial, TrialSet

REST = FISH.rest_markers
SIDEWAYS = 0.020  # m, how far off to the side a marker may be placed by hand
ALONG = 0.005  # m, likewise along the body; neighbors are 20 mm apart


@dataclass(frozen=True)
class Swimmer:
    """A fish that beats its tail at one frequency and swims straight at one speed."""

    frequency: float = 1.0
    speed: float = 0.1
    phase: float = 0.3
    heading: float = 0.4
    amplitude: float = 0.08
    duration: float = 5.0
    fps: float = 60.0

    def track(self, noise: float = 1e-3, seed: int = 0, by_hand: bool = True) -> MarkerTrack:
        rng = np.random.default_rng(seed)
        times = np.arange(round(self.duration * self.fps) + 1) / self.fps
        local = self.body(times)
        if by_hand:
            local = local + rng.uniform(-1, 1, REST.shape) * [ALONG, SIDEWAYS]
        yaw = self.heading + 0.03 * np.sin(2 * np.pi * self.frequency * times)
        c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        world = np.stack([c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]], axis=-1)
        forward = -np.array([np.cos(self.heading), np.sin(self.heading)])  # x points toward the tail
        world = world + self.speed * times[:, None, None] * forward
        return MarkerTrack(times, world + rng.normal(0.0, noise, world.shape))

    def body(self, times: np.ndarray) -> np.ndarray:
        """Markers in a frame that moves with the fish [m]. Shape (T, M, 2)."""
        share = REST[:, 0] / REST[-1, 0]
        angle = 2 * np.pi * self.frequency * times[:, None] + self.phase - 1.2 * np.pi * (share - 1)
        sideways = self.amplitude * share**2 * np.cos(angle)
        return np.stack([np.broadcast_to(REST[:, 0] - 0.02 * share**2, sideways.shape), sideways], axis=-1)


def trial_set(*tracks: MarkerTrack, nominal: float | None = None) -> TrialSet:
    return TrialSet(tuple(Trial(f"swim{i}", track, nominal) for i, track in enumerate(tracks)), FISH.marker_names)
