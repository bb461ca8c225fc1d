"""Short gaps filled and noise smoothed, without inventing measurements and without flattening the beat.

`smooth`, then `fill_gaps`. A filled sample has a position and a low confidence: it can be drawn and its head gives the
fish's progress, but `check_track` counts it as lost, so no loss of the aligned protocol is computed from it. The
paper's protocol takes every position there is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from markertrack.quality import DOUBTFUL, GAP_TIME, runs
from markertrack.track import MarkerTrack
from markertrack.tracking.tracker import Array, Mask
from swimbase.errors import ArgumentError

FASTEST_BEAT = 2.25  # Hz, of the trials to come; its second harmonic must survive smoothing as well
LONGEST_WINDOW = 501  # frames, for more than 4000 frames per second
LEAST_GAIN = 0.98  # of the beat and its second harmonic that smoothing has to leave
ORDER = 3  # of the local polynomials, and known samples on either side of a gap


def fill_gaps(track: MarkerTrack, longest: float = GAP_TIME) -> MarkerTrack:
    """Fills short gaps with a cubic through the samples around them, in the picture or in the pool.

    Not in the body frame, although the body moves less there: the frame stands on a head of 0.14 m, whose noise is four
    times as large at the tail tip. With 6 frames hidden from the published tracks the worst frame of a gap is off by
    1.3 to 3.6 mm at the tail tip this way, and by 5.0 to 8.5 mm in the body frame (`experiments/tracking_films.py
    gaps`). It also needs no head.

    Args:
        track: In pixels or meters. Samples with confidence 0 are gaps, wherever they are; so are short stretches of
            doubtful ones, and longer ones say nothing about others.
        longest: Longest gap that is filled: missing frames times the frame interval [s].

    Returns:
        The track with filled samples at the confidence that they had, NaN in longer gaps and in those at either end.

    Raises:
        ArgumentError: `longest` is no time.
    """
    if not (np.isfinite(longest) and longest >= 0):
        raise ArgumentError(f"longest is {longest} s; the longest gap to fill must be finite and at least 0")
    known = track.confidence >= DOUBTFUL
    positions = np.where(track.confidence[:, :, None] > 0, track.positions, np.nan)
    interval = float(np.median(np.diff(track.times)))
    limit = longest + 1.01 * interval  # from the last sample before a gap to the first after it
    for m in range(track.marker_count):
        _fill(track.times, positions[:, m], known[:, m], limit)
    return MarkerTrack(track.times, positions, track.confidence)


def _fill(times: Array, values: Array, known: Mask, limit: float) -> None:
    """Fills the gaps of one marker's positions (T, 2) whose neighbors are at most `limit` apart [s], in place."""
    seen = np.flatnonzero(known)
    for i in np.flatnonzero((np.diff(seen) > 1) & (np.diff(times[seen]) <= limit)):
        before, after = seen[max(i + 1 - ORDER, 0) : i + 1], seen[i + 1 : i + 1 + ORDER]
        # samples beyond another long gap say nothing about this one
        before = before[times[before[-1]] - times[before] <= limit]
        after = after[times[after] - times[after[0]] <= limit]
        around, inside = np.concatenate([before, after]), np.arange(before[-1] + 1, after[0])
        middle, degree = times[inside].mean(), min(ORDER, len(around) - 1)
        powers = np.vander((times[around] - middle) / limit, degree + 1)
        coefficients = np.linalg.lstsq(powers, values[around], rcond=None)[0]
        values[inside] = np.vander((times[inside] - middle) / limit, degree + 1) @ coefficients


def smooth(track: MarkerTrack, window: int | None = None) -> MarkerTrack:
    """Takes noise out with local cubics, fitted over time stamps that may be uneven (a Savitzky–Golay filter).

    Every stretch of a marker without a gap is smoothed by itself; at its ends the window lies to one side. A stretch
    shorter than the window stays as it is, and so do doubtful samples.

    Args:
        track: In pixels or meters.
        window: Frames that a cubic is fitted to, odd and at least 5; 1 for no smoothing; None for `beat_window`.

    Raises:
        ArgumentError: The window is even or too short.
    """
    size = beat_window(1.0 / float(np.median(np.diff(track.times)))) if window is None else _checked(window)
    if size == 1:
        return track
    positions = track.positions.copy()
    for m in range(track.marker_count):
        for start, stop in runs(track.confidence[:, m] >= DOUBTFUL):
            if stop - start >= size:
                kernels, first = _kernels(track.times[start:stop], size)
                samples = track.positions[start:stop, m][first[:, None] + np.arange(size)]
                positions[start:stop, m] = np.einsum("nk,nkd->nd", kernels, samples)
    return MarkerTrack(track.times, positions, track.confidence)


def beat_gain(window: int, fps: float, frequency: float) -> float:
    """Share of an oscillation that smoothing leaves, 1 for all of it.

    Args:
        window: As for `smooth`.
        fps: Frames a second.
        frequency: Frequency of the oscillation [Hz].
    """
    size = _checked(window)
    if not (np.isfinite(fps) and fps > 0):
        raise ArgumentError(f"fps is {fps}; it must be finite and above 0")
    if size == 1:
        return 1.0
    offsets = np.arange(size) - size // 2
    kernel = _kernels(offsets.astype(float), size, slice(size // 2, size // 2 + 1))[0][0]
    return float(kernel @ np.cos(2 * np.pi * frequency * offsets / fps))


def beat_window(fps: float, frequency: float = FASTEST_BEAT) -> int:
    """The longest window that leaves at least 98 % of a beat and of its second harmonic; 1 where none does.

    At 2.25 Hz: 7 frames at 60 fps, which halves the noise nearly (0.58) and leaves 99.9 and 98.1 %; none at 30 fps.

    Args:
        fps: Frames a second.
        frequency: Frequency of the beat [Hz].
    """
    best = 1
    for size in range(ORDER + 2, max(ORDER + 3, min(int(fps), LONGEST_WINDOW + 1)), 2):
        if min(beat_gain(size, fps, frequency), beat_gain(size, fps, 2 * frequency)) < LEAST_GAIN:
            break
        best = size
    return best


def _kernels(times: Array, size: int, which: slice = slice(None)) -> tuple[Array, NDArray[np.int64]]:
    """Weights (N, size) that give the local cubic's value at time stamps, and the first sample of each window."""
    count = len(times)
    first = np.clip(np.arange(count) - size // 2, 0, count - size)[which]
    offsets = times[first[:, None] + np.arange(size)] - times[which, None]
    powers = (offsets / (times[-1] - times[0]) * (count - 1) / size)[:, :, None] ** np.arange(ORDER + 1)
    return np.linalg.pinv(powers)[:, 0], first


def _checked(window: int) -> int:
    if window != 1 and (window < ORDER + 2 or window % 2 == 0):
        raise ArgumentError(f"window is {window} frames; it must be odd and at least {ORDER + 2}, or 1 for none")
    return int(window)
