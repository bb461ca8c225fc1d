"""The synthetic pool camera: films of simulated swims, with the truth about every marker in every frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from markertrack.track import MarkerTrack
from markertrack.video import VideoWriter
from pool.picture import (
    FLOOR,
    Bytes,
    Color,
    Glare,
    Image32,
    Occluder,
    Pair,
    Patch,
    PoolCamera,
    Rect,
    Water,
    box,
    disc,
    grid,
    hull,
    make_water,
    paint,
    patch_cover,
    patch_radius,
)
from swimbase.errors import ArgumentError

__all__ = ["Color", "Filmed", "Glare", "Occluder", "PoolCamera", "PoolScene", "film", "scene"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Links = Sequence[tuple[int, int]]

_BODY_HALF_WIDTH = 0.045  # m
_BLUR_STEP = 0.75  # px between two instants of one exposure, at most
_MAX_INSTANTS = 32
_SPOTS = 40  # points of a marker's disc that are asked whether they are covered
_BELOW = 0.01  # m, the body under its lowest marker
# half width of the body along it, as a share of the greatest; 0 is the first marker, 1 the last
_ALONG = (-0.07, -0.05, -0.01, 0.08, 0.22, 0.42, 0.52, 0.60, 0.75, 0.92, 1.03)
_SHAPE = (0.30, 0.52, 0.74, 0.93, 1.00, 0.92, 0.76, 0.54, 0.34, 0.15, 0.06)
_NODES = np.concatenate([np.linspace(-0.07, 0.02, 6), np.linspace(0.06, 0.54, 11), np.linspace(0.58, 1.03, 13)])
_WIDTHS = PchipInterpolator(_ALONG, _SHAPE)(_NODES)
_FINS_AT = 9  # node at which the fins begin
_SHADOW = (0.10, -0.07)  # m, where the light throws the body's shadow on the floor
_SHADOW_SOFT = 0.04  # m


@dataclass(frozen=True)
class Filmed:
    """What is true of a film.

    Attributes:
        truth: Centers of the markers in the middle of each exposure [px], NaN outside of the image; times from the
            first frame. Positions have shape (T, M, 2).
        hidden: Where a marker is covered by more than half, or outside of the image. Shape (T, M).
        meters_per_pixel: In the plane of height 0, in the middle of the image [m].
        center: World point in the middle of the image [m].
    """

    truth: MarkerTrack
    hidden: Flags
    meters_per_pixel: float
    center: Pair


@dataclass(frozen=True)
class _Rod:
    """An occluder's pixels: rows and columns, shape (N,); share covered, shape (N, 1); RGB, shape (N, 3)."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    cover: Array
    color: Array


@dataclass(frozen=True)
class _Part:
    """A part of the body: see `hull` for the first three."""

    spine: Array
    radii: Array
    blur: Array
    color: Sequence[float]
    opacity: float

    def box(self, inside: Rect) -> Rect:
        return box(self.spine, float((self.radii + self.blur / 2).max()) + 1.5, inside)


