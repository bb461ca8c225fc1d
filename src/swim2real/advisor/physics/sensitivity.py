"""The physics advisor of any robot: it measures what each parameter does, and steps to where the error is least.

It knows no robot. It has single parameters changed one after the other, keeps a linear model of the residual that
learns from every evaluation, and proposes what the model promises most of within a trust that grows and shrinks with
its successes. When that fails it measures again, in smaller steps.

It also says what the trials don't determine. A direction in the unit cube is undetermined when a change over the whole
range alters the residual by little: against what no change of the parameters explains, against the error of the
measured differences, or against the direction that is determined best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swim2real.advisor.physics.model import reason
from swim2real.formatting import listed
from swim2real.objective.figures import FitFigures
from swim2real.optimizers import Advice, Evaluation, Measurement, Proposal, Round, Situation
from swim2real.optimizers.advisor import DECIMALS
from swim2real.optimizers.least_squares import box_step, updated
from swim2real.parameters import ParameterSpace
from swimbase.arrays import Array
from swimbase.errors import AdvisorError

_TRUST_START, _TRUST_LEAST, _TRUST_MOST = 0.4, 1e-4, 1.0  # half width of the trusted box, in the unit cube
_GROW, _SHRINK = 2.0, 0.5
_DIFFERENCE, _LEAST_DIFFERENCE = 0.03, 1e-3  # change of a parameter that is measured, in the unit cube
_GAIN = 0.01  # of the loss: a round that lowers it by less calls for new slopes
_ATTEMPTS = 2  # at measuring a parameter: to one side, and where that diverges to the other
_NO_EFFECT = 1e-3  # of the largest effect
_DAMPING = 1e-6  # of the mean curvature
_UNEXPLAINED = 0.2  # of the residual that no change explains: errors of neighboring samples are alike, so not all of it
_CURVED = 0.5  # of a difference's width: by how much of itself it may be wrong
_MEMBER = 0.2  # of a direction's largest component: below, a parameter has no part in it
_ROBUST = 0.2  # of the root mean square: residuals well below it weigh by their squares, well above by their size
_MOST_SENSITIVE = 3  # parameters that the residual answers to most
_ALIKE = 1.25  # two changes whose ratio is less may be the same
_NUDGE = 1e-4  # of the cube


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
        """Next measurement to make before a proposal, or the point that promises most within its trust."""
        incumbent = situation.incumbent
        if incumbent.failed:
            return self._elsewhere(situation)
        sensitivities = _learn_sensitivities([e for e in situation.evaluations if not e.failed])
        trust = _trust_radius(situation.rounds)
        parameter = self._next_to_measure(situation)
        if parameter is not None:
            return self._measurement(parameter, situation, sensitivities)
        return self._proposal(incumbent, sensitivities, trust)

    def _elsewhere(self, situation: Situation) -> Measurement:
        """Nothing has gone well yet: a random point near the middle, where simulations are safer."""
        rng = np.random.default_rng([self._seed, len(situation.measurements)])
        return Measurement(0.5 + _TRUST_START * rng.uniform(-1, 1, len(self._space)))

    def _next_to_measure(self, situation: Situation) -> int | None:
        """A parameter, None when a proposal is due."""
        measured = [e for e in situation.measurements if "parameter" in e.candidate.note]
        last = situation.rounds[-1] if situation.rounds else None
        outworn = last is not None and not last.measurements and not _gained(last)
        if last is not None and not outworn and not measured:
            return None
        for i, name in enumerate(self._space.names):
            outcomes = [not e.failed for e in measured if e.candidate.note["parameter"] == name]
            if not any(outcomes) and len(outcomes) < _ATTEMPTS:
                return i
        return None

    def _measurement(self, i: int, situation: Situation, sensitivities: _Sensitivities) -> Measurement:
        """A step of one parameter: downhill where that is known, and the other way where that has diverged."""
        here = situation.incumbent
        point, name = here.candidate.point, self._space.names[i]
        width = _measured_change(situation.rounds)
        slope = sensitivities.slopes(_residual_of(here))[i]
        side = -np.sign(slope) if slope else 1.0 if point[i] <= 0.5 else -1.0
        if any(e.candidate.note.get("parameter") == name for e in situation.measurements):
            side = -side
        if not 0 <= point[i] + side * width <= 1:
            side = -side
        return Measurement.of_one(point, i, name, float(side * width))

    def _proposal(self, incumbent: Evaluation, sensitivities: _Sensitivities, trust: float) -> Proposal:
        here, residual = incumbent.candidate.point, _residual_of(incumbent)
        step = sensitivities.step(residual, here, trust)
        point = np.clip(here + step.round(DECIMALS), 0.0, 1.0)
        all_but_one = np.where(np.eye(len(step), dtype=bool), 0.0, step)
        left, *without = incumbent.loss * sensitivities.remaining(residual, np.vstack([step, all_but_one]))
        unidentified = _unidentified_directions(sensitivities, residual)
        effects = np.linalg.norm(sensitivities.measured, axis=1)
        missing = {i for direction in unidentified for i in direction.members}
        notes = {
            "trust": round(trust, 4),
            "expected_loss": float(left),
            "not_identified": [name for i, name in enumerate(self._space.names) if i in missing],
        }
        return Proposal(
            point,
            _diagnosis(self._space, sensitivities.place, incumbent, effects, unidentified),
            reason(self._space, here, point, np.array(without) - left),
            notes,
        )


def _gained(finished: Round) -> bool:
    """True if a round has lowered the loss by more than what old slopes give."""
    return finished.accepted and finished.steps[-1].evaluation.loss < (1 - _GAIN) * finished.incumbent.loss


def _trust_radius(rounds: Sequence[Round]) -> float:
    """Half width of the box around the incumbent that a proposal stays in, from how far the steps so far were good.

    After a round that failed it is twice the difference that is measured next, or more.
    """
    trust = _TRUST_START
    for number, finished in enumerate(rounds, start=1):
        full, last = (
            float(np.abs(step.evaluation.candidate.point - finished.incumbent.candidate.point).max())
            for step in (finished.steps[0], finished.steps[-1])
        )
        if not finished.accepted:
            trust = max(_SHRINK * last, 2 * _measured_change(rounds[:number]))
        elif len(finished.steps) == 1:
            trust = max(trust, _GROW * full)
        else:
            trust = last
        trust = float(np.clip(trust, _TRUST_LEAST, _TRUST_MOST))
    return trust


def _measured_change(rounds: Sequence[Round]) -> float:
    """By how much a parameter is changed to measure it, in the unit cube: half as much after each failure in a row.

    Where the error is rough, a narrow difference says nothing of what lies a little farther off.
    """
    failures = 0
    for finished in reversed(rounds):
        if finished.accepted:
            break
        failures += 1
    return max(_DIFFERENCE * _SHRINK**failures, _LEAST_DIFFERENCE)


@dataclass(frozen=True)
class _Sensitivities:
    """Change of the residual over each parameter's whole range, were it linear.

    Attributes:
        gradients: Around the incumbent, as far as all evaluations have shown [m]. Shape (d, n).
        measured: Measured in the last steps along a single parameter each, 0 without any [m]. Shape (d, n).
        widths: Widths of those steps, in the unit cube. Shape (d,).
        place: Where the last of them began. Shape (d,).
    """

    gradients: Array
    measured: Array
    widths: Array
    place: Array

    def step(self, residual: Array, point: Array, radius: float) -> Array:
        """The step that the model expects most of, within a box around the point and the unit cube. Shape (d,)."""
        root = np.sqrt(_weights(residual))
        return box_step(self.gradients * root, residual * root, point, radius, _DAMPING)[0]

    def remaining(self, residual: Array, steps: Array) -> Array:
        """The share of the loss that the model expects to be left after each step. Shapes (n,), (N, d) to (N,)."""
        weights = _weights(residual)
        after = residual + np.einsum("ki,in->kn", steps, self.gradients)
        before = float(np.einsum("n,n,n->", weights, residual, residual))
        return np.sqrt(np.einsum("n,kn,kn->k", weights, after, after) / max(before, 1e-300))

    def slopes(self, residual: Array) -> Array:
        """Which way each parameter makes the residual larger. Shapes (n,) to (d,)."""
        return np.einsum("in,n,n->i", self.gradients, _weights(residual), residual)


def _residual_of(evaluation: Evaluation) -> Array:
    """Residual of a usable evaluation [m]. Shape (n,).

    Raises:
        AdvisorError: The evaluation lacks its residual.
    """
    if evaluation.residual is None:
        raise AdvisorError("an evaluation has no residual, which measured sensitivities need; tell it with the loss")
    return evaluation.residual


def _learn_sensitivities(evaluations: Sequence[Evaluation]) -> _Sensitivities:
    """Learns from each evaluation against the best one before it.

    A step of a single parameter is that parameter's doing. Others are put down to the parameters that had an effect.

    Args:
        evaluations: Usable evaluations in the order of the run, at least one.
    """
    base, *others = evaluations
    gradients = np.zeros((base.candidate.point.size, _residual_of(base).size))
    measured, widths, place = np.zeros_like(gradients), np.zeros(len(gradients)), base.candidate.point
    effects = np.zeros(len(gradients))
    for evaluation in others:
        step = evaluation.candidate.point - base.candidate.point
        change = _residual_of(evaluation) - _residual_of(base)
        moved = np.flatnonzero(step)
        if moved.size == 1:
            measured[moved], widths[moved], place = change / step[moved], np.abs(step[moved]), base.candidate.point
            effects = np.linalg.norm(measured, axis=1)
        else:
            step = np.where(effects > _NO_EFFECT * effects.max(), step, 0.0)
        gradients = updated(gradients, change, step)
        if evaluation.loss < base.loss:
            base = evaluation
    return _Sensitivities(gradients, measured, widths, place)


def _weights(residual: Array) -> Array:
    """Weights of squares such that less of them is a lower loss, which is a mean of lengths. Shape (n,)."""
    size = _ROBUST * float(np.sqrt(np.mean(residual**2))) + 1e-15
    return 1 / np.sqrt(residual**2 + size**2)


@dataclass(frozen=True)
class _Unidentified:
    """A direction that the residual hardly answers to.

    Attributes:
        members: Indices of the parameters that take part in it, in order.
        changes: Changes of these parameters along the direction, relative to the largest. Shape of `members`.
    """

    members: tuple[int, ...]
    changes: Array


def _unidentified_directions(sensitivities: _Sensitivities, residual: Array) -> tuple[_Unidentified, ...]:
    """Finds what the trials can't tell near a point, each direction with as few parameters as possible.

    Args:
        sensitivities: Measured sensitivities; steps along several parameters don't count.
        residual: Residual at the point [m]. Shape (n,).
    """
    measured = sensitivities.measured
    curvature = np.einsum("in,jn->ij", measured, measured)
    squares, directions = np.linalg.eigh(curvature)
    strength = np.sqrt(np.maximum(squares, 0.0))
    wrong = np.sqrt(directions.T**2 @ (sensitivities.widths**2 * np.diag(curvature)))
    limit = np.maximum(_CURVED * wrong, max(_UNEXPLAINED * _unexplained(measured, residual), _NO_EFFECT * strength[-1]))
    return tuple(_direction(row) for row in _sparse(directions.T[strength <= limit]))


def _unexplained(measured: Array, residual: Array) -> float:
    """Length of what is left of a residual when all parameters are fitted to it [m]."""
    basis = np.linalg.svd(measured, full_matrices=False)[2]
    inside = np.einsum("in,n->i", basis, residual)
    return float(np.sqrt(max(np.einsum("n,n->", residual, residual) - float(inside @ inside), 0.0)))


def _sparse(rows: Array) -> Array:
    """Rows that span the same, each with a parameter of its own: Gauss and Jordan's elimination with full pivoting."""
    rows = rows.copy()
    for i in range(len(rows)):
        k, pivot = divmod(int(np.argmax(np.abs(rows[i:]))), rows.shape[1])
        rows[[i, i + k]] = rows[[i + k, i]]
        rows[i] /= rows[i, pivot]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, pivot], rows[i])
    return rows


