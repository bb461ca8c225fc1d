"""The pool camera, and what its pictures are made of: water, floor, light and sensor noise, and shapes with soft edges.

The water is made once and moved about for each frame. Its layers are 8-bit numbers with room to spare, so a frame is a
few sums that can't overflow. This makes frames cheap. A shape is the share of each pixel that a disc, a tapered line or
a patch of light covers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from swimbase.errors import ArgumentError

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Steps = NDArray[np.int8]
Image32 = NDArray[np.float32]
Color = tuple[int, int, int]
Pair = tuple[float, float]

# of a camera's numbers; above its own, noise [8-bit steps] would reach black and white
_MOST = {
    "contrast": 1.0, "shutter": 1.0, "jitter": 0.5, "dropped": 0.9, "noise": 20.0, "caustics": 2.0, "glints": 1000.0,
}  # fmt: skip
FLOOR = 1.0  # m below the surface, as it seems from above
_TILE = 0.2  # m
_SWAY = 0.04  # m, how far the pattern of light moves
_NOISE_SHIFT = 64  # px, how far the noise may be shifted
_ROWS = 48  # rows summed at a time, so that they stay in the processor's cache
_WAVY = (0.06, 0.04)  # of a patch's radius, how far its edge runs in and out
_SOFT = 0.12  # of a patch's radius, the width of its edge
_COARSE = 4  # points of the grid on which a smooth pattern is made, in the length over which it changes


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
        for name, most in _MOST.items():
            _check(f"camera {name}", getattr(self, name), least=0.0, most=most)
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


@dataclass(frozen=True)
class Rect:
    """Pixels from (x0, y0) to before (x1, y1)."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def empty(self) -> bool:
        return self.x0 >= self.x1 or self.y0 >= self.y1

    def within(self, other: Rect) -> tuple[slice, slice]:
        """Its rows and columns in an array that shows another box around it."""
        return slice(self.y0 - other.y0, self.y1 - other.y0), slice(self.x0 - other.x0, self.x1 - other.x0)


