"""Finds lost tracks: markers that collapse onto a neighbor, leave their place along the body, jump or freeze.

However a swimmer bends, its markers keep their order and spacing along the body, so the spacing tells which of them is
wrong: a lost marker disagrees with many others, a good one only with the lost ones. What the spacing should be is taken
from the trial itself, since markers are placed by hand, and checked against the robot's own rest lengths. A track that
can't be the robot's is named as what it probably is: in another unit, of another order or rate.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markertrack.layout import Layout
from markertrack.track import MarkerTrack
from markertrack.tracking.tracker import EVEN, Array, Mask
from swimbase.errors import TrialError

REASONS = ("missing", "collapsed", "misplaced", "jumped", "frozen", "doubtful")
DOUBTFUL = 0.5  # confidence below which a marker's position isn't believed
COLLAPSE_SHARE = 0.4  # of the distance that two neighbors should keep; it can't change by the rest from frame to frame
BEND_SHARE = 0.12  # by which a spacing along the bending body may change
PLACE_TOLERANCE = 0.010  # m, on top of it; that a marker jumps beyond what others do, or others move while it is frozen
STRAY_DISTANCE = 0.04  # m by which two markers may be farther apart than they should, on top of BEND_SHARE
DRIFT_DISTANCE = 0.022  # m by which a spacing may differ from the first frame's for good: bending there, parallax later
FREEZE_TIME = 0.15  # s without moving at all
GAP_TIME = 0.1  # s of a gap that can be filled, a fifth of a beat at 2.25 Hz; between two losses that is lost as well
MOST_NAMED = 10  # lost markers with a sentence each; of more the worst are named in one
SUDDEN = 8.0  # times a usual step, or a change of one, above which a marker or a body jumped
MOST_PAIRS = 20_000_000  # pairs of markers times frames: an hour at 60 frames per second with 9 markers
_START_FRAMES = 5
MOST_OFF = 5.0  # times larger or smaller than the robot, which no camera file is off by
UNITS = {1e3: "millimeters", 1e2: "centimeters", 39.37: "inches", 1e-3: "kilometers"}  # of which a meter has so many
_CLOSE = 1.6  # times, within which a factor is taken for a unit's
_NOTABLE = 0.04  # of the robot's length, below which spacings fit either way
_SLOWEST, _FASTEST = 0.6, 1.2  # of its nominal frequency, at which a motor under load turns
SAMPLES = 200  # frames, and pairs of markers, that are looked at
USABLE_SHARE = 0.05  # of frames that a marker may be lost for, and by which the head's length may vary, in a good trial


@dataclass(frozen=True)
class LostMarkers:
    """Markers that are lost in one track, and why.

    Attributes:
        lost: True where a marker must not be scored. Shape (T, M).
        reasons: Number of frames per reason and marker, in the order of `REASONS`. Shape (6, M).
    """

    lost: Mask
    reasons: NDArray[np.int64]

    @property
    def weights(self) -> Array:
        """1 where a marker counts. Shape (T, M)."""
        return (~self.lost).astype(float)

    @property
    def lost_share(self) -> Array:
        """Share of frames for which each marker is lost. Shape (M,)."""
        return self.lost.mean(axis=0)

    @property
    def left_out_share(self) -> float:
        """Share of all marker-frames that is left out; 0 where there are no markers."""
        return float(self.lost.mean()) if self.lost.size else 0.0

    def lost_markers(self, allowed: float = USABLE_SHARE) -> tuple[int, ...]:
        """Indices of the markers that are lost for more than the allowed share of frames."""
        return tuple(int(m) for m in np.flatnonzero(self.lost_share > allowed))

    @property
    def usable(self) -> bool:
        """True if the trial can be used as it is, without weights."""
        return not self.lost_markers()

    def findings(self, names: tuple[str, ...]) -> list[str]:
        """A sentence for each thing that a person should know."""
        shares: list[float] = self.lost_share.tolist()
        lost = [m for m, share in enumerate(shares) if share > 0]
        if len(lost) <= MOST_NAMED:
            return [
                f"{names[m]} is lost in {_percent(shares[m])} of frames ({_listed(self.reasons[:, m])})" for m in lost
            ]
        first, *others = sorted(lost, key=lambda m: -shares[m])
        named = [f"{names[m]} {_percent(shares[m])}" for m in others[: MOST_NAMED - 1]]
        return [
            f"{len(lost)} of {len(names)} markers are lost in some frames; the worst: {names[first]} in "
            f"{_percent(shares[first])} of frames, {', '.join(named)}; of all, marker-frames: "
            f"{_listed(self.reasons.sum(axis=1))}"
        ]


@dataclass(frozen=True)
class TrackQuality(LostMarkers):
    """Quality of one track of a swimmer.

    Attributes:
        head_spread: Relative standard deviation of the head's length, a measure of scale and jitter.
        body_spread: Relative standard deviation of the body's length, first to last marker.
    """

    head_spread: float
    body_spread: float

    @property
    def weights(self) -> Array:
        """1 where a marker counts; 0 where it or the head, on which the body frame stands, is lost. Shape (T, M)."""
        return (~(self.lost | self.lost[:, :2].any(axis=1, keepdims=True))).astype(float)

    def findings(self, names: tuple[str, ...]) -> list[str]:
        sentences = super().findings(names)
        if self.head_spread > USABLE_SHARE:
            sentences.append(f"the head's length varies by {100 * self.head_spread:.1f} %: the scale is doubtful")
        return sentences


def _listed(counts: NDArray[np.int64]) -> str:
    """Reasons and how often each applies. Shape (6,)."""
    return ", ".join(f"{reason} {count}" for reason, count in zip(REASONS, counts, strict=True) if count)


def _percent(share: float) -> str:
    return "under 1 %" if share < 0.01 else f"{100 * share:.0f} %"


def check_lost(track: MarkerTrack, layout: Layout, midline: bool = False) -> LostMarkers:
    """Finds the lost markers of a track.

    Args:
        track: In meters; NaN is legal.
        layout: The markers: a chain is checked by its spacing, which makes a `TrackQuality`, others by rigid bodies.
        midline: Whether they are places along a midline, of which neither tells anything.

    Raises:
        TrialError: The track of a chain is too long.
    """
    if midline:
        return check_places(track)
    return check_track(track, layout.rest) if layout.chain else check_bodies(track, layout.bodies)


def check_bodies(track: MarkerTrack, bodies: Sequence[int]) -> LostMarkers:
    """Checks the track of a robot of rigid bodies: confidence, and markers that took another one's place.

    Markers of one body keep their distances, or change them slowly where it tilts; where one suddenly differs by a good
    part of the distance to the next marker, as few markers as possible are misplaced. A body of which all markers moved
    on by one place jumps.

    Args:
        track: Track of a recording; NaN is legal.
        bodies: Number of the rigid body that carries each marker. Shape (M,).
    """
    missing, doubtful = _missing_and_doubtful(track)
    positions = np.where((missing | doubtful)[:, :, None], np.nan, track.positions)
    misplaced, jumped = np.zeros_like(missing), np.zeros_like(missing)
    for body in set(bodies):
        markers = np.flatnonzero(np.asarray(bodies) == body)
        if len(markers) > 1:
            misplaced[:, markers] = _swapped(positions[:, markers])
            jumped[:, markers] = _jumped_together(positions[:, markers])[:, None]
    jumped &= ~(missing | doubtful | misplaced)
    none = np.zeros_like(missing)
    return LostMarkers(
        missing | doubtful | misplaced | jumped, _counted(missing, none, misplaced, jumped, none, doubtful)
    )


def check_places(track: MarkerTrack) -> TrackQuality:
    """Checks a track of places along a midline, whose distances say nothing: they were put there.

    Length, area and the head's jumps are in the confidence, so what is doubtful or missing is lost.

    Args:
        track: In meters; NaN is legal.
    """
    missing, doubtful = _missing_and_doubtful(track)
    none, lost = np.zeros_like(missing), missing | doubtful
    spreads = [
        _spread(np.linalg.norm(track.positions[:, 0] - track.positions[:, other], axis=1), lost[:, 0] | lost[:, other])
        for other in (min(1, track.marker_count - 1), -1)
    ]
    return TrackQuality(lost, _counted(missing, none, none, none, none, doubtful), *spreads)


def _swapped(positions: Array) -> Mask:
    """Markers of one body whose distances from the others changed suddenly. Shape (T, M)."""
    distances = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3)  # (T, M, M)
    last = _median(distances[:_START_FRAMES])
    limit = (1 - COLLAPSE_SHARE) * np.nanmin(np.where(np.eye(len(last), dtype=bool), np.inf, last))
    out = np.zeros(positions.shape[:2], dtype=bool)
    for t, now in enumerate(distances):
        with np.errstate(invalid="ignore"):
            wrong = np.abs(now - last) > limit
        while wrong.any():
            worst = int(np.argmax(wrong.sum(axis=1)))
            out[t, worst] = True
            wrong[worst], wrong[:, worst] = False, False
        known = np.isfinite(now) & ~out[t] & ~out[t][:, None]
        last = np.where(known, now, last)
    return out


def _jumped_together(positions: Array) -> Mask:
    """Frames in which a whole body is away by about the distance of two markers, from jump to jump. Shape (T,)."""
    first = _median(positions[:_START_FRAMES])
    apart = np.linalg.norm(first[:, None] - first, axis=2)
    limit = (1 - COLLAPSE_SHARE) * float(np.nanmin(np.where(np.eye(len(first), dtype=bool), np.inf, apart)))
    out = np.zeros(len(positions), dtype=bool)
    steps = _median(np.diff(positions, axis=0).swapaxes(0, 1))  # of markers that are seen in both frames, (T - 1, 2)
    change = np.linalg.norm(np.diff(steps, axis=0), axis=1)  # (T - 2,)
    with np.errstate(invalid="ignore"):
        sudden = np.flatnonzero(change > max(limit, SUDDEN * float(np.nan_to_num(_median(change))))) + 2
    # one that is pushed goes on; one that only seems to jump changes its step twice
    begins = [int(t) for t in sudden if t + 1 in sudden and t - 1 not in sudden]
    for start, stop in zip(begins[::2], begins[1::2], strict=False):
        out[start:stop] = True
    return out


def check_track(track: MarkerTrack, rest_markers: Array) -> TrackQuality:
    """Checks one track against the robot's skeleton.

    Positions that weren't seen (confidence 0, such as those that `fill_gaps` makes up) or are doubted (confidence below
    `DOUBTFUL`) are lost, and say nothing about the others.

    Args:
        track: Track of a real swim; NaN is legal.
        rest_markers: Marker positions of the straight robot [m]. Shape (M, 2).

    Raises:
        TrialError: The track is too long.
    """
    if track.frame_count * track.marker_count**2 > MOST_PAIRS:
        raise TrialError(
            f"a track of {track.frame_count} frames with {track.marker_count} markers is too long to be checked; at "
            f"most {MOST_PAIRS // track.marker_count**2} frames are: cut it with `swim2real cut`"
        )
    missing, doubtful = _missing_and_doubtful(track)
    missing |= doubtful
    track = MarkerTrack(track.times, np.where(missing[:, :, None], np.nan, track.positions), track.confidence)
    positions = track.positions
    distances = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3)  # (T, M, M)
    places = _places(track)
    rest = np.linalg.norm(rest_markers[:, None] - rest_markers[None], axis=2)
    start = _first_intact(distances, rest)
    spacings = places[:, None, :] - places[:, :, None]
    if start is None:  # judged by the robot's rest lengths alone
        expected, spacing = rest, rest_markers[None, :, 0] - rest_markers[:, None, 0]
    else:
        expected, spacing = _usual(distances, start), _usual(spacings, start)
    interval = float(np.median(np.diff(track.times)))

    with np.errstate(invalid="ignore"):
        close = (distances < COLLAPSE_SHARE * expected) & ~np.eye(len(expected), dtype=bool)
    misplaced = _misplaced(spacings, spacing, distances, expected, missing, close)
    collapsed = misplaced & close.any(axis=2)
    frozen = _frozen(track, interval)
    jumped = _jumped(track, interval, misplaced | frozen | missing)
    lost = missing | misplaced | frozen | jumped
    lost = _join(lost, max(1, _frames(GAP_TIME, interval, lost)))

    return TrackQuality(
        lost=lost,
        reasons=_counted(missing & ~doubtful, collapsed, misplaced & ~collapsed, jumped, frozen, doubtful),
        head_spread=_spread(distances[:, 0, 1], lost[:, 0] | lost[:, 1]),
        body_spread=_spread(distances[:, 0, -1], lost[:, 0] | lost[:, -1]),
    )


def _counted(*kinds: Mask) -> NDArray[np.int64]:
    """Frames per reason and marker. Shape (6, M)."""
    return np.array([kind.sum(axis=0) for kind in kinds], dtype=np.int64)


def _missing_and_doubtful(track: MarkerTrack) -> tuple[Mask, Mask]:
    """Masks of markers without a position, and of those whose position is doubtful. Each of shape (T, M)."""
    missing = ~np.isfinite(track.positions).all(axis=2) | (track.confidence <= 0)
    return missing, ~missing & (track.confidence < DOUBTFUL)


def _median(values: Array) -> Array:
    """Median over the first axis without the NaNs; NaN where there is nothing else, as for a marker never seen."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmedian(values, axis=0)


