"""The built-in physics advisor: rules and measured sensitivities, not a VLM.

It reads the same evidence that a VLM gets, believes what a measured response of the robot says as far as the run has
not shown otherwise, and proposes the point within its trust that it expects to be best. It never simulates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, minimize

from swim2real.advisor.physics.model import (
    Aim,
    Expectation,
    Features,
    Surrogate,
    Swims,
    direction,
    read_swims,
    shape_floor,
    to_speed_scale,
    trial_frequencies,
    whole_motion,
    without_outliers,
)
from swim2real.advisor.physics.words import diagnose_swims, reason
from swim2real.errors import ArgumentError
from swim2real.optimizers import Evaluation, Proposal, Round, Situation
from swim2real.optimizers.advisor import DECIMALS
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot

Array = NDArray[np.float64]

CAUTION, BOLDER = 0.3, 0.3  # weight of the variance, and what a round without real progress makes of it
PROGRESS = 0.02  # by how much a round must lower the loss to count as progress
TRUST_START, TRUST_LEAST, TRUST_MOST = 0.5, 0.08, 0.7  # half width of the trusted box, in the unit cube
GROW, SHRINK = 1.3, 0.7
_SAMPLES, _STARTS = 3000, 4
_DIFFERENCE = 1e-4
_GRAIN = 9  # decimals of an expected loss [m], for the same reason as those of a proposal


class PhysicsAdvisor:
    """Proposes parameters from measured sensitivities and what the run has shown."""

    def __init__(self, robot: Robot, space: ParameterSpace, seed: int) -> None:
        """Prepares the advisor.

        Args:
            robot: The robot whose simulator is calibrated.
            space: Parameters as the optimizer uses them, on any scale. The advisor itself uses the logarithmic one.
            seed: Seed of the run.

        Raises:
            ArgumentError: Nobody has measured the robot's response.
        """
        if robot.swims.response is None:
            raise ArgumentError(
                f"nobody has measured how robot '{robot.name}' responds to its parameters, which advisor physics "
                f"needs; choose another one"
            )
        self._response, self._space, self._seed = robot.swims.response, space, seed
        self._own = replace(space, scale="log")

    def propose(self, situation: Situation) -> Proposal:
        """The point within its trust that it expects to be best."""
        usable = [e for e in situation.evaluations if not e.failed]
        rng = np.random.default_rng([self._seed, len(situation.rounds)])
        trust = trust_radius(situation.rounds)
        here = self._point(situation.incumbent)
        if situation.incumbent.failed or not usable:
            point = 0.5 + 0.5 * trust * rng.uniform(-1, 1, len(here))
            return Proposal(
                self._back(point), "The simulation diverged.", "A point near the middle of the box is safer.", {}
            )
        expectation = self._expectation(usable, situation.incumbent, situation.rounds)
        point = self._best_point(expectation, here, trust, rng)
        before, after = expectation.losses(np.array([here, point]))
        real, simulated = (read_swims(situation.incumbent.detail, side) for side in ("real", "simulated"))
        notes = {
            "trust": round(trust, 4), "expected_loss": float(after), "expected_loss_here": float(before),
        }  # fmt: skip
        return Proposal(
            self._back(point),
            diagnose_swims(trial_frequencies(situation.incumbent.detail), real, simulated, situation.incumbent.detail),
            reason(self._own, here, point, self._gains(expectation, here, point)),
            notes,
        )

    def _point(self, evaluation: Evaluation) -> Array:
        return self._own.to_cube(self._space.to_values(evaluation.candidate.point))

    def _back(self, point: Array) -> Array:
        return self._space.to_cube(self._own.to_values(point)).round(DECIMALS)

    def _expectation(
        self, evaluations: Sequence[Evaluation], incumbent: Evaluation, rounds: Sequence[Round]
    ) -> Expectation:
        whole = whole_motion(incumbent.detail)
        frame = "path" if whole else "body"
        real = read_swims(incumbent.detail, "real", frame)
        points = np.array([self._point(e) for e in evaluations])
        driven = trial_frequencies(incumbent.detail)
        body_real, here = (read_swims(incumbent.detail, side) for side in ("real", "simulated"))
        shape = np.array([trial["shape_error"] for trial in incumbent.detail["trials"].values()])
        floor = shape_floor(shape, here.beat, body_real.beat)
        aim = Aim(real.speed, real.beat, floor, float(incumbent.detail["horizon"] or 4.0))
        simulated = [read_swims(e.detail, "simulated", frame) for e in evaluations]
        seen = _learned(np.array([s.speed for s in simulated]), np.array([s.beat for s in simulated]), real, driven)
        seen = seen._replace(excess=aim.excess(np.array([e.loss for e in evaluations]), seen))
        surrogate = Surrogate(lambda p: self._prior(p, driven, whole), self._response.lengths, points, seen)
        return Expectation(surrogate, aim, caution(rounds))

    def _prior(self, points: Array, driven: Array, whole: bool) -> Features:
        """Features that the response expects of points, shape (N, d), and no excess."""
        response = self._response
        speeds, forward = response.speeds(points, driven)
        beats = response.beats(points, driven, whole)
        return Features(to_speed_scale(speeds), forward, beats, np.zeros(len(points)))

    def _best_point(self, expectation: Expectation, here: Array, trust: float, rng: np.random.Generator) -> Array:
        low, high = np.maximum(here - trust, 0.0), np.minimum(here + trust, 1.0)
        samples = low + (high - low) * rng.random((_SAMPLES, len(here)))
        # half of them change few parameters only
        keep = rng.random((_SAMPLES // 2, len(here))) < 0.7
        samples[: _SAMPLES // 2][keep] = np.broadcast_to(here, keep.shape)[keep]
        losses = expectation.losses(samples).round(_GRAIN)
        starts = [here, *samples[np.argsort(losses)[:_STARTS]]]
        minima = [self._descend(expectation, start, low, high) for start in starts]
        return min(minima, key=lambda result: result[0])[1]

    def _descend(self, expectation: Expectation, start: Array, low: Array, high: Array) -> tuple[float, Array]:
        def value_and_slope(point: Array) -> tuple[float, Array]:
            steps = np.where(point + _DIFFERENCE <= high, _DIFFERENCE, -_DIFFERENCE)
            losses = expectation.losses(np.vstack([point, point + np.diag(steps)])).round(_GRAIN)
            return float(losses[0]), (losses[1:] - losses[0]) / steps

        result = minimize(
            value_and_slope, start, jac=True, method="L-BFGS-B", bounds=Bounds(low, high),
            options={"maxiter": 25},
        )  # fmt: skip
        return float(result.fun), np.clip(result.x, low, high)

    def _gains(self, expectation: Expectation, here: Array, point: Array) -> Array:
        """By how much each parameter's own change is expected to lower the loss [m]. Shape (d,)."""
        alone = np.repeat(point[None], len(here) + 1, axis=0)
        alone[1:][np.eye(len(here), dtype=bool)] = here  # all but this one
        losses = expectation.losses(alone)
        return losses[1:] - losses[0]


