"""The built-in physics advisor: rules and measured sensitivities, not a VLM.

It reads the same evidence that a VLM gets, believes what a measured response of the robot says as far as the run has
not shown otherwise, and proposes the point within its trust that it expects to be best. It never simulates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import Bounds, minimize

from swim2real.advisor.physics.model import (
    Aim,
    Expectation,
    Features,
    Surrogate,
    Swims,
    direction,
    expected_slopes,
    read_swims,
    reason,
    shape_floor,
    to_speed_scale,
    without_outliers,
)
from swim2real.objective.figures import FitFigures
from swim2real.objective.trial import TAIL_FIRST_LOSS
from swim2real.optimizers import Evaluation, Proposal, Round, Situation
from swim2real.optimizers.advisor import DECIMALS, MEASURED
from swim2real.optimizers.local_model import LocalModel
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

TRIED = "tried"  # note of a step of the local model: the parameter that is changed since little is known of it
_CLOSE = 0.05  # relative difference that isn't worth a word
_CAUTION, _BOLDER = 0.3, 0.3  # weight of the variance, and what a round without real progress makes of it
_PROGRESS = 0.02  # by how much a round must lower the loss to count as progress
_TRUST_START, _TRUST_LEAST, _TRUST_MOST = 0.5, 0.08, 0.7  # half width of the trusted box, in the unit cube
_GROW, _SHRINK = 1.3, 0.7
_SAMPLES, _STARTS = 3000, 4
_ENOUGH, _VAIN = 7, 3  # evaluations that go forward, after which the local model proposes; rounds in which it failed
_RADIUS = 0.15  # of the local model's steps: what it doesn't know keeps them shorter
_DIFFERENCE = 1e-4
_GRAIN = 9  # decimals of an expected loss [m], for the same reason as those of a proposal


class PhysicsAdvisor:
    """Proposes parameters from measured sensitivities and what the run has shown."""

    def __init__(self, robot: Robot, space: ParameterSpace, seed: int, solves: bool = True) -> None:
        """Prepares the advisor.

        Args:
            robot: The robot whose simulator is calibrated.
            space: Parameters as the optimizer uses them, on any scale. The advisor itself uses the logarithmic one.
            seed: Seed of the run.
            solves: Whether it steps by the local model once the run has shown enough.

        Raises:
            ArgumentError: Nobody has measured the robot's response.
        """
        if robot.swims.response is None:
            raise ArgumentError(
                f"nobody has measured how robot '{robot.name}' responds to its parameters, which advisor physics "
                f"needs; choose another one"
            )
        self._response, self._space, self._seed = robot.swims.response, space, seed
        self._own, self._slopes = replace(space, scale="log"), expected_slopes(robot, space)
        self.needs_residual = solves

    def propose(self, situation: Situation) -> Proposal:
        """The point within its trust that it expects to be best."""
        usable = [e for e in situation.evaluations if not e.failed]
        rng = np.random.default_rng([self._seed, len(situation.rounds)])
        trust = trust_radius([one for one in situation.rounds if TRIED not in one.proposal.notes])
        here = self._point(situation.incumbent)
        if situation.incumbent.failed or not usable:
            point = 0.5 + 0.5 * trust * rng.uniform(-1, 1, len(here))
            return Proposal(
                self._back(point), "The simulation diverged.", "A point near the middle of the box is safer.", {}
            )
        if (solved := self._solved(usable, situation)) is not None:
            return solved
        expectation = self._expectation(usable, situation.incumbent, situation.rounds)
        point = self._best_point(expectation, here, trust, rng)
        if self._slopes is not None:  # the response holds where what it knows nothing of is as in the model
            stepped = any(TRIED in one.proposal.notes for one in situation.rounds)
            known = self._slopes(situation.incumbent).any(axis=1)
            point = np.where(known, point, here if stepped else self._own.to_cube(self._own.published))
        before, after = expectation.losses(np.array([here, point]))
        notes = {"trust": round(trust, 4), "expected_loss": float(after), "expected_loss_here": float(before)}
        reasoning = reason(self._own, here, point, self._gains(expectation, here, point))
        return Proposal(self._back(point), _diagnosis(_figures(situation.incumbent)), reasoning, notes)

    def _solved(self, usable: Sequence[Evaluation], situation: Situation) -> Proposal | None:
        """The step that the local model proposes, once the run has shown enough; None before, and after vain ones.

        Where that promises no progress, the parameter of which least is known changes, too.
        """
        if not self.needs_residual or sum(bool(one.stages) and one.loss < TAIL_FIRST_LOSS for one in usable) < _ENOUGH:
            return None
        lately = situation.rounds[-_VAIN:]
        vain = len(lately) == _VAIN and all(one.proposal.notes.get(TRIED) == "" and not one.accepted for one in lately)
        if vain:
            return None
        model = LocalModel(usable, self._slopes)
        here, names = model.base.candidate.point, self._space.names
        point = model.solve(_RADIUS)
        notes: dict[str, object] = {TRIED: ""}
        if model.predict(point).loss > (1 - _PROGRESS) * model.base.loss:
            tried, least = _with_unknown(model, point)
            if least is not None:
                point, notes[TRIED] = tried, names[least]
        expected, gains = model.predict(point), -model.loss_slopes[0] * (point - here)
        notes |= {"expected_loss": expected.loss, "known": float(expected.known)}
        diagnosis = _diagnosis(_figures(situation.incumbent))
        # of a step that failed the model learns more than half of it would show
        return Proposal(point, diagnosis, reason(self._space, here, point, gains), notes, step_sizes=(1.0,))

    def _point(self, evaluation: Evaluation) -> Array:
        return self._own.to_cube(self._space.to_values(evaluation.candidate.point))

    def _back(self, point: Array) -> Array:
        return self._space.to_cube(self._own.to_values(point)).round(DECIMALS)

    def _expectation(
        self, evaluations: Sequence[Evaluation], incumbent: Evaluation, rounds: Sequence[Round]
    ) -> Expectation:
        here = _figures(incumbent)
        whole = all(trial.path_beat_real is not None for trial in here.trials.values())
        frame, driven = "path" if whole else "body", _frequencies(here)
        real = read_swims(here, "real", frame)
        points = np.array([self._point(e) for e in evaluations])
        shape = np.array([trial.shape_error for trial in here.trials.values()], dtype=float)
        floor = shape_floor(shape, read_swims(here, "simulated").beat, read_swims(here, "real").beat)
        aim = Aim(real.speed, real.beat, floor, here.horizon or 4.0)
        simulated = [read_swims(_figures(e), "simulated", frame) for e in evaluations]
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
    trust = _TRUST_START
    for finished in rounds:
        if not finished.accepted:
            trust = trust * _SHRINK if trust > _TRUST_LEAST else _TRUST_START
        elif len(finished.steps) == 1:
            trust *= _GROW
        else:
            trust *= finished.steps[-1].step_size ** 0.25
        trust = float(np.clip(trust, _TRUST_LEAST, _TRUST_MOST))
    return trust


def _with_unknown(model: LocalModel, point: Array) -> tuple[Array, int | None]:
    """The point with a change of the parameter of which least is known, where that may help, for all that is known.

    The change is one that may double the loss at most, so that it tells of slopes.
    """
    here = model.base.candidate.point
    for i in np.argsort(-model.unknown, kind="stable"):
        if MEASURED * model.unknown[i] < _PROGRESS * model.base.loss:
            break
        ahead = np.sign(point[i] - here[i]) or np.sign(0.5 - here[i]) or 1.0
        size = min(MEASURED, model.base.loss / model.unknown[i])
        for side in (ahead, -ahead):
            tried = point.copy()
            tried[i] = np.clip(np.round(here[i] + side * size, DECIMALS), 0.0, 1.0)
            helps = model.predict(tried).loss - model.unknown_at(tried) < model.base.loss
            if helps and abs(tried[i] - here[i]) > size / 2 and model.safe(tried):
                return tried, int(i)
    return point, None


def caution(rounds: Sequence[Round]) -> float:
    """Weight of what the surrogate doesn't know: a run that gets nowhere tries what it is less sure of."""
    weight = _CAUTION
    for finished in reversed(rounds):
        gained = finished.accepted and finished.steps[-1].evaluation.loss < (1 - _PROGRESS) * finished.incumbent.loss
        if gained:
            break
        weight *= _BOLDER
    return weight