def _spread(lengths: Array, lost: Mask) -> float:
    good = lengths[~lost & np.isfinite(lengths)]
    return float(good.std() / good.mean()) if good.size > 1 else float("nan")


def _places(track: MarkerTrack) -> Array:
    """Coordinate of each marker along the trial's mean body, head to tail [m]. Shape (T, M).

    The line through the two head markers may be off the body's axis, so the axis is taken to the last marker.
    """
    body = track.body
    axis = _median(body[:, -1])
    length = np.linalg.norm(axis)
    return body @ (axis / length if length > 0 else np.array([1.0, 0.0]))


def _first_intact(distances: Array, rest: Array) -> int | None:
    """The first frame with all markers and no collapse: trackers start by hand, so early frames show what was meant."""
    neighbors = np.array([[i, i + 1] for i in range(len(rest) - 1)])
    gaps = distances[:, neighbors[:, 0], neighbors[:, 1]]
    intact = (gaps > COLLAPSE_SHARE * rest[neighbors[:, 0], neighbors[:, 1]]).all(axis=1)
    frames = np.flatnonzero(intact & np.isfinite(distances).all(axis=(1, 2)))
    return int(frames[0]) if frames.size else None


def _usual(lengths: Array, start: int) -> Array:
    """Usual length between two markers: its median, unless that is far from where it started. (M, M)."""
    middle = _median(lengths)
    drift = np.abs(middle) - np.abs(lengths[start])
    shrunk = drift < -(1 - COLLAPSE_SHARE) / 2 * np.abs(lengths[start])  # half way to a collapse
    return np.where((np.abs(middle - lengths[start]) <= DRIFT_DISTANCE) & ~shrunk, middle, lengths[start])


