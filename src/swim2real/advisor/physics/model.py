"""Beliefs of the advisor: features of a swim, what the simulator would do elsewhere, and the loss that follows.

A swim is described by its forward speed, its direction and its beat, in the body frame or, where the whole motion is
compared, in the frame of its path. Speeds are compared on a scale that is logarithmic for swimmers and linear around
standstill. The beat is taken relative to the last marker's phase, because the phase of a trial is free.

Gaussian processes predict these features at other points. Their prior mean is the robot's measured response; what the
run has shown so far corrects it. The posterior knows where it is unsure, so a step into the unknown is judged as what
it is. The expected loss follows from predicted speeds and beats, in the terms of the motion error or of the aligned
error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares
from scipy.special import ndtr

from swim2real.objective.figures import Beat, FitFigures
from swim2real.optimizers import Evaluation
from swim2real.optimizers.local_model import Slopes
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot
from swimbase.arrays import Array

SHARP = 0.02  # m in a beat, within which backward turns into forward
BACKWARD_LOSS, DOUBT = 0.1, 0.3  # m for a trial that goes backward; deviation of a direction that seems sure
MOST_EXCESS = 1.5  # of the logarithm of a seen loss over the explained one
LENGTH = 0.35  # in the cube, over which deviations from the response change
NOISES = (0.003, 0.02, 0.1, 0.4)  # of a deviation, in units of the nonlinear part: a run where swims jump is noisy
SLOW = 0.01  # m/s, where the speed scale turns from linear to logarithmic
_LEAST_TRIALS = 4
_OUTLIER = 0.12  # on the speed scale, from a line over the logarithm of frequency
_INSTANTS = 6  # at which the growing difference in progress is looked at
_LEAST_SHAPE = 2e-3  # m
_NAMED = 5  # parameters that are named in the reasoning
_SMALL = 0.01  # of a parameter's range
_SLOPE_OVER = 0.02  # of it, to either side


def to_speed_scale(speed: Array | float) -> Array:
    """Speed [m/s] on the advisor's scale."""
    return np.arcsinh(np.asarray(speed, dtype=float) / SLOW)


def _from_speed_scale(value: Array) -> Array:
    """Speed [m/s] of a value on the advisor's scale."""
    return SLOW * np.sinh(value)


@dataclass(frozen=True)
class Swims:
    """The real or the simulated swims of all trials.

    Attributes:
        speed: Forward speed [m/s]. Shape (F,).
        beat: Real and imaginary parts of each marker's sideways fundamental, turned so that the last marker's phase in
            the body frame is zero [m]; NaN for a marker that never counts. Shape (F, 2 M).
    """

    speed: Array
    beat: Array


class Features(NamedTuple):
    """Predicted features of the swims at some points: of each trial its speed, direction and beat.

    Attributes:
        speed: Speed on the advisor's scale. Shape (N, F).
        direction: From -1, backward, to 1, forward, by the way in a beat. Shape (N, F).
        beat: Beat as in `Swims` [m]. Shape (N, F, 2 M).
        excess: Logarithm of the loss over what the others explain of it. Shape (N,).
    """

    speed: Array
    direction: Array
    beat: Array
    excess: Array


def direction(speed: Array, frequencies: Array) -> Array:
    """From -1, backward, to 1, forward, by the way in a beat. Shapes (..., F), (F,) to (..., F)."""
    return np.tanh(speed / frequencies / SHARP)


def read_swims(figures: FitFigures, side: str, frame: Literal["body", "path"] = "body") -> Swims:
    """Reads the `real` or the `simulated` side from the figures of an evaluation, with beats in a frame."""
    trials = figures.trials.values()
    speed = np.array([getattr(trial, f"velocity_{side}") for trial in trials], dtype=float)
    beats: list[Array] = []
    for trial in trials:
        seen: Beat = getattr(trial, f"path_beat_{side}" if frame == "path" else f"beat_{side}")
        amplitude, phase = np.array(seen.amplitude, dtype=float), np.array(seen.phase, dtype=float)
        last: float | None = getattr(trial, f"beat_{side}").phase[-1]
        turned: NDArray[np.complex128] = amplitude * np.exp(1j * (phase - (last or 0.0)))
        beats.append(np.concatenate([turned.real, turned.imag]))
    return Swims(speed, np.array(beats))


