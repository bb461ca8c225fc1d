"""Measures single parameters before an advisor has its first word."""

from __future__ import annotations

from swim2real.errors import ArgumentError
from swim2real.optimizers import Advice, Advisor, Measurement, Situation
from swim2real.optimizers.advisor import reads_residuals
from swim2real.parameters import ParameterSpace

PROBED = 0.1  # of a parameter's range, by which it is changed


class ProbingAdvisor:
    """Has the first parameters changed one after the other, each at one evaluation, then another advisor proposes."""

    def __init__(self, advisor: Advisor, space: ParameterSpace, count: int) -> None:
        """Prepares the probes.

        Args:
            advisor: Who proposes.
            space: Parameters as the optimizer uses them; they are measured in their order.
            count: Number of parameters that are measured.

        Raises:
            ArgumentError: There are fewer parameters.
        """
        if count > len(space):
            raise ArgumentError(f"probes is {count}; the robot has {len(space)} parameters to measure")
        self._advisor, self._space, self._count = advisor, space, count
        self.needs_residual = reads_residuals(advisor)

    def propose(self, situation: Situation) -> Advice:
        """The next parameter to measure, a step toward the middle of its range, or the advisor's advice."""
        i = len(situation.measurements)
        if situation.rounds or i >= self._count:
            return self._advisor.propose(situation)
        here = situation.incumbent.candidate.point
        return Measurement.of_one(here, i, self._space.names[i], PROBED if here[i] <= 0.5 else -PROBED)
