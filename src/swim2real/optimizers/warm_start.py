"""Warm start: one proposal of an advisor, then another optimizer (the paper's single-call ablation)."""

from __future__ import annotations

from typing import Literal

from swim2real.optimizers.advisor import Advisor, Measurement, Situation, reads_residuals
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
        self.needs_residual = reads_residuals(advisor) or then.needs_residual
        self._advisor, self._first_point, self._then = advisor, cube_point(first), then
        self._told: list[Evaluation] = []  # the first and what was measured
        self._state: Literal["measuring", "proposed", "handed over"] = "measuring"

    def _next(self) -> Candidate:
        if not self._told:
            return Candidate(self._first_point, {"source": "first point"})
        if self._state == "measuring":
            first, *measured = self._told
            incumbent = min((e for e in self._told if not e.failed), key=lambda e: e.loss, default=first)
            advice = self._advisor.propose(Situation(incumbent, (), first, tuple(measured)))
            if isinstance(advice, Measurement):
                return advice.candidate
            self._state = "proposed"
            note = {"source": "warm start", "round": 1, "step_size": 1.0, "proposal": advice.as_dict()}
            return Candidate(cube_point(advice.point), note)
        return self._then.ask()

    def _learn(self, evaluation: Evaluation) -> None:
        if self._state == "measuring":
            self._told.append(evaluation)
        elif self._state == "proposed":
            self._state = "handed over"
        else:
            self._then.tell(evaluation)