def without_outliers(scaled: Array, frequencies: Array) -> Array:
    """Scaled speeds whose outliers are replaced by what the other frequencies suggest. Shape (F,).

    Close to a bound of stability a simulated swimmer may turn or stagger at one frequency and not at the next, for
    the slightest change of a parameter. Such a speed tells nothing of thrust and drag.
    """
    if len(scaled) < _LEAST_TRIALS:
        return scaled
    logs = np.log(frequencies)
    basis = np.column_stack([np.ones_like(logs), logs - logs.mean()])
    line = least_squares(lambda p: basis @ p - scaled, [np.median(scaled), 1.0], loss="soft_l1", f_scale=0.05).x
    rest = scaled - basis @ line
    limit = max(_OUTLIER, 4 * float(np.median(np.abs(rest))))
    return np.where(np.abs(rest) > limit, basis @ line, scaled)


@dataclass(frozen=True)
class Kernel:
    """Covariance of the deviation from the prior mean.

    Attributes:
        offset: Standard deviation of a constant deviation.
        slope: Scale of its linear part, per unit of the cube.
        bend: Scale of its nonlinear part.
        lengths: Length scale of the nonlinear part for each parameter, in the cube; the linear part weighs parameters
            by their inverse. Shape (d,).
    """

    offset: float
    slope: float
    bend: float
    lengths: Array

    def __call__(self, a: Array, b: Array) -> Array:
        """Covariance between points. Shapes (N, d), (K, d) to (N, K)."""
        near, far = (a - 0.5) / self.lengths, (b - 0.5) / self.lengths
        product = near @ far.T
        squared = (near**2).sum(1)[:, None] + (far**2).sum(1) - 2 * product
        linear = self.offset**2 + self._slope**2 * product
        return linear + self.bend**2 * np.exp(-0.5 * np.maximum(squared, 0.0))

    def variance(self, points: Array) -> Array:
        """Prior variance. Shape (N, d) to (N,)."""
        squared = (((points - 0.5) / self.lengths) ** 2).sum(1)
        return self.offset**2 + self._slope**2 * squared + self.bend**2

    @property
    def _slope(self) -> float:
        return self.slope * float(self.lengths.min())


