"""A laboratory camera that knows where every marker is: it draws rigid bodies with equal markers, and writes a film.

It is no relative of `swim2real.rendering`: light is added up linearly over the shutter, the lens bends straight lines,
the sensor counts photons, and only then come gamma and the codec. Places are in pixels and of two kinds: those in the
*plane*, where a lens without distortion would show them and bodies are rigid, and those in the *picture*.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Color = tuple[float, float, float]

MOST_MOMENTS = 48  # of an exposure
NOISE_BANK = 1 << 22
QP_TO_LAMBDA = 118  # FFmpeg's FF_QP2LAMBDA
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

    @property
    def owners(self) -> NDArray[np.int64]:
        """The body of each marker. Shape (M,)."""
        return np.repeat(np.arange(len(self.bodies)), [len(b.markers) for b in self.bodies])

    def plane(self, times: Array) -> Array:
        """Markers in the plane [px]. Shape (N, M, 2)."""
        poses = self.poses(times)
        parts = [_moved(body.markers, poses[:, b]) for b, body in enumerate(self.bodies)]
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
        return self.scene.owners

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
        """Of markers [px]."""
        return self.scene.radius

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


def write(film: Film) -> None:
    """Draws the film and writes its file."""
    camera, rate = film.camera, Fraction(film.camera.fps).limit_denominator(1001)
    part = film.path.with_name("part-" + film.path.name)
    jpeg = camera.codec == "mjpeg"
    pixels, space, span = (
        ("yuvj420p", Colorspace.ITU601, ColorRange.JPEG) if jpeg else ("yuv420p", Colorspace.ITU709, ColorRange.MPEG)
    )
    with av.open(str(part), "w") as container:
        options = {} if jpeg else {"crf": str(camera.quality), "preset": "veryfast"}
        stream = container.add_stream("mjpeg" if jpeg else "libx264", rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = camera.width, camera.height, pixels
        context = stream.codec_context
        context.time_base, context.thread_count = 1 / rate, 1
        context.colorspace, context.color_range = int(space), int(span)
        context.color_primaries = context.color_trc = int(Colorspace.ITU709)
        if jpeg:
            context.qscale, context.global_quality = True, camera.quality * QP_TO_LAMBDA
        for index, image in enumerate(drawn(film)):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(
                format=pixels, dst_colorspace=space, dst_color_range=span
            )
            frame.pts, frame.time_base = index, 1 / rate
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    part.replace(film.path)


def drawn(film: Film) -> Iterator[NDArray[np.uint8]]:
    """The frames, before any codec: RGB. Shape (H, W, 3) each."""
    camera, scene = film.camera, film.scene
    rng = np.random.default_rng([camera.seed, 1])
    bank = rng.standard_normal(NOISE_BANK, dtype=np.float32)
    light = _light(camera, rng)
    empty = light[..., None] * _background(camera, rng)
    levels = np.round(255 * np.linspace(0, 1, 1 << 14) ** (1 / camera.gamma)).astype(np.uint8)
    shot, read = np.float32(1 / camera.electrons), np.float32((camera.read_noise / camera.electrons) ** 2)
    lens = np.array([*camera.center, camera.corner, camera.bend])
    shades = [camera.linear(body.color) for body in scene.bodies]
    contrast = [camera.linear(scene.marker_color) - shade for shade in shades]
    picture, out = np.empty_like(empty), np.empty(empty.shape, np.uint8)
    for index, time in enumerate(film.times):
        np.copyto(picture, empty)
        moments = _moments(film, index)
        poses = scene.poses(moments)
        for b, body in enumerate(scene.bodies):
            pose = poses[:, b] if np.ptp(poses[:, b], axis=0).max() > 0 else poses[:1, b]
            for box in body.boxes:
                _draw(picture, light, camera, lens, pose[:: 1 + (len(pose) > 24)], box, shades[b], over=True)
            for x, y in body.markers:
                size, rounding = (scene.radius, scene.radius), 0.0 if scene.squares else scene.radius
                _draw(picture, light, camera, lens, pose, Box((x, y), size, rounding), contrast[b], over=False)
        for cover in scene.covers:
            if cover.start <= time <= cover.end:
                if isinstance(cover, Glare):
                    _add_glare(picture, cover)
                else:
                    pose = np.array([[*np.multiply(cover.velocity, time - cover.start), 0.0]])
                    _draw(picture, light, camera, lens, pose, cover.box, camera.linear(cover.color), over=True)
        _expose(picture, bank, int(rng.integers(NOISE_BANK)), shot, read, levels, camera.gray, out)
        yield out


def _moments(film: Film, index: int) -> Array:
    """Moments of an exposure, evenly spread [s]. Shape (S,)."""
    camera = film.camera
    way = float(film.speed[index].max()) * camera.shutter
    count = int(np.clip(np.ceil(way / camera.softness), 1, MOST_MOMENTS))  # no gap between two edges
    return film.times[index] + ((np.arange(count) + 0.5) / count - 0.5) * camera.shutter / camera.fps


def _moved(points: Array, poses: Array) -> Array:
    """Points of a body at its poses. Shapes (N, 2), (T, 3) to (T, N, 2)."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    return np.einsum("tij,nj->tni", turn, points) + poses[:, None, :2]


