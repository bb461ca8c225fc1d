"""Optimizers that follow an advisor: backtracking line search (paper, Algorithm 1 and Eq. 2) and warm start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from swim2real.errors import OptimizerError
from swim2real.optimizers.advisor import Advisor, Measurement, Proposal, Round, Situation, Step, reads_residuals
from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point

_DESCENTS = 3  # searches that are begun at most; then the lowest goes on
_FAILURES, _PASSED, _CLEARLY = 2, 4, 0.02  # rounds that may fail and pass before the loss is lower by this share


@dataclass
class _Descent:
    """A search from one start.

    Attributes:
        first: Evaluation of the start.
        incumbent: Lowest evaluation that it came to.
        rounds: Its finished rounds.
    """

    first: Evaluation
    incumbent: Evaluation
    rounds: list[Round] = field(default_factory=list[Round])

    @property
    def is_stalled(self) -> bool:
        """Whether two rounds have failed, or four have passed, since the loss was last clearly lowered."""
        mark, passed, failures = self.first.loss, 0, 0
        for finished in self.rounds:
            lowest = min(finished.incumbent.loss, *(step.evaluation.loss for step in finished.steps))
            if lowest < (1 - _CLEARLY) * mark:
                mark, passed, failures = lowest, 0, 0
            passed, failures = passed + 1, failures + (not finished.accepted)
        return failures >= _FAILURES or passed > _PASSED


class BacktrackingLineSearch(Optimizer):
    """Tries an advisor's direction at the full step, then at ever smaller ones, and keeps the first improvement.

    From the incumbent θ and the proposal θ′ it evaluates clip(θ + βᵏ (θ′ − θ)) for k = 0 … K − 1. A round without an
    improvement is rejected; the advisor finds it in the history when it is asked again. Points that the advisor wants
    measured first are evaluated as they are.

    Of several starts all are evaluated first, and the search goes on from the best of them. When two rounds have failed
    with hardly a gain between them, a new search begins at the next best start, with a history of its own; after three
    searches the lowest goes on.
    """

    def __init__(
        self, advisor: Advisor, first: Array, decrease_factor: float = 0.5, max_steps: int = 3,
        early_stop: bool = False, give_up: float | None = None, more_starts: Sequence[Array] = (),
    ) -> None:  # fmt: skip
        """Prepares the search.

        Args:
            advisor: Advisor that proposes the directions.
            first: First point of the run. Shape (d,).
            decrease_factor: β, within 0 and 1.
            max_steps: K; 1 is the ablation without line search.
            early_stop: Whether evaluations of steps may stop once they are certain to be rejected. The same steps are
                accepted, but the advisor then sees less of rejected ones.
            give_up: A direction is left after its full step where every trial's loss is more than so many times the
                incumbent's; None tries all steps, as the paper does.
            more_starts: Points where a search may begin as well. Shapes (d,).

        Raises:
            OptimizerError: A setting is out of range.
        """
        super().__init__(len(first))
        if not 0 < decrease_factor < 1:
            raise OptimizerError(f"decrease_factor is {decrease_factor}; it must lie between 0 and 1")
        if max_steps < 1:
            raise OptimizerError(f"max_steps is {max_steps}; it must be at least 1")
        if give_up is not None and not give_up > 1:
            raise OptimizerError(f"give_up is {give_up}; it must be above 1")
        self._give_up = give_up
        self._advisor = advisor
        self.needs_residual = reads_residuals(advisor)
        self._start_points = [cube_point(first), *(cube_point(point, len(first)) for point in more_starts)]
        self._decrease_factor, self._max_steps, self._early_stop = decrease_factor, max_steps, early_stop
        self._starts: list[Evaluation] = []
        self._descents: list[_Descent] = []
        self._descent: _Descent | None = None
        self._count = 0  # finished rounds of all descents
        self._proposal: Proposal | None = None
        self._steps: list[Step] = []
        self._measurements: list[Evaluation] = []

    @property
    def rounds(self) -> tuple[Round, ...]:
        """The finished rounds of the present search."""
        return tuple(self._descent.rounds) if self._descent is not None else ()

    def _next(self) -> Candidate:
        evaluated = len(self._starts)
        if evaluated < len(self._start_points):
            note = {"source": "start", "start": evaluated + 1} if evaluated else {"source": "first point"}
            return Candidate(self._start_points[evaluated], note)
        descent = self._present_descent()
        if self._proposal is None:
            elsewhere = sum(1 + len(r.measurements) for d in self._descents if d is not descent for r in d.rounds)
            situation = Situation(
                descent.incumbent, self.rounds, descent.first, tuple(self._measurements), elsewhere
            )  # fmt: skip
            advice = self._advisor.propose(situation)
            if isinstance(advice, Measurement):
                return advice.candidate
            cube_point(advice.point, self.dimension)
            self._proposal = advice
        step_size = self._step_size
        start = descent.incumbent.candidate.point
        point = cube_point(np.clip(start + step_size * (self._proposal.point - start), 0.0, 1.0))
        note: dict[str, Any] = {"source": "line search", "round": self._count + 1, "step_size": step_size}
        if not self._steps:
            note["proposal"] = self._proposal.as_dict()
        return Candidate(point, note, descent.incumbent.loss if self._early_stop else None)

    def _present_descent(self) -> _Descent:
        """The search that goes on, or the one that takes its place where it has stalled between two rounds."""
        between = self._proposal is None and not self._measurements
        if self._descent is not None and not (between and self._descent.is_stalled):
            return self._descent
        begun = [descent.first for descent in self._descents]
        left = [one for one in self._starts if not any(one is first for first in begun)]
        if left and len(begun) < _DESCENTS:
            best = min(left, key=lambda one: (one.failed, one.loss))
            self._descents.append(_Descent(best, best))
            self._descent = self._descents[-1]
        else:
            self._descent = min(self._descents, key=lambda one: (one.incumbent.failed, one.incumbent.loss))
        return self._descent

    @property
    def _step_size(self) -> float:
        return self._decrease_factor ** len(self._steps)

    def _learn(self, evaluation: Evaluation) -> None:
        if self._descent is None:
            self._starts.append(evaluation)
            return
        incumbent = self._descent.incumbent
        better = not evaluation.failed and not evaluation.lower_bound
        better = better and (incumbent.failed or evaluation.loss < incumbent.loss)
        if better:
            self._descent.incumbent = evaluation
        if self._proposal is None:
            self._measurements.append(evaluation)
        else:
            self._steps.append(Step(self._step_size, evaluation))
            if better or len(self._steps) == self._max_steps or self._is_hopeless(evaluation, incumbent):
                self._finish(self._descent, self._proposal, incumbent, accepted=better)

    def _is_hopeless(self, step: Evaluation, incumbent: Evaluation) -> bool:
        """Whether a direction is left early, because a step is far worse in every trial."""
        if self._give_up is None or incumbent.failed or step.lower_bound:
            return False
        losses = [
            {name: trial.get("loss") for name, trial in (one.detail or {}).get("trials", {}).items()}
            for one in (step, incumbent)
        ]
        pairs = [(loss, losses[1].get(name)) for name, loss in losses[0].items()]
        known = [(there, here) for there, here in pairs if there is not None and here is not None]
        return bool(known) and all(there > self._give_up * here for there, here in known)

    def _finish(self, descent: _Descent, proposal: Proposal, incumbent: Evaluation, accepted: bool) -> None:
        descent.rounds.append(Round(proposal, incumbent, tuple(self._steps), accepted, tuple(self._measurements)))
        self._count += 1
        self._proposal, self._steps, self._measurements = None, [], []


class WarmStart(Optimizer):
    """The first point, one proposal of an advisor in full, then another optimizer (the single-call ablation)."""

    def __init__(self, advisor: Advisor, first: Array, then: Optimizer) -> None:
        """Prepares the search.

        Args:
            advisor: Advisor that is asked for one proposal.
            first: First point of the run. Shape (d,).
            then: Optimizer that takes over; it learns from its own candidates alone.
        """
        super().__init__(len(first))
        self.needs_residual = reads_residuals(advisor) or then.needs_residual
        self._advisor, self._first_point, self._then = advisor, cube_point(first), then
        self._evaluations: list[Evaluation] = []  # of the first point and of measurements
        self._state: Literal["measuring", "proposed", "handed over"] = "measuring"

    def _next(self) -> Candidate:
        if not self._evaluations:
            return Candidate(self._first_point, {"source": "first point"})
        if self._state == "measuring":
            first, *measured = self._evaluations
            incumbent = min((e for e in self._evaluations if not e.failed), key=lambda e: e.loss, default=first)
            advice = self._advisor.propose(Situation(incumbent, (), first, tuple(measured)))
            if isinstance(advice, Measurement):
                return advice.candidate
            self._state = "proposed"
            note = {"source": "warm start", "round": 1, "step_size": 1.0, "proposal": advice.as_dict()}
            return Candidate(cube_point(advice.point), note)
        return self._then.ask()

    def _learn(self, evaluation: Evaluation) -> None:
        if self._state == "measuring":
            self._evaluations.append(evaluation)
        elif self._state == "proposed":
            self._state = "handed over"
        else:
            self._then.tell(evaluation)
