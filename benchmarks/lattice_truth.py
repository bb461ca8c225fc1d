"""Films of rigid bodies with equal markers: what moves, what films it, and where every marker is.

Places are in pixels and of two kinds: those in the *plane*, where a lens without distortion would show them and bodies
are rigid, and those in the *picture*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Color = tuple[float, float, float]

_RINGS = np.array([[0.0, 0.0]] + [[f * np.cos(a), f * np.sin(a)] for f, n in ((0.55, 6), (0.9, 8))
                                  for a in 2 * np.pi * np.arange(n) / n])  # fmt: skip


@dataclass(frozen=True)
class Box:
    """A rectangle with round corners on a body, or at rest in the picture [px]."""

    center: tuple[float, float]
    half: tuple[float, float]
    rounding: float
    angle: float = 0.0


@dataclass(frozen=True)
class Body:
    """A rigid body. `markers` are on it, in its own axes [px], shape (N, 2); its color is 0 to 255 as in the film."""

    boxes: tuple[Box, ...]
    markers: Array
    color: Color

    def scaled(self, by: float) -> Body:
        """The same, larger."""
        boxes = [
            Box((by * b.center[0], by * b.center[1]), (by * b.half[0], by * b.half[1]), by * b.rounding, b.angle)
            for b in self.boxes
        ]
        return Body(tuple(boxes), by * self.markers, self.color)


@dataclass(frozen=True)
class Occluder:
    """Something dark or bright over the scene, from one time to another [s]. It moves by `velocity` [px/s]."""

    start: float
    end: float
    box: Box
    color: Color
    velocity: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Glare:
    """A reflection of a lamp: an ellipse of added light. `strength` is in units of a white sheet."""

    start: float
    end: float
    center: tuple[float, float]
    half: tuple[float, float]
    strength: float


@dataclass(frozen=True)
class Look:
    """What real dots and cameras have, and plain ones don't. None of it is there unless given.

    Attributes:
        dots: Half axes of each dot as shares of the radius, and the first one's angle on the body [rad]. Shape (M, 3).
        hub: Radius of the dots' middle, of another color, as a share of theirs.
        hub_color: As in the film, 0 to 255.
        lamp: Direction of the lamp, from which balls have a highlight [rad].
        clear: Of bodies, only the dots can be seen.
        ground: What lies below: see `lattice_looks.ground`.
        shadows: x, y [px] of a point on the edge of each, its direction [rad], share of light it takes, width of the
            edge [px]. Shape (K, 5).
        clipping: By which light is multiplied before highlights are clipped.
        s_curve: Weight of an S-curve over gamma, 0 to 1.
        sharpening: Weight of an unsharp mask.
        interlaced: Even rows are a quarter of a frame early, odd rows are late.
        waves: How the camera sways: x, y [px], frequency [Hz], phase [rad], and the power of the sine, which is 1, or
            odd and large for jerks. Shape (K, 5).
        exposure: How its automatic exposure sways: share of the light, frequency [Hz], phase [rad].
    """

    dots: Array
    hub: float = 0.0
    hub_color: Color = (0, 0, 0)
    lamp: float | None = None
    clear: bool = False
    ground: str = ""
    shadows: Array = field(default_factory=lambda: np.zeros((0, 5)))
    clipping: float = 1.0
    s_curve: float = 0.0
    sharpening: float = 0.0
    interlaced: bool = False
    waves: Array = field(default_factory=lambda: np.zeros((0, 5)))
    exposure: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def shift(self, times: Array) -> Array:
        """By how much all is moved in the plane, by a camera that isn't at rest [px]. Shape (N, 2)."""
        ways, frequencies, phases, powers = self.waves[:, :2], *self.waves[:, 2:].T
        return np.sin(2 * np.pi * np.outer(times, frequencies) + phases) ** powers @ ways

    def gain(self, time: float) -> float:
        """By which light is multiplied."""
        share, frequency, phase = self.exposure
        return float(1 + share * np.sin(2 * np.pi * frequency * time + phase))


