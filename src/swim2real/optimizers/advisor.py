"""The interface between an optimizer and an advisor: a VLM, the built-in physics advisor or a script."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from swim2real.optimizers.contract import Array, Candidate, Evaluation, cube_point
from swimbase.errors import AdvisorError

MEASUREMENT = "measurement"
STAYS = "stays"  # note of a measurement after which the search stays where it is, however good it was
MEASURED = 0.1  # of a parameter's range, by which it is changed where it is measured alone
DECIMALS = 6  # of what a built-in advisor proposes: a processor's last digits must not decide where a search goes


@dataclass(frozen=True)
class Proposal:
    """Point that an advisor would go to, and its reason.

    Attributes:
        point: Point of the unit cube. Shape (d,).
        diagnosis: What differs between simulation and reality.
        reasoning: Which parameters are responsible.
        notes: What else should be kept in the record, ready for JSON.
        step_sizes: Shares of the way to the point at which it is to be tried, in order; the search's own where empty.
        alternatives: What to try, in order, where this one is rejected. A line search has no use for either.
    """

    point: Array
    diagnosis: str = ""
    reasoning: str = ""
    notes: Mapping[str, Any] = field(default_factory=dict[str, object])
    step_sizes: tuple[float, ...] = ()
    alternatives: tuple[Proposal, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON; `from_dict` reads it back to the last bit."""
        content: dict[str, object] = {
            "point": [float(x) for x in self.point],
            "diagnosis": self.diagnosis,
            "reasoning": self.reasoning,
            "notes": dict(self.notes),
        }
        if self.step_sizes:
            content["step_sizes"] = list(self.step_sizes)
        if self.alternatives:
            content["alternatives"] = [one.as_dict() for one in self.alternatives]
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Proposal:
        texts = content.get("diagnosis", ""), content.get("reasoning", "")
        others = tuple(cls.from_dict(one) for one in content.get("alternatives", ()))
        sizes = tuple(content.get("step_sizes", ()))
        return cls(cube_point(content["point"]), *texts, content.get("notes", {}), sizes, others)


@dataclass(frozen=True)
class Measurement:
    """A point that an advisor wants evaluated before it proposes; it counts like any other evaluation.

    Attributes:
        point: Point of the unit cube. Shape (d,).
        notes: What is measured, ready for JSON.
    """

    point: Array
    notes: Mapping[str, Any] = field(default_factory=dict[str, object])

    @classmethod
    def of_one(cls, here: Array, index: int, name: str, change: float | None = None) -> Measurement:
        """A step along a single parameter.

        Args:
            here: Where it begins, in the unit cube. Shape (d,).
            index: Index of the parameter.
            name: Its name.
            change: By how much it changes, in the unit cube; None for `MEASURED` toward the middle.
        """
        point = np.array(here, dtype=float)
        point[index] += (MEASURED if point[index] <= 0.5 else -MEASURED) if change is None else change
        return cls(point, {"parameter": name})

    @property
    def candidate(self) -> Candidate:
        """The point as a candidate, whose source in the record says that it is a measurement."""
        return Candidate(cube_point(self.point), {"source": MEASUREMENT, **self.notes})


Advice = Proposal | Measurement


@dataclass(frozen=True)
class Step:
    """One step along a proposal's direction.

    Attributes:
        step_size: Share of the way from the incumbent to the proposal.
        evaluation: Evaluation of the point there.
    """

    step_size: float
    evaluation: Evaluation


@dataclass(frozen=True)
class Round:
    """One advisor call with its steps.

    Attributes:
        proposal: The advisor's proposal.
        incumbent: Evaluation that the round started from.
        steps: Steps that were evaluated, from the full one on.
        accepted: Whether the last step improved on the incumbent.
        measurements: Measurements that the advisor wanted before the proposal, in order.
    """

    proposal: Proposal
    incumbent: Evaluation
    steps: tuple[Step, ...]
    accepted: bool
    measurements: tuple[Evaluation, ...] = ()

    @property
    def result(self) -> Evaluation:
        """The incumbent after the round."""
        return self.steps[-1].evaluation if self.accepted else self.incumbent


@dataclass(frozen=True)
class Situation:
    """Knowledge of an advisor when it is asked for a proposal.

    Attributes:
        incumbent: Best evaluation so far.
        rounds: Earlier rounds, rejected ones too, in order.
        first: The evaluation that the run began with.
        measurements: Measurements so far of the round that begins.
        in_other_searches: Pieces of advice that the run had for searches from other starts.
    """

    incumbent: Evaluation
    rounds: tuple[Round, ...]
    first: Evaluation
    measurements: tuple[Evaluation, ...] = ()
    in_other_searches: int = 0

    @property
    def evaluations(self) -> tuple[Evaluation, ...]:
        """All evaluations so far, in order."""
        earlier = [e for r in self.rounds for e in (*r.measurements, *(step.evaluation for step in r.steps))]
        return (self.first, *earlier, *self.measurements)


class Advisor(Protocol):
    """Looks at a situation and proposes a point. A pure function of the situation, but for its own random stream.

    One that reads residuals has an attribute `needs_residual` that is true.
    """

    def propose(self, situation: Situation) -> Advice:
        """Proposes a point, or a measurement after which it is asked again.

        Raises:
            AdvisorError: No usable proposal can be had.
        """
        ...


def reads_residuals(advisor: Advisor | None) -> bool:
    """True if evaluations need residuals for this advisor."""
    return bool(getattr(advisor, "needs_residual", False))


class ScriptedAdvisor:
    """Gives prepared advice, whatever the situation: for tests and for replays."""

    def __init__(self, advice: Sequence[Advice | Array], then: Advisor | None = None) -> None:
        """Prepares the script.

        Args:
            advice: Advice in order; a bare point is a proposal without a diagnosis.
            then: Advisor that is asked when the script has ended.
        """
        self._script = [a if isinstance(a, Advice) else Proposal(cube_point(a)) for a in advice]
        self._then = then
        self.needs_residual = reads_residuals(then)

    def propose(self, situation: Situation) -> Advice:
        here = sum(1 + len(r.measurements) for r in situation.rounds) + len(situation.measurements)
        number = here + situation.in_other_searches
        if number < len(self._script):
            return self._script[number]
        if self._then is None:
            raise AdvisorError(f"the script has {len(self._script)} proposals; proposal {number + 1} is due")
        return self._then.propose(situation)


def recorded_advice(entries: Iterable[Mapping[str, Any]]) -> list[Advice]:
    """The advice of a run's advisor, from the entries of the run's record."""
    advice: list[Advice] = []
    for entry in entries:
        note = dict(entry["note"])
        if note.pop("source", None) == MEASUREMENT:
            advice.append(Measurement(cube_point(entry["point"]), note))
        elif "proposal" in note:
            advice.append(Proposal.from_dict(note["proposal"]))
    return advice