@dataclass(frozen=True)
class Water:
    """Layers of 8-bit numbers with the three channels side by side.

    Attributes:
        floor: What never changes. Shape (height, 3 width).
        light: Patterns that move over it, each of shape (height + sway, 3 (width + sway)).
        noise: Noise of the sensor, larger by _NOISE_SHIFT px; None without noise.
        sway: How far the patterns move [px].
        seed: Seed of the noise's shifts.
    """

    floor: Bytes
    light: tuple[Steps, ...]
    noise: Steps | None
    sway: int
    seed: int

    def frame(self, index: int, time: float) -> Bytes:
        """The water with noise. Shape (height, width, 3)."""
        rows, columns = self.floor.shape
        layers = [self.floor, *(layer.view(np.uint8) for layer in self._lit(time))]
        noise = self._noise(index)
        if noise is not None:
            layers.append(noise.view(np.uint8))
        image = np.empty((rows, columns), dtype=np.uint8)
        for start in range(0, rows, _ROWS):
            part = slice(start, start + _ROWS)
            image[part] = layers[0][part]
            for layer in layers[1:]:
                image[part] += layer[part]
        return image.reshape(rows, columns // 3, 3)

    def region(self, time: float, rect: Rect) -> tuple[Image32, Image32]:
        """A part of the water without noise, shape (3, h, w), and the moving light alone, shape (h, w)."""
        part = (slice(rect.y0, rect.y1), slice(3 * rect.x0, 3 * rect.x1))
        below = self.floor[part].reshape(rect.y1 - rect.y0, -1, 3).transpose(2, 0, 1).astype(np.float32)
        light = np.zeros(below.shape[1:], dtype=np.float32)
        for layer in self._lit(time):
            light += layer[part][:, ::3]
        return below + light, light

    def noise_at(self, index: int, rect: Rect) -> Steps | None:
        """Noise of one frame in a part of the image, shape (h, w)."""
        noise = self._noise(index)
        return None if noise is None else noise[rect.y0 : rect.y1, 3 * rect.x0 : 3 * rect.x1 : 3]

    def _lit(self, time: float) -> list[Steps]:
        rows, columns = self.floor.shape
        shifts = []
        for number, layer in enumerate(self.light):
            # the patterns sway against each other, so that what is seen of both never repeats
            turn = 2 * np.pi * time / (5.3 + 1.9 * number) + 2.1 * number
            down, right = (round(self.sway * (0.5 + 0.5 * np.sin(turn * pace))) for pace in (0.7, 1.0))
            shifts.append(layer[down : down + rows, 3 * right : 3 * right + columns])
        return shifts

    def _noise(self, index: int) -> Steps | None:
        if self.noise is None:
            return None
        rows, columns = self.floor.shape
        down, right = np.random.default_rng([self.seed, 3, index]).integers(0, _NOISE_SHIFT, 2)
        return self.noise[down : down + rows, 3 * right : 3 * right + columns]


def make_water(camera: PoolCamera, seed: int) -> Water:
    """Fills the pool."""
    shine, grain, ground = np.random.default_rng([seed, 2]).spawn(3)
    sway = round(_SWAY / camera.meters_per_pixel)
    light = tuple(_caustics(camera, sway, shine) for _ in range(2)) if camera.caustics else ()
    reach = round(min(4 * camera.noise, 60.0))
    noise = None
    if camera.noise:
        shape = (camera.height + _NOISE_SHIFT, camera.width + _NOISE_SHIFT)
        field = np.round(camera.noise * grain.standard_normal(shape, dtype=np.float32))
        noise = _in_three(np.clip(field, -reach, reach))
    room = reach + sum(int(np.abs(layer.astype(np.int16)).max()) for layer in light)
    floor = np.clip(np.round(_floor(camera, ground)), min(room, 127), max(255 - room, 128)).astype(np.uint8)
    return Water(floor.reshape(camera.height, -1), light, noise, sway, seed)


def _in_three(field: Image32) -> Steps:
    return np.repeat(field.astype(np.int8), 3, axis=1)


def _smooth(rows: int, columns: int, length: float, rng: np.random.Generator) -> Image32:
    """A random pattern of mean 0 and standard deviation 1 that changes over `length` [px]. Shape (rows, columns)."""
    step = max(length / _COARSE, 1.0)
    shape = (int(rows / step) + 3, int(columns / step) + 3)
    pattern = ndimage.gaussian_filter(rng.standard_normal(shape), length / step, mode="wrap")
    pattern /= pattern.std()
    fine = pattern.astype(np.float32)
    for count in (rows, columns):  # straight lines between grid points, one axis after the other
        place = np.arange(count) / step
        first = place.astype(int)
        share = (place - first).astype(np.float32)[:, None]
        fine = ((1 - share) * fine[first] + share * fine[first + 1]).T
    return np.ascontiguousarray(fine)


def _caustics(camera: PoolCamera, sway: int, rng: np.random.Generator) -> Steps:
    """A net of bright lines, as a wavy surface throws it on the floor."""
    rows, columns = camera.height + sway, camera.width + sway
    cell = 0.05 / camera.meters_per_pixel
    net = np.exp(-3.0 * np.abs(_smooth(rows, columns, cell, rng)))
    net += 0.4 * _smooth(rows, columns, 4 * cell, rng)
    net -= net.mean()
    return _in_three(np.clip(np.round(14.0 * camera.caustics * net), -40, 60))


def _floor(camera: PoolCamera, rng: np.random.Generator) -> Image32:
    """Tiles seen through still water, darker toward the edges. Shape (height, width, 3)."""
    rows, columns = camera.height, camera.width
    x = (np.arange(columns, dtype=np.float32) - camera.middle[0]) * camera.meters_per_pixel
    y = (np.arange(rows, dtype=np.float32)[:, None] - camera.middle[1]) * camera.meters_per_pixel
    deeper = (camera.camera_height + FLOOR) / camera.camera_height
    length = 0.09 / camera.meters_per_pixel
    joints = np.zeros((rows, columns), dtype=np.float32)
    for axis in (x, y):
        along = axis * deeper + 0.006 * _smooth(rows, columns, length, rng)
        off = np.abs((along / _TILE) % 1.0 - 0.5) * _TILE  # m from the joint
        joints = np.maximum(joints, np.clip(1.5 - off / 0.004, 0.0, 1.0))
    shade = 1.0 - 0.16 * (x**2 + y**2) / (x[0] ** 2 + y[0] ** 2)
    shade += 0.025 * _smooth(rows, columns, 4 * length, rng) - 0.10 * joints
    return shade[..., None] * np.array(camera.water_color, dtype=np.float32)


def box(points: Array, reach: float, inside: Rect) -> Rect:
    """The pixels within `reach` of any point, as far as they are inside another box. Shape of points: (..., 2) [px]."""
    flat = points.reshape(-1, 2)
    low, high = np.floor(flat.min(axis=0) - reach).astype(int), np.ceil(flat.max(axis=0) + reach).astype(int) + 1
    return Rect(
        max(int(low[0]), inside.x0), max(int(low[1]), inside.y0),
        min(int(high[0]), inside.x1), min(int(high[1]), inside.y1),
    )  # fmt: skip


def grid(rect: Rect) -> tuple[Image32, Image32]:
    """Pixel centers: x, shape (w,), and y, shape (h, 1)."""
    return np.arange(rect.x0, rect.x1, dtype=np.float32), np.arange(rect.y0, rect.y1, dtype=np.float32)[:, None]


def disc(centers: Array, radius: float, rect: Rect) -> Image32:
    """A disc's coverage, averaged over its places while the shutter is open.

    Args:
        centers: Places [px]. Shape (S, 2).
        radius: [px].
        rect: Where.

    Returns:
        From 0 to 1. Shape (h, w).
    """
    x, y = grid(rect)
    cover = np.zeros((y.size, x.size), dtype=np.float32)
    for cx, cy in centers:
        away = np.sqrt((x - np.float32(cx)) ** 2 + (y - np.float32(cy)) ** 2)
        cover += np.clip(np.float32(radius + 0.5) - away, 0.0, 1.0)
    return cover / np.float32(len(centers))


def hull(spine: Array, radii: Array, blur: Array, rect: Rect) -> tuple[Image32, Image32]:
    """A body of changing width around a line.

    Args:
        spine: Points of the line [px]. Shape (N, 2).
        radii: Half width of the body at each [px]. Shape (N,).
        blur: How far each moves while the shutter is open [px]; the edges are that soft. Shape (N,).
        rect: Where.

    Returns:
        Coverage, and how near the spine a pixel is: 1 on it, 0 at the edge and outside. Shapes (h, w).
    """
    cover = np.zeros((rect.y1 - rect.y0, rect.x1 - rect.x0), dtype=np.float32)
    ridge = np.zeros_like(cover)
    for a, b, ra, rb, soft in zip(
        spine[:-1], spine[1:], radii[:-1], radii[1:], 1 + (blur[:-1] + blur[1:]) / 2, strict=True
    ):
        part = box(np.stack([a, b]), max(ra, rb) + soft, rect)
        if part.empty:
            continue
        x, y = grid(part)
        (ax, ay), (dx, dy) = a.astype(np.float32), (b - a).astype(np.float32)
        x, y = x - ax, y - ay
        square = max(float(dx * dx + dy * dy), 1e-12)
        share = np.clip(x * (dx / square) + y * (dy / square), 0.0, 1.0, dtype=np.float32)
        away = np.sqrt((x - share * dx) ** 2 + (y - share * dy) ** 2)
        inner = share * np.float32(rb - ra) + np.float32(ra) - away
        window = part.within(rect)
        np.maximum(ridge[window], inner * np.float32(2 / (ra + rb)), out=ridge[window])
        # a strip that moves by more than its width covers no pixel for the whole exposure
        rise = min(soft, ra + rb)
        covered = np.clip((inner + np.float32(soft / 2)) * np.float32(1 / rise), 0.0, 1.0)
        np.maximum(cover[window], covered * np.float32(rise / soft), out=cover[window])
    return cover, ridge


@dataclass(frozen=True)
class Patch:
    """A patch of light.

    Attributes:
        center: [px]. Shape (2,).
        radius: On average, up and down [px].
        stretch: How many times wider it is than high.
        turn: Phase of the waves along its edge [rad].
        strength: What it covers in its middle, 0 to 1.
    """

    center: Array
    radius: float
    stretch: float
    turn: float
    strength: float

    def box(self, inside: Rect) -> Rect:
        """The pixels that it touches."""
        reach = (1 + sum(_WAVY) + _SOFT / 2) * self.radius * np.array([self.stretch, 1.0])
        return box(np.stack([self.center - reach, self.center + reach]), 1.0, inside)


def patch_cover(x: Image32 | Array, y: Image32 | Array, light: Patch) -> Image32:
    """How much a patch of light with a wavy edge covers.

    Args:
        x: Places of the pixels [px].
        y: Places of the pixels [px]; a shape that broadcasts with that of `x`.
        light: The patch.

    Returns:
        From 0 to 1, in the common shape of `x` and `y`.
    """
    dx, dy = ((x - light.center[0]) / light.stretch).astype(np.float32), (y - light.center[1]).astype(np.float32)
    angle = np.arctan2(dy, dx)
    edge = 1 + _WAVY[0] * np.sin(2 * angle + light.turn) + _WAVY[1] * np.sin(3 * angle - 1.7 * light.turn)
    soft = max(_SOFT * light.radius, 1.0)
    cover = np.clip((edge * light.radius - np.hypot(dx, dy)) / soft + 0.5, 0.0, 1.0)
    return (light.strength * cover).astype(np.float32)


def patch_radius(reach: float) -> float:
    """The radius of a patch that covers all within `reach` of its center."""
    return reach / (1 - sum(_WAVY) - _SOFT / 2) + 0.5


def paint(image: Image32, rect: Rect, cover: Image32, part: Rect, color: Sequence[float]) -> None:
    """Lays a color over a part of an image, as much as `cover` says.

    Args:
        image: Shape (3, h, w), changed in place.
        rect: What of the frame the image shows.
        cover: Shape of `part`.
        part: Where, within `rect`.
        color: RGB.
    """
    for channel, value in zip(image, color, strict=True):
        below = channel[part.within(rect)]
        below += cover * (np.float32(value) - below)