def _direction(row: Array) -> _Unidentified:
    row = row / row[np.argmax(np.abs(row))]
    members = np.flatnonzero(np.abs(row) >= _MEMBER)
    return _Unidentified(tuple(int(i) for i in members), row[members])


def _diagnosis(
    space: ParameterSpace, place: Array, incumbent: Evaluation, effects: Array, unidentified: Sequence[_Unidentified]
) -> str:
    """Error of the simulation, and the parameters that the trials identify.

    Args:
        space: On the scale of the place.
        place: Where the effects were measured. Shape (d,).
        incumbent: Best evaluation so far.
        effects: Change of the residual over each parameter's whole range [m]. Shape (d,).
        unidentified: Directions in which the trials tell nothing.
    """
    alone = {direction.members[0] for direction in unidentified if len(direction.members) == 1}
    order = [int(i) for i in np.argsort(-effects, kind="stable") if i not in alone]
    sentences = [f"The simulation is {1e3 * incumbent.loss:.3g} mm off."]
    trials = FitFigures.model_validate(incumbent.detail or {}).trials
    errors = {name: trial.loss for name, trial in trials.items() if trial.loss is not None}
    if len(trials) > 1 and errors:
        worst = max(errors, key=lambda name: errors[name])
        sentences.append(f"The worst trial is {worst} with {1e3 * errors[worst]:.3g} mm.")
    if order:
        effective = [f"{space.names[i]} ({1e3 * effects[i]:.3g} mm over its range)" for i in order[:_MOST_SENSITIVE]]
        sentences.append(f"The error answers most to {listed(effective)}.")
    if alone:
        names = listed([space.names[i] for i in sorted(alone)], len(alone))
        them = "it" if len(alone) == 1 else "them"
        sentences.append(f"It hardly answers to {names}: these trials don't determine {them} so far.")
    several = [direction for direction in unidentified if len(direction.members) > 1]
    return " ".join([*sentences, *(_combination(space, place, direction) for direction in several)])


