"""Round blobs of an image that may be markers: bright or dark, of any color, small and separate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter, uniform_filter1d

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Image = NDArray[np.uint8]
Index = NDArray[np.intp]

WORKING_WIDTH = 1920  # px that a frame is reduced to for the search
SIGMAS = (1.0, 1.4, 2.0, 2.8)  # px, of an octave; a disc of radius r answers most at r / 1.4
OCTAVES = 3
TRUNCATE = 3.0
LEAST_SIGNAL = 5.0  # noise levels that a blob stands out of its surroundings
LEAST_NOISE = 0.35  # 8-bit steps
MOST = 400  # blobs that are looked at closely
LEAST_CONTRAST = 16.0  # 8-bit steps between a blob and what is around it, and
LEAST_OF_NOISE = 9.0  # times the noise of a channel: the noise itself has specks of 6
LONGEST = 6.0  # ratio of the curvatures of a peak
ROUNDS = 5  # of finding the center and the size of a blob anew
WIDEST = 1.6  # ratio of the axes of a blob's ellipse
FULLEST, EMPTIEST = 1.25, 0.70  # of a disc's area within the radius of gyration: a ring or a cross isn't one


@dataclass(frozen=True)
class Blobs:
    """Blobs, the most prominent first.

    Attributes:
        points: Centers [px]. Shape (N, 2).
        radii: Radii of discs with the same area [px]. Shape (N,).
        colors: RGB inside. Shape (N, 3).
        contrasts: RGB inside minus RGB around. Shape (N, 3).
    """

    points: Array
    radii: Array
    colors: Array
    contrasts: Array

    def __len__(self) -> int:
        return len(self.points)


def find_blobs(image: Image) -> Blobs:
    """Finds small round blobs.

    Differences of Gaussians over luminance and two opponent colors give places and sizes, at reduced size; centers,
    sizes and colors come from the image itself.

    Args:
        image: RGB. Shape (H, W, 3).
    """
    factor = max(1, round(image.shape[1] / WORKING_WIDTH))
    rough = _rough(_reduced(image, factor))
    rough = rough[:, :3] * factor + [(factor - 1) / 2, (factor - 1) / 2, 0.0]
    least = max(LEAST_CONTRAST, LEAST_OF_NOISE * _noise(image))
    blobs = [blob for x, y, r in rough if (blob := _examined(image, x, y, r, least)) is not None]
    kept: list[tuple[float, ...]] = []
    for blob in blobs:  # the same blob is found in several sizes
        if all((blob[0] - k[0]) ** 2 + (blob[1] - k[1]) ** 2 > (0.8 * max(blob[2], k[2])) ** 2 for k in kept):
            kept.append(blob)
    table = np.array(kept, dtype=float).reshape(-1, 9)
    return Blobs(table[:, :2], table[:, 2], table[:, 3:6], table[:, 6:9])


def _noise(image: Image) -> float:
    """Standard deviation of a channel's noise, from differences of neighbors [8-bit steps]."""
    changes = np.abs(np.diff(image[::9].astype(np.int16), axis=1))
    return 1.05 * float(np.sqrt(np.mean(np.minimum(changes, np.median(changes) * 2 + 1) ** 2.0)) / np.sqrt(2))


def _reduced(image: Image, factor: int) -> Array32:
    """Luminance, red-green and yellow-blue, at reduced size. Shape (3, h, w)."""
    h, w = image.shape[0] // factor, image.shape[1] // factor
    small = np.zeros((h, w, 3), dtype=np.float32)
    for i in range(factor):
        for j in range(factor):
            small += image[i : h * factor : factor, j : w * factor : factor]
    small /= factor**2
    red, green, blue = small[..., 0], small[..., 1], small[..., 2]
    channels = np.stack([(red + green + blue) / 3, (red - green) / 2, (red + green) / 4 - blue / 2])
    return channels.astype(np.float32, copy=False)


def _rough(channels: Array32) -> Array:
    """Peaks of the answer over places and sizes: x, y, radius, signal; the strongest first. Shape (n, 4)."""
    octaves: list[Array] = []
    scale = 1
    for _ in range(OCTAVES):
        if min(channels.shape[1:]) < 16:
            break
        answers = [np.zeros(channels.shape[1:], dtype=np.float32) for _ in SIGMAS[1:]]
        for channel in channels:
            levels = [channel]
            for before, sigma in zip((0.0, *SIGMAS[:-1]), SIGMAS, strict=True):
                levels.append(gaussian_filter(levels[-1], np.sqrt(sigma**2 - before**2), truncate=TRUNCATE))
            for answer, fine, coarse in zip(answers, levels[1:-1], levels[2:], strict=True):
                change = fine - coarse
                noise = 1.5 * float(np.median(np.abs(change[::7, ::7])))
                answer += np.square(change / max(noise, LEAST_NOISE))
        for answer, sigma in zip(answers, SIGMAS[:-1], strict=True):
            peaks = (answer == maximum_filter(answer, 3)) & (answer > LEAST_SIGNAL**2)
            y, x = np.nonzero(peaks)
            y, x = _not_on_lines(answer, y, x)
            radius = np.full(len(x), 1.7 * sigma)
            table = np.stack([x, y, radius], axis=1) * scale
            table[:, :2] += (scale - 1) / 2
            octaves.append(np.column_stack([table, answer[y, x]]).astype(float))
        channels = np.stack([_halved(channel) for channel in channels])
        scale *= 2
    table = np.concatenate(octaves)
    return table[np.argsort(-table[:, 3], kind="stable")][: 3 * MOST]