def _misplaced(spacings: Array, spacing: Array, distances: Array, expected: Array, missing: Mask, close: Mask) -> Mask:
    """Markers that have to go until the rest agree with one another. Shape (T, M).

    Two markers agree when their spacing along the body or their distance is as usual (a tail that swings out keeps its
    distance, one that is placed off the axis its spacing). In each frame the marker with the largest disagreement goes
    first; of two that collapsed it is the one that fits the others worse.
    """
    with np.errstate(invalid="ignore"):
        along = np.abs(spacings - spacing) - BEND_SHARE * np.abs(spacing)
        apart = np.abs(distances - expected) - BEND_SHARE * expected
        stray = distances - (1 + BEND_SHARE) * expected > STRAY_DISTANCE
        off = np.where(stray, apart, np.minimum(along, apart))
        wrong = (off > PLACE_TOLERANCE) | close
    badness = np.where(wrong, np.maximum(np.nan_to_num(off), 1e-3), 0.0)
    slack = np.nan_to_num(off)
    out = missing.copy()
    for t in np.flatnonzero(wrong.any(axis=(1, 2))):
        left = ~out[t]
        while (pairs := wrong[t] & left[:, None] & left).any():
            # of two that disagree the one with less slack; only of those that are left, or it would never end
            tie = 1e-3 * (slack[t] * (left[:, None] & left)).sum(axis=1)
            left[int(np.argmax(np.where(left, (badness[t] * pairs).sum(axis=1) + tie, -np.inf)))] = False
        out[t] = ~left
    return out & ~missing


