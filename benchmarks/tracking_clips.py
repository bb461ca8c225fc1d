"""The clips that trackers are measured on: simulated swims before a synthetic pool camera, made hard in known ways."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from pool import Filmed, Glare, Occluder, PoolCamera, PoolScene, film, scene
from scipy.interpolate import CubicSpline

from markertrack.track import MarkerTrack
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation
from swimbase.errors import ArgumentError

Array = NDArray[np.float64]

SAMPLE_INTERVAL = 0.004  # s
HD = PoolCamera()
UHD = PoolCamera(width=3840, height=2160)
# halfway within the bounds on the logarithmic scale, with more lift: a fish unlike the published one that swims faster
_POINT = [0.85 if name == "fluid_kutta_lift" else 0.5 for name in FISH.space.names]
STRONG = replace(FISH.space, scale="log").to_values(_POINT)


@dataclass(frozen=True)
class Clip:
    """One film and how it is picked.

    Attributes:
        name: For the table.
        camera: What films.
        frequency: Of the tail beat [Hz].
        seconds: Duration [s].
        heading: Turn of the swim; at 0 the fish swims to the left, and turns counterclockwise [rad].
        strong: Swims with `STRONG` instead of the published parameters.
        occluder: Above the fish.
        clicks: By which each picked point is off, in a random direction [px].
        seed: Of all that is random.
        crf: Quality of the H.264 file, larger is worse.
    """

    name: str
    camera: PoolCamera = HD
    frequency: float = 1.5
    seconds: float = 3.0
    heading: float = -0.4
    strong: bool = False
    occluder: Occluder | None = None
    clicks: float = 1.0
    seed: int = 1
    crf: int = 23

    def track(self) -> MarkerTrack:
        """The swim, with markers in world coordinates."""
        swum = _swim(self.frequency, self.seconds, self.strong)
        c, s = np.cos(self.heading), np.sin(self.heading)
        return MarkerTrack(swum.times, swum.positions @ np.array([[c, s], [-s, c]]))

    def scene(self) -> PoolScene:
        return scene(self.track(), FISH.marker_heights, self.camera, self.seed, occluder=self.occluder)

    def film(self, path: str) -> Filmed:
        """Writes the clip to a file."""
        return film(self.scene(), path, crf=self.crf)

    def places(self, filmed: Filmed) -> Array:
        """Where the markers are, also outside of the image [px]. Shape (T, M, 2)."""
        track = self.track()
        course = CubicSpline(track.times - track.times[0], track.positions, axis=0)
        return self.camera.project(course(filmed.truth.times), FISH.marker_heights, filmed.center)[0]

    def picks(self, filmed: Filmed) -> Array:
        """The points that a person picks [px]. Shape (M, 2)."""
        turns = np.random.default_rng([self.seed, 4]).uniform(0, 2 * np.pi, filmed.truth.marker_count)
        return filmed.truth.positions[0] + self.clicks * np.stack([np.cos(turns), np.sin(turns)], axis=1)

    def settings(self) -> str:
        """What isn't as by default."""
        parts = _changed(self, Clip("")) + _changed(self.camera, PoolCamera())
        return ", ".join(part for part in parts if not part.startswith(("name=", "camera=")))


def _changed(thing: Clip | PoolCamera, usual: Clip | PoolCamera) -> list[str]:
    pairs = [(f.name, getattr(thing, f.name), getattr(usual, f.name)) for f in fields(thing)]
    return [f"{name}={_short(value)}" for name, value, default in pairs if value != default]


def _short(value: object) -> str:
    return re.sub(r"-?\d+\.\d{4,}", lambda found: f"{float(found[0]):.4g}", repr(value))


@cache
def _swim(frequency: float, seconds: float, strong: bool) -> MarkerTrack:
    simulator = Simulator(FISH, 1, sample_interval=SAMPLE_INTERVAL)
    swim = Swim("swim", Actuation(frequency, 0.5, 0.1), seconds)
    return simulator.simulate(STRONG if strong else FISH.space.published, [swim])["swim"].track


LIGHT = (252, 252, 252)
LOW_CONTRAST = 0.18  # of the difference between markers and body, which is 221 of 255 in red
SEVEN_FRAMES = 7 / 60  # s