@dataclass(frozen=True)
class PoolScene:
    """All that a frame is drawn from. Frames can be drawn in any order.

    Attributes:
        camera: What films.
        filmed: What is true of the film.
        course: Time from the first frame [s] to the markers' world positions, shape (..., M, 2) [m].
        heights: Heights of the markers [m]. Shape (M,).
        water: What the fish swims in.
        glares: Those of the camera and the small sparkles.
        rod: What the fish swims below.
        body_half_width: Greatest half width of the body [m].
        links: Pairs of markers that straight bars join; None for a fish.
        instants: Instants of one exposure, from its middle [s]. Shape (S,).
    """

    camera: PoolCamera
    filmed: Filmed
    course: CubicSpline
    heights: Array
    water: Water
    glares: tuple[Glare, ...]
    rod: _Rod | None
    body_half_width: float
    links: Links | None
    instants: Array

    def __iter__(self) -> Iterator[tuple[float, Bytes]]:
        for index, time in enumerate(self.filmed.truth.times):
            yield float(time), self.frame(index)

    def frame(self, index: int) -> Bytes:
        """One picture, RGB. Shape (height, width, 3)."""
        time = float(self.filmed.truth.times[index])
        whole = Rect(0, 0, self.camera.width, self.camera.height)
        image = self.water.frame(index, time)
        discs = self.camera.project(self.course(time + self.instants), self.heights, self.filmed.center)
        body = self._body(time)
        middles = self.camera.project(self.course(time), self.heights, self.filmed.center)[0]
        lights = [_place_glare(glare, time, self.camera, self.filmed.center, middles) for glare in self.glares]
        patches = [light for light in lights if light is not None]

        reach = self.camera.marker_radius * float(discs[1].max()) + 1.5
        outline = [box(discs[0], reach, whole)]
        outline += [part.box(whole) for part in body]
        done: list[Rect] = []
        for rect in [_union(outline), *(patch.box(whole) for patch in patches)]:
            if not rect.empty and not any(_within(rect, other) for other in done):
                done.append(rect)
                picture = self._picture(time, rect, body, discs, patches)
                noise = self.water.noise_at(index, rect)
                if noise is not None:
                    picture += noise
                picture += np.float32(0.5)
                np.clip(picture, 0, 255, out=picture)
                image[rect.y0 : rect.y1, rect.x0 : rect.x1] = picture.astype(np.uint8).transpose(1, 2, 0)
        if self.rod is not None:
            self._draw_rod(self.rod, image, index, whole)
        return image

    def _picture(
        self, time: float, rect: Rect, body: list[_Part], discs: tuple[Array, Array], patches: list[Patch]
    ) -> Image32:
        """A part of the frame without noise and rod. Shape (3, h, w)."""
        picture, light = self.water.region(time, rect)
        for part in body:
            window = part.box(rect)
            if window.empty:
                continue
            cover, ridge = hull(part.spine, part.radii, part.blur, window)
            cover *= np.float32(part.opacity)
            shade = np.float32(0.72) + np.float32(0.28) * ridge  # the full color on the spine
            shine = np.float32(0.35) * light[window.within(rect)]
            for channel, value in zip(picture, part.color, strict=True):
                below = channel[window.within(rect)]
                below += cover * (np.float32(value) * shade + shine - below)
        color = _marker_color(self.camera)
        for centers, scale in zip(discs[0].swapaxes(0, 1), discs[1].mean(axis=0), strict=True):
            radius = self.camera.marker_radius * float(scale)
            window = box(centers, radius + 1, rect)
            if not window.empty:
                paint(picture, rect, disc(centers, radius, window), window, color)
        for light_patch in patches:
            window = light_patch.box(rect)
            if not window.empty:
                paint(picture, rect, patch_cover(*grid(window), light_patch), window, (255, 255, 255))
        return picture

    def _draw_rod(self, rod: _Rod, image: Bytes, index: int, whole: Rect) -> None:
        noise = self.water.noise_at(index, whole)
        color = rod.color if noise is None else rod.color + noise[rod.rows, rod.columns, None]
        below = image[rod.rows, rod.columns].astype(float)
        image[rod.rows, rod.columns] = np.clip(below + rod.cover * (color - below) + 0.5, 0, 255).astype(np.uint8)

    def _body(self, time: float) -> list[_Part]:
        """Links; or of a fish the shadow, fins and hull, in the order in which they are drawn."""
        markers = self.course(time)
        if self.body_half_width == 0 or len(markers) < 2:
            return []
        if self.links is not None:
            return [self._link(markers, self.course(time, 1), list(pair)) for pair in self.links]
        gaps = np.maximum(np.linalg.norm(np.diff(markers, axis=0), axis=1), 1e-6)
        along = np.concatenate([[0.0], np.cumsum(gaps)])
        line, inner = CubicSpline(along / along[-1], markers), np.clip(_NODES, 0, 1)
        spine = line(inner) + (_NODES - inner)[:, None] * line(inner, 1)
        velocity = CubicSpline(along / along[-1], self.course(time, 1))(inner)
        height = float(self.heights.min()) - _BELOW
        points, scales = self.camera.project(spine, height, self.filmed.center)
        blur = np.linalg.norm(velocity, axis=1) * scales * self.camera.exposure
        width = self.body_half_width * _WIDTHS
        below, shrunk = self.camera.project(spine + _SHADOW, -FLOOR, self.filmed.center)
        dark = [0.4 * c for c in self.camera.water_color]
        parts = [_Part(below[::2], (width * shrunk)[::2], (_SHADOW_SOFT * shrunk)[::2], dark, 0.4)]
        back = points[_FINS_AT + 1] - points[_FINS_AT]
        back = back / max(float(np.linalg.norm(back)), 1e-9)
        size = self.body_half_width * float(scales[_FINS_AT])
        for side in (-1.0, 1.0):
            out = side * np.array([-back[1], back[0]])
            root = points[_FINS_AT] + 0.8 * size * out
            fin = root + size * np.outer([0.0, 0.5, 1.0], 0.9 * out + 0.8 * back) - size * np.outer([0, 0.1, 0], back)
            soft = np.full(3, blur[_FINS_AT])
            parts.append(_Part(fin, size * np.array([0.42, 0.34, 0.12]), soft, self.camera.body_color, 0.85))
        return [*parts, _Part(points, width * scales, blur, self.camera.body_color, 1.0)]

    def _link(self, markers: Array, velocities: Array, pair: list[int]) -> _Part:
        points, scales = self.camera.project(markers[pair], self.heights[pair] - _BELOW, self.filmed.center)
        blur = np.linalg.norm(velocities[pair], axis=1) * scales * self.camera.exposure
        return _Part(points, self.body_half_width * scales, blur, self.camera.body_color, 1.0)


