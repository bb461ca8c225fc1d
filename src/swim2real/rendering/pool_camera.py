"""The pool camera and what may stand in its way: sizes, times and colors, and where a point appears."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import ArgumentError

Array = NDArray[np.float64]
Color = tuple[int, int, int]
Pair = tuple[float, float]

MAX_NOISE = 20.0  # 8-bit steps; above it, the noise would reach black and white


@dataclass(frozen=True)
class Glare:
    """A patch of light that the water reflects into the camera. It hides all below it.

    Attributes:
        start: First instant, from the first frame [s].
        end: It is gone from this instant on [s].
        over: Markers that it covers and follows; none for a patch with a course of its own.
        center: Center of a patch that follows no marker, at its start, in the plane of height 0 [m].
        velocity: Velocity of such a patch [m/s].
        radius: Radius of the patch; a patch over markers is as large as it takes to cover them, and at least this [m].
        stretch: How many times wider than high it is in the image; from 1.
        strength: Strength of the reflection from 0, which hides nothing, to 1, which is white.
    """

    start: float = 0.0
    end: float = np.inf
    over: tuple[int, ...] = ()
    center: Pair = (0.0, 0.0)
    velocity: Pair = (0.0, 0.0)
    radius: float = 0.02
    stretch: float = 1.0
    strength: float = 1.0

    def __post_init__(self) -> None:
        if not self.start < self.end:
            raise ArgumentError(f"a glare starts at {self.start} s and ends at {self.end} s; it must end later")
        _check("a glare's radius", self.radius, above=0.0, unit=" m")
        _check("a glare's stretch", self.stretch, least=1.0)
        _check("a glare's strength", self.strength, least=0.0, most=1.0)
        _check_pair("a glare's center", self.center, " m")
        _check_pair("a glare's velocity", self.velocity, " m/s")


@dataclass(frozen=True)
class Occluder:
    """A straight cable or rod above the water. It does not move, and the fish swims below it.

    Attributes:
        ends: The two ends, world x and y [m].
        width: Thickness [m].
        height: Above the plane of height 0 [m].
        color: RGB.
    """

    ends: tuple[Pair, Pair]
    width: float = 0.03
    height: float = 0.3
    color: Color = (38, 36, 34)

    def __post_init__(self) -> None:
        _check("an occluder's width", self.width, above=0.0, unit=" m")
        _check_color("an occluder's color", self.color)
        if len(self.ends) != 2:
            raise ArgumentError(f"an occluder has {len(self.ends)} ends; give two, ((x, y), (x, y)) in m")
        for end in self.ends:
            _check_pair("an occluder's end", end, " m")


@dataclass(frozen=True)
class PoolCamera:
    """A pinhole camera above a pool, looking down.

    Attributes:
        width: Width of the image [px].
        height: Height of the image [px].
        fps: Frames a second.
        view: Width of what is seen in the plane of height 0 [m].
        camera_height: Height of the lens above that plane [m].
        tilt: Turn about the image's x and y axes; the middle of the image stays where it is [rad].
        center: World point in the middle of the image [m]; None for the middle of the swim, which then must fit.
        marker_radius: Radius of all markers [m].
        marker_color: RGB.
        body_color: RGB.
        water_color: RGB.
        contrast: Between markers and body, 1 as the colors say; 0 draws the markers in the body's color.
        shutter: Share of the frame interval in which the shutter is open.
        noise: Standard deviation of the sensor noise, equal in all three channels [8-bit steps].
        caustics: Strength of the moving pattern of light in the water; 0 for none.
        glints: How many small sparkles are seen at a time, on average.
        glares: Larger patches of reflected light.
        jitter: Spread of the frame times, as a share of the frame interval.
        dropped: Share of the frames that the camera loses.
    """

    width: int = 1920
    height: int = 1080
    fps: float = 60.0
    view: float = 2.2
    camera_height: float = 2.5
    tilt: Pair = (0.0, 0.0)
    center: Pair | None = None
    marker_radius: float = 0.008
    marker_color: Color = (255, 140, 20)
    body_color: Color = (34, 38, 44)
    water_color: Color = (92, 158, 178)
    contrast: float = 1.0
    shutter: float = 0.3
    noise: float = 2.0
    caustics: float = 0.5
    glints: float = 0.0
    glares: tuple[Glare, ...] = ()
    jitter: float = 0.0
    dropped: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = getattr(self, name)
            if not isinstance(size, int) or size < 16 or size % 2:
                raise ArgumentError(f"camera {name} is {size} px; it must be an even number from 16 on")
        for name, unit in (("fps", " Hz"), ("view", " m"), ("camera_height", " m"), ("marker_radius", " m")):
            _check(f"camera {name}", getattr(self, name), above=0.0, unit=unit)
        for name, most in (("contrast", 1.0), ("shutter", 1.0), ("jitter", 0.5), ("dropped", 0.9)):
            _check(f"camera {name}", getattr(self, name), least=0.0, most=most)
        _check("camera noise", self.noise, least=0.0, most=MAX_NOISE)
        _check("camera caustics", self.caustics, least=0.0, most=2.0)
        _check("camera glints", self.glints, least=0.0, most=1000.0)
        _check_pair("camera tilt", self.tilt, " rad")
        if max(abs(angle) for angle in self.tilt) > 0.5:
            raise ArgumentError(f"camera tilt is {self.tilt} rad; each angle must lie within -0.5 and 0.5")
        if self.center is not None:
            _check_pair("camera center", self.center, " m")
        for field in fields(self):
            if field.name.endswith("_color"):
                _check_color(f"camera {field.name}", getattr(self, field.name))

    @property
    def interval(self) -> float:
        """Time from frame to frame [s]."""
        return 1.0 / self.fps

    @property
    def exposure(self) -> float:
        """Time in which the shutter is open [s]."""
        return self.shutter / self.fps

    @property
    def meters_per_pixel(self) -> float:
        """In the plane of height 0, in the middle of the image [m]."""
        return self.view / self.width

    @property
    def middle(self) -> Pair:
        """Size of the image [px]; the center of its top left pixel is (0, 0)."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    def project(self, points: object, heights: object, center: Pair) -> tuple[Array, Array]:
        """Where world points appear.

        Args:
            points: World x and y [m]. Shape (..., 2).
            heights: Above the plane of height 0 [m]. A shape that broadcasts to (...).
            center: World point in the middle of the image [m].

        Returns:
            Pixels, shape (..., 2), and the scale at each point, shape (...) [px/m].
        """
        offset = np.asarray(points, dtype=float) - np.asarray(center)
        # image axes: x to the right, y down, z away from the camera
        x, y, z = np.broadcast_arrays(offset[..., 0], -offset[..., 1], -np.asarray(heights, dtype=float))
        (cx, sx), (cy, sy) = ((np.cos(a), np.sin(a)) for a in self.tilt)
        y, z = cx * y - sx * z, sx * y + cx * z
        x, z = cy * x + sy * z, -sy * x + cy * z
        scale = self.camera_height / self.meters_per_pixel / (self.camera_height + z)
        return np.stack([x * scale, y * scale], axis=-1) + self.middle, scale


def _check(
    name: str, value: float, *, above: float | None = None, least: float = -np.inf, most: float = np.inf, unit: str = ""
) -> None:
    if above is not None and not (np.isfinite(value) and value > above):
        raise ArgumentError(f"{name} is {value}{unit}; it must be above {above:g}")
    if not least <= value <= most:
        raise ArgumentError(f"{name} is {value}{unit}; it must lie within {least:g} and {most:g}")


def _check_pair(name: str, value: Sequence[float], unit: str) -> None:
    if len(value) != 2 or not np.all(np.isfinite(value)):
        raise ArgumentError(f"{name} is {value}; it must be two finite numbers (x, y) in{unit}")


def _check_color(name: str, value: Sequence[int]) -> None:
    if len(value) != 3 or any(not 0 <= c <= 255 for c in value):
        raise ArgumentError(f"{name} is {value}; it must be three numbers (red, green, blue) within 0 and 255")
