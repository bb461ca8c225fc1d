"""One swim before the pool camera, and the picture of any of its frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from swim2real.rendering.pool_camera import Glare, Pair, PoolCamera
from swim2real.rendering.pool_picture import (
    FLOOR,
    Bytes,
    Patch,
    Rect,
    Water,
    box,
    disc,
    grid,
    hull,
    paint,
    patch_cover,
    patch_radius,
)
from swim2real.trials import MarkerTrack

Array = NDArray[np.float64]
Image32 = NDArray[np.float32]
Flags = NDArray[np.bool_]
Links = Sequence[tuple[int, int]]

BELOW = 0.01  # m, the body under its lowest marker
# half width of the body along it, as a share of the greatest; 0 is the first marker, 1 the last
ALONG = (-0.07, -0.05, -0.01, 0.08, 0.22, 0.42, 0.52, 0.60, 0.75, 0.92, 1.03)
SHAPE = (0.30, 0.52, 0.74, 0.93, 1.00, 0.92, 0.76, 0.54, 0.34, 0.15, 0.06)
NODES = np.concatenate([np.linspace(-0.07, 0.02, 6), np.linspace(0.06, 0.54, 11), np.linspace(0.58, 1.03, 13)])
WIDTHS = PchipInterpolator(ALONG, SHAPE)(NODES)
FINS_AT = 9  # node at which the fins begin
SHADOW = (0.10, -0.07)  # m, where the light throws the body's shadow on the floor
SHADOW_SOFT = 0.04  # m


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
class Rod:
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
class Scene:
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
    rod: Rod | None
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
        lights = [place_glare(glare, time, self.camera, self.filmed.center, middles) for glare in self.glares]
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

    def _draw_rod(self, rod: Rod, image: Bytes, index: int, whole: Rect) -> None:
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
        line, inner = CubicSpline(along / along[-1], markers), np.clip(NODES, 0, 1)
        spine = line(inner) + (NODES - inner)[:, None] * line(inner, 1)
        velocity = CubicSpline(along / along[-1], self.course(time, 1))(inner)
        height = float(self.heights.min()) - BELOW
        points, scales = self.camera.project(spine, height, self.filmed.center)
        blur = np.linalg.norm(velocity, axis=1) * scales * self.camera.exposure
        width = self.body_half_width * WIDTHS
        below, shrunk = self.camera.project(spine + SHADOW, -FLOOR, self.filmed.center)
        dark = [0.4 * c for c in self.camera.water_color]
        parts = [_Part(below[::2], (width * shrunk)[::2], (SHADOW_SOFT * shrunk)[::2], dark, 0.4)]
        back = points[FINS_AT + 1] - points[FINS_AT]
        back = back / max(float(np.linalg.norm(back)), 1e-9)
        size = self.body_half_width * float(scales[FINS_AT])
        for side in (-1.0, 1.0):
            out = side * np.array([-back[1], back[0]])
            root = points[FINS_AT] + 0.8 * size * out
            fin = root + size * np.outer([0.0, 0.5, 1.0], 0.9 * out + 0.8 * back) - size * np.outer([0, 0.1, 0], back)
            soft = np.full(3, blur[FINS_AT])
            parts.append(_Part(fin, size * np.array([0.42, 0.34, 0.12]), soft, self.camera.body_color, 0.85))
        return [*parts, _Part(points, width * scales, blur, self.camera.body_color, 1.0)]

    def _link(self, markers: Array, velocities: Array, pair: list[int]) -> _Part:
        points, scales = self.camera.project(markers[pair], self.heights[pair] - BELOW, self.filmed.center)
        blur = np.linalg.norm(velocities[pair], axis=1) * scales * self.camera.exposure
        return _Part(points, self.body_half_width * scales, blur, self.camera.body_color, 1.0)


def place_glare(glare: Glare, time: float, camera: PoolCamera, center: Pair, markers: Array) -> Patch | None:
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