SUITE = (
    Clip("1080p 60 fps, 0.5 Hz", frequency=0.5),
    Clip("1080p 60 fps, 1 Hz", frequency=1.0, strong=True, heading=2.6),
    Clip("1080p 60 fps, 2.25 Hz", frequency=2.25, heading=0.3),
    Clip("1080p 30 fps, 2.25 Hz", replace(HD, fps=30), frequency=2.25, strong=True),
    Clip("1080p 240 fps, 1.75 Hz", replace(HD, fps=240), frequency=1.75, seconds=1.5, strong=True),
    Clip("1080p across, 1.25 Hz", replace(HD, view=2.4), frequency=1.25, heading=-1.5),
    Clip("4K 60 fps, 1.5 Hz", UHD, seconds=2.0, crf=20),
    Clip("4K 60 fps, 2.25 Hz", UHD, frequency=2.25, seconds=2.0, strong=True, heading=3.5),
    Clip("4K 30 fps, 2.25 Hz, motion blur", replace(UHD, fps=30, shutter=0.5), frequency=2.25, seconds=2.0),
    Clip("glare over 2 markers, 7 frames", replace(HD, glares=(Glare(1.0, 1.0 + SEVEN_FRAMES, over=(4, 5)),))),
    Clip("glare over 2 markers, 7 frames, 4K", replace(UHD, glares=(Glare(1.0, 1.0 + SEVEN_FRAMES, over=(4, 5)),)),
         seconds=2.0, frequency=2.0),
    Clip("glare, longer and moving",
         replace(HD, glares=(Glare(0.5, 1.1, over=(5, 6)), Glare(1.5, 1.8, over=(8,)),
                             Glare(0.3, 2.9, center=(-0.1, -0.35), velocity=(0.05, 0.15), radius=0.05),
                             Glare(0.8, 2.6, center=(0.5, 0.2), velocity=(-0.35, -0.1), radius=0.03, stretch=3.0))),
         frequency=2.0),
    Clip("glare over the tail but its tip",
         replace(HD, view=2.0, glares=(Glare(0.48, 0.84, over=(4,), radius=0.048, stretch=1.9),)),
         frequency=0.8, seconds=2.0, heading=3.2),
    Clip("glare over the tail's end, 30 fps, close",
         replace(HD, fps=30, view=1.5, marker_color=(30, 30, 32), body_color=(205, 205, 200),
                 glares=(Glare(0.2, 0.64, over=(6, 7, 8), stretch=2.7, strength=0.8),)),
         frequency=1.87, seconds=1.6, heading=-0.7),
    Clip("white markers under white glare",
         replace(HD, marker_color=LIGHT, glints=10, glares=(Glare(1.0, 1.0 + SEVEN_FRAMES, over=(4, 5)),))),
    Clip("a cable across the tail", frequency=1.0, occluder=Occluder(((-0.10, -1.0), (0.05, 1.0)), width=0.03)),
    Clip("clicks off by 3 px, a", frequency=1.75, clicks=3.0, seed=2),
    Clip("clicks off by 3 px, b", replace(HD, view=2.6), frequency=1.75, clicks=3.0, seed=3, heading=1.0),
    Clip("clicks off by 3 px, c", UHD, frequency=1.75, clicks=3.0, seed=4, seconds=2.0),
    Clip("low contrast", replace(HD, contrast=LOW_CONTRAST), frequency=1.25),
    Clip("low contrast, gray", replace(HD, marker_color=(74, 80, 86), noise=3.0), frequency=1.0, heading=2.0),
    Clip("noise of 8 steps", replace(HD, noise=8.0), frequency=1.75),
    Clip("strong caustics and glints", replace(HD, glints=30.0, caustics=1.5)),
    Clip("frames dropped, times jittered", replace(HD, dropped=0.15, jitter=0.3), frequency=1.75),
    Clip("tail beats out of the image and in", replace(HD, center=(-0.1, -0.597)), frequency=1.75, heading=0.0),
    Clip("front leaves for good", replace(HD, center=(0.8, 0.0)), frequency=1.75, strong=True, heading=0.0),
    Clip("small fish, view 3.5 m", replace(HD, view=3.5), frequency=1.75),
    Clip("small fish, crf 30", replace(HD, view=3.0), crf=30),
    Clip("crf 30", frequency=2.0, crf=30, heading=0.8),
)  # fmt: skip
CSRT_CLIPS = ("1080p 60 fps, 2.25 Hz", "4K 60 fps, 2.25 Hz", "glare over 2 markers, 7 frames, 4K")