def _figures(evaluation: Evaluation) -> FitFigures:
    return FitFigures.model_validate(evaluation.detail)


def _frequencies(figures: FitFigures) -> Array:
    """Frequency of each trial [Hz]. Shape (F,)."""
    return np.array([trial.frequency for trial in figures.trials.values()], dtype=float)


def _learned(speeds: Array, beats: Array, real: Swims, driven: Array) -> Features:
    """Features to learn from: no outlying speeds, and zeros for markers that never count."""
    scaled = np.array([without_outliers(one, driven) for one in to_speed_scale(speeds)])
    beats = np.where(np.isfinite(real.beat), np.nan_to_num(beats), 0.0)
    return Features(scaled, direction(speeds, driven), beats, np.zeros(len(speeds)))


def _diagnosis(figures: FitFigures) -> str:
    """Difference between simulated and real swims: speed over frequency first, then the beat."""
    frequencies, real, simulated = _frequencies(figures), read_swims(figures, "real"), read_swims(figures, "simulated")
    order = np.argsort(frequencies)
    speeds = [
        _speed(float(frequencies[i]), float(real.speed[i]), float(simulated.speed[i])) for i in (order[0], order[-1])
    ]
    sentences = [". ".join(speeds[: len(order)]) + "."]
    backward = frequencies[order][simulated.speed[order] < 0]
    forward = simulated.speed > 0
    if 0 < backward.size < len(order):
        sentences.append(
            f"It swims backward at {_listed(backward)} Hz: its thrust has no reserve against what opposes it."
        )
    elif backward.size:
        sentences.append("It swims tail first throughout: what opposes thrust is stronger than lift.")
    if forward.sum() > 1:
        sentences.append(_slope(frequencies[forward], real.speed[forward], simulated.speed[forward]))
    sentences.append(_beat(real, simulated))
    name, worst = max(figures.trials.items(), key=lambda item: item[1].aligned_marker_error or 0.0)
    sentences.append(
        f"The worst trial is {name} with {1e3 * (worst.aligned_marker_error or 0.0):.0f} mm, of which shape alone is "
        f"{1e3 * (worst.shape_error or 0.0):.0f} mm."
    )
    return " ".join(sentences)


