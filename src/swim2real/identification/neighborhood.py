"""How well the trials determine the parameters near a fit: standard errors, correlations, stiff and sloppy directions.

The residual of a good fit is mostly what the model can't do, strongly correlated in time and between markers. Counting
frames as independent would make standard errors many times too small. Here the noise of a trial is taken as stationary,
with the residual's own covariance between markers and its own autocorrelation in time, and errors come from a sandwich
estimator, (J'J)^-1 (J'WJ) (J'J)^-1 with W that covariance. Trials, and sensors, are taken as independent. Where the
start of a playback comes from the frames, J'WJ is the covariance of drawn noise (`pulls`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz

from swim2real.errors import TrialError
from swim2real.identification.gauss_newton import EvaluatedPoint, Evaluator
from swim2real.objective import ComparedTrial
from swim2real.trials import MarkerTrack, Signals, Trial, TrialSet

Array = NDArray[np.float64]

DRAWS = 40  # of noise: a standard deviation to 11 %
_SEED = 0
_NO_EFFECT = 1e-12  # of the largest eigenvalue of J'J
_NAMED = 0.8  # of a direction's square that its named parameters hold


@dataclass(frozen=True)
class Neighborhood:
    """The neighborhood of a fit, in the unit cube.

    Attributes:
        normal: J'J [m²]. Shape (d, d).
        covariance: Covariance of the parameters, infinite on the diagonal where nothing determines them. Shape (d, d).
        effective_count: Estimated number of independent numbers in the residual.
    """

    normal: Array
    covariance: Array
    effective_count: float

    @property
    def standard_errors(self) -> Array:
        """Standard error of each parameter in the cube; infinite where nothing determines it. Shape (d,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Array:
        """Correlations between parameters, 0 where one isn't determined at all. Shape (d, d)."""
        errors = self.standard_errors
        finite = np.isfinite(errors) & (errors > 0)
        out = np.eye(len(errors))
        both = np.ix_(finite, finite)
        out[both] = self.covariance[both] / np.outer(errors[finite], errors[finite])
        return np.clip(out, -1.0, 1.0)

    def directions(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Eigenvectors of J'J, the sloppiest first.

        Returns:
            For each the `slope`, by how much the residual's root mean square grows over the whole range [m], and the
            `parameters` that hold most of it with their shares of the vector, the largest first.
        """
        values, vectors = np.linalg.eigh(self.normal)
        out: list[dict[str, Any]] = []
        for value, vector in zip(values, vectors.T, strict=True):
            order = np.argsort(-np.abs(vector))
            count = int(np.searchsorted(np.cumsum(vector[order] ** 2), _NAMED)) + 1
            sign = np.sign(vector[order[0]])
            held = {names[i]: float(sign * vector[i]) for i in order[:count]}
            out.append({"slope": float(np.sqrt(max(value, 0.0))), "parameters": held})
        return out


def neighborhood(
    slopes: Array, residual: Array, blocks: Sequence[tuple[int, int]], pulls: Array | None = None
) -> Neighborhood:
    """Standard errors and directions from a Jacobian and the residual at a fit.

    Args:
        slopes: Jacobian of the residual by the cube's coordinates [m]. Shape (n, d).
        residual: Residual at the fit [m]. Shape (n,).
        blocks: Rows, in time, and columns of the numbers that belong together; n is the sum of their products.
        pulls: Draws of J'r by noise, whose covariance takes the place of J'WJ; None estimates it. Shape (K, d).
    """
    count = slopes.shape[1]
    normal = slopes.T @ slopes
    middle, effective, first = np.zeros((count, count)), 0.0, 0
    for rows, columns in blocks:
        part = slice(first, first + rows * columns)
        first = part.stop
        noise = residual[part].reshape(rows, columns)
        between, along = noise.T @ noise / rows, autocorrelation(noise)
        effective += _participation(between) * _independent_frames(along)
        if pulls is not None:
            continue
        sway = slopes[part].reshape(rows, columns, count)
        over_time = np.tensordot(toeplitz(along), sway, axes=1)
        over_both = np.einsum("tci,ce->tei", over_time, between)
        middle += np.tensordot(sway, over_both, axes=((0, 1), (0, 1)))
    if pulls is not None:
        middle = pulls.T @ pulls / len(pulls)
    values, vectors = np.linalg.eigh(normal)
    determined = values > _NO_EFFECT * max(float(values[-1]), 1e-300)
    inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T
    fitted = int(determined.sum())
    spread = effective / max(effective - fitted, 1.0)  # a fit takes away from the residual
    covariance: Array = np.asarray(inverse @ middle @ inverse * spread, dtype=float)
    undetermined = np.square(vectors[:, ~determined]).sum(axis=1) > 1e-6
    covariance[undetermined, undetermined] = np.inf
    return Neighborhood(normal, covariance, effective)


def autocorrelation(noise: Array) -> Array:
    """Autocorrelation of all channels together, not centered, biased toward 0 at long lags so that it is a covariance.

    Args:
        noise: Channels over time. Shape (T, C).

    Returns:
        The autocorrelation, 1 at lag 0. Shape (T,).
    """
    frames = len(noise)
    spectrum = np.square(np.abs(np.fft.rfft(noise, 2 * frames, axis=0))).sum(axis=1)
    lags = np.fft.irfft(spectrum)[:frames]
    return lags / lags[0] if lags[0] > 0 else np.eye(1, frames)[0]


def _independent_frames(correlation: Array) -> float:
    """Independent numbers in a stationary series of this correlation: 2 for a sine, T for white noise."""
    frames = len(correlation)
    shares = 1 - np.arange(frames) / frames
    return float(frames / (1 + 2 * np.sum(shares[1:] * correlation[1:] ** 2)))


def _participation(covariance: Array) -> float:
    """Participation ratio: how many eigenvalues share the sum."""
    square = float(np.sum(covariance**2))
    return float(np.trace(covariance)) ** 2 / square if square > 0 else 0.0


def pulls(evaluate: Evaluator, at: EvaluatedPoint, slopes: Array) -> Array:
    """What drawn noise makes of J'r, by which a residual pulls at parameters.

    Where a playback starts as its first frames show, their noise moves the start and all that follows. A residual
    doesn't show by how much, since the parameters have made up for it. So noise like the residual is added to the
    recordings, and their starts are found anew.

    Args:
        evaluate: Evaluates points; the draws are counted with them.
        at: The fit.
        slopes: Jacobian J of the residual there [m]. Shape (n, d).

    Returns:
        Differences to the fit's own [m²], fewer than `DRAWS` where playbacks diverge. Shape (K, d).
    """
    problem, rng, rows = evaluate.problem, np.random.default_rng(_SEED), list[Array]()
    (fit,) = evaluate.comparisons([at.point])
    values = evaluate.space.to_values(at.point)
    for _ in range(DRAWS):
        drawn = tuple(_with_noise(trial, one, rng) for trial, one in zip(problem.trials, fit.trials, strict=True))
        try:
            noisy = problem.of(TrialSet(drawn, problem.robot.marker_names)).evaluate(values)
        except TrialError:
            continue  # too noisy for any start
        finally:
            evaluate.add(1)
        if noisy.divergence is None:
            rows.append(slopes.T @ (noisy.residual_vector() - at.residual))
    return np.array(rows).reshape(-1, slopes.shape[1])


def surrogate(noise: Array, rng: np.random.Generator) -> Array:
    """Noise with the spectra of given noise, and its covariance between channels, by random phases.

    Source: Prichard and Theiler, Generating surrogate data for time series with several simultaneously measured
    variables, Physical Review Letters 73, 951 (1994).

    Args:
        noise: Channels over time, 0 where nothing is known. Shape (T, C).
        rng: Draws the phases.
    """
    spectrum = np.fft.rfft(noise, axis=0)
    turns = np.exp(2j * np.pi * rng.random(len(spectrum)))
    turns[0] = rng.choice((-1.0, 1.0))
    if len(noise) % 2 == 0:
        turns[-1] = rng.choice((-1.0, 1.0))
    return np.fft.irfft(spectrum * turns[:, None], len(noise), axis=0)


def _with_noise(trial: Trial, fit: ComparedTrial, rng: np.random.Generator) -> Trial:
    """A recording with noise like the residual of its fit on what was compared."""
    track, missed = trial.track, np.nan_to_num(fit.path_simulated - fit.path_real)
    positions = track.positions.copy()
    positions[: len(missed)] += surrogate(missed.reshape(len(missed), -1), rng).reshape(missed.shape)
    noisy = replace(trial, track=MarkerTrack(track.times, positions, track.confidence))
    if trial.sensors is None:
        return noisy
    table, readings = trial.sensors, trial.sensors.values.copy()
    for sensor in fit.sensors:
        compared = np.isin(table.times, sensor.times)
        noise = surrogate(np.nan_to_num(sensor.residual)[:, None], rng)
        readings[compared, table.names.index(sensor.name)] += noise[:, 0]
    return replace(noisy, sensors=Signals(table.times, table.names, readings))
