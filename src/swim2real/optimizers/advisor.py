"""What an optimizer asks of an advisor, be it a VLM, the built-in physics advisor or a script."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from swim2real.errors import AdvisorError
from swim2real.optimizers.contract import Array, Evaluation, cube_point


@dataclass(frozen=True)
class Proposal:
    """Where an advisor would go, and why.

    Attributes:
        point: In the unit cube. Shape (d,).
        diagnosis: What differs between simulation and reality.
        reasoning: Which parameters are responsible.
        notes: What else should be kept, ready for JSON.
    """

    point: Array
    diagnosis: str = ""
    reasoning: str = ""
    notes: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON; `from_dict` reads it back to the last bit."""
        return {
            "point": [float(x) for x in self.point],
            "diagnosis": self.diagnosis,
            "reasoning": self.reasoning,
            "notes": dict(self.notes),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Proposal:
        return cls(cube_point(content["point"]), content["diagnosis"], content["reasoning"], content["notes"])


@dataclass(frozen=True)
class Step:
    """One try along a proposal's direction."""

    step_size: float
    evaluation: Evaluation


@dataclass(frozen=True)
class Round:
    """One advisor call with its steps.

    Attributes:
        proposal: As given.
        incumbent: Where the round started.
        steps: As far as they were tried, from the full step on.
        accepted: Whether the last step improved on the incumbent.
    """

    proposal: Proposal
    incumbent: Evaluation
    steps: tuple[Step, ...]
    accepted: bool


@dataclass(frozen=True)
class Situation:
    """All that an advisor may know when it is asked.

    Attributes:
        incumbent: Best evaluation so far.
        rounds: Earlier rounds, rejected ones too, in order.
        first: The evaluation that the run began with.
    """

    incumbent: Evaluation
    rounds: tuple[Round, ...]
    first: Evaluation

    @property
    def evaluations(self) -> tuple[Evaluation, ...]:
        """All so far, in order."""
        return (self.first, *(step.evaluation for r in self.rounds for step in r.steps))


class Advisor(Protocol):
    """Looks at a situation and proposes a point. A pure function of the situation, but for its own random stream."""

    def propose(self, situation: Situation) -> Proposal:
        """Where to go from the incumbent.

        Raises:
            AdvisorError: No usable proposal can be had.
        """
        ...


class ScriptedAdvisor:
    """Gives prepared proposals one after the other, whatever the situation: for tests and for replays."""

    def __init__(self, proposals: Sequence[Proposal | Array], then: Advisor | None = None) -> None:
        """Prepares the script.

        Args:
            proposals: In order; a bare point is a proposal without words.
            then: Asked when the script has ended.
        """
        self._proposals = [p if isinstance(p, Proposal) else Proposal(cube_point(p)) for p in proposals]
        self._then = then

    def propose(self, situation: Situation) -> Proposal:
        number = len(situation.rounds)
        if number < len(self._proposals):
            return self._proposals[number]
        if self._then is None:
            raise AdvisorError(f"the script has {len(self._proposals)} proposals; proposal {number + 1} was asked for")
        return self._then.propose(situation)
