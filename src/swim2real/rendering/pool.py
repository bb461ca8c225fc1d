"""The synthetic pool camera: films of simulated swims, with the truth about every marker in every frame."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from swim2real.rendering.pool_camera import Color, Glare, Occluder, PoolCamera
from swim2real.rendering.pool_scene import Filmed, Links, Scene
from swim2real.rendering.pool_setup import set_scene
from swim2real.rendering.pool_water import Bytes
from swim2real.trials import MarkerTrack
from swim2real.video import VideoWriter

__all__ = ["BODY_HALF_WIDTH", "Color", "Filmed", "Glare", "Occluder", "PoolCamera", "Scene", "film", "frames", "scene"]

BODY_HALF_WIDTH = 0.045  # m


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
        heights: Of the markers above the plane in which `camera.view` is measured [m]. Shape (M,).
        camera: What films it.
        seed: Of everything random. The same seed gives the same film.
        body_half_width: Greatest half width of the body [m]; 0 films the markers alone.
        links: Pairs of markers that a straight bar of this half width joins; None draws a fish.
        occluder: Hides what swims below it.

    Returns:
        `filmed` is the truth, `frame(k)` a picture; iteration gives times [s] and pictures.

    Raises:
        ArgumentError: The swim doesn't fit into the image, has gaps, or lasts less than two frames.
    """
    return set_scene(track, heights, camera, seed, body_half_width, links, occluder)


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
        track: As for `scene`.
        heights: As for `scene`.
        camera: As for `scene`.
        path: Of the video.
        seed: As for `scene`.
        body_half_width: As for `scene`.
        links: As for `scene`.
        occluder: As for `scene`.
        codec: Of the video.
        crf: Its quality; larger is smaller and worse.
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
