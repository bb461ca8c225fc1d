"""Elongated body theory: a forward speed from nothing but the motion of the tail's end, the prior work's baseline.

A slender body that swims at the steady speed U gives thrust by the water that its tail's end leaves behind
(Lighthill 1970, Aquatic animal propulsion of high hydromechanical efficiency, J. Fluid Mech. 44, 265-301; with
small slopes the same as Lighthill 1971, Proc. R. Soc. B 179, 125-138). With h the end's sideways position and x along
the swim,

    mean thrust  T = m/2 (<h_t²> - U² <h_x²>),  m = β ρ π s² / 4,
    drag         D = C S ρ U² / 2,

where s is the fin's span, m [kg/m] the water that moves with a meter of it, β about 1, S the wetted area and C its drag
coefficient. The two balance at

    U² = <h_t²> / (κ + <h_x²>),  κ = ρ C S / m,

so the whole robot is one number, κ. It is fitted to other trials than the one that is predicted. U stays below
V, V² = <h_t²> / <h_x²>, where thrust ends: for a wave of even amplitude the speed at which it runs down the tail.

The prior work [michelis2026simple] balances the same, but with h in a frame that turns with the head, which adds the
head's yaw to the tail's sweep. Here h is measured across the swimming axis, in water at rest, as the theory wants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from swim2real.objective.target import Target
from swimbase.arrays import Array
from swimbase.errors import TrialError

_HARMONICS = 3
_LOWEST, _HIGHEST = np.log(1e-3), np.log(1e4)  # of κ
_GRID = 60


@dataclass(frozen=True)
class TailMotion:
    """Motion of a tail, as the theory needs it.

    Attributes:
        name: Name of the trial.
        lateral_speed: Root mean square of h_t [m/s].
        slope: Root mean square of h_x.
        speed: Measured, over the whole trial [m/s].
    """

    name: str
    lateral_speed: float
    slope: float
    speed: float

    def cruising_speed(self, drag_ratio: float) -> float:
        """U for a given κ [m/s]."""
        return float(self.lateral_speed / np.sqrt(drag_ratio + self.slope**2))


def tail_motion(target: Target, end: tuple[int, int]) -> TailMotion:
    """The motion of the tail's end in one trial.

    Speed and slope are those of a fit of three harmonics of the beat, which needs no derivative of noisy positions,
    bridges frames without the markers, and leaves out how the markers were placed.

    Args:
        target: A real trial with its weights and the frequency of its beat.
        end: Indices of two markers on the last stiff part of the tail, the trailing edge last.

    Raises:
        TrialError: The trial has no beat, or the two markers are seen together for less than one.
    """
    track, frequency = target.trial.track, target.beat_frequency or target.frequency
    if frequency is None:
        raise TrialError(f"trial '{target.name}' has no beat, which elongated body theory needs")
    times, course = track.times - track.times[0], track.course
    pair = course[:, list(end)]
    good = np.isfinite(pair).all(axis=(1, 2)) & (target.weights[:, list(end)] > 0).all(axis=1)
    seen = times[good]
    columns = 2 * _HARMONICS + 2
    if np.count_nonzero(good) < 2 * columns or (seen[-1] - seen[0]) * frequency < 1:
        raise TrialError(
            f"trial '{target.trial.name}': markers {end[0]} and {end[1]} are seen together in "
            f"{np.count_nonzero(good)} of {len(times)} frames; elongated body theory needs a whole beat of them"
        )
    before, last = pair[good, 0], pair[good, 1]
    slope = (last[:, 1] - before[:, 1]) / (last[:, 0] - before[:, 0])
    rates: Array = 2 * np.pi * frequency * np.arange(1.0, _HARMONICS + 1)
    amplitudes = _amplitudes(seen, np.column_stack([last[:, 1], slope]), rates)
    return TailMotion(
        target.trial.name,
        float(np.sqrt(np.square(rates * amplitudes[:, 0]).sum() / 2)),
        float(np.sqrt(np.square(amplitudes[:, 1]).sum() / 2)),
        track.speed,
    )


def _amplitudes(times: Array, signals: Array, rates: Array) -> Array:
    """Amplitudes of the harmonics of signals that may drift. Shapes (T,), (T, K), (H,) to (H, K)."""
    angles = times[:, None] * rates
    basis = np.column_stack([np.ones_like(times), times - times.mean(), np.cos(angles), np.sin(angles)])
    found = np.linalg.lstsq(basis, signals, rcond=None)[0]
    return np.hypot(found[2 : 2 + len(rates)], found[2 + len(rates) :])


def fit_drag_ratio(motions: Sequence[TailMotion]) -> float:
    """κ with the smallest squared errors in speed."""

    def misfit(logarithm: float) -> float:
        ratio = float(np.exp(logarithm))
        return sum((motion.cruising_speed(ratio) - motion.speed) ** 2 for motion in motions)

    grid = np.linspace(_LOWEST, _HIGHEST, _GRID)
    best = float(grid[int(np.argmin([misfit(x) for x in grid]))])
    width = float(grid[1] - grid[0])
    found = minimize_scalar(misfit, bounds=(best - width, best + width), method="bounded", options={"xatol": 1e-8})
    return float(np.exp(found.x))


def predict_speeds(targets: Sequence[Target], end: tuple[int, int]) -> dict[str, float]:
    """Each trial's speed by its name [m/s], with κ fitted to all the others.

    Args:
        targets: Real trials with their weights and the frequency of their beat; two or more.
        end: Indices of two markers on the last stiff part of the tail, the trailing edge last.

    Raises:
        TrialError: There are fewer than two trials, or a trial shows less than a beat of the two markers.
    """
    if len(targets) < 2:
        count = f"{len(targets)} trial{' is' if len(targets) == 1 else 's are'}"
        raise TrialError(f"{count} too few: each speed is predicted from the other trials, so give two or more")
    motions = [tail_motion(target, end) for target in targets]
    return {
        motion.name: motion.cruising_speed(fit_drag_ratio([other for other in motions if other is not motion]))
        for motion in motions
    }
