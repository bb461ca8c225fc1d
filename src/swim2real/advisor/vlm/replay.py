"""An advisor that gives the replies of an earlier run again: no network, no key, the same to the last bit."""

from __future__ import annotations

from pathlib import Path

from swim2real.advisor.vlm.advisor import proposal_of
from swim2real.advisor.vlm.transcript import Transcript
from swim2real.errors import AdvisorError, ArgumentError
from swim2real.optimizers import Proposal, Situation
from swim2real.parameters import ParameterSpace


class ReplayAdvisor:
    """Answers from a run's transcript, as long as the run takes the same way."""

    def __init__(self, run: str | Path, space: ParameterSpace) -> None:
        """Opens the transcript.

        Args:
            run: Run folder whose calls are on record.
            space: Of its parameters, on its scale.

        Raises:
            ArgumentError: There is no call on record.
            AdvisorError: The transcript is damaged.
        """
        self._run, self._space, self._transcript = Path(run), space, Transcript(run)
        if not self._transcript.calls:
            raise ArgumentError(
                f"'{run}' has no calls on record, so there is nothing to replay; give the folder of a run with a VLM "
                f"or with --advisor files"
            )

    def propose(self, situation: Situation) -> Proposal:
        """The recorded proposal.

        Raises:
            AdvisorError: The record ends before, or this run has come elsewhere.
        """
        number = len(situation.rounds) + 1
        calls = self._transcript.of_round(number)
        used = self._transcript.answer(number, situation.incumbent)
        if used is not None:
            return proposal_of(used, calls, situation, self._space)
        if any(call.outcome == "used" for call in calls):
            there = next(call.incumbent["loss"] for call in calls if call.outcome == "used")
            raise AdvisorError(
                f"round {number} of '{self._run}' began at a loss of {1e3 * there:.3f} mm and here it is "
                f"{1e3 * situation.incumbent.loss:.3f} mm; a replay needs the same reference, settings and versions"
            )
        raise AdvisorError(
            f"the replies in '{self._run}' end before round {number}; a budget up to that run's replays without it"
        )
