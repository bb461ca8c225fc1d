"""Frames of reference that remove where a robot is and where it heads. Arrays only.

A frame stands on a pair of markers; a swimmer's are 0, the front of the head, and 1, its rear. So x of the body frame
points from head to tail, and a swimmer moves toward its -x.
"""

from __future__ import annotations

import numpy as np

from swimbase.arrays import Array

Pair = tuple[int, int]

HEAD: Pair = (0, 1)


def heads(positions: Array, pair: Pair = HEAD) -> Array:
    """Mean of the pair's markers [m]. Shape (T, M, 2) to (T, 2)."""
    return (positions[:, pair[0]] + positions[:, pair[1]]) / 2


def body_axes(positions: Array, pair: Pair = HEAD) -> Array:
    """Unit vectors from the first marker of the pair to the second. Shape (T, M, 2) to (T, 2)."""
    axes = positions[:, pair[1]] - positions[:, pair[0]]
    with np.errstate(invalid="ignore", divide="ignore"):
        return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def components(vectors: Array, axes: Array) -> Array:
    """Components of vectors along the axes and to their left. Shapes (..., 2)."""
    along = vectors[..., 0] * axes[..., 0] + vectors[..., 1] * axes[..., 1]
    left = vectors[..., 1] * axes[..., 0] - vectors[..., 0] * axes[..., 1]
    return np.stack([along, left], axis=-1)


def composed(along_and_left: Array, axes: Array) -> Array:
    """The vectors that have these components along the axes and to their left. Shapes (..., 2)."""
    return components(along_and_left, axes * np.array([1.0, -1.0]))


def to_body(positions: Array, pair: Pair = HEAD) -> Array:
    """Body frame: origin at the first marker of the pair, x axis toward the second [m]. Shape (T, M, 2)."""
    return components(positions - positions[:, pair[0], None], body_axes(positions, pair)[:, None])


def to_swim(positions: Array) -> Array:
    """Swim frame: the body frame, carried along by the head's displacement [m]. Shape (T, M, 2).

    Each step of the head is rotated into the body frame of its time and added up; the origin is the first frame's
    head. Frames without a head are stepped over.
    """
    head = heads(positions)
    seen = np.flatnonzero(np.isfinite(head).all(axis=1))
    path = np.full_like(head, np.nan)
    if seen.size:
        steps = components(np.diff(head[seen], axis=0), body_axes(positions)[seen[1:]])
        path[seen] = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    body = to_body(positions)
    return body - heads(body)[:, None] + path[:, None]


def to_course(times: Array, positions: Array) -> Array:
    """The world, turned so that the swim as a whole goes toward -x, from where the head is first seen [m].

    Shape (T, M, 2).
    """
    head = heads(positions)
    seen = np.flatnonzero(np.isfinite(head).all(axis=1))
    start = head[seen[0]] if seen.size else np.zeros(2)
    return components(positions - start, -swimming_axis(times, positions))


def slope(times: Array, values: Array) -> float:
    """Slope of a straight-line fit to the finite values; NaN with fewer than two."""
    good = np.isfinite(values)
    if np.count_nonzero(good) < 2:
        return float("nan")
    t, v = times[good] - times[good].mean(), values[good]
    return float(t @ (v - v.mean()) / (t @ t))


def swimming_axis(times: Array, positions: Array, pair: Pair = HEAD) -> Array:
    """Direction of a straight-line fit to the head's path over time, a unit vector. Shape (2,).

    Of the line's two directions it is the one that the head points to, so tail-first swimming is negative progress.
    """
    head = heads(positions, pair)
    forward = -np.nanmean(body_axes(positions, pair), axis=0)
    direction = np.array([slope(times, head[:, 0]), slope(times, head[:, 1])])
    length = np.linalg.norm(direction)
    if not length > 0:  # no motion
        return forward / np.linalg.norm(forward)
    return direction / (length if direction @ forward >= 0 else -length)


def progress(times: Array, positions: Array, pair: Pair = HEAD) -> Array:
    """Displacement of the head along the swimming axis since the first frame that has one [m]. Shape (T,)."""
    along = heads(positions, pair) @ swimming_axis(times, positions, pair)
    seen = np.flatnonzero(np.isfinite(along))
    return along - (along[seen[0]] if seen.size else 0.0)
