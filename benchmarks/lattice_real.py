"""Films for `lattice_films.py` with what real films taught: each trait alone in the same film, then several at once.

The first film of a seed is plain, and the next ones differ from it by one trait, so that a failure tells its cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from lattice_scenes import (
    MAKERS,
    MILD,
    REST,
    SCENES,
    Colors,
    DoesNotFitError,
    check,
    disc,
    random_camera,
    seconds,
    stored,
)
from lattice_truth import Array, Body, Box, Camera, Film, Look, Scene, planned

# a film has one at most of the traits in a row
TRAITS = (
    ("oval",), ("sizes",), ("shade",), ("tone",), ("halo",), ("hub", "ring", "glossy"), ("cards", "ground"),
    ("interlaced",), ("shake",), ("exposure",), ("tiny", "huge", "zoom"), ("soft", "free"),
)  # fmt: skip
ALONE = ("plain", *(trait for row in TRAITS for trait in row))
KINDS = ("real alone", "real mixed")
SOME = (3, 6)  # traits of a mixed film, from the first number to below the second
SIZES = ((640, 480), (1280, 720), (1280, 1024))
RADII = {"tiny": (2.5, 4.5), "huge": (22.0, 40.0)}  # px
RADIUS, USUAL = (5.0, 16.0), 10.0  # px: of others, and what `MAKERS` have
SPEEDS = (3.0, 25.0)  # px a frame, of mixed films
SWAY = 15.0  # px that a camera moves
PERIOD = 15  # frames at least, of markers that move on their own
STRETCH = 0.25  # share by which dots of a soft sheet come apart


def real_film(seed: int, index: int, folder: Path) -> Film:
    """A film that nobody chose; the same for the same numbers. Drawing it is left to `lattice_looks.filmed`."""
    alone = index < len(ALONE)
    rng, own = np.random.default_rng([seed, 0 if alone else index, 2]), np.random.default_rng([seed, index, 3])
    rows = np.sort(own.choice(len(TRAITS), int(own.integers(*SOME)), replace=False))
    traits = (ALONE[index],) if alone else tuple(str(own.choice(TRAITS[row])) for row in rows)
    kind = "lattice" if alone else SCENES[int(rng.integers(len(SCENES)))].split()[-1]
    kind = next((trait for trait in traits if trait in _MAKERS), kind)
    speed = float(rng.uniform(*(MILD if alone else SPEEDS)))
    while True:
        camera, colors = random_camera(rng)
        try:
            camera, scene = _enlarged(rng, kind, speed, traits, camera, colors)
            check(planned("", scene, camera, folder))
        except DoesNotFitError:
            continue
        camera, scene = _dressed(own, traits, camera, scene, colors)
        return stored(planned(f"{KINDS[not alone]} {'+'.join(traits)} {seed}/{index}", scene, camera, folder))


def _enlarged(
    rng: np.random.Generator, kind: str, speed: float, traits: tuple[str, ...], camera: Camera, colors: Colors
) -> tuple[Camera, Scene]:
    """A scene for a picture where markers are of the usual size, enlarged until they are of the wanted one."""
    low, high = next((RADII[trait] for trait in traits if trait in RADII), RADIUS)
    by = float(np.exp(rng.uniform(np.log(low), np.log(high)))) / USUAL
    width, height = SIZES[int(rng.integers(len(SIZES)))]
    speed = min(speed, 2 * low) if "interlaced" in traits else speed  # a dot's two fields overlap
    camera = replace(camera, width=round(width / by), height=round(height / by))
    scene = _MAKERS[kind](rng, camera, colors, speed / by)
    radius = by * scene.radius
    if not low <= radius <= high:
        raise DoesNotFitError
    hinges = tuple((a, b, (by * x, by * y)) for a, b, (x, y) in scene.hinges)
    bodies = tuple(body.scaled(by) for body in scene.bodies)
    camera = replace(camera, width=width, height=height, softness=min(camera.softness, max(1.0, 0.4 * radius)))
    return camera, replace(
        scene, bodies=bodies, hinges=hinges, radius=radius, poses=lambda times: scene.poses(times) * (by, by, 1.0)
    )


def _dressed(
    rng: np.random.Generator, traits: tuple[str, ...], camera: Camera, scene: Scene, colors: Colors
) -> tuple[Camera, Scene]:
    """What films, and what is filmed, with these traits."""
    look, growth = Look(_dots(rng, len(scene.owners), traits), clear=scene.soft), scene.growth
    camera = replace(camera, background=colors[1] if scene.soft else camera.background)
    marker, paper, duration = np.array(colors[0]), np.array(colors[1]), scene.seconds
    for trait in traits:
        if trait == "shade":
            look = replace(look, shadows=_shadows(rng, camera))
        elif trait == "tone":
            way, amount = int(rng.integers(3)), float(rng.uniform(0.4, 1.0))
            camera = replace(camera, gamma=float(rng.choice([rng.uniform(1.0, 1.7), rng.uniform(2.5, 2.8)])))
            look = replace(look, s_curve=amount * (way == 1), clipping=1 + 0.8 * amount * (way == 2))
        elif trait == "halo":
            look = replace(look, sharpening=float(rng.uniform(0.5, 2.0)))
        elif trait in ("hub", "ring"):  # a middle that is bright or dark, or as what is around the dot
            middle = paper if trait == "ring" else 0.5 * marker + 0.5 * paper if rng.random() < 0.5 else 255 - marker
            look = replace(look, hub=float(rng.uniform(0.2, 0.5)), hub_color=tuple(middle.tolist()))
        elif trait == "glossy":
            look = replace(look, lamp=float(rng.uniform(0, 2 * np.pi)))
        elif trait == "cards":
            camera = replace(camera, background=(200, 196, 188))
            look = replace(look, ground=str(rng.choice(["checkerboard", "print", "wood"])), clear=False)
            scene = replace(scene, bodies=tuple(_carded(rng, body, scene.radius) for body in scene.bodies))
        elif trait == "ground":
            camera = replace(camera, background=colors[1])
            look = replace(look, ground=str(rng.choice(["wood", "fabric", "print"])), clear=True)
        elif trait == "interlaced":
            camera, look = replace(camera, shutter=camera.shutter / 2), replace(look, interlaced=True)
        elif trait == "shake":  # slow drift, trembling, jerks
            ways = SWAY * np.array([[0.6], [0.1], [0.3]]) * rng.choice([-1, 1], (3, 2)) * rng.uniform(0.3, 0.7, (3, 2))
            frequencies, powers = np.array([rng.uniform(0.4, 1.0), 6.0, 2.0]) / duration, [1, 1, 15]
            look = replace(look, waves=np.column_stack([ways, frequencies, rng.uniform(0, 2 * np.pi, 3), powers]))
        elif trait == "exposure":
            frequency, phase = rng.uniform(0.7, 2.0) / duration, rng.uniform(0, 2 * np.pi)
            look = replace(look, exposure=(float(rng.uniform(0.2, 0.3)), float(frequency), float(phase)))
        elif trait == "zoom":  # from its size to as little as a half of it, or back
            scene, growth = (
                replace(scene, fixed=None),
                _zooming(rng.uniform(1.4, 2.0), rng.choice([0, np.pi]), duration),
            )
    poses, center = scene.poses, camera.center

    def carried(times: Array) -> Array:
        places, angles = np.split(poses(times), [2], axis=2)
        places = center + growth(times)[:, None, None] * (places - center) + look.shift(times)[:, None]
        return np.concatenate([places, angles], axis=2)

    return camera, replace(scene, poses=carried, growth=growth, look=look)


def _dots(rng: np.random.Generator, count: int, traits: tuple[str, ...]) -> Array:
    """Half axes as shares of the radius, and the angle of the first one [rad]. Shape (M, 3)."""
    size = rng.uniform(0.75, 1.25, count) if "sizes" in traits else np.ones(count)
    oval = np.where(rng.random(count) < 0.1, rng.uniform(1.3, 2.5, count), rng.uniform(1.05, 1.2, count))
    longer = np.sqrt(oval) if "oval" in traits else np.ones(count)
    return np.column_stack([size * longer, size / longer, rng.uniform(0, np.pi, count)])


def _shadows(rng: np.random.Generator, camera: Camera) -> Array:
    """Less and less light to one side, mostly to the base, and some edges. As in `Look`, shape (K, 5)."""
    count = int(rng.integers(2, 5))
    places = rng.uniform(0.25, 0.75, (count, 2)) * (camera.width, camera.height)
    angles, depths, widths = (rng.uniform(low, high, count) for low, high in ((0, 6.28), (0.2, 0.4), (2, 40)))
    places[0], angles[0], widths[0] = camera.center, np.pi / 2 + rng.normal(0, 0.3), camera.height
    return np.column_stack([places, angles, depths, widths])


def _carded(rng: np.random.Generator, body: Body, radius: float) -> Body:
    """The same, but all that can be seen of it are cards around its markers, cut by hand."""
    halves = radius * rng.uniform(1.6, 2.4, (len(body.markers), 2))
    places = body.markers + (halves - 1.6 * radius) * rng.uniform(-1, 1, halves.shape)
    turns = rng.normal(0, 0.1, len(halves))
    boxes = (Box(tuple(p), tuple(h), 1.0, t) for p, h, t in zip(places.tolist(), halves.tolist(), turns, strict=True))
    return replace(body, boxes=tuple(boxes))


def _zooming(ratio: float, phase: float, duration: float) -> Callable[[Array], Array]:
    return lambda times: ratio ** (0.5 * np.cos(np.pi * times / duration + phase) - 0.5)


def _many(rng: np.random.Generator, camera: Camera, colors: Colors, speed: float, soft: bool) -> Scene:
    """Markers each of which moves on its own: on a soft sheet that is stretched, sheared and bulges, or freely."""
    radius, counts = float(rng.uniform(6, 14)), rng.integers(3, 6, 2) if soft else rng.integers(2, 4, 2)
    gap = 0.55 * np.array([camera.width, camera.height]) / counts
    if gap.min() < 4 * radius:
        raise DoesNotFitError
    grid = np.argwhere(np.ones(counts)) - (counts - 1) / 2
    home = (grid + rng.uniform(-0.1, 0.1, grid.shape)) * gap
    if soft:
        strain = STRETCH * rng.uniform(-1, 1, (2, 2)) * [[1.0, 0.4], [0.0, 0.7]]
        ways, rates = 0.8 * home @ strain + 0.2 * STRETCH * gap * np.sin(grid[:, ::-1]), np.ones(grid.shape)
    else:
        ways, rates = rng.uniform(-0.9, 0.9, grid.shape) * gap, rng.uniform(0.6, 1.6, grid.shape)
    phases = rng.uniform(0, 2 * np.pi, grid.shape) * (not soft)
    pace = camera.fps * min(speed / np.linalg.norm(ways * rates, axis=1).max(), 2 * np.pi / PERIOD)  # rad/s

    def poses(times: Array) -> Array:
        turns = pace * rates * np.maximum(times - REST, 0.0)[:, None, None] + phases
        places = camera.center + home + ways * (np.sin(turns) - np.sin(phases))
        return np.concatenate([places, np.zeros((*places.shape[:2], 1))], axis=2)

    dots = tuple(Body((disc(0.0, 1.8 * radius),), np.zeros((1, 2)), colors[1]) for _ in home)
    return Scene(dots, None, (), poses, colors[0], False, radius, seconds(rng, camera), soft=soft)


_MAKERS: dict[str, Callable[[np.random.Generator, Camera, Colors, float], Scene]] = {
    **MAKERS, "soft": lambda *given: _many(*given, soft=True), "free": lambda *given: _many(*given, soft=False),
}  # fmt: skip