def _not_on_lines(answer: Array32, y: Index, x: Index) -> tuple[Index, Index]:
    """Peaks that fall off to all sides: along an edge or a rope they don't."""
    inside = (y > 0) & (x > 0) & (y < answer.shape[0] - 1) & (x < answer.shape[1] - 1)
    y, x = y[inside], x[inside]
    across = answer[y, x - 1] + answer[y, x + 1] - 2 * answer[y, x]
    down = answer[y - 1, x] + answer[y + 1, x] - 2 * answer[y, x]
    mixed = (answer[y + 1, x + 1] + answer[y - 1, x - 1] - answer[y + 1, x - 1] - answer[y - 1, x + 1]) / 4
    keep = (across + down) ** 2 * LONGEST < (LONGEST + 1) ** 2 * (across * down - mixed**2)
    return y[keep], x[keep]


def _halved(channel: Array32) -> Array32:
    h, w = channel.shape[0] // 2 * 2, channel.shape[1] // 2 * 2
    return uniform_filter1d(uniform_filter1d(channel[:h, :w], 2, axis=0, origin=-1), 2, axis=1, origin=-1)[::2, ::2]


def _examined(image: Image, x: float, y: float, radius: float, least_contrast: float) -> tuple[float, ...] | None:
    """Center, radius, color and contrast of the blob at a place, or None where there is no round one."""
    blob = None
    for _ in range(ROUNDS):
        blob = _measured(image, x, y, radius, least_contrast)
        if blob is None:
            return None
        x, y, radius = blob[:3]
    if blob is None or not _round(blob[9:], radius):
        return None
    return blob[:9]


def _measured(image: Image, x: float, y: float, radius: float, least_contrast: float) -> tuple[float, ...] | None:
    """Center, radius, color, contrast and second moments of what differs from its surroundings at a place."""
    reach = 2.2 * radius + 1
    x0, y0 = max(int(x - reach), 0), max(int(y - reach), 0)
    part = image[y0 : int(y + reach) + 2, x0 : int(x + reach) + 2].astype(float)
    if min(part.shape[:2]) < 3:
        return None
    dx, dy = np.arange(x0, x0 + part.shape[1]) - x, (np.arange(y0, y0 + part.shape[0]) - y)[:, None]
    distance = np.hypot(dx, dy)
    core, ring = distance <= max(0.6 * radius, 0.8), (distance > 1.35 * radius + 0.5) & (distance <= reach)
    if core.sum() < 1 or ring.sum() < 8:
        return None
    color, around = part[core].mean(axis=0), np.median(part[ring], axis=0)
    contrast = color - around
    strength = float(contrast @ contrast)
    if strength < least_contrast**2:
        return None
    share = np.clip(1.25 * (part - around) @ contrast / strength - 0.125, 0, 1)
    share[distance > 1.2 * radius + 0.8] = 0  # a neighbor isn't part of it
    area = float(share.sum())
    if area < 3:
        return None
    mx, my = float((share * dx).sum()) / area, float((share * dy).sum()) / area
    if np.hypot(mx, my) > radius or not (-0.5 <= x + mx < image.shape[1] and -0.5 <= y + my < image.shape[0]):
        return None
    xx, yy = float((share * (dx - mx) ** 2).sum()) / area, float((share * (dy - my) ** 2).sum()) / area
    xy = float((share * (dx - mx) * (dy - my)).sum()) / area
    return x + mx, y + my, float(np.sqrt(area / np.pi)), *color, *contrast, xx, xy, yy


def _round(moments: tuple[float, ...], radius: float) -> bool:
    xx, xy, yy = moments
    spread = float(np.hypot((xx - yy) / 2, xy))
    long, short = (xx + yy) / 2 + spread, (xx + yy) / 2 - spread
    fullness = 2 * (xx + yy) / radius**2  # 1 for a disc
    return long <= WIDEST**2 * max(short, 1e-9) and EMPTIEST <= fullness <= FULLEST + 2 / radius**2