class Correction:
    """Gaussian process of how some outputs deviate from what was expected, all with the same covariance."""

    def __init__(self, kernel: Kernel, points: Array, deviations: Array) -> None:
        """Conditions the process on deviations that were seen, with the noise that explains them best.

        Args:
            kernel: Covariance.
            points: Evaluated points. Shape (N, d).
            deviations: Outputs there. Shape (N, K).
        """
        self._kernel, self._points = kernel, points
        noises = kernel.bend * np.array(NOISES)
        factors = [cho_factor(kernel(points, points) + n**2 * np.eye(len(points)), lower=True) for n in noises]
        self._factor = max(factors, key=lambda factor: _evidence(factor, deviations))
        self._weights = np.asarray(cho_solve(self._factor, deviations))

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Mean of every output, and their variance. Shape (N, d) to (N, K) and (N,)."""
        cross = self._kernel(points, self._points)
        explained = (cross.T * np.asarray(cho_solve(self._factor, cross.T))).sum(axis=0)
        return cross @ self._weights, np.maximum(self._kernel.variance(points) - explained, 0.0)


def _evidence(factor: tuple[Array, bool], outputs: Array) -> float:
    """Logarithm of the evidence for a covariance, but for a constant. Shape (N, K) of the outputs."""
    fit = float((outputs * np.asarray(cho_solve(factor, outputs))).sum())
    return -0.5 * fit - outputs.shape[1] * float(np.log(np.diag(factor[0])).sum())


class Surrogate:
    """Mean and variance of the features at any point: what the response expects, corrected by what was seen."""

    def __init__(self, prior: Callable[[Array], Features], lengths: Array, points: Array, seen: Features) -> None:
        """Corrects the prior by what was seen.

        Args:
            prior: Points (N, d) to features.
            lengths: Over which parameters change the beat, relative to each other. Shape (d,).
            points: Evaluated points. Shape (N, d).
            seen: Features there.
        """
        self._prior, expected, alike = prior, prior(points), np.full_like(lengths, LENGTH)
        beats = (seen.beat - expected.beat).reshape(len(points), -1)
        self._speed = Correction(Kernel(0.1, 0.15, 0.25, alike), points, seen.speed - expected.speed)
        self._direction = Correction(Kernel(0.15, 0.1, 0.3, alike), points, seen.direction - expected.direction)
        self._beat = Correction(Kernel(0.004, 0.008, 0.006, 2 * LENGTH * lengths), points, beats)
        self._excess = Correction(Kernel(0.15, 0.25, 0.5, alike), points, (seen.excess - expected.excess)[:, None])

    def predict(self, points: Array) -> tuple[Features, Features]:
        """Mean and variance of the features. Shape (N, d)."""
        mean = self._prior(points)
        parts = [correction(points) for correction in (self._speed, self._direction, self._beat, self._excess)]
        more, variances = zip(*parts, strict=True)
        changed = [old + new.reshape(old.shape) for old, new in zip(mean, more, strict=True)]
        spread = [
            np.broadcast_to(v.reshape(-1, *[1] * (o.ndim - 1)), o.shape) for v, o in zip(variances, mean, strict=True)
        ]
        return Features(*changed), Features(*spread)


@dataclass(frozen=True)
class Aim:
    """Features of the real swims, from which the loss of any other ones follows.

    Attributes:
        speed: Real speeds [m/s]. Shape (F,).
        beat: Real beats [m], NaN where unknown. Shape (F, 2 M).
        shape_floor: What of each trial's shape error the beats don't explain [m]. Shape (F,).
        horizon: Seconds compared in each trial.
    """

    speed: Array
    beat: Array
    shape_floor: Array
    horizon: float

    def losses(self, speed: Array, beat: Array, speed_variance: Array, beat_variance: Array) -> Array:
        """Expected losses [m].

        Args:
            speed: On the advisor's scale. Shape (N, F).
            beat: [m]. Shape (N, F, 2 M).
            speed_variance: Of the speed. Shape (N, F).
            beat_variance: Of each part of the beat. Shape (N, F, 2 M).

        Returns:
            Shape (N,).
        """
        simulated = _from_speed_scale(speed)
        # along the swimming axis: the difference grows with time
        instants = (np.arange(_INSTANTS) + 0.5) / _INSTANTS * self.horizon
        unsure = (simulated**2 + SLOW**2) * speed_variance
        progress = ((simulated - self.speed) ** 2 + unsure)[:, :, None] * instants**2
        shape = self.shape_floor**2 + mean_square(beat, self.beat, beat_variance)
        return np.sqrt(progress + shape[:, :, None]).mean(axis=(1, 2))

    def excess(self, losses: Array, features: Features) -> Array:
        """Logarithms of seen losses over what the features explain of them. Shape (N,) to (N,).

        It is large where a swimmer staggers, which smooth features don't tell; of one that goes backward it says
        nothing.
        """
        explained = self.losses(features.speed, features.beat, 0 * features.speed, 0 * features.beat)
        excess = np.clip(np.log(np.maximum(losses, 1e-9) / explained), -MOST_EXCESS, MOST_EXCESS)
        return np.where(features.direction.min(axis=1) < 0, 0.0, excess)


@dataclass(frozen=True)
class Expectation:
    """Predicts the loss from a surrogate of what a swim does.

    Attributes:
        surrogate: Surrogate of the features of all trials.
        aim: What the real swims do.
        caution: Weight of the surrogate's variance.
    """

    surrogate: Surrogate
    aim: Aim
    caution: float

    def losses(self, points: Array) -> Array:
        """Expected loss of each point [m]. Shape (N, d) to (N,)."""
        mean, variance = self.surrogate.predict(points)
        losses = self.aim.losses(mean.speed, mean.beat, self.caution * variance.speed, self.caution * variance.beat)
        backward = ndtr(-mean.direction / np.sqrt(variance.direction + DOUBT**2))
        return losses * np.exp(np.maximum(mean.excess, 0.0)) + BACKWARD_LOSS * backward.sum(axis=1)


def expected_slopes(robot: Robot, space: ParameterSpace) -> Slopes | None:
    """How steeply the speeds of the trials change with the parameters, by the robot's response.

    Args:
        robot: The robot; None is returned where nobody has measured its response.
        space: Its parameters, on the run's scale.
    """
    if not robot.trials.steady or (response := robot.swims.response) is None:
        return None
    own = replace(space, scale="log")

    def slopes(at: Evaluation) -> Array:
        trials = FitFigures.model_validate(at.detail).trials.values()
        driven = np.array([trial.frequency for trial in trials], dtype=float)
        sides = _SLOPE_OVER * np.eye(len(space))
        ends = [np.clip(at.candidate.point + side, 0.0, 1.0) for side in (-sides, sides)]
        low, high = (response.speeds(np.array([own.to_cube(space.to_values(one)) for one in end]), driven)[0]
                     for end in ends)  # fmt: skip
        return (high - low) / np.diag(ends[1] - ends[0])[:, None]

    return slopes


def reason(space: ParameterSpace, here: Array, point: Array, gains: Array) -> str:
    """Which parameters are changed, and what each change is expected to bring.

    Args:
        space: Parameters, on the scale of the points.
        here: Point of the incumbent. Shape (d,).
        point: Point that is proposed. Shape (d,).
        gains: Expected decrease of the loss by each change [m]. Shape (d,).
    """
    before, after = space.to_values(here), space.to_values(point)
    moved = [i for i in np.argsort(-np.abs(gains)) if abs(point[i] - here[i]) > _SMALL]
    if not moved:
        return "No parameter is expected to help by more than a hair."
    parts: list[str] = []
    for i in moved[:_NAMED]:
        name, unit = space.names[i], space.parameters[i].unit.removesuffix("-")
        verb = "raise" if point[i] > here[i] else "lower"
        parts.append(
            f"{verb} {name} from {before[name]:.3g} to {after[name]:.3g} {unit}".rstrip()
            + f" (expected gain {1e3 * gains[i]:.1f} mm)"
        )
    rest = len(moved) - len(parts)
    more = f"; {rest} smaller change{'s' if rest > 1 else ''}" if rest else ""
    lead = space[space.names[moved[0]]].meaning
    return "; ".join(parts)[0].upper() + "; ".join(parts)[1:] + f"{more}. {lead}"


def mean_square(simulated: Array, real: Array, variance: Array | float = 0.0) -> Array:
    """Mean squared distance over a cycle and the markers that count [m²]. Shapes (..., 2 M) to (...)."""
    known = np.isfinite(real)
    squared = np.where(known, (simulated - np.nan_to_num(real)) ** 2 + variance, 0.0)
    # half the squared amplitude is the mean over a cycle; a marker has two parts
    return squared.sum(axis=-1) / 2 / np.maximum(known.sum(axis=-1) / 2, 1)


def shape_floor(measured: Array, simulated: Array, real: Array) -> Array:
    """Part of the measured shape errors that the beats leave unexplained [m]. Shape (F,)."""
    return np.sqrt(np.maximum(measured**2 - mean_square(simulated, real), _LEAST_SHAPE**2))