def _place_glare(glare: Glare, time: float, camera: PoolCamera, center: Pair, markers: Array) -> Patch | None:
    """A glare in the image at one time; None while it isn't there. Shape of markers: (M, 2) [px]."""
    if not glare.start - 1e-9 <= time < glare.end - 1e-9:
        return None
    since = time - max(glare.start, 0.0)
    course = np.asarray(glare.center) + np.asarray(glare.velocity) * since
    spot, scale = camera.project(course, 0.0, center)
    radius = glare.radius * float(scale)
    if glare.over:
        under = markers[list(glare.over)]
        spot = under.mean(axis=0)
        # half again for markers above the plane, which appear larger, and for their motion
        reach = float(np.linalg.norm(under - spot, axis=1).max()) + 1.5 * camera.marker_radius * float(scale)
        radius = max(radius, patch_radius(reach))
    turn = 3.0 * time + 1000.0 * sum(glare.center) + 10.0 * glare.radius
    return Patch(spot, radius, glare.stretch, turn, glare.strength)


def _marker_color(camera: PoolCamera) -> list[float]:
    pairs = zip(camera.body_color, camera.marker_color, strict=True)
    return [body + camera.contrast * (marker - body) for body, marker in pairs]


def _within(rect: Rect, other: Rect) -> bool:
    return rect.x0 >= other.x0 and rect.y0 >= other.y0 and rect.x1 <= other.x1 and rect.y1 <= other.y1


def _union(rects: list[Rect]) -> Rect:
    seen = [rect for rect in rects if not rect.empty] or [Rect(0, 0, 0, 0)]
    return Rect(
        min(r.x0 for r in seen), min(r.y0 for r in seen), max(r.x1 for r in seen), max(r.y1 for r in seen)
    )  # fmt: skip


