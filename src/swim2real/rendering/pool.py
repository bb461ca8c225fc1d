"""The synthetic pool camera: films of simulated swims, with the truth about every marker in every frame."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from swim2real.errors import ArgumentError
from swim2real.rendering.pool_camera import Color, Glare, Occluder, Pair, PoolCamera
from swim2real.rendering.pool_picture import Bytes, Rect, hull, make_water, patch_cover
from swim2real.rendering.pool_scene import Filmed, Links, Rod, Scene, place_glare
from swim2real.trials import MarkerTrack
from swim2real.video import VideoWriter

__all__ = ["BODY_HALF_WIDTH", "Color", "Filmed", "Glare", "Occluder", "PoolCamera", "Scene", "film", "frames", "scene"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

BODY_HALF_WIDTH = 0.045  # m
BLUR_STEP = 0.75  # px between two instants of one exposure, at most
MAX_INSTANTS = 32
SPOTS = 40  # points of a marker's disc that are asked whether they are covered


def scene(
    track: MarkerTrack,
    heights: object,
    camera: PoolCamera,
    seed: int,
    *,
    body_half_width: float = BODY_HALF_WIDTH,
    links: Links | None = None,
    occluder: Occluder | None = None,
) -> Scene:
    """A swim before the camera: the truth about its film, and its frames in any order.

    Args:
        track: A swim in the world, y up, without gaps [m]. 100 samples a second or more show the motion well.
        heights: Heights of the markers above the plane in which `camera.view` is measured [m]. Shape (M,).
        camera: What films it.
        seed: Seed of everything random. The same seed gives the same film.
        body_half_width: Greatest half width of the body [m]; 0 films the markers alone.
        links: Pairs of markers that a straight bar of this half width joins; None draws a fish.
        occluder: Hides what swims below it.

    Returns:
        `filmed` is the truth, `frame(k)` a picture; iteration gives times [s] and pictures.

    Raises:
        ArgumentError: The swim doesn't fit into the image, has gaps, or lasts less than two frames.
    """
    levels = _check(track, heights, camera, body_half_width, links or ())
    course = CubicSpline(track.times - track.times[0], track.positions, axis=0)
    center = camera.center or _fitted(track, levels, camera, max(body_half_width, camera.marker_radius))
    times = _frame_times(track, camera, np.random.default_rng([seed, 0]))
    pixels, scales = camera.project(course(times), levels, center)
    fastest = float((np.linalg.norm(course(times, 1), axis=-1) * scales).max()) * camera.exposure
    count = int(np.clip(np.ceil(fastest / BLUR_STEP), 1, MAX_INSTANTS))
    instants = ((np.arange(count) + 0.5) / count - 0.5) * camera.exposure
    glares = (*camera.glares, *_glints(camera, center, float(times[-1]), np.random.default_rng([seed, 1])))
    rod, cover = _rod(occluder, camera, center) if occluder else (None, None)

    # a marker's disc as points that each stand for the same area
    turns, rings = np.arange(SPOTS) * np.pi * (3 - np.sqrt(5)), np.sqrt((np.arange(SPOTS) + 0.5) / SPOTS)
    spots = np.stack([rings * np.cos(turns), rings * np.sin(turns)], axis=-1)
    outside = ~_inside(pixels, camera)
    hidden = outside.copy()
    for index, time in enumerate(times):
        points = pixels[index][:, None] + camera.marker_radius * scales[index][:, None, None] * spots
        clear = _inside(points, camera).astype(float)
        for glare in glares:
            p = place_glare(glare, float(time), camera, center, pixels[index])
            if p is not None:
                clear *= 1 - patch_cover(points[..., 0], points[..., 1], p)
        if cover is not None:
            columns = np.clip(np.round(points[..., 0]).astype(int), 0, camera.width - 1)
            rows = np.clip(np.round(points[..., 1]).astype(int), 0, camera.height - 1)
            clear *= 1 - cover[rows, columns]
        hidden[index] |= clear.mean(axis=1) < 0.5
    truth = MarkerTrack(times, np.where(outside[..., None], np.nan, pixels))
    filmed = Filmed(truth, hidden, camera.meters_per_pixel, center)
    return Scene(
        camera, filmed, course, levels, make_water(camera, seed), glares, rod, body_half_width, links, instants
    )


def frames(
    track: MarkerTrack,
    heights: object,
    camera: PoolCamera,
    seed: int,
    *,
    body_half_width: float = BODY_HALF_WIDTH,
    links: Links | None = None,
    occluder: Occluder | None = None,
) -> Iterator[tuple[float, Bytes]]:
    """What `film` writes: times from the first frame [s] and RGB pictures, shape (height, width, 3)."""
    return iter(scene(track, heights, camera, seed, body_half_width=body_half_width, links=links, occluder=occluder))


def film(
    track: MarkerTrack,
    heights: object,
    camera: PoolCamera,
    path: str | Path,
    seed: int,
    *,
    body_half_width: float = BODY_HALF_WIDTH,
    links: Links | None = None,
    occluder: Occluder | None = None,
    codec: str = "h264",
    crf: int = 20,
    rotation: int = 0,
) -> Filmed:
    """Films a swim into a video file.

    Args:
        track: See `scene`.
        heights: See `scene`.
        camera: See `scene`.
        path: Path of the video.
        seed: See `scene`.
        body_half_width: See `scene`.
        links: See `scene`.
        occluder: See `scene`.
        codec: Codec of the video.
        crf: Quality of the video; larger is smaller and worse.
        rotation: The camera is held turned: the file holds turned pictures, and says that players turn them clockwise
            by 0, 90, 180 or 270 degrees, which makes them upright again.

    Returns:
        The truth about the film.
    """
    swim = scene(track, heights, camera, seed, body_half_width=body_half_width, links=links, occluder=occluder)
    size = (camera.height, camera.width) if rotation in (90, 270) else (camera.width, camera.height)
    uneven = bool(camera.jitter or camera.dropped)
    with VideoWriter(path, *size, camera.fps, codec=codec, crf=crf, rotation=rotation) as video:
        for time, picture in swim:
            video.write(np.rot90(picture, rotation // 90), time if uneven else None)
    return swim.filmed


def _check(track: MarkerTrack, heights: object, camera: PoolCamera, body_half_width: float, links: Links) -> Array:
    levels = np.array(heights, dtype=float)
    count = track.marker_count
    if levels.shape != (count,) or not np.all(np.isfinite(levels)):
        raise ArgumentError(f"heights have shape {levels.shape}; give {count} finite numbers in m, one a marker")
    if levels.max() >= camera.camera_height:
        raise ArgumentError(
            f"a marker is {levels.max():g} m high and the camera {camera.camera_height:g} m; raise camera_height"
        )
    if not np.all(np.isfinite(track.positions)):
        raise ArgumentError("the swim has positions that are not finite; only a swim without gaps can be filmed")
    if not (np.isfinite(body_half_width) and body_half_width >= 0):
        raise ArgumentError(f"body_half_width is {body_half_width} m; it must be 0, for no body, or more")
    for pair in links:
        if any(not 0 <= marker < count for marker in pair):
            raise ArgumentError(f"a link joins markers {pair}; there are markers 0 to {count - 1}")
    for glare in camera.glares:
        if any(not 0 <= marker < count for marker in glare.over):
            raise ArgumentError(f"a glare lies over markers {glare.over}; there are markers 0 to {count - 1}")
    return levels


def _fitted(track: MarkerTrack, heights: Array, camera: PoolCamera, margin: float) -> Pair:
    """The middle of the swim, if all of it is then seen."""
    middle = (track.positions.min(axis=(0, 1)) + track.positions.max(axis=(0, 1))) / 2
    center = (float(middle[0]), float(middle[1]))
    pixels, scales = camera.project(track.positions, heights, center)
    halves = np.array([camera.width, camera.height]) / 2
    share = float(((np.abs(pixels - camera.middle) + margin * scales[..., None]) / halves).max())
    if share > 1:
        needed = np.ceil(100 * share * camera.view) / 100
        raise ArgumentError(
            f"the swim needs a view of {needed:.2f} m and the camera has {camera.view:g} m; set view to that, cut the "
            "swim, or give center for a fish that leaves the image"
        )
    return center


def _frame_times(track: MarkerTrack, camera: PoolCamera, rng: np.random.Generator) -> Array:
    """Times of the frames from the first one [s]. Shape (T,)."""
    times = np.arange(int(np.floor(track.duration * camera.fps + 1e-6)) + 1) * camera.interval
    times[1:] += rng.uniform(-0.5, 0.5, times.size - 1) * camera.jitter * camera.interval
    kept = rng.uniform(size=times.size) >= camera.dropped
    kept[:1] = True
    times = np.minimum(times[kept], track.duration)
    if times.size < 2:
        raise ArgumentError(
            f"the swim lasts {track.duration:g} s, which leaves {times.size} frame at {camera.fps:g} frames a second; "
            "at least 2 are needed"
        )
    return times


def _glints(camera: PoolCamera, center: Pair, duration: float, rng: np.random.Generator) -> Iterator[Glare]:
    half = np.array([camera.view, camera.view * camera.height / camera.width]) / 2
    for _ in range(round(camera.glints * (duration + 0.2) / 0.2)):
        start, place = rng.uniform(-0.2, duration), np.asarray(center) + rng.uniform(-1, 1, 2) * half
        life, radius, stretch = rng.uniform(0.1, 0.3), rng.uniform(0.002, 0.005), rng.uniform(2.5, 5.0)
        drift = (rng.normal(0, 0.1), rng.normal(0, 0.03))
        strength = rng.uniform(0.5, 1.0)
        yield Glare(start, start + life, (), (place[0], place[1]), drift, radius, stretch, strength)


def _rod(occluder: Occluder, camera: PoolCamera, center: Pair) -> tuple[Rod, NDArray[np.float32]]:
    if occluder.height >= camera.camera_height:
        raise ArgumentError(
            f"the occluder is {occluder.height:g} m high and the camera {camera.camera_height:g} m; lower the occluder"
        )
    ends, scales = camera.project(np.array(occluder.ends), occluder.height, center)
    whole = Rect(0, 0, camera.width, camera.height)
    cover, ridge = hull(ends, occluder.width / 2 * scales, np.zeros(2), whole)
    rows, columns = np.nonzero(cover)
    color = np.array(occluder.color) * (0.7 + 0.6 * np.maximum(ridge[rows, columns], 0))[:, None]
    return Rod(rows, columns, cover[rows, columns, None].astype(float), color), cover


def _inside(pixels: Array, camera: PoolCamera) -> Flags:
    edges = np.array([camera.width, camera.height]) - 0.5
    return np.asarray(((pixels >= -0.5) & (pixels < edges)).all(axis=-1), dtype=bool)
