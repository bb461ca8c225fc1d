"""Parameter sets that fit as well as the noise allows: drawn with an emulator, which evaluations correct.

A residual of N independent numbers of which k parameters were fitted has the likelihood exp(-(N - k) S / 2 S0), with
the sum of squares S, and S0 the lowest one: the noise is what the best fit leaves, model error included, so intervals
widen with it. N is far below the number of frames, since residuals hang together in time and between markers; only a
tenth of it counts, since model error isn't noise, and lets chains cross the ridges between fits. Chains
walk on an emulator of the residual (differential evolution: ter Braak, Statistics and Computing 16, 239 (2006)); some
of the points where they are get evaluated, and the emulator is made anew, until it is right there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from swim2real.identification.emulator import Emulator
from swim2real.identification.evaluated import EvaluatedPoint
from swimbase.arrays import Array

BATCH = 32  # points that are evaluated between two emulators
_CHAINS, _STEPS, _LAST_STEPS, _THINNED = 160, 400, 1600, 20
_AROUND = 0.06  # per range: first points on both sides of the best one
_NEAR, _APART, _MOST_NEAR = 2.5, 0.02, 64  # times the lowest loss; per range; points of a run that are taken
_LEAST_SHARE = 0.2  # of the independent numbers, which count at least
SHARPNESS = 0.1  # share of the independent numbers that counts, by the coverage of experiments/interval_coverage.py
_UNIFORM = 1 / 12  # variance of a parameter that nothing determines


@dataclass(frozen=True)
class Posterior:
    """Sample of the parameter sets that fit.

    Attributes:
        draws: Points of the unit cube, as likely as they fit. Shape (K, d).
        checked: Evaluated points among which the chains were in the last rounds.
        lowest: The evaluated point with the lowest loss.
        weight: What the square of the misfit S counts: the likelihood is exp(-weight S² / 2) [1/m²].
    """

    draws: Array
    checked: tuple[EvaluatedPoint, ...]
    lowest: EvaluatedPoint
    weight: float


def first_points(record: Sequence[tuple[Array, float]]) -> list[Array]:
    """Points to begin with: the best of a run, on both sides of it, and others of the run that are near its loss.

    Args:
        record: Points of the unit cube, shapes (d,), with their losses.
    """
    ordered = sorted(record, key=lambda one: one[1])
    best, lowest = ordered[0]
    taken = [best]
    for point, loss in ordered:
        if loss <= _NEAR * lowest and len(taken) < _MOST_NEAR and min(np.abs(point - p).max() for p in taken) > _APART:
            taken.append(point)
    sides = [sign * _AROUND * side for side in np.eye(best.size) for sign in (-1, 1)]
    return [best, *(np.clip(best + side, 0.0, 1.0) for side in sides), *taken[1:]]


def draw(
    evaluate: Callable[[Sequence[Array]], list[EvaluatedPoint]], first: Sequence[Array],
    independent: Callable[[Array], float], rounds: int, seed: int, check: Callable[[], None] = lambda: None,
) -> Posterior:  # fmt: skip
    """Draws parameter sets.

    Args:
        evaluate: Evaluates points.
        first: Points to begin with, as `first_points` gives them.
        independent: Number of independent numbers in a residual (n,).
        rounds: Of emulators and evaluations, after the first points.
        seed: Decides every random choice.
        check: Called again and again as chains go on; what it raises ends them.
    """
    rng = np.random.default_rng(seed)
    evaluated = [one for one in evaluate(first) if not one.failed]
    size, kernel, checked = first[0].size, None, list[EvaluatedPoint]()
    chains = np.clip(_lowest(evaluated).point + 0.01 * rng.standard_normal((_CHAINS, size)), 0.0, 1.0)
    determined, draws, weight = float(size), chains, 0.0
    for left in reversed(range(rounds + 1)):
        emulator = Emulator(evaluated, kernel)
        count = independent(_lowest(evaluated).residual)
        weight = SHARPNESS * max(count - determined, _LEAST_SHARE * count) / emulator.lowest**2
        chains, draws = _walk(emulator, weight, chains, _STEPS if left else _LAST_STEPS, rng, check)
        kernel, determined = emulator.kernel, _determined(draws)
        if left:
            made = evaluate(list(chains[rng.choice(_CHAINS, BATCH, replace=False)]))
            checked = [one for one in made if not one.failed]
            evaluated += checked
    return Posterior(draws, tuple(checked), min(evaluated, key=lambda one: one.loss), weight)


def _lowest(evaluated: Sequence[EvaluatedPoint]) -> EvaluatedPoint:
    return min(evaluated, key=lambda one: one.misfit)


def _determined(draws: Array) -> float:
    """Number of directions that are narrower than without data, each by its share."""
    variances = np.linalg.eigvalsh(np.atleast_2d(np.cov(draws.T)))
    return float(np.sum(1 - np.clip(variances / _UNIFORM, 0.0, 1.0)))


def _walk(
    emulator: Emulator, weight: float, chains: Array, steps: int, rng: np.random.Generator, check: Callable[[], None]
) -> tuple[Array, Array]:
    """Chains that go on from where they are, and what they came upon in their second half."""
    size = chains.shape[1]

    def height(points: Array) -> Array:
        inside = np.logical_and(points >= 0, points <= 1).all(axis=1)
        return np.where(inside, -0.5 * weight * emulator(np.clip(points, 0.0, 1.0)), -np.inf)

    chains, heights, kept = chains.copy(), height(chains), list[Array]()
    for step in range(steps):
        check()
        one, other = rng.integers(len(chains), size=(2, len(chains)))
        length = 1.0 if step % 10 == 0 else 2.38 / np.sqrt(2 * size)
        jumps = length * rng.uniform(0.2, 1.2, (len(chains), 1)) * (chains[one] - chains[other])
        tried = chains + jumps + 1e-3 * rng.standard_normal(chains.shape)
        found = height(tried)
        taken = np.log(rng.random(len(chains))) < found - heights
        chains[taken], heights[taken] = tried[taken], found[taken]
        if step >= steps // 2 and step % _THINNED == 0:
            kept.append(chains.copy())
    return chains, np.concatenate(kept)
