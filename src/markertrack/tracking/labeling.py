"""Finds the markers in a first frame without a click: round blobs that lie as the robot's markers do, head to tail.

The body may be bent, so what is compared are the distances of neighbors, up to one scale, and how much the line through
them turns; the head is straight. Distances differ along the robot, so its two ends can't be mistaken. When something
else fits about as well, or nothing does, it says so: a person then picks the points. It can't notice that the first or
last marker is hidden while a look-alike of its size and color lies where it might be.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter, uniform_filter1d
from scipy.optimize import least_squares

from markertrack.tracking.tracker import Array, Image, Mask
from swimbase.errors import TrackingError

Array32 = NDArray[np.float32]
Index = NDArray[np.intp]

HEAD = 3  # markers on the rigid head
HEAD_BEND = np.radians(15)  # by which the line through them may turn
TAIL_BEND = np.radians(45)  # by which the line through the others may turn at a marker
PLACEMENT = 0.0035  # m, standard deviation of a distance, and
STRETCH = 0.04  # share of it
RAISED_PLACEMENT = 0.012  # m, of distances to a marker that stands higher: the published tracks have up to twice that
SLANT = 0.4  # standard deviation of the tangent of the angle under which a camera sees the robot
USUAL_HEAD_BEND, USUAL_TAIL_BEND = np.radians(4), np.radians(15)
REACH = 3.0  # standard deviations within which a marker is looked for
LARGEST, SMALLEST = 0.65, 0.08  # radius of a marker over the smallest distance of two
WORST = 1.0  # mean square of the residuals, in standard deviations, of a labeling that is believed
WORST_DISTANCE = 2.5  # standard deviations of a distance that is believed
LEAD = 9.0  # by which the sum of squares must be better than that of any other labeling
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
MOST_CHAINS = 20000
MOST_FITS = 30  # labelings that are looked at more closely
PICK = "pick the points with `swim2real pick`"


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


@dataclass(frozen=True)
class _Fit:
    chosen: tuple[int, ...]
    cost: float
    mean_square: float
    worst_distance: float
    misfit: float  # root mean square by which distances of neighbors differ from the robot's [m]


def label_markers(image: Image, rest_markers: Array, heights: Array | None = None) -> Array:
    """Finds the markers of a frame and says which is which.

    Args:
        image: RGB, upright. Shape (H, W, 3).
        rest_markers: Marker positions of the straight robot, head first [m]. Shape (M, 2).
        heights: Heights of the markers [m]; a slanted view displaces higher ones. None where they are all the same.
            Shape (M,).

    Returns:
        Points, head to tail [px]. Shape (M, 2).

    Raises:
        TrackingError: Too few blobs, no labeling that fits, or more than one.
    """
    return label_blobs(find_blobs(image), rest_markers, heights)


def label_blobs(blobs: Blobs, rest_markers: Array, heights: Array | None = None) -> Array:
    """Says which of some blobs are which markers; as `label_markers`."""
    count = len(rest_markers)
    raised = np.zeros(count) if heights is None else heights - _most_common(heights)
    if len(blobs) < count:
        raise TrackingError(f"{len(blobs)} round blobs were found in the frame, of {count} markers; {PICK}")
    level = np.flatnonzero(raised == 0)
    alike = _alike(blobs)
    fits = _best(_fit(blobs, c, rest_markers[level], raised[level]) for c in _chains(blobs, alike, rest_markers, level))
    if raised.any():
        whole = (c for fit in fits for c in _completed(blobs, alike, fit.chosen, rest_markers, raised, level))
        fits = _best(_fit(blobs, chosen, rest_markers, raised) for chosen in whole)
        fits = _best(_fit(blobs, fit.chosen, rest_markers, raised, refine=True) for fit in fits)
    if not fits:
        raise TrackingError(
            f"of {len(blobs)} round blobs in the frame no {count} lie as the robot's markers do; {PICK}"
        )
    best = fits[0]
    if best.mean_square > WORST or best.worst_distance > WORST_DISTANCE:
        raise TrackingError(
            f"of {len(blobs)} round blobs in the frame the {count} that lie most like the robot's markers are off by "
            f"{1e3 * best.misfit:.1f} mm (worst distance {best.worst_distance:.1f} times its usual deviation), too "
            f"much to be sure; {PICK}"
        )
    if len(fits) > 1 and fits[1].cost < best.cost + LEAD:
        other = [m for m in range(count) if fits[1].chosen[m] != best.chosen[m]]
        raise TrackingError(
            f"{len(blobs)} round blobs were found in the frame, and two ways to label {count} of them fit about "
            f"equally well ({1e3 * best.misfit:.1f} and {1e3 * fits[1].misfit:.1f} mm); they differ in marker "
            f"{', '.join(str(m) for m in other)} from the head, counted from 0; {PICK}"
        )
    return blobs.points[list(best.chosen)]


def _best(fits: Iterable[_Fit]) -> list[_Fit]:
    return sorted(fits, key=lambda fit: fit.cost)[:MOST_FITS]


def _most_common(heights: Array) -> float:
    values, counts = np.unique(heights, return_counts=True)
    return float(values[np.argmax(counts)])


def _alike(blobs: Blobs) -> Mask:
    """Whether two blobs may both be markers of one robot: about one size and one color. Shape (N, N).

    What is around them doesn't count: the last marker may have water around it, the others the hull.
    """
    size = np.abs(np.log(blobs.radii[:, None] / blobs.radii)) < np.log(1.5)
    strength = np.linalg.norm(blobs.contrasts, axis=1)
    color = np.linalg.norm(blobs.colors[:, None] - blobs.colors, axis=2)
    alike = size & (color < 20 + 0.3 * np.minimum(strength[:, None], strength))
    np.fill_diagonal(alike, False)  # no blob is two markers
    return alike


def _chains(blobs: Blobs, alike: Mask, rest: Array, level: Index) -> list[tuple[int, ...]]:
    """Ways to place the markers of the common height, one after the other from the head."""
    gaps = np.linalg.norm(np.diff(rest[level], axis=0), axis=1)
    smallest = float(np.linalg.norm(np.diff(rest, axis=0), axis=1).min())
    points = blobs.points
    first, second = np.nonzero(alike)
    length = np.linalg.norm(points[second] - points[first], axis=1)
    scale = gaps[0] / np.maximum(length, 1e-9)  # m/px
    size = blobs.radii[first] * scale / smallest
    plausible = (size < LARGEST * 1.1) & (size > SMALLEST)
    chains, length = np.stack([first, second], axis=1)[plausible], length[plausible]
    for k in range(1, len(gaps)):
        chains, length = _extended(points, alike, chains, length, gaps, k, level)
        if len(chains) > MOST_CHAINS:
            raise TrackingError(
                f"{len(blobs)} round blobs in the frame look alike, too many to tell which are markers; {PICK}"
            )
    return [tuple(int(i) for i in chain) for chain in chains]


def _extended(
    points: Array, alike: Mask, chains: Index, length: Array, gaps: Array, k: int, level: Index
) -> tuple[Index, Array]:
    """Each chain with each blob that may be its next marker, and the new lengths [px]."""
    grown: list[Index] = []
    lengths: list[Array] = []
    limit = (HEAD_BEND if level[k + 1] < HEAD else TAIL_BEND) + 2 * PLACEMENT / min(gaps[k], gaps[k - 1])
    for start in range(0, len(chains), 2000):
        part, px = chains[start : start + 2000], length[start : start + 2000]
        last = points[part[:, -1]]
        step = last - points[part[:, -2]]
        way = points[None] - last[:, None]  # (K, N, 2)
        distance = np.linalg.norm(way, axis=2)
        meters = distance * (gaps[:k].sum() / px)[:, None]
        turn = np.abs(
            np.arctan2(
                step[:, None, 0] * way[..., 1] - step[:, None, 1] * way[..., 0], (step[:, None] * way).sum(axis=2)
            )
        )
        fits = np.abs(meters - gaps[k]) < REACH * (PLACEMENT + STRETCH * gaps[k] + STRETCH * gaps[k] / k)
        fits &= (turn < limit) & np.logical_and.reduce([alike[part[:, i]] for i in range(part.shape[1])])
        which, blob = np.nonzero(fits)
        grown.append(np.column_stack([part[which], blob]))
        lengths.append(px[which] + distance[which, blob])
    if not grown:
        return np.empty((0, chains.shape[1] + 1), dtype=np.intp), np.empty(0)
    return np.concatenate(grown), np.concatenate(lengths)


def _completed(
    blobs: Blobs, alike: Mask, chain: tuple[int, ...], rest: Array, raised: Array, level: Index
) -> list[tuple[int, ...]]:
    """Ways to place the raised markers of a chain: each near its place on the line, off it by what a slant may do."""
    if len(level) == len(rest):
        return [chain]
    at = {int(m): i for m, i in zip(level, chain, strict=True)}
    points = blobs.points
    scale = _length(points[list(chain)]) / _length(rest[level])  # px/m
    free = np.logical_and.reduce(alike[list(chain)])
    choices: list[list[int]] = []
    missing = [int(m) for m in np.flatnonzero(raised != 0)]
    for m in missing:
        before, after = [n for n in at if n < m][-2:], [n for n in at if n > m][:2]
        ends = (before[-1], after[0]) if before and after else tuple(before or after[::-1])
        a, b = points[at[ends[0]]], points[at[ends[1]]]
        share = float((rest[m, 0] - rest[ends[0], 0]) / (rest[ends[1], 0] - rest[ends[0], 0]))
        bend = 0.0 if before and after else np.tan(TAIL_BEND) * float(abs(rest[m, 0] - rest[ends[-1], 0]))
        reach = 2.5 * SLANT * abs(raised[m]) + 2 * RAISED_PLACEMENT + bend
        off = np.linalg.norm(points - (a + share * (b - a)), axis=1)
        near = np.flatnonzero(free & (off < reach * scale))
        choices.append([int(i) for i in near[np.argsort(off[near])][:6]])
    labelings: list[tuple[int, ...]] = []
    for extra in product(*choices):
        if len(set(extra)) == len(extra):
            whole = at | dict(zip(missing, extra, strict=True))
            labelings.append(tuple(whole[m] for m in range(len(rest))))
    return labelings


def _guess(points: Array, rest: Array, raised: Array) -> Array:
    """Scale [m/px] from the markers of the common height, and the slant that puts the others onto their line."""
    level = np.flatnonzero(raised == 0)
    scale = _length(rest[level]) / _length(points[level])
    offsets: list[Array] = []
    for m in np.flatnonzero(raised):
        if level[0] < m < level[-1]:
            line = [np.interp(rest[m, 0], rest[level, 0], points[level, axis]) for axis in (0, 1)]
            offsets.append((points[m] - line) * scale / raised[m])
    slant = np.mean(offsets, axis=0) if offsets else np.zeros(2)
    return np.array([scale, *slant])


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _fit(blobs: Blobs, chosen: tuple[int, ...], rest: Array, raised: Array, refine: bool = False) -> _Fit:
    """How well blobs lie as the robot's markers do: scale and slant fitted, everything in standard deviations.

    Without `refine` the slant is what puts raised markers onto the line; with it, what suits all distances and turns.
    """
    index = list(chosen)
    points = blobs.points[index]
    gaps = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    lifted = np.diff(raised) != 0
    sigma = PLACEMENT + STRETCH * gaps + RAISED_PLACEMENT * lifted
    usual = np.where(np.arange(2, len(rest)) < HEAD, USUAL_HEAD_BEND, USUAL_TAIL_BEND)
    aside = (PLACEMENT + 0.5 * RAISED_PLACEMENT * (lifted[:-1] | lifted[1:])) / np.minimum(gaps[:-1], gaps[1:])
    bend_sigma = np.hypot(usual, aside)

    def residuals(z: Array) -> Array:
        places = points * z[0] - raised[:, None] * z[1:]
        steps = np.diff(places, axis=0)
        turns = np.angle(np.exp(1j * np.diff(np.arctan2(steps[:, 1], steps[:, 0]))))
        return np.concatenate([(np.linalg.norm(steps, axis=1) - gaps) / sigma, turns / bend_sigma, z[1:] / SLANT])

    if not raised.any():  # distances are linear in the scale, turns don't depend on it
        length = np.linalg.norm(np.diff(points, axis=0), axis=1) / sigma
        solved = np.array([float(length @ (gaps / sigma)) / float(length @ length), 0.0, 0.0])
    else:
        solved = _guess(points, rest, raised)
        if refine:
            solved = least_squares(residuals, solved, x_scale=[solved[0], SLANT, SLANT], max_nfev=40).x
    off = residuals(solved)
    radii, colors = blobs.radii[index], blobs.colors[index]
    strength = float(np.median(np.linalg.norm(blobs.contrasts[index], axis=1)))
    size = np.log(radii / np.median(radii)) / 0.12
    color = np.linalg.norm(colors - np.median(colors, axis=0), axis=1) / (10 + 0.1 * strength)
    distances = off[: len(gaps)]
    geometry = float(off @ off)
    return _Fit(
        chosen=chosen,
        cost=geometry + float(size @ size + color @ color),
        mean_square=geometry / (len(gaps) - 1 + len(gaps) - 1),
        worst_distance=float(np.abs(distances).max()),
        misfit=float(np.sqrt(np.mean((distances * sigma) ** 2))),
    )


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
