"""The physics advisor of any robot: it measures what each parameter does, and steps to where the error is least.

It knows no robot. It has single parameters changed one after the other, keeps a linear model of the residual that
learns from every evaluation, and proposes what the model promises most of within a trust that grows and shrinks with
its successes. When that fails it measures again, in smaller steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.physics.sensitivities import (
    Sensitivities,
    is_usable,
    learn_sensitivities,
    residual_of,
    unidentified_directions,
)
from swim2real.advisor.physics.words import diagnose_sensitivities, reason
from swim2real.optimizers import Advice, Evaluation, Measurement, Proposal, Round, Situation
from swim2real.optimizers.advisor import DECIMALS
from swim2real.parameters import ParameterSpace

Array = NDArray[np.float64]

TRUST_START, TRUST_LEAST, TRUST_MOST = 0.4, 1e-4, 1.0  # half width of the trusted box, in the unit cube
GROW, SHRINK = 2.0, 0.5
DIFFERENCE, LEAST_DIFFERENCE = 0.03, 1e-3  # change of a parameter that is measured, in the unit cube
GAIN = 0.01  # of the loss: a round that lowers it by less calls for new slopes
_ATTEMPTS = 2  # at measuring a parameter: to one side, and where that diverges to the other


class SensitivityAdvisor:
    """Proposes parameters from sensitivities that it has measured in the run."""

    needs_residual = True

    def __init__(self, space: ParameterSpace, seed: int) -> None:
        """Prepares the advisor.

        Args:
            space: Parameters as the optimizer uses them.
            seed: Seed of the run.
        """
        self._space, self._seed = space, seed

    def propose(self, situation: Situation) -> Advice:
        """What to measure before the next proposal, or the point that promises most within its trust."""
        incumbent = situation.incumbent
        if not is_usable(incumbent):
            return self._elsewhere(situation)
        sensitivities = learn_sensitivities([e for e in situation.evaluations if is_usable(e)])
        trust = trust_radius(situation.rounds)
        parameter = self._next_to_measure(situation)
        if parameter is not None:
            return self._measurement(parameter, situation, sensitivities)
        return self._proposal(incumbent, sensitivities, trust)

    def _elsewhere(self, situation: Situation) -> Measurement:
        """Nothing has gone well yet: a random point near the middle, where simulations are safer."""
        rng = np.random.default_rng([self._seed, len(situation.measurements)])
        return Measurement(0.5 + TRUST_START * rng.uniform(-1, 1, len(self._space)))

    def _next_to_measure(self, situation: Situation) -> int | None:
        """A parameter, None when a proposal is due."""
        measured = [e for e in situation.measurements if "parameter" in e.candidate.note]
        last = situation.rounds[-1] if situation.rounds else None
        outworn = last is not None and not last.measurements and not _gained(last)
        if last is not None and not outworn and not measured:
            return None
        for i, name in enumerate(self._space.names):
            outcomes = [is_usable(e) for e in measured if e.candidate.note["parameter"] == name]
            if not any(outcomes) and len(outcomes) < _ATTEMPTS:
                return i
        return None

    def _measurement(self, i: int, situation: Situation, sensitivities: Sensitivities) -> Measurement:
        """A step of one parameter: downhill where that is known, and the other way where that has diverged."""
        here = situation.incumbent
        point, name = here.candidate.point, self._space.names[i]
        width = measured_change(situation.rounds)
        slope = sensitivities.slopes(residual_of(here))[i]
        side = -np.sign(slope) if slope else 1.0 if point[i] <= 0.5 else -1.0
        if any(e.candidate.note.get("parameter") == name for e in situation.measurements):
            side = -side
        if not 0 <= point[i] + side * width <= 1:
            side = -side
        return Measurement.of_one(point, i, name, float(side * width))

    def _proposal(self, incumbent: Evaluation, sensitivities: Sensitivities, trust: float) -> Proposal:
        here, residual = incumbent.candidate.point, residual_of(incumbent)
        step = sensitivities.step(residual, here, trust)
        point = np.clip(here + step.round(DECIMALS), 0.0, 1.0)
        all_but_one = np.where(np.eye(len(step), dtype=bool), 0.0, step)
        left, *without = incumbent.loss * sensitivities.remaining(residual, np.vstack([step, all_but_one]))
        unidentified = unidentified_directions(sensitivities, residual)
        effects = np.linalg.norm(sensitivities.measured, axis=1)
        missing = {i for direction in unidentified for i in direction.members}
        notes = {
            "trust": round(trust, 4),
            "expected_loss": float(left),
            "not_identified": [name for i, name in enumerate(self._space.names) if i in missing],
        }
        return Proposal(
            point,
            diagnose_sensitivities(
                self._space, sensitivities.place, incumbent.loss, effects, unidentified, incumbent.detail
            ),
            reason(self._space, here, point, np.array(without) - left),
            notes,
        )


def _gained(finished: Round) -> bool:
    """Whether a round has lowered the loss by more than what old slopes give."""
    return finished.accepted and finished.steps[-1].evaluation.loss < (1 - GAIN) * finished.incumbent.loss


def trust_radius(rounds: Sequence[Round]) -> float:
    """Half width of the box around the incumbent that a proposal stays in, from how far the steps so far were good.

    After a round that failed it is twice the difference that is measured next, or more.
    """
    trust = TRUST_START
    for number, finished in enumerate(rounds, start=1):
        full, last = (
            float(np.abs(step.evaluation.candidate.point - finished.incumbent.candidate.point).max())
            for step in (finished.steps[0], finished.steps[-1])
        )
        if not finished.accepted:
            trust = max(SHRINK * last, 2 * measured_change(rounds[:number]))
        elif len(finished.steps) == 1:
            trust = max(trust, GROW * full)
        else:
            trust = last
        trust = float(np.clip(trust, TRUST_LEAST, TRUST_MOST))
    return trust


def measured_change(rounds: Sequence[Round]) -> float:
    """By how much a parameter is changed to measure it, in the unit cube: half as much after each failure in a row.

    Where the error is rough, a narrow difference says nothing of what lies a little farther off.
    """
    failures = 0
    for finished in reversed(rounds):
        if finished.accepted:
            break
        failures += 1
    return max(DIFFERENCE * SHRINK**failures, LEAST_DIFFERENCE)
