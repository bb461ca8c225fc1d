"""What a run folder tells, gathered for the page, whatever a trial is and whether the run has ended or not."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from swim2real.calibration.run_folder import still_falling
from swim2real.parameters import ParameterSpace
from swim2real.report.recorded_calls import RecordedCalls
from swim2real.robots.robot import Robot

Json = Mapping[str, Any]


@dataclass(frozen=True)
class ReportedTrial:
    """A trial at the best parameters.

    Attributes:
        name: Of the trial.
        held_out: Whether it was left out of the fit.
        figures: SI numbers as in an evaluation's evidence.
        quality: What was found in the real track; empty before a run ends.
    """

    name: str
    held_out: bool
    figures: Json
    quality: Json

    @property
    def diverged(self) -> bool:
        return bool(self.figures.get("divergence"))


class Sections(ABC):
    """What a page shows of one kind of trial beside what it shows of any run.

    Attributes:
        template: Of the page; it extends `run.html.j2`.
        file: In which a run keeps its trials, real and simulated.
        drawn: What is drawn of them, in words.
        unused: Settings that mean nothing for them.
    """

    template: ClassVar[str]
    file: ClassVar[str]
    drawn: ClassVar[tuple[str, str]]
    unused: ClassVar[tuple[str, ...]] = ()

    @property
    @abstractmethod
    def warning(self) -> str | None:
        """What to know before the best parameters are used; None where there is nothing."""

    @abstractmethod
    def content(self, run: ReportedRun) -> dict[str, Any]:
        """What the template shows.

        Returns:
            `loss` (what is minimized, in words), `tiles`, `split`, `errors` by marker and the `order` of the markers in
            words, `trials`, `figures`, and what is the kind's own.
        """


@dataclass(frozen=True)
class ReportedRun:
    """A run as it is reported.

    Attributes:
        name: Of the folder.
        robot: What was calibrated.
        settings: As recorded.
        space: On the run's scale.
        entries: The record, one entry an evaluation, at least one.
        fit: Figures of the best parameters on the fitted trials, in SI.
        held_out: The same on trials left out of the fit, None without any.
        quality: By trial, what was found in the real tracks.
        sensitivity: By parameter, empty where it wasn't determined.
        marker_names: M names.
        unfinished: What is missing and why, in sentences; None for a run that ended.
        calls: Of the advisor; None for a run that made none.
        sections: What the page shows of this run's kind of trials.
    """

    name: str
    robot: Robot
    settings: Json
    space: ParameterSpace
    entries: tuple[Json, ...]
    fit: Json
    held_out: Json | None
    quality: Json
    sensitivity: Json
    marker_names: tuple[str, ...]
    unfinished: str | None
    calls: RecordedCalls | None
    sections: Sections

    @property
    def first(self) -> Json:
        """The first evaluation's entry."""
        return self.entries[0]

    @cached_property
    def best(self) -> Json:
        """The incumbent's entry."""
        return incumbent(self.entries) or self.entries[0]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before the best parameters are used."""
        return tuple(one for one in (self.sections.warning, still_falling(self.entries, self.settings)) if one)

    @property
    def paper_protocol(self) -> bool:
        return self.settings.get("protocol") == "paper"

    @cached_property
    def trials(self) -> tuple[ReportedTrial, ...]:
        """Fitted and held-out trials by frequency, where they have one, and name."""
        found: list[ReportedTrial] = []
        for figures, held_out in ((self.fit, False), (self.held_out or {}, True)):
            for name, trial in figures.get("trials", {}).items():
                found.append(ReportedTrial(name, held_out, trial, self.quality.get(name, {})))
        return tuple(sorted(found, key=lambda t: (t.figures.get("frequency") or 0.0, t.name)))


def incumbent(entries: tuple[Json, ...]) -> Json | None:
    """The entry with the lowest loss of those that didn't fail, the earliest of equals; None when all failed."""
    proper = [entry for entry in entries if not entry["failed"]]
    return min(proper, key=lambda entry: entry["loss"]) if proper else None
