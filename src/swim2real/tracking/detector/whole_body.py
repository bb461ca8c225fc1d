"""The whole body fitted to the blobs of a frame, when following markers one by one has lost the thread.

The markers keep their order and their distances along the body. Of all ways to give some of them a blob in this order,
the one is taken that leaves fewest markers out and strains the distances least; dynamic programming finds it. Where
the markers were a moment ago counts for little, so it recovers from a wrong prediction or a long occlusion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim2real.tracking.detector.matching import LINK_SHARES
from swim2real.tracking.tracker import Array

MISSED = 2.0  # cost of a marker without a blob; a length that is off by all that is allowed costs 1
POOR = 1.0  # cost of a blob of quality 0
FAR = 1.0  # cost of a place that is off by the length of the body
LEAST_PARTS = 5  # markers that must be found for a body to be believed
SHORTEST_CHORD, LONGEST_CHORD = 0.5, 1.05  # of the way along the body, between markers with others left out between


def fit_body(predicted: Array, lengths: Array, blobs: Array, quality: Array, slack: float) -> NDArray[np.int64]:
    """Gives the markers blobs in the order of the body.

    Args:
        predicted: Where the markers might be [px]. Shape (M, 2).
        lengths: Usual distances of neighbors, then of next neighbors, (i, i + 1) and (i, i + 2) in turns as in
            `links_of` [px]. Shape (2 M - 3,).
        blobs: In the frame [px]. Shape (P, 2).
        quality: Of the blobs, from 0 to 1. Shape (P,).
        slack: By which a length may be off in any case [px].

    Returns:
        Index of each marker's blob, -1 for none; all -1 when no body is found. Shape (M,).
    """
    count, number = len(predicted), len(blobs)
    nothing = np.full(count, -1)
    least = max(LEAST_PARTS, int(np.ceil(0.5 * count)))
    if count < 3 or number < least:
        return nothing
    neighbors = lengths[0::2]  # links_of lists (0, 1), (0, 2), (1, 2), (1, 3), ...
    body = float(neighbors.sum())
    away = np.linalg.norm(blobs[:, None] - blobs[None], axis=2)  # (P, P)
    own = FAR * (np.linalg.norm(predicted[:, None] - blobs[None], axis=2) / body) ** 2 + POOR * (1 - quality)
    best = own + MISSED * np.arange(count)[:, None]  # cost up to here with all markers before left out
    came = np.full((count, number, 2), -1)
    for m in range(1, count):
        for before in range(m):
            step = (
                best[before][:, None] + _strain(before, m, lengths, neighbors, away, slack) + MISSED * (m - before - 1)
            )
            np.fill_diagonal(step, np.inf)
            source = np.argmin(step, axis=0)
            cost = step[source, np.arange(number)] + own[m]
            better = cost < best[m]
            best[m] = np.where(better, cost, best[m])
            came[m, better] = np.stack([np.full(number, before), source], axis=1)[better]
    ends = best + MISSED * np.arange(count - 1, -1, -1)[:, None]
    m, p = (int(i) for i in np.unravel_index(int(np.argmin(ends)), ends.shape))
    chosen = nothing.copy()
    while m >= 0:
        chosen[m] = p
        m, p = (int(i) for i in came[m, p])
    taken = chosen[chosen >= 0]
    return chosen if len(taken) >= least and len(set(taken.tolist())) == len(taken) else nothing


def _strain(before: int, m: int, lengths: Array, neighbors: Array, away: Array, slack: float) -> Array:
    """Cost of two markers' blobs, with none for the markers between. Shape (P, P)."""
    if m - before <= 2:
        # of marker i: (i, i + 1) at 2 i, (i, i + 2) at 2 i + 1
        length = lengths[2 * before + (m - before - 1)]
        return np.minimum(((away - length) / (LINK_SHARES[m - before - 1] * length + slack)) ** 2, 1e3)
    way = float(neighbors[before:m].sum())
    off = np.maximum(away - LONGEST_CHORD * way, 0.0) + np.maximum(SHORTEST_CHORD * way - away, 0.0)
    return np.minimum((off / (LINK_SHARES[1] * way + slack)) ** 2 * 4, 1e3)
