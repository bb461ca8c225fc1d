"""Swimming kinematics of places along a body: beat, amplitudes, body wave and speed, each with its standard error.

As fishmechr (Tytell) defines them. The body's center and the axis of swimming are running means over a beat; a place's
excursion is its distance to the side of them, its amplitude half the way from one side to the other. The wavelength
follows from the phases along the body, the wave's speed is frequency times wavelength, and the Strouhal number is
frequency times twice the tail's amplitude by the speed. All are fitted to each beat by itself; what beats differ by
gives the standard errors.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from markertrack.layout import Layout
from markertrack.quality import DOUBTFUL
from markertrack.track import MarkerTrack
from swimbase.arrays import Array, Mask
from swimbase.errors import TrackingError

LEAST_BEATS = 2  # whole ones that errors take
LEAST_EXPLAINED = 0.5  # of the excursions' variance that one frequency must explain
FINENESS = 4  # frequencies that are tried for each that can be told apart
SURE = 3.0  # standard errors above which a speed is one
LEAST_KNOWN = 0.8  # of the frames of a beat in which a place must be known


@dataclass(frozen=True)
class Estimate:
    """A value and its standard error, NaN where it can't be told."""

    value: float
    error: float

    def __str__(self) -> str:
        return "–" if not np.isfinite(self.value) else f"{self.value:.3g} ± {self.error:.1g}"


