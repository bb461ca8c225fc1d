"""Backtracking line search along the directions that an advisor proposes (paper, Algorithm 1 and Eq. 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from swim2real.optimizers.advisor import (
    STAYS,
    Advice,
    Advisor,
    Measurement,
    Proposal,
    Round,
    Situation,
    Step,
    reads_residuals,
)
from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point
from swimbase.errors import OptimizerError

_DESCENTS = 3  # searches that are begun at most; then the lowest goes on
_JUMP = 5.0  # times the loss before: a step that comes so high has gone over an edge
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
        """True if two rounds have failed, or four have passed, since the loss was last clearly lowered."""
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
        more_starts: Sequence[Array] = (),
    ) -> None:  # fmt: skip
        """Prepares the search.

        Args:
            advisor: Advisor that proposes the directions.
            first: First point of the run. Shape (d,).
            decrease_factor: β, within 0 and 1.
            max_steps: K; 1 is the ablation without line search.
            more_starts: Points where a search may begin as well. Shapes (d,).

        Raises:
            OptimizerError: A setting is out of range.
        """
        super().__init__(len(first))
        if not 0 < decrease_factor < 1:
            raise OptimizerError(f"decrease_factor is {decrease_factor}; it must lie between 0 and 1")
        if max_steps < 1:
            raise OptimizerError(f"max_steps is {max_steps}; it must be at least 1")
        self._advisor = advisor
        self.needs_residual = reads_residuals(advisor)
        self._start_points = [cube_point(first), *(cube_point(point, len(first)) for point in more_starts)]
        self._decrease_factor, self._max_steps = decrease_factor, max_steps
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
            advice = self._advice(situation)
            if isinstance(advice, Measurement):
                return advice.candidate
            cube_point(advice.point, self.dimension)
            self._proposal = advice
        step_size = self._step_size(self._proposal)
        start = descent.incumbent.candidate.point
        point = cube_point(np.clip(start + step_size * (self._proposal.point - start), 0.0, 1.0))
        note: dict[str, object] = {"source": "line search", "round": self._count + 1, "step_size": step_size}
        if not self._steps:
            note["proposal"] = self._proposal.as_dict()
        return Candidate(point, note)

    def _present_descent(self) -> _Descent:
        """The active descent, or the next one if it has stalled between two rounds."""
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

    def _advice(self, situation: Situation) -> Advice:
        return self._advisor.propose(situation)

    def _step_size(self, proposal: Proposal) -> float:
        return self._decrease_factor ** len(self._steps)

    def _is_over(self, proposal: Proposal, incumbent: Evaluation) -> bool:
        """True if a round ends with a step that failed."""
        return len(self._steps) == self._max_steps

    def _learn(self, evaluation: Evaluation) -> None:
        if self._descent is None:
            self._starts.append(evaluation)
            return
        incumbent = self._descent.incumbent
        better = not evaluation.failed and (incumbent.failed or evaluation.loss < incumbent.loss)
        if better and not evaluation.candidate.note.get(STAYS):
            self._descent.incumbent = evaluation
        if self._proposal is None:
            self._measurements.append(evaluation)
        else:
            self._steps.append(Step(self._step_size(self._proposal), evaluation))
            if better or self._is_over(self._proposal, incumbent):
                self._finish(self._descent, self._proposal, incumbent, accepted=better)

    def _finish(self, descent: _Descent, proposal: Proposal, incumbent: Evaluation, accepted: bool) -> None:
        descent.rounds.append(Round(proposal, incumbent, tuple(self._steps), accepted, tuple(self._measurements)))
        self._count += 1
        self._proposal, self._steps, self._measurements = None, [], []


class ProposalSearch(BacktrackingLineSearch):
    """Asks the advisor again after a step that fails, or tries what it has named for that case.

    A proposal is tried at its own step sizes, else in full: what an advisor learns from a failed step is worth more
    than half of the same step. Where the loss jumps, since a robot turned around or a body snapped, half and quarter
    are tried all the same: they stay on this side of the edge more often than not. The alternatives of a rejected
    proposal come before the advisor is asked again.
    """

    _waiting: tuple[Proposal, ...] = ()
    _proposed_at: Evaluation | None = None

    def _advice(self, situation: Situation) -> Advice:
        if self._waiting and situation.incumbent is self._proposed_at and not situation.measurements:
            advice, *others = self._waiting
            self._waiting = tuple(others)
            return advice
        advice = super()._advice(situation)
        self._waiting = advice.alternatives if isinstance(advice, Proposal) else ()
        self._proposed_at = situation.incumbent
        return advice

    def _step_size(self, proposal: Proposal) -> float:
        sizes = proposal.step_sizes
        return sizes[len(self._steps)] if sizes else super()._step_size(proposal)

    def _is_over(self, proposal: Proposal, incumbent: Evaluation) -> bool:
        if proposal.step_sizes:
            return len(self._steps) == len(proposal.step_sizes)
        return super()._is_over(proposal, incumbent) or self._steps[0].evaluation.loss < _JUMP * incumbent.loss