def _combination(space: ParameterSpace, place: Array, direction: _Unidentified) -> str:
    names = listed([space.names[i] for i in direction.members], len(direction.members))
    kind = _kind(space, place, direction) if len(direction.members) == 2 else None
    return f"Of {names} only {f'the {kind}' if kind else 'a combination'} is seen."


def _kind(space: ParameterSpace, place: Array, direction: _Unidentified) -> str | None:
    """Combination of two parameters that is constant along an unidentified direction; None if nothing simple does."""
    members, there = list(direction.members), np.clip(place, _NUDGE, 1 - _NUDGE)
    slopes = space.to_array(there + _NUDGE) - space.to_array(there - _NUDGE)
    changes = slopes[members] * direction.changes
    values = space.to_array(there)[members]
    opposite = changes[0] * changes[1] < 0
    unlike = {}
    if len({space.parameters[i].unit for i in members}) == 1:
        unlike["sum" if opposite else "difference"] = _unlike(changes)
    if np.all(values != 0):
        unlike["product" if opposite else "ratio"] = _unlike(changes / values)
    kind = min(unlike, key=lambda name: unlike[name], default=None)
    return kind if kind is not None and unlike[kind] <= _ALIKE else None


def _unlike(pair: Array) -> float:
    """Ratio of the larger to the smaller."""
    small, large = np.sort(np.abs(pair))
    return float(large / small) if small > 0 else np.inf
