"""Identifies what drove a trial from its own time base: beat frequency, phase and start speed, with uncertainty.

The tail's lateral motion in the body frame is fitted with a sine and its harmonics, all markers at one frequency
(variable projection: the amplitudes are linear, only the frequency is searched). Frequencies in file names or motor
commands are never used: in the published tracks the tail beats at 0.75 times the commanded frequency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from markertrack import frames
from markertrack.quality import TrackQuality
from markertrack.track import MarkerTrack
from markertrack.tracking.tracker import Array
from swim2real.trials.trial import Actuation
from swimbase.errors import TrialError

HARMONICS = 3
SLOWEST = 0.1  # Hz
FASTEST = 5.0  # Hz
LONG = 100.0  # s of a trial that are searched for the beat at first
LEAST_CYCLES = 1.0  # that a trial must show
LEAST_SHARE = 0.5  # of the lateral motion's variance that the fit must explain
_DECIMALS = 9  # so that a processor's last digits don't reach the simulation, which may amplify them


@dataclass(frozen=True)
class Beat:
    """Drive of a real trial.

    Attributes:
        frequency: Frequency of the tail's beat, one turn of the motor [Hz].
        frequency_std: Standard error of the frequency [Hz].
        phase: Phase of the last tail marker's fundamental at the first frame, as a cosine [rad].
        phase_std: Standard error of the phase [rad].
        start_speed: Forward speed over the first cycles [m/s].
        start_speed_std: Standard error of the speed [m/s].
        amplitude: Amplitude of the last tail marker's fundamental [m].
        explained: Share of the lateral motion's variance that the fit explains.
    """

    frequency: float
    frequency_std: float
    phase: float
    phase_std: float
    start_speed: float
    start_speed_std: float
    amplitude: float
    explained: float

    @property
    def actuation(self) -> Actuation:
        """A motor at this frequency, at angle 0 at the first frame; the true angle is found by alignment."""
        return Actuation(self.frequency, 0.0, max(self.start_speed, 0.0))


def identify_beat(track: MarkerTrack, tail_markers: tuple[int, ...], quality: TrackQuality, name: str = "") -> Beat:
    """Fits the beat of one track.

    Args:
        track: Track of a real swim.
        tail_markers: Indices of the markers to fit; the last one gives phase and amplitude.
        quality: Quality of the track; lost marker-frames are left out.
        name: Name of the trial, for messages.

    Raises:
        TrialError: No beat can be made out: less than a cycle, no motion, or nothing periodic.
    """
    times = track.times - track.times[0]
    body = track.body
    signals = [
        (times[good], body[good, m, 1])
        for m in tail_markers
        if np.count_nonzero(good := (quality.weights[:, m] > 0) & np.isfinite(body[:, m, 1])) > 2 * (2 * HARMONICS + 2)
    ]
    where = f"trial '{name}': " if name else ""
    if not signals:
        raise TrialError(f"{where}the tail markers are lost for nearly the whole trial, so no beat can be identified")
    span = max(t[-1] - t[0] for t, _ in signals)
    lowest = max(SLOWEST, LEAST_CYCLES / span)
    nyquist = 0.5 / float(np.median(np.diff(track.times)))
    highest = min(FASTEST, 0.5 * nyquist)
    total = sum(float(((y - y.mean()) ** 2).sum()) for _, y in signals)
    if lowest >= highest or total <= 0:
        raise TrialError(f"{where}{span:.2f} s of tail motion are too little to identify a beat")

    bounds = _peak(signals, span, lowest, highest)
    fit = minimize_scalar(_misfit, bounds=bounds, args=(signals, HARMONICS), method="bounded", options={"xatol": 1e-7})
    frequency, residual = round(float(fit.x), _DECIMALS), float(fit.fun)
    explained = 1 - residual / total
    if explained < LEAST_SHARE:
        raise TrialError(
            f"{where}no regular beat: the best sine, at {frequency:.3f} Hz, explains {100 * explained:.0f} % of the "
            f"tail's lateral motion; at least {100 * LEAST_SHARE:.0f} % are needed. Is the fish swimming?"
        )
    if frequency < (1 + 1e-3) * lowest:
        raise TrialError(
            f"{where}no whole beat: in {span:.2f} s the tail moves more slowly than the {lowest:.2f} Hz that can be "
            f"measured; give a longer trial"
        )
    frequency_std = _frequency_std(times, signals, frequency)
    t, y = signals[-1]
    coefficients, rest = _fit(t, y, frequency, HARMONICS)
    cosine, sine = coefficients[2], coefficients[3]
    amplitude = float(np.hypot(cosine, sine))
    noise = np.sqrt(float(rest @ rest) / max(len(y) - 2 * HARMONICS - 2, 1) * _correlation_time(rest))
    phase_std = float(np.hypot(noise / amplitude * np.sqrt(2 / len(y)), np.pi * span * frequency_std))
    phase = round(float(np.arctan2(-sine, cosine)), _DECIMALS)
    speed, speed_std = _start_speed(track, 2 / frequency)
    speed = round(speed, _DECIMALS)
    return Beat(frequency, frequency_std, phase, phase_std, speed, speed_std, amplitude, explained)


def _peak(signals: list[tuple[Array, Array]], span: float, lowest: float, highest: float) -> tuple[float, float]:
    """Frequencies around the highest spectral peak [Hz].

    The grid is finer than the width of a peak; the fundamental alone picks the peak, not a harmonic. Of a long trial
    the beginning is searched and twice as much each time, near what was found, so that time grows with frames alone.
    """
    seconds = min(span, LONG)
    while True:
        parts = [(t[: np.searchsorted(t, t[0] + seconds, "right")], y) for t, y in signals]
        parts = [(t, y[: len(t)]) for t, y in parts]
        grid = np.linspace(lowest, highest, max(32, int(np.ceil(8 * seconds * (highest - lowest)))))
        coarse = [_misfit(frequency, parts, 1) for frequency in grid]
        best = int(np.argmin(coarse))
        lowest, highest = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)])
        if seconds >= span:
            return lowest, highest
        seconds = min(2 * seconds, span)


def _basis(times: Array, frequency: float, harmonics: int) -> Array:
    """Constant, drift, and a cosine and sine a harmonic. Shape (N, 2 + 2 harmonics)."""
    angles = 2 * np.pi * frequency * times[:, None] * np.arange(1, harmonics + 1)
    waves = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(times), -1)
    return np.column_stack([np.ones_like(times), times - times.mean(), waves])


def _fit(times: Array, values: Array, frequency: float, harmonics: int) -> tuple[Array, Array]:
    """Least-squares coefficients, and residuals."""
    basis = _basis(times, frequency, harmonics)
    coefficients = np.asarray(np.linalg.lstsq(basis, values, rcond=None)[0], dtype=np.float64)
    return coefficients, values - basis @ coefficients


def _misfit(frequency: float, signals: list[tuple[Array, Array]], harmonics: int) -> float:
    """Sum of squared residuals."""
    rests = (_fit(t, y, frequency, harmonics)[1] for t, y in signals)
    return sum(float(rest @ rest) for rest in rests)


def _correlation_time(rest: Array) -> float:
    """Frames that count as one, because residuals of neighboring frames are alike."""
    power = float(rest @ rest)
    if power <= 0:
        return 1.0
    lag_one = float(rest[1:] @ rest[:-1]) / power
    return float(np.clip((1 + lag_one) / (1 - min(lag_one, 0.98)), 1.0, len(rest) / 4))


def _frequency_std(times: Array, signals: list[tuple[Array, Array]], frequency: float) -> float:
    """Standard error of the frequency from the linearized fit.

    Residuals are taken as correlated in time and from marker to marker: the noise of the two head markers turns the
    body frame, so it is in all of them.
    """
    information, score = 0.0, np.zeros(len(times))
    inflation = 1.0
    for t, y in signals:
        coefficients, rest = _fit(t, y, frequency, HARMONICS)
        basis = _basis(t, frequency, HARMONICS)
        step = 1e-6 * frequency
        slope = (_basis(t, frequency + step, HARMONICS) - _basis(t, frequency - step, HARMONICS)) @ coefficients
        slope = slope / (2 * step)
        slope = slope - basis @ np.linalg.lstsq(basis, slope, rcond=None)[0]  # what no amplitude can take up
        freedom = len(y) / max(len(y) - basis.shape[1] - 1, 1)
        score[np.searchsorted(times, t)] += slope * rest * np.sqrt(freedom)
        inflation = max(inflation, _correlation_time(rest))
        information += float(slope @ slope)
    return float(np.sqrt(max(float(score @ score), 1e-18) * inflation) / max(information, 1e-18))


def _start_speed(track: MarkerTrack, window: float) -> tuple[float, float]:
    """Forward speed over the first two cycles or 2 s, and its standard error [m/s]."""
    early = track.times - track.times[0] <= max(window, 2.0)
    times, progress = track.times[early], frames.progress(track.times, track.positions)[early]
    good = np.isfinite(progress)
    times, progress = times[good], progress[good]
    if times.size < 3:
        return 0.0, float("inf")
    speed = frames.slope(times, progress)
    rest = progress - progress.mean() - speed * (times - times.mean())
    spread = float(((times - times.mean()) ** 2).sum())
    return speed, float(np.sqrt(float(rest @ rest) / max(times.size - 2, 1) * _correlation_time(rest) / spread))
