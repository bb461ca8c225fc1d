"""The settings of a run as they were resolved: what `settings.json` holds, and what a run that goes on must share."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from swim2real.settings import CalibrationSettings, asks_a_vlm
from swim2real.simulation import Engine

FORMAT = 1
SEARCH = 2  # what multi-start does: 1 until its starts were led
_FREE = ("budget", "minutes", "threads", "finish")  # may differ when a run goes on
_ORIGIN = ("robot_file", "reference", "versions", "commit", "created")  # decide nothing


@dataclass(frozen=True, kw_only=True)
class RunSettings(CalibrationSettings):
    """Settings that decided a run, without anything left to choose, and its origin.

    Attributes:
        robot: Name of the robot.
        robot_fingerprint: Fingerprint of the robot file; None for a robot known by its name.
        reference_fingerprint: Fingerprint of the real trials, held-out ones included.
        engine: Physics that the losses are made with.
        robot_file: The robot file, relative to the run folder.
        reference: Where the real trials came from, relative to the run folder.
        versions: Versions of what the numbers depend on.
        commit: Commit of the checkout; None where swim2real was installed otherwise.
        created: When the run was begun.
        search: Version of multi-start, by which a record is replayed.
        first_values: Values that it began at where `first` is `FROM_FILE`; None for another first point.
    """

    robot: str
    reference_fingerprint: str
    engine: Engine
    robot_fingerprint: str | None = None
    robot_file: str | None = None
    reference: str = ""
    versions: dict[str, str] = field(default_factory=dict[str, str])
    commit: str | None = None
    created: str = ""
    first_values: dict[str, float] | None = None
    search: int = 1

    def difference(self, other: RunSettings) -> tuple[str, Any, Any] | None:
        """The first setting that decides the result and differs: its name, its value here, the other's."""
        unused = () if asks_a_vlm(self.advisor) else ("briefing",)
        for name in (each.name for each in fields(self)):
            here, there = getattr(self, name), getattr(other, name)
            if name not in (*_FREE, *_ORIGIN, *unused) and here != there:
                return name, here, there
        return None
