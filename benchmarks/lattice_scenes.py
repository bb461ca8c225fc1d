"""Scenes for `lattice_films.py`: robots of rigid bodies with equal markers, with numbers drawn at random."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from lattice_truth import Array, Body, Box, Camera, Color, Film, Glare, Occluder, Scene, planned
from numba import njit
from scipy.interpolate import CubicSpline

_TEN = ("lattice", "arm", "lattice", "sheet", "lattice", "pendulum", "lattice", "mild lattice", "lattice", "mild sheet")
SCENES = (*_TEN, *("puck" if kind == "pendulum" else kind for kind in _TEN))  # film k shows the (k mod 20)th
COVERED = 0.3  # share of the films, but for mild ones, with an occluder or glare
REST = 0.2  # s at the start of each film
MILD = (2.0, 7.5)  # px a frame at most, in mild films
FAST = (3.0, 60.0)  # in the others
SHORTEST_PERIOD, LONGEST_PERIOD = 10, 70  # frames
SIZES = ((1280, 720), (1920, 1080), (2046, 1300), (1300, 2046), (1280, 1024))
FRAME_RATES = (30.0, 50.0, 60.0, 60.0, 100.0, 120.0)

# markers, bodies, background: as they look in the film
COLORS = (
    ((25, 25, 28), (225, 224, 220), (130, 128, 122)),  # black on white, gray table
    ((35, 33, 30), (190, 188, 180), (225, 225, 222)),  # black on gray, white table
    ((20, 22, 25), (215, 205, 180), (60, 62, 66)),  # black on wood, dark table
    ((240, 240, 238), (45, 46, 50), (120, 118, 112)),  # white on black
    ((230, 228, 220), (70, 75, 82), (35, 36, 38)),  # white on gray, black table
    ((210, 60, 130), (225, 222, 215), (110, 112, 108)),  # pink on white
    ((40, 130, 70), (228, 226, 220), (150, 140, 125)),  # green on white
    ((225, 120, 30), (50, 52, 58), (150, 150, 148)),  # orange on black
)
Colors = tuple[Color, Color, Color]
Shape = Callable[[Array], Array]  # from phases, shape (N,), to poses of the bodies, shape (N, B, 3)


class DoesNotFitError(Exception):
    """These numbers give no film; others are drawn."""


def random_film(seed: int, index: int, folder: Path) -> Film:
    """A film that nobody chose; the same for the same numbers. Drawing it is left to `lattice_camera.write`."""
    rng = np.random.default_rng([seed, index])
    kind = SCENES[index % len(SCENES)]
    speed = rng.uniform(*(MILD if kind.startswith("mild") else FAST))
    while True:
        camera, colors = random_camera(rng)
        try:
            scene = MAKERS[kind.split()[-1]](rng, camera, colors, speed)
            check(planned("", scene, camera, folder))
        except DoesNotFitError:
            continue
        if not kind.startswith("mild") and rng.random() < COVERED:
            scene = replace(scene, covers=(_cover(rng, camera, scene, colors),))
        return stored(planned(f"{kind} {seed}/{index}", scene, camera, folder))


def stored(film: Film) -> Film:
    """The film with a name for its file, in the folder that was its path."""
    suffix = ".mkv" if film.camera.codec == "mjpeg" else ".mp4"
    name = f"{film.name.replace(' ', '-').replace('/', '-')}-{_settings(film)}{suffix}"
    return replace(film, path=film.path / name)


def _settings(film: Film) -> str:
    """Letters and digits that differ when films do."""
    scene = film.scene
    drawn = (film.camera, scene.bodies, scene.marker_color, scene.squares, scene.radius, scene.covers)
    drawn += (scene.look,) if scene.look else ()
    return hashlib.sha256(repr(drawn).encode() + film.places.tobytes()).hexdigest()[:8]


def random_camera(rng: np.random.Generator) -> tuple[Camera, Colors]:
    """What films, and the colors before it: of markers, bodies and background."""
    gray = bool(rng.random() < 0.3)
    told_apart = [c for c in COLORS if not gray or abs(sum(c[0]) - sum(c[1])) > 250]
    colors = told_apart[int(rng.integers(len(told_apart)))]
    width, height = SIZES[int(rng.integers(len(SIZES)))]
    codec = "mjpeg" if rng.random() < 0.4 else "h264"
    camera = Camera(
        width, height, fps=float(rng.choice(FRAME_RATES)), shutter=float(rng.uniform(0.1, 1.0)),
        bend=float(rng.uniform(-0.05, 0.08)), softness=float(rng.uniform(1.0, 4.0)),
        gamma=float(rng.uniform(1.9, 2.4)), electrons=float(np.exp(rng.uniform(np.log(1500), np.log(15000)))),
        read_noise=float(rng.uniform(3, 20)), gray=gray, uneven=float(rng.uniform(0.1, 0.6)),
        texture=float(rng.uniform(0.05, 0.35)), codec=codec,
        quality=int(rng.integers(2, 9) if codec == "mjpeg" else rng.integers(17, 27)), seed=int(rng.integers(1 << 30)),
        background=colors[2],
    )  # fmt: skip
    return camera, colors


def check(film: Film) -> None:
    """Markers stay in the picture and apart, and hardly ever go below another body."""
    edge = np.array([film.camera.width, film.camera.height]) - 1 - film.radius - 2
    if (film.places < film.radius + 2).any() or (film.places > edge).any():
        raise DoesNotFitError
    used = np.ptp(film.places.reshape(-1, 2), axis=0) / edge
    if used.max() < (0.4 if len(film.bodies) > 2 else 0.1):  # nobody films from so far away
        raise DoesNotFitError
    for places in film.places:
        apart = np.linalg.norm(places[:, None] - places[None], axis=2) + 1e9 * np.eye(len(places))
        if apart.min() < 2.6 * film.radius:
            raise DoesNotFitError
    if (film.covered > 0).mean() > 0.05 or (film.covered[0] > 0).any():
        raise DoesNotFitError


def _released(shape: Shape, bodies: tuple[Body, ...], fps: float, speed: float, phases: float) -> Shape:
    """Poses in time [s]: at rest as at phase 0, then on, so fast that the fastest marker goes `speed` px a frame.

    Args:
        shape: Poses by phase; a phase of 1 is about a period.
        bodies: Which move.
        fps: Frames a second.
        speed: Wanted [px a frame].
        phases: How many are looked at.
    """
    fine = np.linspace(0, phases, int(400 * phases))
    places = Scene(bodies, None, (), shape, (0, 0, 0), False, 1.0, 0.0).plane(fine)
    fastest = np.linalg.norm(np.diff(places, axis=0), axis=2).max() / fine[1]
    period = fastest / speed  # frames
    if not SHORTEST_PERIOD <= period <= LONGEST_PERIOD:
        raise DoesNotFitError
    rate = fps / period
    return lambda times: shape(rate * np.maximum(times - REST, 0.0))


def _row(count: int, spacing: float, radius: float, color: Color) -> Body:
    """A bar with equal markers, its axis along x."""
    along = spacing * (np.arange(count) - (count - 1) / 2)
    half = (along[-1] + 1.9 * radius, 1.8 * radius)
    return Body((Box((0.0, 0.0), half, 0.8 * radius),), np.column_stack([along, np.zeros(count)]), color)


def _lattice(rng: np.random.Generator, camera: Camera, colors: Colors, speed: float) -> Scene:
    """Rows of equal dots. The first or last one is fixed; the others were pulled aside and are released."""
    rows = int(rng.integers(2, 6))
    counts = np.full(rows, int(rng.integers(3, 11)))
    if rng.random() < 0.3:
        counts = np.clip(counts + rng.integers(-2, 3, rows), 3, 10)
    if not 9 <= counts.sum() <= 40:
        raise DoesNotFitError
    radius = float(rng.uniform(6, 15))
    spacing = radius * float(rng.uniform(3.5, 8))
    bodies = tuple(_row(int(n), spacing, radius, colors[1]) for n in counts)
    gap = radius * float(rng.uniform(5, 14))
    fixed = 0 if rng.random() < 0.5 else rows - 1
    level = np.abs(np.arange(rows) - fixed) / (rows - 1)  # 0 at the fixed row, 1 at the free end
    across = gap * (np.arange(rows) - (rows - 1) / 2)
    stagger = spacing * float(rng.choice([0.0, 0.0, 0.5])) * (np.arange(rows) % 2)

    lowest, highest = speed * SHORTEST_PERIOD / (2 * np.pi), speed * LONGEST_PERIOD / (2 * np.pi)
    pull = float(np.exp(rng.uniform(np.log(lowest), np.log(min(highest, 0.35 * max(camera.width, camera.height))))))
    along_pull = pull * np.sin(level * np.pi / 2)
    across_pull = rng.uniform(-0.25, 0.25) * min(pull, 2 * gap) * level
    second = rng.uniform(-0.25, 0.25) * pull * np.sin(level * np.pi) * (rows > 2)
    twist = np.where(level > 0, rng.uniform(-0.12, 0.12, rows), 0.0) * min(1.0, 4 * pull / (spacing * counts.max()))
    overtone, decay, twisting = rng.uniform(2.2, 2.9), rng.uniform(1.5, 6), rng.uniform(0.8, 2.5)
    sideways = rng.uniform(0.7, 1.6)
    turn = float(rng.choice([0.0, np.pi / 2]) + rng.normal(0, 0.06))
    cos, sin = np.cos(turn), np.sin(turn)
    middle = camera.center + rng.uniform(-0.08, 0.08, 2) * (camera.width, camera.height)

    def shape(phase: Array) -> Array:
        fade = np.exp(-phase / decay)[:, None]
        wave = 2 * np.pi * phase[:, None]
        x = stagger + fade * (along_pull * np.cos(wave) + second * np.cos(overtone * wave))
        y = across + fade * across_pull * np.cos(sideways * wave)
        angle = turn + fade * twist * np.cos(twisting * wave)
        return np.stack([middle[0] + cos * x - sin * y, middle[1] + sin * x + cos * y, angle], axis=2)

    poses = _released(shape, bodies, camera.fps, speed, 2.0)
    return Scene(bodies, fixed, (), poses, colors[0], False, radius, seconds(rng, camera))


def _arm(rng: np.random.Generator, camera: Camera, colors: Colors, speed: float) -> Scene:
    """A base that is fixed, and two or three links in a chain, pulled aside and released."""
    links, radius = int(rng.integers(2, 4)), float(rng.uniform(6, 13))
    bodies: list[Body] = []
    lengths: list[float] = []
    for link in range(links + 1):
        count, spacing = int(rng.integers(2, 5)), radius * float(rng.uniform(3.5, 7))
        markers = 3.3 * radius + spacing * np.arange(count)
        lengths.append(float(markers[-1] + 3.3 * radius))
        half = (0.5 * lengths[-1] + 1.8 * radius, 1.8 * radius)
        side = -1 if link == 0 else 1  # the base lies behind the first hinge
        box = Box((side * 0.5 * lengths[-1], 0.0), half, 1.75 * radius)
        bodies.append(Body((box,), np.column_stack([side * markers, np.zeros(count)]), colors[1]))
    lengths[0] = 0.0
    hinge = camera.center + rng.uniform(-0.3, 0.3, 2) * (camera.width, camera.height)
    rest = rng.uniform(-0.6, 0.6, links + 1)
    pull = rng.uniform(-1.0, 1.0, links + 1) * np.exp(rng.uniform(np.log(0.15), 0))
    rest[0], pull[0] = rng.uniform(-np.pi, np.pi), 0.0
    tempo, decay = np.append(1.0, rng.uniform(0.8, 2.0, links)), rng.uniform(1.5, 6)

    def shape(phase: Array) -> Array:
        wave = np.exp(-phase / decay)[:, None] * np.cos(2 * np.pi * tempo * phase[:, None])
        angles = np.cumsum(rest + pull * wave, axis=1)
        ways = np.array(lengths)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=2)
        origins = hinge + np.cumsum(ways, axis=1) - ways
        return np.concatenate([origins, angles[..., None]], axis=2)

    poses = _released(shape, tuple(bodies), camera.fps, speed, 2.0)
    start = poses(np.zeros(1))[0]
    hinges = tuple((k, k + 1, (float(start[k + 1, 0]), float(start[k + 1, 1]))) for k in range(links))
    return Scene(tuple(bodies), 0, hinges, poses, colors[0], False, radius, seconds(rng, camera))


def _sheet(rng: np.random.Generator, camera: Camera, colors: Colors, speed: float) -> Scene:
    """A plate that turns within a few frames, lies still, and slides. Mild: slowly, up to the speed."""
    radius, count = float(rng.uniform(6, 14)), int(rng.choice([3, 3, 3, 4, 5, 6]))
    half = rng.uniform(0.14, 0.26, 2) * min(camera.width, camera.height)
    markers = rng.uniform(-1, 1, (count, 2)) * (half - 2 * radius)
    apart = np.linalg.norm(markers[:, None] - markers[None], axis=2) + 1e9 * np.eye(count)
    if apart.min() < 4 * radius:
        raise DoesNotFitError
    angle = np.deg2rad(rng.uniform(15, 40)) * rng.choice([-1, 1])
    heading, way = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.35) * camera.width
    slide = way * np.array([np.cos(heading), np.sin(heading)])
    turning = float(rng.uniform(3, 7))  # frames
    if speed < MILD[1]:  # 1.5 times the mean speed is the highest
        turning = 1.5 * abs(angle) * np.linalg.norm(markers, axis=1).max() / speed
    sliding = 1.5 * way / speed
    still = float(rng.uniform(0.6, 0.9)) * camera.fps
    first, place = rng.uniform(-np.pi, np.pi), camera.center + rng.uniform(-0.2, 0.2, 2) * camera.width

    def poses(times: Array) -> Array:
        frames = (times - REST) * camera.fps - 1
        turned, slid = _smooth(frames / turning), _smooth((frames - turning - still) / sliding)
        return np.column_stack([place + slid[:, None] * slide, first + angle * turned])[:, None]

    plate = Body((Box((0.0, 0.0), (half[0], half[1]), float(radius)),), markers, colors[1])
    seconds = (np.ceil(REST * camera.fps) + turning + still + min(sliding, 60.0) + 20) / camera.fps
    return Scene((plate,), None, (), poses, colors[0], bool(rng.random() < 0.8), radius, float(seconds))


def _smooth(share: Array) -> Array:
    """From 0 to 1, at rest before 0 and after 1."""
    inside = np.clip(share, 0, 1)
    return inside * inside * (3 - 2 * inside)


def _pendulum(rng: np.random.Generator, camera: Camera, colors: Colors, speed: float) -> Scene:
    """A double pendulum with a marker on each bob, and perhaps one on the pivot."""
    radius = float(rng.uniform(6, 13))
    lengths = rng.uniform(0.12, 0.2, 2) * min(camera.width, camera.height)
    if lengths.min() < 6 * radius:
        raise DoesNotFitError
    bodies: list[Body] = []
    for length in lengths:
        rod = Box(((length + 1.9 * radius) / 2, 0.0), ((length - 1.9 * radius) / 2, 0.6 * radius), 0.0)
        bodies.append(Body((rod, disc(length, 1.8 * radius)), np.array([[length, 0.0]]), colors[1]))
    marked = rng.random() < 0.5
    pivot = Body((disc(0.0, 1.8 * radius),), np.zeros((1, 2)), colors[1])
    start = rng.uniform(-1.8, 1.8, 2) * np.exp(rng.uniform(np.log(0.1), 0))
    swing = CubicSpline(*_double_pendulum(start, lengths / lengths.mean()))
    place = camera.center + rng.uniform(-0.1, 0.1, 2) * camera.width

    def shape(phase: Array) -> Array:
        angles = np.pi / 2 - swing(phase)  # from straight down to the x axis of a rod
        bob = place + lengths[0] * np.stack([np.cos(angles[:, 0]), np.sin(angles[:, 0])], axis=1)
        first = np.column_stack([np.broadcast_to(place, bob.shape), angles[:, 0]])
        second = np.column_stack([bob, angles[:, 1]])
        still = np.broadcast_to([*place, 0.0], first.shape)
        return np.stack([still, first, second] if marked else [first, second], axis=1)

    every = (pivot, *bodies) if marked else tuple(bodies)
    poses = _released(shape, every, camera.fps, speed, 5.0)
    elbow = poses(np.zeros(1))[0, -1]
    hinges = [(len(every) - 2, len(every) - 1, (float(elbow[0]), float(elbow[1])))]
    if marked:
        hinges.insert(0, (0, 1, (float(place[0]), float(place[1]))))
    fixed = 0 if marked else None
    return Scene(every, fixed, tuple(hinges), poses, colors[0], False, radius, seconds(rng, camera))


def _double_pendulum(start: Array, lengths: Array) -> tuple[Array, Array]:
    """Equal bobs on massless rods. Times, in periods of a small swing of length 1; and angles from straight down."""
    step, count = 1 / 200, 2400
    states = np.empty((count, 4))
    _integrate(states, float(lengths[0]), float(lengths[1]), step, (float(start[0]), float(start[1]), 0.0, 0.0))
    return step * np.arange(count), states[:, :2]


@njit(cache=True)
def _integrate(states, p, q, step, state):
    for k in range(len(states)):
        states[k] = state
        total = np.zeros(4)
        slope = np.zeros(4)
        for reach, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):  # Runge-Kutta of order 4
            a, b, u, v = states[k] + reach * step * slope
            c, s, gravity = np.cos(a - b), np.sin(a - b), 4 * np.pi**2
            f, g = -q * v * v * s - 2 * gravity * np.sin(a), p * u * u * s - gravity * np.sin(b)
            slope = np.array([u, v, (f - c * g) / (p * (2 - c * c)), (2 * g - c * f) / (q * (2 - c * c))])
            total += weight * slope
        after = states[k] + step / 6 * total
        state = (after[0], after[1], after[2], after[3])


def _puck(rng: np.random.Generator, camera: Camera, colors: Colors, speed: float) -> Scene:
    """A disc with one marker slides on a table, is slowed down by friction, and bounces off its edges."""
    radius = float(rng.uniform(6, 16))
    low = np.array([0.06, 0.06]) * (camera.width, camera.height) + 3 * radius
    high = np.array([camera.width, camera.height]) - 1 - low
    place, heading, friction = rng.uniform(low, high), rng.uniform(0, 2 * np.pi), rng.uniform(25, 120)
    spin = rng.uniform(-0.1, 0.1)

    def sharp(frames: Array) -> Array:
        frames = np.maximum(frames, 0)
        way = speed * friction * (1 - np.exp(-frames / friction)) * _smooth(frames / 6)
        straight = place + way[:, None] * np.array([np.cos(heading), np.sin(heading)]) - low
        folded = np.abs((straight + (high - low)) % (2 * (high - low)) - (high - low)) + low
        return np.column_stack([folded, spin * way / radius])[:, None]

    def poses(times: Array) -> Array:  # it touches an edge for three frames
        frames = (times - REST) * camera.fps - 2
        return np.mean([sharp(frames + away) for away in np.linspace(-1.5, 1.5, 13)], axis=0)

    puck = Body((disc(0.0, 2.2 * radius),), np.zeros((1, 2)), colors[1])
    return Scene((puck,), None, (), poses, colors[0], False, radius, seconds(rng, camera))


def disc(x: float, radius: float) -> Box:
    return Box((x, 0.0), (radius, radius), radius)


def _cover(rng: np.random.Generator, camera: Camera, scene: Scene, colors: Colors) -> Occluder | Glare:
    """Something over one of the markers, for a part of the film."""
    start = float(rng.uniform(REST + 2 / camera.fps, 0.8 * scene.seconds))
    end = start + float(rng.uniform(4, 15)) / camera.fps
    markers = scene.plane(np.array([(start + end) / 2]))[0]
    place = markers[int(rng.integers(len(markers)))]
    x, y = float(place[0]), float(place[1])
    if rng.random() < 0.5:
        half = scene.radius * rng.uniform(2, 9, 2)
        return Glare(start, end, (x, y), (float(half[0]), float(half[1])), float(rng.uniform(0.5, 3)))
    speed = rng.normal(0, 0.1, 2) * camera.width
    half = (scene.radius * float(rng.uniform(1.5, 4)), 0.3 * camera.height)
    way = speed * (end - start) / 2
    box = Box((x - float(way[0]), y - float(way[1])), half, scene.radius, float(rng.uniform(0, np.pi)))
    skin = (190.0, 145.0, 120.0)
    return Occluder(start, end, box, skin if rng.random() < 0.5 else colors[1], (float(speed[0]), float(speed[1])))


def seconds(rng: np.random.Generator, camera: Camera) -> float:
    return float((np.ceil(REST * camera.fps) + int(rng.integers(60, 100))) / camera.fps)


MAKERS: dict[str, Callable[[np.random.Generator, Camera, Colors, float], Scene]] = {
    "lattice": _lattice, "arm": _arm, "sheet": _sheet, "pendulum": _pendulum, "puck": _puck,
}  # fmt: skip
