"""Draws films as real cameras show real dots: what `lattice_truth.Look` says they have beyond `lattice_camera.py`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from lattice_camera import NOISE_BANK, background, draw, expose, hat, lamp_light, moments_of
from lattice_truth import Array, Camera, Film, Look
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

MARGIN = 20  # px around the picture that come into it when the camera moves
FIELDS = (-0.25, 0.25)  # frames from the middle of an interlaced frame to its fields: even rows, odd rows
LEVELS = 1 << 14
HIGHLIGHT = (0.42, 0.16)  # radii: from a ball's center to its highlight, and the highlight's width
SHADED = 0.65  # share of a ball's color that depends on how it faces the lamp

Picture = NDArray[np.float32]


def filmed(film: Film) -> Iterator[NDArray[np.uint8]]:
    """The frames, before any codec: RGB. Shape (H, W, 3) each. Of interlaced ones, truth is between both fields."""
    camera, scene, look = film.camera, film.scene, film.scene.look
    rng = np.random.default_rng([camera.seed, 1])
    bank = rng.standard_normal(NOISE_BANK, dtype=np.float32)
    wide = replace(camera, width=camera.width + 2 * MARGIN, height=camera.height + 2 * MARGIN)
    light = lamp_light(wide, rng) * _shade(look.shadows, wide)
    empty = light[..., None] * background(wide, rng) * ground(look.ground, wide, rng)[..., None]
    levels, lens = tone(look, camera.gamma), np.array([*camera.center, camera.corner, camera.bend])
    shot, read = np.float32(1 / camera.electrons), np.float32((camera.read_noise / camera.electrons) ** 2)
    marker, hub = camera.linear(scene.marker_color), camera.linear(look.hub_color)
    for index, time in enumerate(film.times):
        fields: list[NDArray[np.uint8]] = []
        for part in FIELDS if look.interlaced else (0.0,):
            now = np.array([time + part / camera.fps])
            moments = moments_of(film, index) + part / camera.fps
            shift, size = look.shift(now)[0], float(scene.growth(now)[0])
            picture, lit = _shifted(empty, shift), _shifted(light, shift)
            poses, dots = scene.poses(moments), iter(look.dots)
            for b, body in enumerate(scene.bodies):
                shown, shade = body.scaled(size), camera.linear(body.color) * (not look.clear)
                for box in () if look.clear else shown.boxes:
                    draw(picture, lit, camera, lens, poses[:, b], box, shade, over=True)
                colors = np.array([marker, hub, shade], np.float32)
                for place, dot in zip(shown.markers, dots, strict=False):
                    placed = place, size * scene.radius * dot[:2], float(dot[2])
                    _draw_dot(picture, lit, camera, lens, poses[:, b], placed, look, colors)
            picture *= np.float32(look.gain(float(now[0])))
            out = np.empty(picture.shape, np.uint8)
            expose(picture, bank, int(rng.integers(NOISE_BANK)), shot, read, levels, camera.gray, out)
            fields.append(_sharpened(out, look.sharpening))
        fields[0][1::2] = fields[-1][1::2]
        yield fields[0]


def tone(look: Look, gamma: float) -> NDArray[np.uint8]:
    """Levels of the film by light from 0 to 1: highlights clipped, gamma, S-curve. Shape (LEVELS,)."""
    level = np.clip(look.clipping * np.linspace(0, 1, LEVELS), 0, 1) ** (1 / gamma)
    curved = level * level * (3 - 2 * level)
    return np.round(255 * ((1 - look.s_curve) * level + look.s_curve * curved)).astype(np.uint8)


def _sharpened(image: NDArray[np.uint8], weight: float) -> NDArray[np.uint8]:
    """Unsharp mask, as cameras do: edges get halos."""
    if not weight:
        return image
    sharp = image.astype(np.float32)
    sharp += weight * (sharp - gaussian_filter(sharp, (1.2, 1.2, 0)))
    return np.clip(np.round(sharp), 0, 255).astype(np.uint8)


def _shifted(wide: Picture, shift: Array) -> Picture:
    """The picture without its margin, moved by (x, y) [px], interpolated linearly."""
    whole = np.floor(-shift).astype(int)
    x, y = (-shift - whole).astype(np.float32)
    height, width = wide.shape[0] - 2 * MARGIN, wide.shape[1] - 2 * MARGIN
    left, top = MARGIN + whole
    out = np.zeros((height, width, *wide.shape[2:]), np.float32)
    for down, across, weight in ((0, 0, (1 - x) * (1 - y)), (0, 1, x * (1 - y)), (1, 0, (1 - x) * y), (1, 1, x * y)):
        if weight > 0:
            out += weight * wide[top + down : top + down + height, left + across : left + across + width]
    return out


def _shade(shadows: Array, camera: Camera) -> Picture:
    """Share of the light that shadows leave. Shape (H, W)."""
    y, x = np.mgrid[: camera.height, : camera.width].astype(np.float32)
    left = np.ones(x.shape, np.float32)
    for *place, angle, depth, width in shadows:
        away = (x - place[0]) * np.cos(angle) + (y - place[1]) * np.sin(angle)
        left *= 1 - depth * np.clip(0.5 + away / width, 0, 1)
    return left


def ground(kind: str, camera: Camera, rng: np.random.Generator) -> Picture:
    """Brightness of a textured ground, 1 where it has none: wood, fabric, checkerboard, print. Shape (H, W)."""
    shape = camera.height, camera.width
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    if kind == "wood":  # rings, cut lengthwise
        coarse = rng.standard_normal((shape[0] // 60 + 2, shape[1] // 500 + 2)).astype(np.float32)
        rings = (
            y / rng.uniform(4, 12) + 4 * hat(shape[0], len(coarse), 60) @ coarse @ hat(shape[1], coarse.shape[1], 500).T
        )
        return 0.8 + 0.2 * np.abs(np.sin(rings)) * np.sin(rings / 7)
    if kind == "fabric":
        pitch = 2 * np.pi / rng.uniform(4, 10)
        return 0.8 + 0.2 * np.sin(pitch * x) * np.sin(pitch * y) + 0.1 * np.sign(np.sin(pitch * (x + y) / 2))
    if kind == "checkerboard":
        side, angle = rng.uniform(30, 90), rng.normal(0, 0.1)
        u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        return gaussian_filter(np.where((u // side + v // side) % 2 < 1, 0.05, 1.0).astype(np.float32), 0.8)
    page = np.ones(shape, np.float32)
    if kind == "print":  # columns of words, whose letters are as large as small dots
        size = int(rng.integers(3, 9))
        for top in range(0, shape[0] - size, 2 * size + 1):
            letters = rng.random(shape[1] // size + 1) < 0.75
            letters &= np.arange(len(letters)) % 40 > 3
            page[top : top + size] = np.where(np.repeat(letters, size)[: shape[1]], rng.uniform(0.1, 0.35), 1.0)
            page[top : top + size] = np.where(rng.random((size, shape[1])) < 0.35, 1.0, page[top : top + size])
        page = gaussian_filter(page, 0.8)
    return page


def _draw_dot(
    picture: Picture, light: Picture, camera: Camera, lens: Array, poses: Array, dot: tuple[Array, Array, float],
    look: Look, colors: Picture,
) -> None:  # fmt: skip
    """Draws a dot (place on the body, half axes, angle); `colors` are its own, its hub's, and what is below it."""
    (x, y), axes, turn = dot
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    center = poses[:, :2] + np.column_stack([cos * x - sin * y, sin * x + cos * y])
    around, margin = camera.picture(center), 1.2 * axes.max() + camera.softness + 3
    left, top = (int(v) for v in np.maximum(around.min(axis=0) - margin, 0))
    right, bottom = (int(v) for v in np.minimum(around.max(axis=0) + margin, (camera.width, camera.height)))
    course = np.column_stack([center, np.cos(poses[:, 2] + turn), np.sin(poses[:, 2] + turn)])
    lamp = (0.0, 0.0) if look.lamp is None else (float(np.cos(look.lamp)), float(np.sin(look.lamp)))
    shape = (float(axes[0]), float(axes[1]), look.hub, camera.softness)
    _cover_dot(picture, light, (left, top, right, bottom), lens, course, shape, lamp, colors, look.clear)


