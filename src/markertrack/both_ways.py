"""A film both ways: forth from the points that were clicked, and back to them, and what both say together.

What was certain from a click on without a break is believed. After a break, in which a marker was lost or doubtful, it
may be another one that is followed: it is believed unless the way back, followed without a break, arrives at another
place than where the marker was last certain. What the way back is certain of in a break is taken, where it is the same
marker: the way back agrees with what is believed before or after, and contradicts it nowhere.
"""

from __future__ import annotations

import numpy as np

from markertrack.quality import DOUBTFUL
from markertrack.tracking.tracker import DOUBT, Array, Mask

AGREE, AGREE_PX = 0.5, 3.0  # radii, or px, within which both ways say the same


def joined(
    forth: tuple[Array, Array], back: tuple[Array, Array], radii: Array
) -> tuple[Array, Array]:
    """Positions and confidence by both ways.

    Args:
        forth: Positions [px], shape (T, M, 2), and confidence, shape (T, M), from the clicked frame on.
        back: Those of the way back, in the order of the film; confidence 0 in frames that it didn't see.
        radii: Radii of the markers [px]. Shape (M,).
    """
    positions, confidence = forth[0].copy(), forth[1].copy()
    apart = np.linalg.norm(forth[0] - back[0], axis=2) > np.maximum(AGREE * radii, AGREE_PX)
    for m in range(positions.shape[1]):
        believed, again = forth[1][:, m] >= DOUBTFUL, back[1][:, m] >= DOUBTFUL
        believed &= ~_refuted(believed, again, apart[:, m])
        confidence[~believed, m] = np.minimum(confidence[~believed, m], DOUBT)
        for first, last in _runs(again):
            part = slice(first, last + 1)
            known, other = believed[part].copy(), apart[part, m]
            if (known & ~other).any() and not (known & other).any():
                known[[0, -1]] = True  # where it is lost next, the last place isn't confirmed by another
                positions[part, m][~known] = back[0][part, m][~known]
                confidence[part, m][~known] = back[1][part, m][~known]
    return positions, confidence


def _refuted(certain: Mask, again: Mask, apart: Mask) -> Mask:
    """Frames in which a marker is certain that the way back leads elsewhere from. Shapes (T,)."""
    out = np.zeros_like(certain)
    runs = _runs(certain)
    known = runs[0][1] if runs else 0  # last frame that is believed
    for first, last in runs[1:]:
        same = np.flatnonzero(again[first : last + 1] & ~apart[first : last + 1])
        if len(same) and again[known : first + same[0]].all() and apart[known]:
            out[first : last + 1] = True
        else:
            known = last
    return out


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """First and last frames of each stretch in which it is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]