def trust_radius(rounds: Sequence[Round]) -> float:
    """Half width of the box around the incumbent that a proposal stays in: grows and shrinks with its successes.

    A run that is stuck where the box is smallest looks far away again.
    """
    trust = TRUST_START
    for finished in rounds:
        if not finished.accepted:
            trust = trust * SHRINK if trust > TRUST_LEAST else TRUST_START
        elif len(finished.steps) == 1:
            trust *= GROW
        else:
            trust *= finished.steps[-1].step_size ** 0.25
        trust = float(np.clip(trust, TRUST_LEAST, TRUST_MOST))
    return trust


def caution(rounds: Sequence[Round]) -> float:
    """Weight of what the surrogate doesn't know: a run that gets nowhere tries what it is less sure of."""
    weight = CAUTION
    for finished in reversed(rounds):
        gained = finished.accepted and finished.steps[-1].evaluation.loss < (1 - PROGRESS) * finished.incumbent.loss
        if gained:
            break
        weight *= BOLDER
    return weight


def _learned(speeds: Array, beats: Array, real: Swims, driven: Array) -> Features:
    """Features to learn from: no outlying speeds, and zeros for markers that never count."""
    scaled = np.array([without_outliers(one, driven) for one in to_speed_scale(speeds)])
    beats = np.where(np.isfinite(real.beat), np.nan_to_num(beats), 0.0)
    return Features(scaled, direction(speeds, driven), beats, np.zeros(len(speeds)))
