"""Draws films of rigid bodies with equal markers, as a laboratory camera sees them, and writes them.

It is no relative of `swim2real.rendering`: light is added up linearly over the shutter, the lens bends straight lines,
the sensor counts photons, and only then come gamma and the codec.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace
from lattice_truth import Array, Box, Camera, Film, Glare, glow, moved
from numba import njit
from numpy.typing import NDArray

MOST_MOMENTS = 48  # of an exposure
NOISE_BANK = 1 << 22
QP_TO_LAMBDA = 118  # FFmpeg's FF_QP2LAMBDA


def write(film: Film, frames: Iterable[NDArray[np.uint8]] | None = None) -> None:
    """Draws the film, unless its frames are given, and writes its file."""
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
        for index, image in enumerate(drawn(film) if frames is None else frames):
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
    light = lamp_light(camera, rng)
    empty = light[..., None] * background(camera, rng)
    levels = np.round(255 * np.linspace(0, 1, 1 << 14) ** (1 / camera.gamma)).astype(np.uint8)
    shot, read = np.float32(1 / camera.electrons), np.float32((camera.read_noise / camera.electrons) ** 2)
    lens = np.array([*camera.center, camera.corner, camera.bend])
    shades = [camera.linear(body.color) for body in scene.bodies]
    contrast = [camera.linear(scene.marker_color) - shade for shade in shades]
    picture, out = np.empty_like(empty), np.empty(empty.shape, np.uint8)
    for index, time in enumerate(film.times):
        np.copyto(picture, empty)
        moments = moments_of(film, index)
        poses = scene.poses(moments)
        for b, body in enumerate(scene.bodies):
            pose = poses[:, b] if np.ptp(poses[:, b], axis=0).max() > 0 else poses[:1, b]
            for box in body.boxes:
                draw(picture, light, camera, lens, pose[:: 1 + (len(pose) > 24)], box, shades[b], over=True)
            for x, y in body.markers:
                size, rounding = (scene.radius, scene.radius), 0.0 if scene.squares else scene.radius
                draw(picture, light, camera, lens, pose, Box((x, y), size, rounding), contrast[b], over=False)
        for cover in scene.covers:
            if cover.start <= time <= cover.end:
                if isinstance(cover, Glare):
                    _add_glare(picture, cover)
                else:
                    pose = np.array([[*np.multiply(cover.velocity, time - cover.start), 0.0]])
                    draw(picture, light, camera, lens, pose, cover.box, camera.linear(cover.color), over=True)
        expose(picture, bank, int(rng.integers(NOISE_BANK)), shot, read, levels, camera.gray, out)
        yield out


def moments_of(film: Film, index: int) -> Array:
    """Moments of an exposure, evenly spread [s]. Shape (S,)."""
    camera = film.camera
    way = float(film.speed[index].max()) * camera.shutter
    count = int(np.clip(np.ceil(way / camera.softness), 1, MOST_MOMENTS))  # no gap between two edges
    return film.times[index] + ((np.arange(count) + 0.5) / count - 0.5) * camera.shutter / camera.fps


def _add_glare(picture: NDArray[np.float32], glare: Glare) -> None:
    (x, y), (a, b) = glare.center, glare.half
    left, right = (int(np.clip(v, 0, picture.shape[1])) for v in (x - 2 * a, x + 2 * a))
    top, bottom = (int(np.clip(v, 0, picture.shape[0])) for v in (y - 2 * b, y + 2 * b))
    rows, columns = np.mgrid[top:bottom, left:right].astype(np.float32)
    picture[top:bottom, left:right] += glow(columns, rows, glare)[..., None]


def lamp_light(camera: Camera, rng: np.random.Generator) -> NDArray[np.float32]:
    """Light on the scene: brightest somewhere, less in the picture's corners. Shape (H, W)."""
    x = np.linspace(-1, 1, camera.width, dtype=np.float32)
    y = np.linspace(-1, 1, camera.height, dtype=np.float32)[:, None]
    lamp = rng.uniform(-0.7, 0.7, 2)
    fall = (x - lamp[0]) ** 2 + (y - lamp[1]) ** 2
    return (rng.uniform(0.75, 0.95) * (1 - camera.uneven * fall / fall.max())).astype(np.float32)


def background(camera: Camera, rng: np.random.Generator) -> NDArray[np.float32]:
    """Color of what lies below: stains, grain, and some straight edges. Shape (H, W, 3)."""
    height, width = camera.height, camera.width
    bumps = np.zeros((height, width), np.float32)
    for size, weight in ((300, 0.5), (60, 0.3), (12, 0.15), (3, 0.1)):
        grid = rng.standard_normal((height // size + 2, width // size + 2)).astype(np.float32)
        bumps += weight * hat(height, grid.shape[0], size) @ grid @ hat(width, grid.shape[1], size).T
    y, x = np.mgrid[:height, :width].astype(np.float32)
    for _ in range(int(rng.integers(0, 5))):  # tapes, cables, gaps between boards
        angle, place = rng.uniform(0, np.pi), rng.uniform(0, 1, 2) * (width, height)
        away = np.abs((x - place[0]) * np.sin(angle) - (y - place[1]) * np.cos(angle)) - rng.uniform(2, 12)
        bumps += rng.uniform(-1.2, 1.2) * np.clip(0.5 - away / camera.softness, 0, 1)
    return np.clip(1 + camera.texture * bumps, 0.1, 2.5)[..., None] * camera.linear(camera.background).astype(
        np.float32
    )


def hat(count: int, knots: int, size: int) -> NDArray[np.float32]:
    """Weights of linear interpolation. Shape (count, knots)."""
    return np.maximum(0, 1 - np.abs(np.arange(count)[:, None] / size - np.arange(knots))).astype(np.float32)


def draw(
    picture: NDArray[np.float32], light: NDArray[np.float32], camera: Camera, lens: Array, poses: Array, box: Box,
    color: Array, over: bool,
) -> None:  # fmt: skip
    """Draws a box of a body at some poses of an exposure, over what is there or added to it."""
    (x, y), (a, b) = box.center, box.half
    cos, sin = np.cos(box.angle), np.sin(box.angle)
    edge = np.array([[s * a, t * b] for s in (-1, -0.5, 0, 0.5, 1) for t in (-1, 1)])
    around = moved(edge @ np.array([[cos, sin], [-sin, cos]]) + (x, y), poses)
    around = camera.picture(around).reshape(-1, 2)
    margin = camera.softness + 3
    left, top = (int(v) for v in np.clip(np.floor(around.min(axis=0) - margin), 0, (camera.width, camera.height)))
    right, bottom = (int(v) for v in np.clip(np.ceil(around.max(axis=0) + margin), 0, (camera.width, camera.height)))
    center = moved(np.array([[x, y]]), poses)[:, 0]
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
def expose(picture, bank, offset, shot, read, levels, gray, out):
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
