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
from scipy.optimize import least_squares

from swim2real.errors import TrackingError
from swim2real.tracking.candidates import Blobs, find_blobs

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

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
MOST_CHAINS = 20000
MOST_FITS = 30  # labelings that are looked at more closely
PICK = "pick the points with `swim2real pick`"


@dataclass(frozen=True)
class Labeling:
    """Markers found in a frame.

    Attributes:
        points: Head to tail [px]. Shape (M, 2).
        misfit: Root mean square by which distances of neighbors differ from the robot's [m].
        meters_per_pixel: Scale found from the whole body [m/px].
    """

    points: Array
    misfit: float
    meters_per_pixel: float


@dataclass(frozen=True)
class _Fit:
    chosen: tuple[int, ...]
    cost: float
    mean_square: float
    worst_distance: float
    misfit: float
    meters_per_pixel: float


def label_markers(image: Image, rest_markers: Array, heights: Array | None = None) -> Labeling:
    """Finds the markers of a frame and says which is which.

    Args:
        image: RGB, upright. Shape (H, W, 3).
        rest_markers: Marker positions of the straight robot, head first [m]. Shape (M, 2).
        heights: Heights of the markers [m]; a slanted view displaces higher ones. None where they are all the same.
            Shape (M,).

    Raises:
        TrackingError: Too few blobs, no labeling that fits, or more than one.
    """
    return label_blobs(find_blobs(image), rest_markers, heights)


def label_blobs(blobs: Blobs, rest_markers: Array, heights: Array | None = None) -> Labeling:
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
    return Labeling(blobs.points[list(best.chosen)], best.misfit, best.meters_per_pixel)


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
        meters_per_pixel=float(solved[0]),
    )
