"""What a track probably is when it can't be the robot's: in another unit, of another order or rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swim2real.errors import TrialError
from swim2real.trials.trial import MarkerTrack, Trial

Array = NDArray[np.float64]

MOST_OFF = 5.0  # times larger or smaller than the robot, which no camera file is off by
UNITS = {1e3: "millimeters", 1e2: "centimeters", 39.37: "inches", 1e-3: "kilometers"}  # of which a meter has so many
_CLOSE = 1.6  # times, within which a factor is taken for a unit's
_BETTER = 0.5  # of the misfit of one order that the other order must come below
_NOTABLE = 0.04  # of the robot's length, below which spacings fit either way
_SLOWEST, _FASTEST = 0.6, 1.2  # of its nominal frequency, at which a motor under load turns
_SAMPLES = 200  # frames that are looked at
_MOST_PAIRS = 500


def another_unit(track: MarkerTrack, rest: Array) -> str | None:
    """What is wrong with the size of a track; None where it could be the robot's.

    Args:
        track: Track of the robot's markers [m].
        rest: Positions of the markers at rest [m]. Shape (M, 2).

    Returns:
        The end of a sentence that begins with the trial.
    """
    ratios = _ratios(track, rest)
    if not len(ratios):
        return None
    factor = float(np.median(ratios))
    if 1 / MOST_OFF <= factor <= MOST_OFF:
        return None
    unit = min(UNITS, key=lambda known: abs(np.log(factor / known)))
    if 1 / _CLOSE < factor / unit < _CLOSE:
        return (
            f"its markers are {factor:.3g} times as far apart as the robot's: that looks like {UNITS[unit]}; "
            f"tracks are in meters"
        )
    return (
        f"its markers are {factor:.3g} times as far apart as the robot's; give positions in meters, and check the "
        f"camera file's lengths, or the robot file's model"
    )


def other_order(track: MarkerTrack, rest: Array, names: tuple[str, ...]) -> str | None:
    """Whether the markers of a chain fit the robot from its end to its beginning, and not as they are.

    Args:
        track: Track of the robot's markers [m].
        rest: Positions of the markers at rest [m]. Shape (M, 2).
        names: Their names.

    Returns:
        The end of a sentence that begins with the trial; None where nothing speaks for it.
    """
    if len(names) < 3:
        return None
    seen = _frames(track)
    spacing = _median(np.linalg.norm(np.diff(seen, axis=1), axis=2))
    wanted = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    if not np.isfinite(spacing).all() or not spacing.sum() > 0:
        return None
    scaled = spacing * wanted.sum() / spacing.sum()
    given, turned = (float(np.abs(scaled - one).mean()) for one in (wanted, wanted[::-1]))
    if given < _NOTABLE * wanted.sum() or turned > _BETTER * given:
        return None
    return (
        f"its markers fit the robot in the other order, from {names[-1]} to {names[0]}; click, or name, "
        f"{names[0]} first"
    )


def check_plausible(trial: Trial, rest: Array, names: tuple[str, ...]) -> None:
    """Refuses a trial that can't be the robot's, and says what it probably is.

    Args:
        trial: Real trial.
        rest: Positions of the robot's markers at rest [m]. Shape (M, 2).
        names: Their names.

    Raises:
        TrialError: It is in another unit, or its markers are in the other order.
    """
    wrong = another_unit(trial.track, rest) or other_order(trial.track, rest, names)
    if wrong is not None:
        raise TrialError(f"trial '{trial.name}': {wrong}")


def doubled_rate(frequency: float, nominal: float | None) -> str | None:
    """Whether a beat is faster than the motor was set to, or half as fast: a loaded motor only lags.

    Args:
        frequency: Frequency of the beat [Hz].
        nominal: Frequency that the motor was set to [Hz]; None where nobody wrote it down.
    """
    if not nominal or _SLOWEST < frequency / nominal < _FASTEST:
        return None
    return (
        f"it beats at {frequency:.3g} Hz, {frequency / nominal:.2g} times its nominal {nominal:g} Hz: that looks like "
        f"a frame rate that is off (often by two: --fps, or a film that was made slower or faster)"
    )


def _ratios(track: MarkerTrack, rest: Array) -> Array:
    """Distances of pairs of markers, as a share of those at rest. Shape (K,)."""
    first, second = np.triu_indices(len(rest), 1)
    known = np.linalg.norm(rest[first] - rest[second], axis=1)
    pairs = np.argsort(-known, kind="stable")[:_MOST_PAIRS]
    pairs = pairs[known[pairs] > 0]
    seen = _frames(track)
    apart = _median(np.linalg.norm(seen[:, first[pairs]] - seen[:, second[pairs]], axis=2))
    ratios = apart / known[pairs]
    return ratios[np.isfinite(ratios) & (ratios > 0)]


def _frames(track: MarkerTrack) -> Array:
    """Some frames, all over the track. Shape (K, M, 2)."""
    return track.positions[:: max(1, track.frame_count // _SAMPLES)]


def _median(values: Array) -> Array:
    """Over time, NaN for what isn't known in any frame. Shape (T, K) to (K,)."""
    out = np.full(values.shape[1], np.nan)
    some = np.isfinite(values).any(axis=0)
    out[some] = np.nanmedian(values[:, some], axis=0)
    return out