def _speed(frequency: float, real: float, simulated: float) -> str:
    measured = f"At {frequency:.2f} Hz it swims {1e3 * simulated:.0f} mm/s, the real one {1e3 * real:.0f} mm/s"
    if simulated <= 0 or abs(simulated - real) <= _CLOSE * abs(real):
        return measured
    factor = simulated / real
    size = (
        f"{factor:.1f} times too fast"
        if factor >= 2
        else f"{100 * abs(factor - 1):.0f} % too {'fast' if factor > 1 else 'slow'}"
    )
    return f"{measured}: {size}"


def _slope(frequencies: Array, real: Array, simulated: Array) -> str:
    logs = np.log(frequencies)
    steepness = [np.polyfit(logs, np.log(np.maximum(speed, 1e-4)), 1)[0] for speed in (real, simulated)]
    text = f"Speed grows with frequency to the power {steepness[1]:.1f}, in reality {steepness[0]:.1f}"
    if abs(steepness[1] - steepness[0]) < 0.1:
        return text + ", which fits."
    if steepness[1] < steepness[0]:
        return text + ": too much thrust at low frequencies or too much resistance at high ones."
    return text + ": too little thrust at low frequencies or too little resistance at high ones."


def _beat(real: Swims, simulated: Swims) -> str:
    half = real.beat.shape[1] // 2
    sizes = [np.hypot(side.beat[:, half - 1], side.beat[:, -1]) for side in (real, simulated)]
    known = np.isfinite(sizes[0]) & np.isfinite(sizes[1]) & (sizes[0] > 0)
    if not known.any():
        return "The tail tip is lost in all trials, so its beat can't be compared."
    ratio = float(np.mean(sizes[1][known] / sizes[0][known]))
    if abs(ratio - 1) <= _CLOSE:
        return f"The tail tip's amplitude fits ({100 * (ratio - 1):+.0f} %)."
    return f"The tail tip beats {100 * abs(ratio - 1):.0f} % too {'wide' if ratio > 1 else 'narrow'}."


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
