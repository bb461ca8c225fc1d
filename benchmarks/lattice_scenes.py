"""Scenes for `lattice_films.py`: robots of rigid bodies with equal markers, with numbers drawn at random."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from lattice_camera import Array, Body, Box, Camera, Color, Film, Scene, planned

SCENES = ("lattice", "lattice", "lattice", "lattice", "mild lattice")  # film k shows the (k mod 5)th
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


class _DoesNotFitError(Exception):
    """These numbers give no film; others are drawn."""


def random_film(seed: int, index: int, folder: Path) -> Film:
    """A film that nobody chose; the same for the same numbers. Drawing it is left to `lattice_camera.write`."""
    rng = np.random.default_rng([seed, index])
    kind = SCENES[index % len(SCENES)]
    speed = rng.uniform(*(MILD if kind.startswith("mild") else FAST))
    while True:
        camera, colors = _camera(rng)
        try:
            scene = _MAKERS[kind.split()[-1]](rng, camera, colors, speed)
            film = planned(f"{kind} {seed}/{index}", scene, camera, folder)
            _check(film)
        except _DoesNotFitError:
            continue
        suffix = ".mkv" if camera.codec == "mjpeg" else ".mp4"
        return replace(film, path=folder / f"{film.name.replace(' ', '-').replace('/', '-')}-{_settings(film)}{suffix}")


def _settings(film: Film) -> str:
    """Letters and digits that differ when films do."""
    scene = film.scene
    drawn = (film.camera, scene.bodies, scene.marker_color, scene.squares, scene.radius, scene.covers)
    return hashlib.sha256(repr(drawn).encode() + film.places.tobytes()).hexdigest()[:8]


def _camera(rng: np.random.Generator) -> tuple[Camera, Colors]:
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


def _check(film: Film) -> None:
    """Markers stay in the picture and apart, and hardly ever go below another body."""
    edge = np.array([film.camera.width, film.camera.height]) - 1 - film.radius - 2
    if (film.places < film.radius + 2).any() or (film.places > edge).any():
        raise _DoesNotFitError
    used = np.ptp(film.places.reshape(-1, 2), axis=0) / edge
    if used.max() < 0.4:  # nobody films from so far away
        raise _DoesNotFitError
    for places in film.places:
        apart = np.linalg.norm(places[:, None] - places[None], axis=2) + 1e9 * np.eye(len(places))
        if apart.min() < 2.6 * film.radius:
            raise _DoesNotFitError
    if (film.covered > 0).mean() > 0.02 or (film.covered[0] > 0).any():
        raise _DoesNotFitError


def _released(shape: Shape, markers: Callable[[Array], Array], fps: float, speed: float, phases: float) -> Shape:
    """Poses in time [s]: at rest as at phase 0, then on, so fast that the fastest marker goes `speed` px a frame.

    Args:
        shape: Poses by phase; a phase of 1 is about a period.
        markers: From poses to places of all markers [px]. Shapes (N, B, 3) to (N, M, 2).
        fps: Frames a second.
        speed: Wanted [px a frame].
        phases: How many are looked at.
    """
    fine = np.linspace(0, phases, int(400 * phases))
    fastest = np.linalg.norm(np.diff(markers(shape(fine)), axis=0), axis=2).max() / fine[1]
    period = fastest / speed  # frames
    if not SHORTEST_PERIOD <= period <= LONGEST_PERIOD:
        raise _DoesNotFitError
    rate = fps / period
    return lambda times: shape(rate * np.maximum(times - REST, 0.0))


def _markers_of(bodies: tuple[Body, ...]) -> Callable[[Array], Array]:
    def places(poses: Array) -> Array:
        return Scene(bodies, None, (), lambda _: poses, (0, 0, 0), False, 1.0, 0.0).plane(np.zeros(len(poses)))

    return places


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
        raise _DoesNotFitError
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

    poses = _released(shape, _markers_of(bodies), camera.fps, speed, 2.0)
    return _scene(rng, camera, bodies, fixed, (), poses, colors, False, radius)


def _scene(
    rng: np.random.Generator, camera: Camera, bodies: tuple[Body, ...], fixed: int | None,
    hinges: tuple[tuple[int, int, tuple[float, float]], ...], poses: Shape, colors: Colors, squares: bool,
    radius: float,
) -> Scene:  # fmt: skip
    seconds = (np.ceil(REST * camera.fps) + int(rng.integers(60, 100))) / camera.fps
    return Scene(bodies, fixed, hinges, poses, colors[0], squares, radius, float(seconds))


_MAKERS: dict[str, Callable[[np.random.Generator, Camera, Colors, float], Scene]] = {"lattice": _lattice}