@dataclass(frozen=True)
class Kinematics:
    """Kinematics of a swimmer.

    Attributes:
        beats: Number of whole beats that they are of.
        length: Length from the first to the last marker at rest [m].
        frequency: Frequency of the beat [Hz].
        wavelength: Length of the body's wave [lengths].
        wave_speed: Speed of the body's wave along the body [lengths/s].
        speed: Speed ahead, against the ground [lengths/s].
        strouhal: Strouhal number; NaN where the swimmer holds station.
        amplitudes: Amplitude of each marker [lengths]. Shape (M,).
    """

    beats: int
    length: float
    frequency: Estimate
    wavelength: Estimate
    wave_speed: Estimate
    speed: Estimate
    strouhal: Estimate
    amplitudes: tuple[Estimate, ...]

    def table(self, names: tuple[str, ...]) -> list[tuple[str, str, Estimate]]:
        """Names, units and values of all quantities; `names` are those of the markers."""
        rows = [
            ("beat frequency", "Hz", self.frequency), ("wavelength", "lengths", self.wavelength),
            ("wave speed", "lengths/s", self.wave_speed), ("speed", "lengths/s", self.speed),
            ("Strouhal number", "1", self.strouhal),
        ]  # fmt: skip
        return rows + [(f"amplitude {name}", "lengths", one) for name, one in zip(names, self.amplitudes, strict=True)]

    def to_csv(self, trial: str, names: tuple[str, ...], header: bool = True) -> str:
        """Rows of a CSV table with columns trial, quantity, unit, value and standard_error."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        if header:
            rows.writerow(("trial", "quantity", "unit", "value", "standard_error"))
        for quantity, unit, one in self.table(names):
            rows.writerow((trial, quantity, unit, f"{one.value:.6g}", f"{one.error:.3g}"))
        return text.getvalue()


def swimming_kinematics(track: MarkerTrack, layout: Layout) -> Kinematics:
    """Kinematics of a track whose markers stand in a row, from head to tail.

    Args:
        track: In meters. Lost and doubtful positions are left out.
        layout: The markers.

    Raises:
        TrackingError: The markers stand in no row, or there are too few beats, or none.
    """
    places = layout.places_along
    length = float(np.hypot(*np.diff(layout.rest, axis=0).T).sum())
    known = np.isfinite(track.positions).all(axis=2) & (track.confidence >= DOUBTFUL)
    times, positions = track.times - track.times[0], np.where(known[:, :, None], track.positions, np.nan) / length
    often = known.mean(axis=0) > LEAST_KNOWN
    whole = known[:, often].all(axis=1)
    if whole.sum() < 8 or not often[-1]:
        raise TrackingError(f"the whole body is seen in {int(whole.sum())} frames; kinematics take more, with the tail")
    center = _filled(times, positions[:, often].mean(axis=1))
    ends = _filled(times, positions[:, 0] - positions[:, -1])
    excursions = _sideways(positions, center, ends, np.inf)
    frequency = _frequency(times[whole], excursions[whole][:, often])
    for _ in range(2):  # with means over a beat instead of over the whole film
        beat = 1 / frequency / float(np.median(np.diff(times)))
        excursions = _sideways(positions, center, ends, beat)
        frequency = _frequency(times[whole], excursions[whole][:, often])
    beats = int(times[-1] * frequency)
    if beats < LEAST_BEATS:
        raise TrackingError(f"there are {times[-1] * frequency:.1f} beats; standard errors take {LEAST_BEATS} at least")
    return _of_beats(times, excursions, known, center, ends, places, length, frequency, beats)


def _of_beats(
    times: Array, excursions: Array, known: Mask, center: Array, ends: Array, places: Array, length: float,
    frequency: float, beats: int,
) -> Kinematics:  # fmt: skip
    """Means over beats and their standard errors."""
    waves = np.full((beats, len(places)), np.nan, dtype=complex)
    speeds = np.full(beats, np.nan)
    for k in range(beats):
        part = (times >= k / frequency) & (times < (k + 1) / frequency)
        for m in np.flatnonzero(known[part].mean(axis=0) > LEAST_KNOWN).tolist():
            inside = part & known[:, m]
            cosine, sine = np.linalg.lstsq(_basis(times[inside], frequency), excursions[inside, m])[0][:2]
            waves[k, m] = complex(cosine, -sine)
        way = center[part][-1] - center[part][0]
        ahead = ends[part].mean(axis=0)
        speeds[k] = way @ ahead / np.hypot(*ahead) / (times[part][-1] - times[part][0])
    turns = np.angle(np.nansum(waves[1:] * waves[:-1].conj(), axis=1))
    frequencies = frequency * (1 + turns / (2 * np.pi))
    lengths = np.array([_wavelength(places, wave) for wave in waves])
    tails = 2 * np.abs(waves[:, -1])
    beat, wavelength, speed, width = (_mean(one) for one in (frequencies, lengths, speeds, tails))
    beat = Estimate(frequency, beat.error)
    moves = speed.value > SURE * speed.error and speed.value > 0
    strouhal = _product(beat, width, (1 if moves else np.nan, speed))
    return Kinematics(
        beats, length, beat, wavelength, _product(beat, wavelength), speed, strouhal,
        tuple(_mean(np.abs(waves[:, m])) for m in range(len(places))),
    )  # fmt: skip


def _wavelength(places: Array, wave: Array) -> float:
    """Wavelength by the phases along the body, weighted by the squares of amplitudes [lengths]."""
    seen = np.isfinite(wave)
    if seen.sum() < 3:
        return float("nan")
    weights, at = np.abs(wave[seen]), places[seen]
    slope = np.polyfit(at, np.unwrap(np.angle(wave[seen])), 1, w=weights)[0]
    return float(-2 * np.pi / slope)


def _sideways(positions: Array, center: Array, ends: Array, window: float) -> Array:
    """Distances to the left of the axis of swimming, through means over a window of frames. Shape (T, M)."""
    axis = _running(ends, window)
    left = axis[:, ::-1] * [-1.0, 1.0] / np.hypot(*axis.T)[:, None]
    return ((positions - _running(center, window)[:, None]) * left[:, None]).sum(axis=2)


def _running(values: Array, window: float) -> Array:
    """Means over a window; near the ends, where it would be cut, straight on from there. Shape (T, 2)."""
    half = int(np.ceil((min(window, len(values)) - 1) / 2))
    kernel = np.ones(2 * half + 1)
    kernel[[0, -1]] = (window - (2 * half - 1)) / 2 if half else 1.0
    if len(values) < 2 * half + 3:
        return np.repeat(values.mean(axis=0)[None], len(values), axis=0)
    inner = np.stack([np.convolve(one, kernel / kernel.sum(), "valid") for one in values.T], axis=1)
    t, count = np.arange(len(values)), min(len(inner), max(half, 2))
    out = np.empty_like(values)
    out[half : half + len(inner)] = inner
    last = half + len(inner)
    for part, fitted in ((t[:half], slice(half, half + count)), (t[last:], slice(last - count, last))):
        out[part] = np.stack([np.polyval(np.polyfit(t[fitted], out[fitted, k], 1), part) for k in (0, 1)], axis=1)
    return out


def _filled(times: Array, values: Array) -> Array:
    """Values (T, 2), straight between those that are known."""
    seen = np.isfinite(values[:, 0])
    return np.stack([np.interp(times, times[seen], values[seen, k]) for k in (0, 1)], axis=1)


def _frequency(times: Array, excursions: Array) -> float:
    """Frequency of the one sine that, beside a course that turns steadily, explains most of excursions (K, N) [Hz]."""
    course = np.linalg.qr(np.vander(times - times.mean(), 3))[0]
    excursions = excursions - course @ (course.T @ excursions)
    total = float((excursions**2).sum())

    def left(frequency: float) -> float:
        beat = _basis(times, frequency)[:, :2]
        beat = beat - course @ (course.T @ beat)
        return float(((excursions - beat @ np.linalg.lstsq(beat, excursions)[0]) ** 2).sum()) / total

    seconds = float(times[-1] - times[0])
    slowest, fastest = 1 / seconds, 0.45 / float(np.median(np.diff(times)))
    grid = np.linspace(slowest, fastest, max(8, round(FINENESS * seconds * (fastest - slowest))))
    best = int(np.argmin([left(frequency) for frequency in grid]))
    step = grid[1] - grid[0]
    fit = minimize_scalar(left, bounds=(grid[best] - step, grid[best] + step), method="bounded")
    if not float(fit.fun) < 1 - LEAST_EXPLAINED:
        raise TrackingError(
            f"there is no regular beat: the best one, at {float(fit.x):.3g} Hz, explains "
            f"{100 * (1 - float(fit.fun)):.0f} % of the body's motion to the side; "
            f"{100 * LEAST_EXPLAINED:.0f} % are needed"
        )
    return float(fit.x)


def _basis(times: Array, frequency: float) -> Array:
    angles = 2 * np.pi * frequency * times
    return np.stack([np.cos(angles), np.sin(angles), np.ones_like(times)], axis=1)


def _mean(values: Array) -> Estimate:
    seen = values[np.isfinite(values)]
    if not len(seen):
        return Estimate(float("nan"), float("nan"))
    error = float(seen.std(ddof=1) / np.sqrt(len(seen))) if len(seen) > 1 else float("nan")
    return Estimate(float(seen.mean()), error)


def _product(first: Estimate, second: Estimate, by: tuple[float, Estimate] = (1.0, Estimate(1.0, 0.0))) -> Estimate:
    """Product of two estimates, by a third one, and its error."""
    share, divisor = by
    value = share * first.value * second.value / divisor.value
    errors = [one.error / one.value for one in (first, second, divisor)]
    return Estimate(value, float(abs(value) * np.hypot(np.hypot(errors[0], errors[1]), errors[2])))