def _frozen(track: MarkerTrack, interval: float) -> Mask:
    """Markers that stand still to the last digit while the others move on. Shape (T, M)."""
    still = np.zeros(track.positions.shape[:2], dtype=bool)
    with np.errstate(invalid="ignore"):
        still[1:] = (np.diff(track.positions, axis=0) == 0).all(axis=2)
    frozen, least = np.zeros_like(still), max(2, _frames(FREEZE_TIME, interval, still))
    for m in np.flatnonzero(still.any(axis=0)):
        for start, stop in runs(still[:, m]):
            travel = np.linalg.norm(track.positions[stop - 1] - track.positions[max(start - 1, 0)], axis=1)
            if stop - start >= least and _median(np.delete(travel, m)) > PLACE_TOLERANCE:
                frozen[start:stop, m] = True
    return frozen


def _jumped(track: MarkerTrack, interval: float, known: Mask) -> Mask:
    """Frames beside a step that is far longer than what the neighbors do. Shape (T, M)."""
    steps = np.full(track.positions.shape[:2], np.nan)
    steps[1:] = np.linalg.norm(np.diff(track.body, axis=0), axis=2)
    steps[1:][known[1:] | known[:-1]] = np.nan
    usual = _median(steps)
    limit = np.maximum(PLACE_TOLERANCE * max(1.0, 60 * interval), SUDDEN * np.nan_to_num(usual))
    with np.errstate(invalid="ignore"):
        return steps > limit


