"""How the noise of recordings reaches parameters by way of their starts.

Where a playback starts as its first frames show, their noise moves the start, and with it all that follows. A residual
doesn't show by how much: the parameters have made up for it. So noise like the residual is drawn and added to the
recordings, their starts are found anew, and how the residual then pulls at the parameters goes into their errors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration.gauss_newton import EvaluatedPoint, Evaluator
from swim2real.errors import TrialError
from swim2real.objective import ComparedTrial
from swim2real.trials import MarkerTrack, Signals, Trial, TrialSet

Array = NDArray[np.float64]

DRAWS = 40  # of noise: a standard deviation to 11 %
_SEED = 0


def pulls(evaluate: Evaluator, at: EvaluatedPoint, slopes: Array) -> Array:
    """What drawn noise makes of J'r, by which a residual pulls at parameters.

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
