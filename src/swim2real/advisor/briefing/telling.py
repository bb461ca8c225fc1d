"""What the briefing asks of a kind of trial: its facts and its words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from swim2real.robots.robot import Robot

Facts = Mapping[str, Any]


class Telling(Protocol):
    """How trials of one kind are told and shown.

    Attributes:
        kind: In a word, as the facts have it.
        motion: What a trial shows, as a noun.
        names: What is to be said of trials' names; empty for nothing.
        look_for: Discrepancies that an advisor is asked to name.
        alike: Effects that look alike, and what tells them apart.
    """

    kind: str
    motion: str
    names: str
    look_for: str
    alike: str

    def compared(self, detail: Facts, robot: Robot) -> dict[str, Any]:
        """How trials are compared: `protocol`, `horizon`, `loss` in words, and what else the words need."""
        ...

    def trials(self, detail: Facts, robot: Robot) -> list[dict[str, Any]]:
        """Every trial that was simulated, with `name`, `diverged`, `error` and more, in the order of the tables."""
        ...

    def differences(self, trials: Sequence[Facts]) -> dict[str, Any]:
        """What differs over all trials, with `worst_trial` and more."""
        ...

    def outcome(self, trials: Sequence[Facts]) -> dict[str, Any]:
        """What a step did, beside its loss; of no trials, that nothing is known."""
        ...

    def markers(self, facts: Facts) -> str:
        """A sentence on the markers."""
        ...

    def called(self, trial: Facts) -> str:
        """A trial by its name, and what tells it apart."""
        ...

    def details(self, facts: Facts) -> list[str]:
        """Paragraphs and tables on the differences."""
        ...

    def steps(self, facts: Facts) -> str:
        """A sentence on what each step tells."""
        ...

    def step(self, outcome: Facts) -> str:
        """An outcome in few words after its loss; empty where nothing is known."""
        ...