@dataclass(frozen=True)
class Scene:
    """What is filmed.

    Attributes:
        bodies: In the order in which they are drawn: the last one is on top.
        fixed: Index of the body that is fixed to the world, if any.
        hinges: Pairs of bodies, and the place of their hinge in the plane at time 0 [px].
        poses: From times [s], shape (N,), to x, y [px] and angle [rad] of each body, shape (N, B, 3).
        marker_color: As in the film, 0 to 255.
        squares: Markers are squares, with a side of two radii, not discs.
        radius: Of markers [px].
        seconds: Duration of the film.
        covers: Occluders and glare.
        growth: Size of all in the picture, as a share of what is given here, by time.
        soft: All are one body, which isn't rigid.
        look: What films of it have and plain ones don't.
    """

    bodies: tuple[Body, ...]
    fixed: int | None
    hinges: tuple[tuple[int, int, tuple[float, float]], ...]
    poses: Callable[[Array], Array]
    marker_color: Color
    squares: bool
    radius: float
    seconds: float
    covers: tuple[Occluder | Glare, ...] = ()
    growth: Callable[[Array], Array] = np.ones_like
    soft: bool = False
    look: Look | None = None

    @property
    def owners(self) -> NDArray[np.int64]:
        """The body of each marker. Shape (M,)."""
        return np.repeat(np.arange(len(self.bodies)), [len(b.markers) for b in self.bodies])

    def plane(self, times: Array) -> Array:
        """Markers in the plane [px]. Shape (N, M, 2)."""
        poses = self.poses(times)
        size = self.growth(times)
        parts = [moved(body.markers, poses[:, b], size) for b, body in enumerate(self.bodies)]
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class Camera:
    """What films.

    Attributes:
        width: Of the picture [px].
        height: Of the picture [px].
        fps: Frames a second.
        shutter: Share of the frame interval during which it is open.
        bend: Radial distortion: `plane = center + (picture - center) (1 + bend r^2)`, with r = 1 in the corners.
        softness: Width of edges [px]: 1 in focus, more out of focus.
        gamma: Of the film.
        electrons: That a white, fully lit pixel collects.
        read_noise: In electrons.
        gray: One color channel only.
        uneven: Share of the light that is missing in the darkest place.
        texture: Contrast of the background.
        background: Its color, 0 to 255.
        codec: `h264` or `mjpeg`.
        quality: CRF of H.264, or quantizer of JPEG (1 is best, 31 worst).
        seed: Of texture and noise.
    """

    width: int = 1280
    height: int = 720
    fps: float = 60.0
    shutter: float = 0.5
    bend: float = 0.03
    softness: float = 1.5
    gamma: float = 2.2
    electrons: float = 8000.0
    read_noise: float = 15.0
    gray: bool = False
    uneven: float = 0.3
    texture: float = 0.3
    background: Color = (120, 118, 112)
    codec: str = "h264"
    quality: int = 21
    seed: int = 0

    @property
    def center(self) -> Array:
        return np.array([(self.width - 1) / 2, (self.height - 1) / 2])

    @property
    def corner(self) -> float:
        """Distance of the corners from the center [px]."""
        return float(np.hypot(*self.center))

    def picture(self, plane: Array) -> Array:
        """From places in the plane to those in the picture [px]. Shape (..., 2)."""
        away = (plane - self.center) / self.corner
        wanted = np.linalg.norm(away, axis=-1)
        r = wanted.copy()
        for _ in range(8):  # Newton's method
            r -= (r * (1 + self.bend * r**2) - wanted) / (1 + 3 * self.bend * r**2)
        return self.center + away * np.where(wanted > 0, r / np.maximum(wanted, 1e-12), 1.0)[..., None] * self.corner

    def linear(self, color: Color) -> Array:
        """Light of a color, 1 for white. Shape (3,)."""
        values = np.array(color, float)
        values = np.full(3, values.mean()) if self.gray else values
        return (values / 255) ** self.gamma