def _inside(points: Array, box: Box) -> NDArray[np.bool_]:
    """Points (..., 2) within a box, whose corners are taken as sharp."""
    cos, sin = np.cos(box.angle), np.sin(box.angle)
    local = (points - np.array(box.center)) @ np.array([[cos, -sin], [sin, cos]])
    return (np.abs(local) <= np.array(box.half)).all(axis=-1)


def _covered(scene: Scene, camera: Camera, times: Array, places: Array) -> Array:
    """Share of each marker that can't be seen. Shape (T, M)."""
    poses, owners = scene.poses(times), scene.owners
    plane = scene.plane(times)
    samples = plane[:, :, None] + scene.radius * _RINGS  # (T, M, S, 2)
    hidden = np.zeros(samples.shape[:3], bool)
    for b, body in enumerate(scene.bodies):
        below = np.flatnonzero(owners < b)
        for t in range(len(times)) if len(below) else ():
            back = samples[t, below] - poses[t, b, :2]
            cos, sin = np.cos(poses[t, b, 2]), np.sin(poses[t, b, 2])
            back = back @ np.array([[cos, -sin], [sin, cos]])
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
    added = _glow(points[..., 0], points[..., 1], glare)[..., None]
    shown = []
    for color in (scene.marker_color, scene.bodies[0].color):
        value = 0.7 * camera.linear(color)
        shown.append((np.minimum(value, 1.0), np.minimum(value + added, 1.0)))
    (marker, marker_lit), (body, body_lit) = shown
    usual = np.abs(marker ** (1 / camera.gamma) - body ** (1 / camera.gamma)).sum()
    lit = np.abs(marker_lit ** (1 / camera.gamma) - body_lit ** (1 / camera.gamma)).sum(axis=-1)
    return lit < 0.5 * usual


def _glow(x: Array, y: Array, glare: Glare) -> Array:
    away = ((x - glare.center[0]) / glare.half[0]) ** 2 + ((y - glare.center[1]) / glare.half[1]) ** 2
    return glare.strength * np.exp(-(away**2))


def _add_glare(picture: NDArray[np.float32], glare: Glare) -> None:
    (x, y), (a, b) = glare.center, glare.half
    left, right = (int(np.clip(v, 0, picture.shape[1])) for v in (x - 2 * a, x + 2 * a))
    top, bottom = (int(np.clip(v, 0, picture.shape[0])) for v in (y - 2 * b, y + 2 * b))
    rows, columns = np.mgrid[top:bottom, left:right].astype(np.float32)
    picture[top:bottom, left:right] += _glow(columns, rows, glare)[..., None]


def _light(camera: Camera, rng: np.random.Generator) -> NDArray[np.float32]:
    """Light on the scene: brightest somewhere, less in the picture's corners. Shape (H, W)."""
    x = np.linspace(-1, 1, camera.width, dtype=np.float32)
    y = np.linspace(-1, 1, camera.height, dtype=np.float32)[:, None]
    lamp = rng.uniform(-0.7, 0.7, 2)
    fall = (x - lamp[0]) ** 2 + (y - lamp[1]) ** 2
    return (rng.uniform(0.75, 0.95) * (1 - camera.uneven * fall / fall.max())).astype(np.float32)