def scene(
    track: MarkerTrack, heights: object, camera: PoolCamera, seed: int, *, body_half_width: float = _BODY_HALF_WIDTH,
    links: Links | None = None, occluder: Occluder | None = None,
) -> PoolScene:  # fmt: skip
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
    count = int(np.clip(np.ceil(fastest / _BLUR_STEP), 1, _MAX_INSTANTS))
    instants = ((np.arange(count) + 0.5) / count - 0.5) * camera.exposure
    glares = (*camera.glares, *_glints(camera, center, float(times[-1]), np.random.default_rng([seed, 1])))
    rod, cover = _rod(occluder, camera, center) if occluder else (None, None)

    # a marker's disc as points that each stand for the same area
    turns, rings = np.arange(_SPOTS) * np.pi * (3 - np.sqrt(5)), np.sqrt((np.arange(_SPOTS) + 0.5) / _SPOTS)
    spots = np.stack([rings * np.cos(turns), rings * np.sin(turns)], axis=-1)
    outside = ~_inside(pixels, camera)
    hidden = outside.copy()
    for index, time in enumerate(times):
        points = pixels[index][:, None] + camera.marker_radius * scales[index][:, None, None] * spots
        clear = _inside(points, camera).astype(float)
        for glare in glares:
            p = _place_glare(glare, float(time), camera, center, pixels[index])
            if p is not None:
                clear *= 1 - patch_cover(points[..., 0], points[..., 1], p)
        if cover is not None:
            columns = np.clip(np.round(points[..., 0]).astype(int), 0, camera.width - 1)
            rows = np.clip(np.round(points[..., 1]).astype(int), 0, camera.height - 1)
            clear *= 1 - cover[rows, columns]
        hidden[index] |= clear.mean(axis=1) < 0.5
    truth = MarkerTrack(times, np.where(outside[..., None], np.nan, pixels))
    filmed = Filmed(truth, hidden, camera.meters_per_pixel, center)
    return PoolScene(
        camera, filmed, course, levels, make_water(camera, seed), glares, rod, body_half_width, links, instants
    )


def film(swim: PoolScene, path: str | Path, *, codec: str = "h264", crf: int = 20, rotation: int = 0) -> Filmed:
    """Films a swim into a video file.

    Args:
        swim: What `scene` made.
        path: Path of the video.
        codec: Codec of the video.
        crf: Quality of the video; larger is smaller and worse.
        rotation: The camera is held turned: the file holds turned pictures, and says that players turn them clockwise
            by 0, 90, 180 or 270 degrees, which makes them upright again.

    Returns:
        The truth about the film.
    """
    camera = swim.camera
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
        raise ArgumentError(f"heights have shape {levels.shape}; give {count} finite numbers in m, one per marker")
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
            f"the swim lasts {track.duration:g} s, which leaves {times.size} frame at {camera.fps:g} frames "
            "per second; at least 2 are needed"
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


def _rod(occluder: Occluder, camera: PoolCamera, center: Pair) -> tuple[_Rod, NDArray[np.float32]]:
    if occluder.height >= camera.camera_height:
        raise ArgumentError(
            f"the occluder is {occluder.height:g} m high and the camera {camera.camera_height:g} m; lower the occluder"
        )
    ends, scales = camera.project(np.array(occluder.ends), occluder.height, center)
    whole = Rect(0, 0, camera.width, camera.height)
    cover, ridge = hull(ends, occluder.width / 2 * scales, np.zeros(2), whole)
    rows, columns = np.nonzero(cover)
    color = np.array(occluder.color) * (0.7 + 0.6 * np.maximum(ridge[rows, columns], 0))[:, None]
    return _Rod(rows, columns, cover[rows, columns, None].astype(float), color), cover


def _inside(pixels: Array, camera: PoolCamera) -> Flags:
    edges = np.array([camera.width, camera.height]) - 0.5
    return np.asarray(((pixels >= -0.5) & (pixels < edges)).all(axis=-1), dtype=bool)