# markers on a body
COLORS = (
    ((255, 140, 20), (34, 38, 44)),  # orange on black
    ((240, 240, 235), (34, 38, 44)),  # white on black
    ((250, 220, 40), (40, 60, 90)),  # yellow on blue
    ((210, 40, 40), (200, 200, 190)),  # red on light gray
    ((40, 170, 80), (60, 60, 62)),  # green on gray
    ((30, 30, 32), (205, 205, 200)),  # black on light gray
    ((70, 190, 220), (225, 120, 40)),  # light blue on orange
)


def random_clip(seed: int, index: int) -> Clip:
    """A clip that nobody chose; the same for the same numbers. All markers can be seen in its first frame."""
    rng = np.random.default_rng([seed, index])
    while True:
        clip = _drawn(rng, f"random {seed}/{index}")
        for _ in range(20):
            try:
                filmed = clip.scene().filmed
            except ArgumentError:  # the fish doesn't fit in: from farther away
                clip = replace(clip, camera=replace(clip.camera, view=1.1 * clip.camera.view))
                continue
            if not filmed.hidden[0].any():
                return clip
            break


def _drawn(rng: np.random.Generator, name: str) -> Clip:
    def often(share: float) -> bool:
        return bool(rng.random() < share)

    seconds, frequency, heading = 1.6, rng.uniform(0.5, 2.25), rng.uniform(0, 2 * np.pi)
    glares = [_random_glare(rng, seconds) for _ in range(int(rng.integers(0, 4)))]
    marker, body = COLORS[int(rng.integers(len(COLORS)))] if often(0.7) else COLORS[0]
    width, height = (3840, 2160) if often(0.15) else (1920, 1080)
    camera = PoolCamera(
        width, height, fps=float(rng.choice([30, 50, 60, 60, 120])), view=rng.uniform(1.3, 3.2),
        tilt=(rng.uniform(-0.15, 0.15), rng.uniform(-0.15, 0.15)), marker_radius=rng.uniform(0.006, 0.009),
        marker_color=marker, body_color=body, contrast=rng.uniform(0.3, 1.0) if often(0.6) else 1.0,
        shutter=rng.uniform(0.05, 0.5), noise=rng.uniform(0.5, 6.0), caustics=rng.uniform(0.0, 1.5),
        glints=rng.uniform(0, 20) if often(0.5) else 0.0, glares=tuple(glares),
        jitter=rng.uniform(0, 0.3) if often(0.3) else 0.0, dropped=rng.uniform(0, 0.2) if often(0.3) else 0.0,
    )  # fmt: skip
    if often(0.2):  # not in the middle, so that it may leave the image
        camera = replace(camera, center=(rng.uniform(-0.9, 0.9), rng.uniform(-0.5, 0.5)))
    occluder = None
    if often(0.15):
        x, lean = rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3)
        occluder = Occluder(((x - lean, -1.0), (x + lean, 1.0)), rng.uniform(0.01, 0.04))
    return Clip(
        name, camera, frequency, seconds, heading, often(0.5), occluder, clicks=rng.uniform(0, 3.0),
        seed=int(rng.integers(1000)),
    )  # fmt: skip


def _random_glare(rng: np.random.Generator, seconds: float) -> Glare:
    start = rng.uniform(0.1, seconds - 0.2)
    end = start + rng.uniform(0.05, 0.5)
    radius, stretch, strength = rng.uniform(0.01, 0.05), rng.uniform(1, 3), rng.uniform(0.6, 1.0)
    if rng.random() < 0.6:
        first = int(rng.integers(9))
        over = tuple(range(first, min(first + int(rng.integers(1, 4)), 9)))
        return Glare(start, end, over, radius=radius, stretch=stretch, strength=strength)
    place, speed = rng.uniform(-0.4, 0.4, 2), rng.normal(0, 0.2, 2)
    center, velocity = (float(place[0]), float(place[1])), (float(speed[0]), float(speed[1]))
    return Glare(start, end, (), center, velocity, radius, stretch, strength)