def _background(camera: Camera, rng: np.random.Generator) -> NDArray[np.float32]:
    """Color of what lies below: stains, grain, and some straight edges. Shape (H, W, 3)."""
    height, width = camera.height, camera.width
    bumps = np.zeros((height, width), np.float32)
    for size, weight in ((300, 0.5), (60, 0.3), (12, 0.15), (3, 0.1)):
        grid = rng.standard_normal((height // size + 2, width // size + 2)).astype(np.float32)
        bumps += weight * _hat(height, grid.shape[0], size) @ grid @ _hat(width, grid.shape[1], size).T
    y, x = np.mgrid[:height, :width].astype(np.float32)
    for _ in range(int(rng.integers(0, 5))):  # tapes, cables, gaps between boards
        angle, place = rng.uniform(0, np.pi), rng.uniform(0, 1, 2) * (width, height)
        away = np.abs((x - place[0]) * np.sin(angle) - (y - place[1]) * np.cos(angle)) - rng.uniform(2, 12)
        bumps += rng.uniform(-1.2, 1.2) * np.clip(0.5 - away / camera.softness, 0, 1)
    return np.clip(1 + camera.texture * bumps, 0.1, 2.5)[..., None] * camera.linear(camera.background).astype(
        np.float32
    )


def _hat(count: int, knots: int, size: int) -> NDArray[np.float32]:
    """Weights of linear interpolation. Shape (count, knots)."""
    return np.maximum(0, 1 - np.abs(np.arange(count)[:, None] / size - np.arange(knots))).astype(np.float32)


def _draw(
    picture: NDArray[np.float32], light: NDArray[np.float32], camera: Camera, lens: Array, poses: Array, box: Box,
    color: Array, over: bool,
) -> None:  # fmt: skip
    """Draws a box of a body at some poses of an exposure, over what is there or added to it."""
    (x, y), (a, b) = box.center, box.half
    cos, sin = np.cos(box.angle), np.sin(box.angle)
    edge = np.array([[s * a, t * b] for s in (-1, -0.5, 0, 0.5, 1) for t in (-1, 1)])
    around = _moved(edge @ np.array([[cos, sin], [-sin, cos]]) + (x, y), poses)
    around = camera.picture(around).reshape(-1, 2)
    margin = camera.softness + 3
    left, top = (int(v) for v in np.clip(np.floor(around.min(axis=0) - margin), 0, (camera.width, camera.height)))
    right, bottom = (int(v) for v in np.clip(np.ceil(around.max(axis=0) + margin), 0, (camera.width, camera.height)))
    center = _moved(np.array([[x, y]]), poses)[:, 0]
    turns = poses[:, 2] + box.angle
    course = np.column_stack([center, np.cos(turns), np.sin(turns)])
    shape = np.array([a, b, box.rounding, camera.softness])
    _cover(picture, light, (left, top, right, bottom), lens, course, shape, color.astype(np.float32), over)


@njit(cache=True, nogil=True, fastmath=True)
def _cover(picture, light, area, lens, course, shape, color, over):
    half_x, half_y, rounding, softness = shape[0] - shape[2], shape[1] - shape[2], shape[2], shape[3]
    moments = len(course)
    for row in range(area[1], area[3]):
        for column in range(area[0], area[2]):
            dx, dy = (column - lens[0]) / lens[2], (row - lens[1]) / lens[2]
            scale = lens[2] * (1 + lens[3] * (dx * dx + dy * dy))
            x, y = lens[0] + scale * dx, lens[1] + scale * dy
            covered = 0.0
            for m in range(moments):
                px, py = x - course[m, 0], y - course[m, 1]
                qx = abs(course[m, 2] * px + course[m, 3] * py) - half_x
                qy = abs(course[m, 2] * py - course[m, 3] * px) - half_y
                away = np.sqrt(qx * qx + qy * qy) if qx > 0 and qy > 0 else max(qx, qy)
                away -= rounding
                share = min(max(0.5 - away / softness, 0.0), 1.0)
                covered += share * share * (3 - 2 * share)
            covered /= moments
            if covered > 0:
                bright = covered * light[row, column]
                for c in range(3):
                    if over:
                        picture[row, column, c] *= 1 - covered
                    picture[row, column, c] += bright * color[c]


@njit(cache=True, nogil=True, fastmath=True)
def _expose(picture, bank, offset, shot, read, levels, gray, out):
    """Photon noise, read noise, saturation, gamma."""
    zero, one, top = np.float32(0), np.float32(1), np.float32(len(levels) - 1)
    height, width, _ = picture.shape
    for row in range(height):
        at = (offset + 3 * row * width) % (len(bank) - 3 * width)
        noise = bank[at : at + 3 * width].reshape((width, 3))
        for column in range(width):
            for c in range(1 if gray else 3):
                value = picture[row, column, c]
                value += noise[column, c] * np.sqrt(value * shot + read)
                out[row, column, c] = levels[int(min(max(value, zero), one) * top)]
            if gray:
                out[row, column, 1] = out[row, column, 2] = out[row, column, 0]