@dataclass(frozen=True)
class Film:
    """A film, and the truth about it.

    Attributes:
        name: For the table.
        path: Of the file.
        scene: What was filmed.
        camera: What filmed.
        times: Middle of each exposure, and time stamp of the frame [s]. Shape (T,).
        places: Where markers are in the picture in the middle of the exposure [px]. Shape (T, M, 2).
        speed: How far each marker goes in a frame interval [px]. Shape (T, M).
        covered: Share of each marker that can't be seen: below another thing, in glare, or outside. Shape (T, M).
        picks: Points that a person picks in the first frame, off by 1 px [px]. Shape (M, 2).
    """

    name: str
    path: Path
    scene: Scene
    camera: Camera
    times: Array
    places: Array = field(repr=False)
    speed: Array = field(repr=False)
    covered: Array = field(repr=False)
    picks: Array = field(repr=False)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Markers of which more than half can be seen. Shape (T, M)."""
        return self.covered < 0.5

    @property
    def bodies(self) -> NDArray[np.int64]:
        """The body of each marker. Shape (M,)."""
        return self.scene.owners * (not self.scene.soft)

    @property
    def fixed(self) -> int | None:
        """Index of the body that is fixed to the world, if any."""
        return self.scene.fixed

    @property
    def hinges(self) -> list[tuple[int, int, Array]]:
        """Pairs of bodies, and the place of their hinge in the first frame [px]."""
        return [(a, b, self.camera.picture(np.array(place))) for a, b, place in self.scene.hinges]

    @property
    def radius(self) -> float:
        """Of markers in the first frame [px]."""
        return self.scene.radius * float(self.scene.growth(self.times[:1])[0])

    @property
    def fps(self) -> float:
        return self.camera.fps


def planned(name: str, scene: Scene, camera: Camera, path: Path) -> Film:
    """The film as it will be, before it is drawn."""
    times = np.arange(round(scene.seconds * camera.fps)) / camera.fps
    places = camera.picture(scene.plane(times))
    half = 0.5 / camera.fps
    speed = np.linalg.norm(
        camera.picture(scene.plane(times + half)) - camera.picture(scene.plane(times - half)), axis=2
    )
    turns = np.random.default_rng([camera.seed, 4]).uniform(0, 2 * np.pi, places.shape[1])
    picks = places[0] + np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return Film(name, path, scene, camera, times, places, speed, _covered(scene, camera, times, places), picks)


def moved(points: Array, poses: Array, size: Array | float = 1.0) -> Array:
    """Points of a body at its poses, and grown to a size. Shapes (N, 2), (T, 3), (T,) to (T, N, 2)."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    return np.einsum("tij,nj->tni", turn, points) * np.reshape(size, (-1, 1, 1)) + poses[:, None, :2]


def _inside(points: Array, box: Box) -> NDArray[np.bool_]:
    """Points (..., 2) within a box, whose corners are taken as sharp."""
    cos, sin = np.cos(box.angle), np.sin(box.angle)
    local = (points - np.array(box.center)) @ np.array([[cos, -sin], [sin, cos]])
    return (np.abs(local) <= np.array(box.half)).all(axis=-1)


def _covered(scene: Scene, camera: Camera, times: Array, places: Array) -> Array:
    """Share of each marker that can't be seen. Shape (T, M)."""
    poses, owners = scene.poses(times), scene.owners
    plane = scene.plane(times)
    size = scene.growth(times)
    samples = plane[:, :, None] + scene.radius * size[:, None, None, None] * _RINGS  # (T, M, S, 2)
    hidden = np.zeros(samples.shape[:3], bool)
    for b, body in enumerate(scene.bodies):
        below = np.flatnonzero(owners < b)
        for t in range(len(times)) if len(below) else ():
            back = samples[t, below] - poses[t, b, :2]
            cos, sin = np.cos(poses[t, b, 2]), np.sin(poses[t, b, 2])
            back = back @ np.array([[cos, -sin], [sin, cos]]) / size[t]
            for box in body.boxes:
                hidden[t, below] |= _inside(back, box)
    seen_at = places[:, :, None] + scene.radius * _RINGS
    for cover in scene.covers:
        on = np.flatnonzero((times >= cover.start) & (times <= cover.end))
        for t in on:
            if isinstance(cover, Glare):
                hidden[t] |= _drowned(scene, camera, seen_at[t], cover)
            else:
                hidden[t] |= _inside(samples[t] - np.multiply(cover.velocity, times[t] - cover.start), cover.box)
    edge = np.array([camera.width, camera.height]) - 1
    hidden |= ((seen_at < 0) | (seen_at > edge)).any(axis=3)
    return hidden.mean(axis=2)


def _drowned(scene: Scene, camera: Camera, points: Array, glare: Glare) -> NDArray[np.bool_]:
    """Points where glare leaves less than half of the contrast between markers and their bodies."""
    added = glow(points[..., 0], points[..., 1], glare)[..., None]
    shown = []
    for color in (scene.marker_color, scene.bodies[0].color):
        value = 0.7 * camera.linear(color)
        shown.append((np.minimum(value, 1.0), np.minimum(value + added, 1.0)))
    (marker, marker_lit), (body, body_lit) = shown
    usual = np.abs(marker ** (1 / camera.gamma) - body ** (1 / camera.gamma)).sum()
    lit = np.abs(marker_lit ** (1 / camera.gamma) - body_lit ** (1 / camera.gamma)).sum(axis=-1)
    return lit < 0.5 * usual


def glow(x: Array, y: Array, glare: Glare) -> Array:
    away = ((x - glare.center[0]) / glare.half[0]) ** 2 + ((y - glare.center[1]) / glare.half[1]) ** 2
    return glare.strength * np.exp(-(away**2))