@njit(cache=True, nogil=True, fastmath=True)
def _cover_dot(picture, light, area, lens, course, shape, lamp, colors, over):
    a, b, hub, softness = shape
    glossy = lamp[0] != 0 or lamp[1] != 0
    for row in range(area[1], area[3]):
        for column in range(area[0], area[2]):
            dx, dy = (column - lens[0]) / lens[2], (row - lens[1]) / lens[2]
            scale = lens[2] * (1 + lens[3] * (dx * dx + dy * dy))
            x, y = lens[0] + scale * dx, lens[1] + scale * dy
            covered = middle = lit = shine = 0.0
            for m in range(len(course)):
                px, py = x - course[m, 0], y - course[m, 1]
                u, v = (course[m, 2] * px + course[m, 3] * py) / a, (course[m, 2] * py - course[m, 3] * px) / b
                out = np.sqrt(u * u + v * v)  # 1 on the edge
                slope = max(np.sqrt((u / a) ** 2 + (v / b) ** 2) / max(out, 1e-6), 1e-6)  # of that, per px
                share = min(max(0.5 - (out - 1) / slope / softness, 0.0), 1.0)
                share *= share * (3 - 2 * share) / len(course)
                covered += share
                if hub > 0:
                    inner = min(max(0.5 - (out - hub) / slope / softness, 0.0), 1.0)
                    middle += min(inner * inner * (3 - 2 * inner) / len(course), share)
                if glossy:  # a ball: its highlight is on the lamp's side, however it is turned
                    radius = np.sqrt(a * b)
                    nx, ny = px / radius, py / radius
                    facing = 0.6 * (nx * lamp[0] + ny * lamp[1]) + 0.8 * np.sqrt(max(1 - nx * nx - ny * ny, 0.0))
                    lit += share * (1 - SHADED + SHADED * max(facing, 0.0))
                    away = (nx - HIGHLIGHT[0] * lamp[0]) ** 2 + (ny - HIGHLIGHT[0] * lamp[1]) ** 2
                    shine += share * np.exp(-away / (2 * HIGHLIGHT[1] ** 2))
                else:
                    lit += share
            if covered > 0:
                for c in range(3):
                    if over:
                        picture[row, column, c] *= 1 - covered
                    added = lit * colors[0, c] - covered * colors[2, c] + middle * (colors[1, c] - colors[0, c])
                    picture[row, column, c] += light[row, column] * (added + shine)