def _frames(seconds: float, interval: float, mask: Mask) -> int:
    """Number of frames in a time; one more than there are, where it is longer than all of them."""
    return round(min(seconds / interval, len(mask) + 1))


def _join(lost: Mask, frames: int) -> Mask:
    """Closes gaps of at most so many frames between two losses of a marker."""
    out = lost.copy()
    for m in np.flatnonzero(lost.any(axis=0)):
        for start, stop in runs(~lost[:, m]):
            if start > 0 and stop < len(lost) and stop - start <= frames:
                out[start:stop, m] = True
    return out


def runs(mask: Mask) -> NDArray[np.int64]:
    """Stretches of true values: first frame, and first frame after it. Shapes (T,), (R, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]]))).reshape(-1, 2)


def _another_unit(track: MarkerTrack, rest: Array) -> str | None:
    """Error in the size of a track, in a sentence; None if it could be the robot's.

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


def _other_order(track: MarkerTrack, rest: Array, names: tuple[str, ...]) -> str | None:
    """Doubt that the markers of a chain are in reverse order, in a sentence; None if they fit the robot as they are.

    Args:
        track: Track of the robot's markers [m].
        rest: Positions of the markers at rest [m]. Shape (M, 2).
        names: Their names.

    Returns:
        The end of a sentence that begins with the trial; None where nothing speaks for it.
    """
    if len(names) < 3:
        return None
    seen = _sampled(track)
    spacing = _median(np.linalg.norm(np.diff(seen, axis=1), axis=2))
    wanted = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    if not np.isfinite(spacing).all() or not spacing.sum() > 0:
        return None
    scaled = spacing * wanted.sum() / spacing.sum()
    given, turned = (float(np.abs(scaled - one).mean()) for one in (wanted, wanted[::-1]))
    if given < _NOTABLE * wanted.sum() or turned > EVEN * given:
        return None
    return (
        f"its markers fit the robot in the other order, from {names[-1]} to {names[0]}; click, or name, "
        f"{names[0]} first"
    )


def check_plausible(track: MarkerTrack, rest: Array, names: tuple[str, ...], name: str) -> None:
    """Refuses a track that can't be the body's, and says what it probably is.

    Args:
        track: Track of a real trial [m].
        rest: Positions of the body's markers at rest [m]. Shape (M, 2).
        names: Their names.
        name: Name of the trial, for the message.

    Raises:
        TrialError: It is in another unit, or its markers are in the other order.
    """
    wrong = _another_unit(track, rest) or _other_order(track, rest, names)
    if wrong is not None:
        raise TrialError(f"trial '{name}': {wrong}")


def doubled_rate(frequency: float, nominal: float | None) -> str | None:
    """Doubt that a beat is faster than the motor was set to, or half as fast: a loaded motor only lags.

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
    pairs = np.argsort(-known, kind="stable")[:SAMPLES]
    pairs = pairs[known[pairs] > 0]
    seen = _sampled(track)
    apart = _median(np.linalg.norm(seen[:, first[pairs]] - seen[:, second[pairs]], axis=2))
    ratios = apart / known[pairs]
    return ratios[np.isfinite(ratios) & (ratios > 0)]


def _sampled(track: MarkerTrack) -> Array:
    """Some frames, all over the track. Shape (K, M, 2)."""
    return track.positions[:: max(1, track.frame_count // SAMPLES)]
