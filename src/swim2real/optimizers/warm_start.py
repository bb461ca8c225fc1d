"""Warm start: one proposal of an advisor, then another optimizer (the paper's single-call ablation)."""

from __future__ import annotations

from swim2real.optimizers.advisor import Advisor, Situation
from swim2real.optimizers.contract import Array, Candidate, Evaluation, Optimizer, cube_point


class WarmStart(Optimizer):
    """The first point, an advisor's one proposal in full, then whatever `then` asks."""

    def __init__(self, advisor: Advisor, first: Array, then: Optimizer) -> None:
        """Prepares the search.

        Args:
            advisor: Asked once.
            first: Where the run begins. Shape (d,).
            then: Takes over; it is told what it asked itself, nothing else.
        """
        super().__init__(len(first))
        self._advisor, self._first_point, self._then = advisor, cube_point(first), then
        self._told = 0
        self._first: Evaluation | None = None

    def _next(self) -> Candidate:
        if self._first is None:
            return Candidate(self._first_point, {"source": "first point"})
        if self._told == 1:
            proposal = self._advisor.propose(Situation(self._first, (), self._first))
            note = {"source": "warm start", "round": 1, "step_size": 1.0, "proposal": proposal.as_dict()}
            return Candidate(cube_point(proposal.point), note)
        return self._then.ask()

    def _learn(self, evaluation: Evaluation) -> None:
        if self._first is None:
            self._first = evaluation
        elif self._told > 1:
            self._then.tell(evaluation)
        self._told += 1
