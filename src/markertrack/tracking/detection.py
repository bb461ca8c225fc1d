"""The default tracker: finds all markers anew in every frame, and knows when it doesn't see one.

In each frame: predict from motion, look at the region around the prediction, find round blobs of marker color, give
each marker its blob (`matching`), and refuse what doesn't fit. A marker that isn't seen is lost, not guessed; it is
searched for at its place on the body until it is seen again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, uniform_filter

from markertrack.tracking.appearance import ROUNDS, Appearance, contrasts, covered, discs
from markertrack.tracking.matching import MOST, Chain, filled, gaps_of, match
from markertrack.tracking.tracker import Array, Image, Mask, check_order, check_points, inside
from swimbase.errors import TrackingError

LEAST_MARKERS = 3  # of a chain that is tracked
LIKELY = 0.5  # share of the usual contrast above which something is rather a marker than not
MEANWHILE = 0.2  # s in which light and lengths may change, or the robot is somewhere else
SAME_AREA = 1.5  # times more or less than usual that a marker may cover of its disc
MANY = 2  # markers that must be missing, and blobs left over, before the whole body is fitted anew
BLUR_SHARE = 0.25  # of a marker's step that blurs it to each side: a shutter that is open half of the time
_DETAIL = 4.0  # px radius at which blobs are searched for: larger markers are looked at in less detail
_MOST_BLOBS = 80


class DetectionTracker:
    """Follows the markers of one robot. See `tracker.Tracker`."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._tracks: list[Array] = []

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like."""
        if len(points) < LEAST_MARKERS:
            raise TrackingError(f"{len(points)} points were given; the tracker needs {LEAST_MARKERS} markers or more")
        check_points(image, points)
        self._look = Appearance(image, points)
        positions = self._look.points
        count = len(positions)
        self._usual, self._shares = np.maximum(self._look.contrast, 0.2), self._look.shares.copy()
        self._chain = Chain(positions)
        self._shapes = np.repeat(positions[None], count, axis=0)  # all markers when each was last seen
        self._times, self._tracks = [], []
        self._lost_since = np.full(count, -np.inf)
        self._learned, self._seen_at = time, time
        confidence = np.clip(self._look.contrast / max(float(np.median(self._look.contrast)), 1e-9), 0.0, 1.0)
        confidence[(confidence < LIKELY) | (gaps_of(positions) < self._look.radius)] = 0.0
        positions = np.where(confidence[:, None] > 0, positions, np.nan)
        self._remember(positions, time)
        self._interval = 0.0
        return positions.copy(), confidence

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Finds the markers in the next frame."""
        check_order(time, self._times[-1] if self._times else np.inf)
        self._interval = time - self._times[-1]
        predicted = self._predicted(time)
        result = self._in_region(image, predicted, time)
        if np.isfinite(result[0][:, 0]).sum() < 2 and time - self._seen_at > MEANWHILE:
            size = np.array(image.shape[1::-1], dtype=float)
            result = self._whole(image, self._blobs(image, np.zeros(2), size)[0])
        positions, confidence = result
        self._remember(positions, time)
        self._adapt(image, positions, confidence, time)
        return positions, confidence

    def _in_region(self, image: Image, predicted: Array, time: float) -> tuple[Array, Array]:
        radius = self._look.radius
        lost_for = np.where(np.isfinite(self._tracks[-1][:, 0]), 0.0, time - self._lost_since)
        doubt = 1.5 * radius + 3 + 0.35 * self._steps() + 150 * radius / 8 * np.minimum(lost_for, 1.0)
        reach = float(3 * radius + 2 * np.median(doubt) + min(doubt.max(), 200.0))
        blobs, quality = self._blobs(image, predicted.min(axis=0) - reach, predicted.max(axis=0) + reach)
        chosen, places = match(predicted, doubt, blobs, quality)
        result = self._measured(image, chosen, blobs, places)
        seen = result[0][np.isfinite(result[0][:, 0])]
        good = blobs[quality > LIKELY]
        strange = np.linalg.norm(good[:, None] - seen[None], axis=2).min(axis=1, initial=np.inf) > 1.5 * radius
        if len(predicted) - len(seen) >= MANY and strange.sum() >= MANY:
            # markers are missing and blobs are left over: another way to see it may explain more
            other = self._whole(image, blobs)
            if np.isfinite(other[0][:, 0]).sum() >= len(seen) + MANY:
                return other
        return result

    def _measured(
        self, image: Image, chosen: NDArray[np.int64], blobs: Array, places: Array, whole: bool = False
    ) -> tuple[Array, Array]:
        """Positions and confidence of what was chosen; NaN and 0 for what doesn't fit."""
        count, radius = len(chosen), self._look.radius
        seeds = np.where(chosen[:, None] >= 0, blobs[chosen], places) if len(blobs) else places.copy()
        # of markers that overlap in the picture only one blob may be left: each is looked for at its place
        apart = np.linalg.norm(places[:, None] - places[None], axis=2) + np.where(np.eye(count), np.inf, 0.0)
        crowded = (apart < 2 * radius) & ((chosen < 0)[:, None] | (chosen < 0))
        crowded = crowded.any(axis=1) & inside(places, image)
        seeds[crowded] = places[crowded]
        seen = np.flatnonzero((chosen >= 0) | crowded)
        self._share = np.zeros(count)
        positions, contrast = np.full((count, 2), np.nan), np.zeros(count)
        if len(seen) == 0:
            return positions, contrast
        blur, at = BLUR_SHARE * self._steps(), seeds[seen]
        reaches = radius + 0.5 + blur[seen]
        for _ in range(ROUNDS if crowded.any() else 1):
            at, self._share[seen] = discs(image, self._look.table, seeds[seen], reaches, seeds, radius)
            seeds[seen] = np.where(np.isfinite(at), at, seeds[seen])
        at[_outside(at, image, radius) | (np.linalg.norm(at - places[seen], axis=1) > 2 * radius)] = np.nan
        positions[seen] = at
        contrast[seen] = contrasts(image, self._look.table, at, radius + blur[seen])
        confidence = np.minimum(contrast / self._usual, 1.0)
        # part of a marker has its center elsewhere
        size = self._share / self._shares
        with np.errstate(invalid="ignore"):
            positions[gaps_of(positions) < radius] = np.nan  # their places in one blob are a guess
        positions[(confidence < LIKELY) | (size < 1 / SAME_AREA) | (size > SAME_AREA)] = np.nan
        positions[self._chain.strained(self._chain.strain(positions, self._slack), count)] = np.nan
        strain = self._chain.strain(positions, self._slack)
        if not whole:
            known = np.isfinite(self._tracks[-1][:, 0])
            positions[self._chain.unsupported(np.isfinite(positions[:, 0]), known, strain)] = np.nan
        elif np.isfinite(positions[:, 0]).mean() <= MOST:
            positions[:] = np.nan
        confidence[~np.isfinite(positions[:, 0])] = 0.0
        # a length that is nearly off casts doubt on both ends
        worst = np.zeros(count)
        np.maximum.at(worst, self._chain.pairs.ravel(), np.repeat(np.where(strain <= 1, strain, 0.0), 2))
        return positions, confidence * (1 - 0.3 * worst**2)

    def _blobs(self, image: Image, low: Array, high: Array) -> tuple[Array, Array]:
        """Round blobs of marker color in a box, with their quality."""
        height, width = image.shape[:2]
        radius = self._look.radius
        step = max(1, int(radius / _DETAIL + 0.5))
        left, top = (int(np.clip(np.floor(v), 0, s)) for v, s in zip(low, (width, height), strict=True))
        right, bottom = (int(np.clip(np.ceil(v), 0, s)) for v, s in zip(high, (width, height), strict=True))
        if right - left < 4 * step or bottom - top < 4 * step:
            return np.empty((0, 2)), np.empty(0)
        coverage = covered(image[top:bottom, left:right], self._look.table, step)
        size = max(3, 2 * int(0.6 * radius / step) + 1)
        inner = uniform_filter(uniform_filter(coverage, size, mode="nearest"), 3, mode="nearest")
        response = inner - uniform_filter(coverage, 2 * size + 3, mode="nearest")
        peaks = (response >= maximum_filter(response, max(3, size - 2))) & (response > 0)
        rows, columns = np.nonzero(peaks)
        best = np.argsort(-response[rows, columns])[:_MOST_BLOBS]
        blobs = np.stack([columns[best], rows[best]], axis=1) * step + (step - 1) / 2 + np.array([left, top])
        blobs = blobs.astype(np.float64)
        reaches = np.full(len(blobs), radius)
        blobs, _ = discs(image, self._look.table, blobs, reaches, blobs, radius)
        quality = contrasts(image, self._look.table, blobs, reaches) / float(np.median(self._usual))
        keep = quality > LIKELY / 2
        return blobs[keep], np.minimum(quality[keep], 1.0)

    def _whole(self, image: Image, blobs: Array) -> tuple[Array, Array]:
        """Fits the whole body to the blobs, wherever it was expected."""
        count = len(self._shapes)
        chosen = self._chain.fit(count, blobs, self._slack)
        if (chosen < 0).all():
            return np.full((count, 2), np.nan), np.zeros(count)
        places = filled(np.where(chosen[:, None] >= 0, blobs[chosen], np.nan), self._shapes)
        return self._measured(image, chosen, blobs, places, whole=True)

    def _predicted(self, time: float) -> Array:
        """Where each marker should be now [px]. Shape (M, 2)."""
        last = self._tracks[-1]
        out = last.copy()
        if len(self._tracks) >= 2:
            before, now = self._times
            velocity = (last - self._tracks[-2]) / (now - before)
            out = np.where(np.isfinite(velocity), last + velocity * (time - now), out)
        return filled(out, self._shapes)

    @property
    def _slack(self) -> float:
        """By which a length may be off in any case [px]."""
        return 0.15 * self._look.radius + 1.0 + 0.05 * float(np.median(self._steps()))

    def _steps(self) -> Array:
        """How far markers went from the last frame but one to the last, or about that [px]. Shape (M,)."""
        if len(self._tracks) < 2:
            return np.full(len(self._tracks[-1]), self._look.radius)
        steps = np.linalg.norm(self._tracks[-1] - self._tracks[-2], axis=1)
        typical = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else self._look.radius
        return np.where(np.isfinite(steps), steps, typical)

    def _remember(self, positions: Array, time: float) -> None:
        seen = np.isfinite(positions[:, 0])
        if seen.sum() >= 2:
            self._seen_at = time
        self._shapes[seen] = filled(positions, self._shapes)
        just_lost = ~seen & (np.isfinite(self._tracks[-1][:, 0]) if self._tracks else True)
        self._lost_since = np.where(just_lost, time, self._lost_since)
        self._times = [*self._times, time][-2:]
        self._tracks = [*self._tracks, positions][-2:]

    def _adapt(self, image: Image, positions: Array, confidence: Array, time: float) -> None:
        sure = confidence > 0.7
        self._chain.adapt(positions, sure, min(1.0, self._interval / MEANWHILE))
        if time - self._learned >= MEANWHILE and sure.sum() > len(sure) // 2:
            self._learned = time
            self._look.learn(image, positions[sure])
            radii = self._look.radius + BLUR_SHARE * self._steps()[sure]
            contrast = contrasts(image, self._look.table, positions[sure], radii)
            self._usual[sure] += 0.2 * (np.maximum(contrast, 0.2) - self._usual[sure])
            self._shares[sure] += 0.2 * (self._share[sure] - self._shares[sure])


def _outside(points: Array, image: Image, margin: float) -> Mask:
    """Points whose marker isn't wholly in the frame. Shape (N,)."""
    height, width = image.shape[:2]
    x, y = points.T
    return ~((x >= margin) & (x <= width - 1 - margin) & (y >= margin) & (y <= height - 1 - margin))
