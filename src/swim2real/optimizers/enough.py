"""Evidence that a search is done: the gain that is expected of another start, by the ends of the starts so far.

Starts are independent, so either of two estimates is enough. By the ends alone: over all ways to take half of them, the
mean of the lowest, less the lowest of all, is what each of the other half has gained, and another start gains no more,
since gains become rarer. By the trials: of n + 1 starts any may be the best, so the next one is with a probability of
1 / (n + 1), and then it gains no more than what lies between the lowest loss and the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, inf

_GAIN, _GAIN_NOISE = 0.02, 0.25  # of the lowest loss and of the noise: a gain by ends that isn't worth a start
_GAIN_MOTION, _LEFT_MOTION = 0.004, 0.01  # of the motion: one by the trials, and what hidden values leave themselves
_EXPLAINED, _NEAR = 0.02, 4.0  # of the motion and of the noise, up to which a loss explains the trials
_ENDS_EXPLAINED, _ENDS = 2, 5  # without which ends decide nothing: what every third start finds, five miss in 13 %
AGREEMENT = 0.1  # of the lowest loss, within which ends agree


@dataclass(frozen=True)
class Sizes:
    """Sizes by which a search judges a loss [m].

    Attributes:
        noise: Noise of the data.
        motion: Size of the real motion.
    """

    noise: float = 0.0
    motion: float = 0.0


def expected_gain(ends: Sequence[float]) -> float:
    """Expected gain of another start by the ends, in their unit; infinite where fewer than two are known."""
    ascending, count = sorted(ends), len(ends)
    half = (count + 1) // 2
    if count < 2:
        return inf
    ways = [comb(count - k, half - 1) for k in range(1, count + 1)]  # in which the k-th is the lowest of a half
    missed = sum(way * (end - ascending[0]) for way, end in zip(ways, ascending, strict=True))
    return missed / comb(count, half) / (count - half)


def needed(ends: Sequence[float], sizes: Sizes) -> int:
    """Ends without which nothing is decided by ends."""
    explained = max(_EXPLAINED * sizes.motion, _NEAR * sizes.noise)
    return _ENDS_EXPLAINED if ends and min(ends) <= explained else _ENDS


def conclusion(ends: Sequence[float], sizes: Sizes) -> str:
    """The reason to begin no other start, in words; empty where one is worth its evaluations."""
    if not ends:
        return ""
    lowest, count = min(ends), len(ends)
    left = lowest - sizes.noise
    if left / (count + 1) <= _GAIN_MOTION * sizes.motion or left <= _LEFT_MOTION * sizes.motion:
        return "too little is left unexplained for another start"
    worth = max(_GAIN * lowest, _GAIN_NOISE * sizes.noise)
    if count < needed(ends, sizes) or expected_gain(ends) > worth:
        return ""
    near = agreeing(ends)
    if near > 1:
        return f"{near} of {count} starts agree"
    return f"another start would hardly lower the loss, by the {count} that are at their end"


def agreeing(ends: Sequence[float]) -> int:
    """Number of descents that ended within a tenth of the best one's loss, that one included."""
    return sum(end <= (1 + AGREEMENT) * min(ends) for end in ends)
